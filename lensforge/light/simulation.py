"""Simulation of a finished lens with many rays, in independent replicates, so that every metric has a standard error.

Metrics of one lens come from its replicates; their change from one lens to another from two that the same rays lit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from jaxtyping import Bool, Float, Int8, Shaped

from lensforge import seeds
from lensforge.errors import remedy
from lensforge.kernels.fate import Fate
from lensforge.light.evaluation_result import LightMetrics
from lensforge.light.light_ways import FluxByWay
from lensforge.light.paths_to_eye import landed_at_eye
from lensforge.light.received_flux import MISSED_RECEIVER, ReceivedFlux
from lensforge.light.table_trace import Scene, Tables, trace_tables
from lensforge.optics.media import Media
from lensforge.results import Image, Metric
from lensforge.results.estimates import (
    ExtremeEstimate,
    Images,
    PairEstimate,
    RootEstimate,
    jackknife_metric,
    least_over_mean,
    nmse_estimate,
    rsd_estimate,
)
from lensforge.scene.body import Body, Chain, Face, nearest
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.eye_view import EyeView
from lensforge.scene.lamp_pictures import LampPictures
from lensforge.scene.lens import Lens
from lensforge.scene.made_part import at_work
from lensforge.scene.pixel_grid import gaussian3
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.region import Region
from lensforge.scene.rough_faces import with_facets
from lensforge.scene.target_pattern import target_light, uniform_region
from lensforge.sources.measured_rays import rays_of_file
from lensforge.sources.ray_bundle import RayBundle, Source, drawn
from lensforge.sources.waist import waist_mm
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import TableGrid, grid_for, table_error, tabulate

REPLICATES = 16
_ROUNDING = 1e-12  # of ratios
_LEVEL = 1e-3  # of a direction: flatter rays tell no waist
_MOST_RAYS_AT_ONCE = 2**20  # bounds the memory: about 200 MB of rays and hits


# Large weights of the broadest functions make a shape that is finer than they are: the tables of a lens of 9 functions
# (sigma 0.83 rad, weights to 4.4 mm) moved rays by 13 um rms at 150 mm by six nodes across it, now by 1.3 um.
_WIDEST_DETAIL_RAD = 0.4


@dataclass(frozen=True)
class TracedLens:
    """A lens with its tables, ready to trace.

    ``kinds``: the lenses of all kinds, where lamps have several.
    """

    scene: Scene
    tables: Tables
    table_error_nm: dict[str, float]
    kinds: "tuple[TracedLens, ...]" = ()

    @staticmethod
    @lru_cache(maxsize=2)  # light, photometry and proof of a lens ask for the same
    def of(lens: Lens, nodes_per_sigma: float) -> "TracedLens":
        """Tabulate all surfaces from the exact sum; the tables' error against it is measured at once."""
        if not lens.others:
            return TracedLens._of_one(lens, nodes_per_sigma)
        kinds = {kind.kind: TracedLens._of_one(kind, nodes_per_sigma) for kind in lens.kinds}
        return replace(kinds[lens.kind], kinds=tuple(kinds.values()))

    @staticmethod
    def _of_one(lens: Lens, nodes_per_sigma: float) -> "TracedLens":
        chain = Chain.of_lens(lens.spec.lens)
        if chain is not None:
            traced = TracedLens.of_body(lens.body, lens.media, chain.events, nodes_per_sigma)
            scene = replace(traced.scene, drawn_half_mm=lens.spec.lens.drawn_half_mm)
            return replace(traced, scene=scene).at_work(lens.spec)
        with remedy("take a lower accuracy"):
            grid: TableGrid = grid_for(min(lens.detail_rad, _WIDEST_DETAIL_RAD), nodes_per_sigma)
        tables = np.stack([tabulate(grid, surface) for surface in lens.surfaces.values()])
        scene = Scene.of_lens(lens.spec.lens, lens.media, grid)
        errors = {
            name: 1e6 * table_error(grid, table, surface)
            for table, (name, surface) in zip(tables, lens.surfaces.items(), strict=True)
        }
        return TracedLens(scene, tables, errors).at_work(lens.spec)

    def at_work(self, spec: Spec) -> "TracedLens":
        """The same lens in the media and at the temperature of ``spec``, one of its states."""
        scene = replace(self.scene, media=spec.media, made=at_work(spec, self.scene.names))
        return replace(self, scene=scene, kinds=tuple(kind.at_work(spec) for kind in self.kinds))

    @staticmethod
    def of_body(body: Body, media: Media, events: int, nodes_per_sigma: float) -> "TracedLens":
        """Tabulate the faces of a body in which a ray meets the nearest face, at most ``events`` times.

        The error of a table counts where its face bounds a medium. Raises :class:`InputError` for faces that make no
        body.
        """
        body.require_sound()
        grid = grid_for(min(face.surface.detail_rad for face in body.faces), nodes_per_sigma)
        tables = []
        errors = {}
        for face in body.in_order:
            beside = body.bounding(face.before)
            table = tabulate(grid, face.surface)
            within = partial(_is_nearest, beside, beside.index(face))
            tables.append(table)
            errors[face.name] = 1e6 * table_error(grid, table, face.surface, within=within)
        return TracedLens(Scene(media, grid, chain=Body(body.in_order).chain(events)), np.stack(tables), errors)

    def trace(self, rays: RayBundle) -> ExitRays:
        """Send ``rays`` through the lens."""
        return trace_tables(self.tables, self.scene, rays)


