"""Light that leaves the lens, traced until its intensity is known to the stated noise; its rays start on a sphere."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.light.angular_grid import COARSEST, COARSEST_TO_HORIZON, AngularGrid, FittedIntensity, finest_grid, fit
from lensforge.light.luminaire_classes import zone_flux
from lensforge.light.received_flux import flux_by_fate
from lensforge.light.simulation import TracedLens, bundles
from lensforge.results import Metric
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing, Shadow
from lensforge.scene.housing_walk import last_of, legs_of
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec.lamps_section import ALONE, Lamps


@dataclass(frozen=True)
class Goniophotometer:
    """The sphere of a radius (mm) around the ``lamps`` on which exit rays start, and how it is read.

    ``symmetry``: mirror group of lens, source and ``lamps``, under which the light is averaged. ``street_deg``: azimuth
    of the street. ``to_horizon``: the table is fine up to the horizon, where little light makes glare. ``housing``:
    opaque bodies around the lamps.
    """

    sphere_mm: float
    symmetry: str
    street_deg: float
    lamps: Lamps = ALONE
    to_horizon: bool = False
    housing: Housing | None = None


@dataclass(frozen=True)
class RaysOnSphere:
    """Rays that leave the lens upwards, starting on the sphere; and the flux (W) of all rays by fate.

    The last of ``by_fate_w`` is the flux of rays that leave the lens, but not upwards.
    """

    rays: RayBundle
    by_fate_w: Float[np.ndarray, " f"]


def exit_rays(
    lens: TracedLens, rays: RayBundle, sphere_mm: float, lamps: Lamps = ALONE, housing: Housing | None = None
) -> RaysOnSphere:
    """Trace ``rays`` and start those that leave upwards on the sphere of radius ``sphere_mm`` around the lamps.

    Those that meet the ``housing`` end there, or go on from there.

    Rays are dealt to the lamps at random, equally many to each, and carry the flux of all.
    """
    traced = lens.trace(rays) if lamps.is_single else _of_lamps(lens, rays, lamps)
    left = traced.left_lens
    shadow = Shadow.none_of(len(left))
    ways = traced
    if housing is not None:
        shadow = housing.endless_shadow(traced)
        if housing.reflects:
            _, ways, shadow = last_of(legs_of(housing, traced, shadow, housing.endless_shadow))
    upwards = left & (ways.directions[:, 2] > 0.0) & (shadow.lost < 1.0)
    points, directions, flux = (values[upwards] for values in (ways.points, ways.directions, ways.flux))
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    by_fate = flux_by_fate(traced, left & ~upwards, shadow)
    return RaysOnSphere(RayBundle(_on_sphere(points, directions, sphere_mm), directions, flux), by_fate)


def _of_lamps(lens: TracedLens, rays: RayBundle, lamps: Lamps) -> ExitRays:
    rays = replace(rays, flux=len(lamps) * rays.flux)
    lamp_numbers = np.random.default_rng(len(rays)).permutation(len(rays)) % len(lamps)
    if lamps.kinds:
        of_kinds = [np.flatnonzero(np.isin(lamp_numbers, kind.numbers)) for kind in lamps.kinds]
        parts = zip(lens.kinds, of_kinds, strict=True)
        traced = ExitRays.joined([kind.trace(rays.take(rows)) for kind, rows in parts])
        lamp_numbers = lamp_numbers[np.concatenate(of_kinds)]
    else:
        traced = lens.trace(rays)
    poses = [lamp.pose for lamp in lamps.lamps]
    turned, places = (
        np.array(values)[lamp_numbers] for values in zip(*((p.rotation, p.origin_mm) for p in poses), strict=True)
    )
    points, directions = (np.einsum("nij,nj->ni", turned, vectors) for vectors in (traced.points, traced.directions))
    return replace(traced, points=points + places, directions=directions)


def _on_sphere(
    points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], radius_mm: float
) -> Float[np.ndarray, "n 3"]:
    """Points at which rays from inside a sphere about the origin cross it."""
    along = np.sum(points * directions, axis=1)
    closest = points - along[:, None] * directions
    half_chord = np.sqrt(np.maximum(radius_mm**2 - np.sum(closest**2, axis=1), 0.0))
    return closest + half_chord[:, None] * directions


PARTS = 16  # independent samples: their spread is the standard error
_ROUNDS = 32  # at most, of these samples, so that every one has a seed of its own
_FILE_RAYS = 2**17  # rays of the ray file
_LARGEST_NODE_ERROR = 0.02  # rms, relative: more rays are traced until then; goniophotometers have about as much
_MOST_AT_ONCE = 2**20  # bounds the memory
_IN_BEAM = 0.995  # of the flux: within the angle that holds it, the grid is fine


@dataclass(frozen=True, eq=False)
class ExitLight:
    """Light of ``rays`` rays: its intensity (W/sr), its flux, that of all rays by fate, and some of the rays.

    ``zones_w``: flux of each sample by :func:`~lensforge.light.luminaire_classes.zone_flux`.
    """

    rays: int
    intensity: FittedIntensity
    exit_w: Metric
    by_fate_w: Float[np.ndarray, " f"]
    sample: RayBundle
    zones_w: Float[np.ndarray, "p 2 4"]


def trace_exit_light(
    lens: TracedLens, source: Source, meter: Goniophotometer, *, rays: int | None, by_itself: tuple[int, int], seed: int
) -> ExitLight:
    """Trace ``rays`` rays, or more and more, until the nodes are known to 2 % rms.

    ``by_itself``: without ``rays``, the first and the largest number. A measured source gives at most its own rays.
    Raises :class:`InputError` if no light leaves the lens upwards.
    """
    sums = _Sums(lens, meter)
    wanted = rays or min(by_itself)
    if source.ray_count is not None:
        count = min(wanted, source.ray_count)
        parts = bundles(source, count, min(PARTS, count), seed)
        sums.add(replace(part, flux=share * part.flux) for _, share, part in parts)
        return sums.light()
    for number in range(_ROUNDS):
        count = min(-(-(wanted - sums.rays) // PARTS), _MOST_AT_ONCE)
        own_seeds = (seeds.of_far_field(seed, PARTS * _ROUNDS, number * PARTS + part) for part in range(PARTS))
        sums.add(source.sample(count, seed) for seed in own_seeds)
        if sums.rays < wanted:
            continue
        light = sums.light()
        wanted = sums.rays if rays is not None else _rays_needed(light, by_itself[1])
        if wanted <= sums.rays:
            break
    return light


def _rays_needed(light: ExitLight, most_rays: int) -> int:
    """Rays that bring the noise of the nodes down to its limit, by doublings: it falls with the root of the number."""
    error = light.intensity.node_error
    needed = light.rays
    noise = 0.0 if error is None else error.rms
    while noise > _LARGEST_NODE_ERROR and 2 * needed <= most_rays:
        needed = 2 * needed
        noise = noise / np.sqrt(2.0)
    return needed


class _Sums:
    """Sums over all rays traced so far, by sample."""

    def __init__(self, lens: TracedLens, meter: Goniophotometer) -> None:
        self.rays = 0
        self._lens = lens
        self._meter = meter
        self._grid: AngularGrid | None = None
        self._deposits: list[Float[np.ndarray, "c g"]] = []
        self._zones: list[Float[np.ndarray, "2 4"]] = []
        self._weights: list[float] = []
        self._by_fate: list[Float[np.ndarray, " f"]] = []
        self._file_bundles: list[RayBundle] = []

    def add(self, rays: Iterator[RayBundle]) -> None:
        """Trace another bundle for each sample; each bundle carries all the flux."""
        for part, bundle in enumerate(rays):
            meter = self._meter
            out = exit_rays(self._lens, bundle, meter.sphere_mm, meter.lamps, meter.housing)
            if self._grid is None:
                self._grid = finest_grid(90.0 if self._meter.to_horizon else _reach_deg(out.rays))
            deposit = self._grid.deposit(out.rays)
            weight = float(len(bundle))
            if part == len(self._weights):
                self._deposits.append(np.zeros_like(deposit))
                self._zones.append(np.zeros((2, 4)))
                self._by_fate.append(np.zeros_like(out.by_fate_w))
                self._weights.append(0.0)
                self._file_bundles.append(out.rays.take(slice(_FILE_RAYS // PARTS)))
            self._deposits[part] += weight * deposit
            self._zones[part] += weight * zone_flux(out.rays, self._meter.street_deg, self._meter.symmetry)
            self._by_fate[part] += weight * out.by_fate_w
            self._weights[part] += weight
            self.rays += len(bundle)
        if not any(deposit.any() for deposit in self._deposits):
            raise InputError(
                f"none of {self.rays} rays leaves the lens upwards: there is no light to write; check lens.json"
            )

    def light(self) -> ExitLight:
        """Light of all rays so far; standard errors by the spread of the samples."""
        grid = self._grid
        assert grid is not None
        samples, zones, by_fate = (
            np.stack([sum / weight for sum, weight in zip(sums, self._weights, strict=True)])
            for sums in (self._deposits, self._zones, self._by_fate)
        )
        coarsest = COARSEST_TO_HORIZON if self._meter.to_horizon else COARSEST
        exits = samples.sum(axis=(1, 2))
        bundle = RayBundle.joined(self._file_bundles)
        error = float(exits.std(ddof=1) / np.sqrt(len(exits))) if len(exits) > 1 else None
        exit_w = Metric(value=float(exits.mean()), unit="W", standard_error=error)
        return ExitLight(
            rays=self.rays,
            intensity=fit(grid, grid.images_mean(samples, self._meter.symmetry), coarsest),
            exit_w=exit_w,
            by_fate_w=by_fate.mean(axis=0),
            sample=replace(bundle, flux=bundle.flux * (exit_w.value / bundle.flux.sum())),
            zones_w=zones,
        )


def _reach_deg(rays: RayBundle) -> float:
    """Angle (degrees) from the axis that holds nearly all the flux of ``rays``."""
    if len(rays) == 0:
        return 90.0
    gamma = np.rad2deg(np.arccos(np.clip(rays.directions[:, 2], -1.0, 1.0)))
    order = np.argsort(gamma)
    held = np.cumsum(rays.flux[order])
    return float(gamma[order[np.searchsorted(held, _IN_BEAM * held[-1])]])