def _is_nearest(faces: tuple[Face, ...], number: int, directions: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """True in directions in which face ``number`` bounds its medium."""
    return nearest(faces, directions) == number


@dataclass(frozen=True)
class Simulation:
    """Light of ``rays`` rays on each receiver, of ``emitted_w`` from the source, and the flux by its way."""

    received: tuple[ReceivedFlux, ...]
    emitted_w: float
    rays: int
    by_way: FluxByWay


def simulate(
    lens: TracedLens,
    source: Source,
    receivers: tuple[PosedReceiver, ...],
    rays: int,
    seed: int,
    regions: Sequence[tuple[Region, ...]] = (),
    *,
    coloured: bool = False,
) -> Simulation:
    """Trace ``rays`` rays, or as many as a measured source holds, in up to 16 independent replicates.

    ``regions``: of each receiver, in which flux is counted; none by default. ``coloured``: also count the rays'
    colours.
    """
    if receivers[0].lamps.kinds:
        return _simulate_kinds(lens.kinds, source, receivers, rays, seed, regions, coloured=coloured)
    replicates = min(REPLICATES, rays, source.ray_count or rays)
    counted = regions or [()] * len(receivers)
    lamps = [LampPictures.of(receiver) for receiver in receivers]
    bodies = len(lens.scene.media.bodies)
    deposits = [
        [
            ReceivedFlux.none_yet(
                receiver, replicates, countded if board.is_single else (), coloured=coloured, bodies=bodies
            )
            for receiver in board.receivers
        ]
        for board, countded in zip(lamps, counted, strict=True)
    ]
    looked_at = any(isinstance(receiver, EyeView) for receiver in receivers)
    facets = lens.scene.media.scattering if looked_at else 0  # a ray that is turned to an eye meets the same ones
    measured = looked_at and rays_of_file(source).ray_count is not None
    by_way = FluxByWay.none_yet(lens.scene.chain, replicates)
    traced = 0
    for replicate, share, bundle in bundles(source, rays, replicates, seed):
        bundle = with_facets(bundle, facets)
        exit_rays = lens.trace(bundle)
        colours = bundle.colours if coloured else None
        waist = waist_mm(bundle.take(bundle.directions[:, 2] > _LEVEL)) if measured else None
        by_way.add(replicate, share, exit_rays)
        for board, landed in zip(lamps, deposits, strict=True):
            for receiver, deposit in zip(board.receivers, landed, strict=True):
                deposit.add(
                    replicate, share, receiver, exit_rays, _landed(lens, bundle, exit_rays, receiver, waist), colours
                )
        traced += len(bundle)
    received = tuple(
        deposit[0] if board.is_single else ReceivedFlux.mean_of_lamps(board, deposit, wanted)
        for board, deposit, wanted in zip(lamps, deposits, counted, strict=True)
    )
    return Simulation(received, source.flux_w, traced, by_way)


def _landed(
    lens: TracedLens, rays: RayBundle, exits: ExitRays, receiver: PosedReceiver, waist: float | None
) -> Landings:
    if isinstance(receiver, EyeView):
        return landed_at_eye(lens.trace, rays, exits, receiver, waist)
    return receiver.land(exits)


def _simulate_kinds(
    kinds: tuple[TracedLens, ...],
    source: Source,
    receivers: tuple[PosedReceiver, ...],
    rays: int,
    seed: int,
    regions: Sequence[tuple[Region, ...]],
    *,
    coloured: bool,
) -> Simulation:
    """The light of lamps whose lenses are of several kinds, each traced with its share of the rays.

    Each kind has rays of its own; of a measured source all of its rays, the same in each replicate.
    """
    lamps = receivers[0].lamps
    simulations = []
    shares = [len(kind.numbers) / len(lamps) for kind in lamps.kinds]
    for number, (kind, lens, share) in enumerate(zip(lamps.kinds, kinds, lamps.shares_of_rays, strict=True)):
        receivers_of_kind = tuple(replace(receiver, lamps=receiver.lamps.of_kind(kind)) for receiver in receivers)
        measured = source.ray_count is not None
        count = rays if measured else max(round(share * rays), min(rays, REPLICATES))
        own_seed = seed if measured else seeds.of_kind(seed, number)
        simulations.append(simulate(lens, source, receivers_of_kind, count, own_seed, regions, coloured=coloured))
    received = zip(*(simulation.received for simulation in simulations), strict=True)
    by_way = np.sum(
        [share * simulation.by_way.flux for share, simulation in zip(shares, simulations, strict=True)], axis=0
    )
    return Simulation(
        tuple(ReceivedFlux.mean(of_kinds, shares) for of_kinds in received),
        source.flux_w,
        sum(simulation.rays for simulation in simulations),
        replace(simulations[0].by_way, flux=by_way),
    )


@dataclass(frozen=True)
class DesignLandings:
    """Landings of the same rays on one receiver: hits, NaN where they do not land, their flux (W) there, their fates.

    Fates are the names of :class:`~lensforge.kernels.fate.Fate`, "landed", "missed_receiver", "housing" and
    "second_wall". ``met``: number of the face at each event of a chain, -1 where there was none; None of a
    double-freeform lens.
    """

    hits: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]
    fates: Shaped[np.ndarray, " n"]
    met: Int8[np.ndarray, "n e"] | None = None


def design_landings(lens: TracedLens, spec: Spec, rays: RayBundle) -> list[DesignLandings]:
    """Landings of ``rays`` on each receiver of ``spec``."""
    exit_rays = lens.trace(rays)
    by_receiver = []
    names = np.array(["landed", *(fate.name.lower() for fate in Fate if fate != Fate.LEFT_LENS), "missed_receiver"])
    for receiver in receivers_of(spec, spec.evaluate.pixels):
        landings = receiver.land(exit_rays)
        fates = names[np.where(landings.missed_receiver, MISSED_RECEIVER, exit_rays.fates)]
        if landings.shadow is not None:
            fates = np.where(landings.shadow.onward > 0.0, fates, "housing")
            fates = np.where(landings.shadow.again, "second_wall", fates)
        hits = np.where(landings.landed[:, None], landings.hits, np.nan)
        by_receiver.append(DesignLandings(hits, landings.flux, fates, exit_rays.met))
    return by_receiver


def bundles(source: Source, rays: int, replicates: int, seed: int) -> Iterator[tuple[int, float, RayBundle]]:
    """Bundles as (replicate, factor of flux, rays): a measured source divided at random, any other sampled afresh."""
    ray_count = source.ray_count
    if ray_count is not None:
        everything = drawn(source, min(rays, ray_count), seed)
        order = np.random.default_rng(seed).permutation(len(everything))
        for replicate, rows in enumerate(np.array_split(order, replicates)):
            part = everything.take(rows)
            yield replicate, source.flux_w / part.flux.sum(), part
        return
    per_replicate = rays // replicates
    parts = -(-per_replicate // _MOST_RAYS_AT_ONCE)
    for replicate in range(replicates):
        for part_number in range(parts):
            part_seed = seeds.of_replicate(seed, replicates, replicate, parts, part_number)
            yield replicate, 1.0 / parts, source.sample(-(-per_replicate // parts), part_seed)


@dataclass(frozen=True)
class ReplicateMetrics:
    """Metrics on one receiver before they are records; None if the spec names no mask.

    ``efficiency``: share of the emitted flux in the window, of each replicate.
    """

    nmse: PairEstimate
    uniformity: ExtremeEstimate | None
    rsd: RootEstimate | None
    efficiency: Float[np.ndarray, " r"]

    @staticmethod
    def of(
        images: Images, target: Image, mask: Bool[np.ndarray, "h w"] | None, efficiency: Float[np.ndarray, " r"]
    ) -> "ReplicateMetrics":
        """Metrics of filtered ``images`` against ``target``, uniformity and RSD in ``mask``."""
        return ReplicateMetrics(
            nmse=nmse_estimate(images, target),
            uniformity=None if mask is None else least_over_mean(images[:, mask]),
            rsd=None if mask is None else rsd_estimate(images, mask),
            efficiency=efficiency,
        )

    def metrics(self) -> LightMetrics:
        """Metrics with their standard errors."""
        return LightMetrics(
            nmse=self.nmse.metric(),
            uniformity=None if self.uniformity is None else self.uniformity.metric(),
            rsd=None if self.rsd is None else self.rsd.metric(),
            efficiency=jackknife_metric(self.efficiency, float),
        )

    @property
    def noise(self) -> list[Float[np.ndarray, " r"]]:
        """Noise of every defined metric by replicate, in their order, up to a factor."""
        estimates = (self.nmse, self.uniformity, self.rsd)
        return [*(estimate.noise for estimate in estimates if estimate is not None), self.efficiency]

    def change_from(
        self, before: "ReplicateMetrics", *, designed_rsd: float | None = None, designed_uniformity: float | None = None
    ) -> LightMetrics:
        """Differences from ``before``, replicate by replicate: common noise cancels in their errors.

        ``designed_rsd``, ``designed_uniformity``: of ``before`` by many rays, to which the change is to be added.
        """
        least = before.uniformity
        even = before.rsd
        deviation = None
        if self.rsd is not None and even is not None:
            deviation = self.rsd.change_from(even) if designed_rsd is None else self.rsd.change_of(designed_rsd, even)
        uniformity = None
        if self.uniformity is not None and least is not None:
            given = designed_uniformity
            uniformity = (
                self.uniformity.change_from(least) if given is None else self.uniformity.change_of(given, least)
            )
        return LightMetrics(
            nmse=_beyond_rounding(self.nmse.change_from(before.nmse)),
            uniformity=None if uniformity is None else _beyond_rounding(uniformity),
            rsd=None if deviation is None else _beyond_rounding(deviation),
            efficiency=_beyond_rounding(jackknife_metric(self.efficiency - before.efficiency, float)),
        )


@dataclass(frozen=True)
class TracedLight:
    """Light of one lens on its first receiver: metrics by replicates, and its mean map (flux per measure, [y, x])."""

    replicates: ReplicateMetrics
    map: Image

    @property
    def metrics(self) -> LightMetrics:
        """Metrics with their standard errors."""
        return self.replicates.metrics()


def traced_light(traced: TracedLens, spec: Spec, source: Source, rays: int, seed: int) -> TracedLight:
    """Light on the first receiver of ``spec``, with the rays of its evaluation for the same ``seed``."""
    receiver = receivers_of(spec, spec.evaluate.pixels)[0]
    simulation = simulate(traced.at_work(spec), source, (receiver,), rays, seed)
    received = simulation.received[0]
    targets = spec.all_receivers[0].targets
    images = gaussian3(received.images, spec.evaluate.filter_variance)
    target = target_light(targets, receiver)
    mask = lit_mask(uniform_region(targets, receiver), images)
    replicates = ReplicateMetrics.of(images, target, mask, received.window / simulation.emitted_w)
    return TracedLight(replicates, images.mean(axis=0) / receiver.pixel_measure)


def lit_mask(mask: Bool[np.ndarray, "h w"] | None, images: Images) -> Bool[np.ndarray, "h w"] | None:
    """``mask``; None without one, if no pixel lies in it, or in the dark."""
    return mask if mask is not None and mask.any() and images.sum() > 0.0 else None


def _beyond_rounding(change: Metric) -> Metric:
    """``change`` of a ratio; 0 if it and its error are mere rounding, as for a shape that is independent of flux."""
    if max(abs(change.value), change.standard_error or 0.0) > _ROUNDING:
        return change
    return change.changed(value=0.0, standard_error=None if change.standard_error is None else 0.0)
