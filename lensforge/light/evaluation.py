"""Evaluation of a finished lens by the paper's protocol: rays in independent replicates, metrics, :class:`Light`.

The error of an accuracy preset on this scene is that of light through its tables against light through the exact
surfaces. The same rays pass through both, so that no noise enters; they come in independent scrambles, which give the
standard error.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import astuple
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from lensforge import seeds
from lensforge.kernels.fate import Fate
from lensforge.light.beam_colour import BeamColour
from lensforge.light.evaluation_result import FittedLight, Light, LightMetrics, PresetError, TableError
from lensforge.light.far_field import limits_by_intensities
from lensforge.light.irradiated_body import IrradiatedBody
from lensforge.light.judged_limits import colour_limits, judged_limits, stated_figures
from lensforge.light.light_ways import FluxByWay
from lensforge.light.received_flux import BLOCKED, CAUSES, MISSED_RECEIVER, SECOND_WALL, ReceivedFlux, named_flux
from lensforge.light.receiver_light import (
    BlockedLight,
    EstimatedLight,
    Flux,
    MissedByCause,
    Possible,
    RawMetrics,
    ReceiverLight,
    WindowSize,
)
from lensforge.light.region_light import RegionLight
from lensforge.light.seen_lens import SeenLens
from lensforge.light.simulation import ReplicateMetrics, TracedLens, lit_mask, simulate, traced_light
from lensforge.optics.efficacy import UNKNOWN, Efficacy
from lensforge.results import Fact, Metric
from lensforge.results.chart import light_unit
from lensforge.results.estimates import (
    Images,
    jackknife_metric,
    nmse,
    nmse_estimate,
    relative_deviation,
    relative_square,
    uniformity,
    with_error,
)
from lensforge.scene.body_view import body_views
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.eye_view import EyeView, eye_views
from lensforge.scene.lens import Lens
from lensforge.scene.light_ends import LOSSES, NUMBER_BY_FATE
from lensforge.scene.limit_readings import LightLimit, LightReading, light_limits, stated_readings, zones_on
from lensforge.scene.pixel_grid import flux_in, gaussian3, rebinned, splat_flux
from lensforge.scene.possible_light import PossibleLight, SourceLight
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import DrawnTarget, coarser_target, drawn_target, uniform_region
from lensforge.sources.measured_rays import RefittedSource, held_back, searched
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import ReceiverSection, Spec
from lensforge.spec.accuracy import Preset
from lensforge.spec.light_limits import ColourSection

_SCRAMBLES = 8
_RAYS = 2**8  # few: each is traced through the exact surfaces, which is slow
_REFITS = 4
_RAYS_OF_REFIT = 2**20
_RAYS_OF_OUTLINE = 2**16  # the hull of so many places on a disc lacks 0.1 % of its area


def measure_preset(lens: Lens, source: Source, design: TracedLens, evaluation: TracedLens) -> PresetError:
    """Errors of the tables of both stages against the exact surfaces; the evaluation's tables bracket the crossings.

    The light is that on the first receiver, by the four-pixel splat on the design's pixels. Few rays fall into a pixel,
    so the errors of neighbouring rays do not average out: the error is an upper bound.
    """
    count = min(_RAYS, (source.ray_count or _SCRAMBLES * _RAYS) // _SCRAMBLES or 1)
    own_seeds = (seeds.of_preset_error(lens.seed, _SCRAMBLES, k) for k in range(_SCRAMBLES))
    # in one go: many small arrays take longer
    rays = RayBundle.joined([source.sample(count, seed) for seed in own_seeds])
    receiver = receivers_of(lens.spec, lens.spec.optimise.pixels)[0].before_black
    exact = receiver.land(_through_exact(lens, evaluation, rays))
    return PresetError(
        rays=len(rays),
        scrambles=_SCRAMBLES,
        design=_stage(design, rays, exact, receiver, source.flux_w),
        evaluation=_stage(evaluation, rays, exact, receiver, source.flux_w),
    )


def _through_exact(lens: Lens, traced: TracedLens, rays: RayBundle) -> ExitRays:
    """``rays`` through the exact surfaces of ``lens``; the tables of ``traced`` lead to the hits of two faces."""
    from lensforge.light.reference_bodies import ReferenceBody
    from lensforge.light.reference_trace import as_arrays, trace_reference

    guides = traced.tables if traced.scene.chain is None else None
    return as_arrays(trace_reference(ReferenceBody.exact(lens.surfaces, traced.scene, guides), rays))


def _stage(
    traced: TracedLens, rays: RayBundle, exact: Landings, receiver: PosedReceiver, emitted_w: float
) -> TableError:
    landed = receiver.land(traced.trace(rays))
    squares = []
    pictures = []
    lost = []
    largest = 0.0
    unit = "" if receiver.is_far else "mm"
    for rows in np.split(np.arange(len(rays)), _SCRAMBLES):
        tabulated = landed.take(rows)
        reference = exact.take(rows)
        on = (np.abs(reference.hits) <= 0.5 * np.array(receiver.grid.size)).all(axis=1)
        both = tabulated.arrived & reference.arrived & on
        away = np.linalg.norm(tabulated.hits[both] - reference.hits[both], axis=1)
        largest = max(largest, float(away.max(initial=0.0)))
        squares.append([float(away @ away), float(both.sum())])
        pictures.append([splat_flux(light.hits, light.flux, receiver.grid) for light in (tabulated, reference)])
        detected = [flux_in(light.hits, light.flux, receiver.window) for light in (tabulated, reference)]
        lost.append((detected[0] - detected[1]) / emitted_w)
    return TableError(
        table_error_nm=max(traced.table_error_nm.values()),
        hit_max_mm=largest,
        hit_mm=jackknife_metric(
            np.array(squares), lambda mean: float(np.sqrt(mean[0] / mean[1])) if mean[1] else 0.0, unit
        ),
        irradiance_nmse=jackknife_metric(np.array(pictures), relative_square),
        efficiency=jackknife_metric(np.array(lost), float),
    )


def evaluate_lens(
    lens: Lens,
    source: Source,
    preset: Preset,
    *,
    rays: int | None = None,
    pixels: int | None = None,
    seed: int | None = None,
    efficacy: Efficacy = UNKNOWN,
    searched_with: bool = False,
) -> Light:
    """Simulate ``lens``: rays from the argument, the spec, or the preset, in this order; pixels likewise.

    ``searched_with``: the lens was designed with ``source``; of measured rays, those that the search has not used then
    judge it, and the figures by the others, to which it is fitted, stand beside.

    ``seed``: by default the lens's own. The error of the preset's tables on this scene is measured as well, and the
    limits of the spec are judged: those in lux, candela and photons by the ``efficacy`` of ``source``.
    """
    traced = TracedLens.of(lens, preset.evaluate_nodes_per_sigma)
    count = rays or lens.spec.evaluate.rays or preset.evaluate_rays
    side = pixels or lens.spec.evaluate.pixels
    limits = light_limits(lens.spec, receivers_of(lens.spec, side), efficacy, source.flux_w)
    seed = lens.seed if seed is None else seed
    judging = held_back(source) if searched_with else source
    far = tuple(limits_by_intensities(lens, judging, preset, efficacy.lumens, rays=rays, seed=seed))
    stated = stated_readings(lens.spec, receivers_of(lens.spec, side), efficacy)
    settings: dict[str, Any] = {"pixels": side, "limits": limits, "by_intensities": far, "stated": stated}
    light = evaluate_traced(
        traced, lens.spec, judging, count, seed, bounds_by=source, colour=lens.spec.colour, **settings
    )
    error = None
    if preset.table_error:
        error = measure_preset(lens, judging, TracedLens.of(lens, preset.nodes_per_sigma), traced)
    fitted = _light_by(traced, lens.spec, searched(source), count, seed) if judging is not source else None
    if isinstance(judging, RefittedSource):
        light = _with_left_open(light, traced, lens.spec, judging, count, seed)
    settled: dict[str, object] = {"preset_error": error, "inputs": {"lens": lens.sha256}, "fitted": fitted}
    settled["lumens_per_watt"] = efficacy.lumens
    return light.changed(**settled)


def _light_by(traced: TracedLens, spec: Spec, source: Source, rays: int, seed: int) -> FittedLight:
    metrics = traced_light(traced, spec, source, rays, seed).metrics
    return FittedLight(rays=min(rays, source.ray_count or rays), nmse=metrics.nmse, efficiency=metrics.efficiency)


def _with_left_open(
    light: Light, traced: TracedLens, spec: Spec, source: RefittedSource, rays: int, seed: int
) -> Light:
    """``light`` with errors of NMSE and efficiency on the first receiver enlarged by the doubt of a file's few rays.

    That is the root mean square of the changes when the model is fitted to other draws of the file's rays, and the
    difference, in excess of noise, from the figures by rays of the file that are held back.
    """
    numbers = min(rays, _RAYS_OF_REFIT)
    first = light.receivers[0]
    models = [source, *(source.refitted(number) for number in range(_REFITS))]
    measured, *refitted = [traced_light(traced, spec, model, numbers, seed).metrics for model in models]
    by_file = _light_by(traced, spec, source.held_back, numbers, seed)

    def left_open(of: Callable[[LightMetrics | FittedLight], Metric]) -> float:
        changes = np.mean([(of(model_metrics).value - of(measured).value) ** 2 for model_metrics in refitted])
        apart = of(by_file).value - of(measured).value
        noise = of(by_file).standard_error or 0.0
        return float(np.sqrt(changes + max(apart**2 - noise**2, 0.0)))

    nmse = with_error(first.nmse, left_open(lambda metrics: metrics.nmse))
    efficiency = with_error(first.efficiency, left_open(lambda metrics: metrics.efficiency))
    with_errors = first.changed(nmse=nmse, efficiency=efficiency)
    return light.changed(receivers=(with_errors, *light.receivers[1:]), by_file=by_file)


def evaluate_traced(
    traced: TracedLens,
    spec: Spec,
    source: Source,
    rays: int,
    seed: int,
    *,
    pixels: int | None = None,
    limits: Sequence[LightLimit] = (),
    by_intensities: Sequence[Fact] = (),
    stated: Sequence[LightReading] = (),
    bounds_by: Source | None = None,
    colour: ColourSection | None = None,
) -> Light:
    """Simulate surfaces that are tables already, such as measured ones, under the protocol of ``spec``.

    ``limits`` on pictures of that many ``pixels`` are judged, but for those that are judged ``by_intensities`` already;
    ``stated``: readings of them that are stated.
    The luminous efficacy is left open: it is not one of the emitter. ``bounds_by``: all rays of the source, of which
    ``source`` may be a part; they tell what is possible. ``colour``: as it is wanted of rays that have their colours.
    """
    started = time.perf_counter()
    traced = traced.at_work(spec)
    side = pixels or spec.evaluate.pixels
    receivers = receivers_of(spec, side)
    limits = [limit for limit in limits if not limit.by_intensities]
    zones = [zones_on(number, limits) for number in range(len(receivers))]
    regions = [
        (drawn_target(section.targets, receiver), *eyee)
        for section, receiver, eyee in zip(spec.all_receivers, receivers, zones, strict=True)
    ]
    eyes = eye_views(spec) if any(limit.quantity.of_view for limit in limits) else ()
    bodies = body_views(spec)
    views = (*eyes, *bodies)
    simulation = simulate(
        traced, source, (*receivers, *views), rays, seed, [*regions, *[()] * len(views)], coloured=colour is not None
    )
    looked_at = simulation.received[: len(receivers)]
    by_eyes = simulation.received[len(receivers) : len(receivers) + len(eyes)]
    on_bodies = simulation.received[len(receivers) + len(eyes) :]
    light = SourceLight.of(bounds_by or source, traced.scene.media, lens=spec.lens)
    variance = spec.evaluate.filter_variance
    space = spec.lens.exit_space(spec.constraints).grown(spec.grown_mm)
    lit = tuple(
        receiver_light(section, PossibleLight(light, receiver, space), received, variance, simulation.emitted_w, colour)
        for section, receiver, received in zip(spec.all_receivers, receivers, looked_at, strict=True)
    )
    seen = tuple(_seen(traced, source, seed, zip(eyes, by_eyes, strict=True)))
    images = [gaussian3(flux.images, variance) for flux in looked_at] if limits or stated else []
    for view, received, eye in zip(eyes, by_eyes, seen, strict=True):
        images.append(received.images / (eye.outline_mm2 or np.inf) if view.of_mean else received.images)
    images += [received.images for received in on_bodies]
    losses = [_losses(received, simulation.by_way) for received in looked_at] if limits else []
    shares = [flux.in_regions[:, 1:] / simulation.emitted_w for flux in looked_at]
    names = [receiver.name for receiver in lit] + [""] * len(views)
    return Light(
        receivers=lit,
        limits=(*judged_limits(limits, images, names, losses, shares), *by_intensities, *colour_limits(colour, lit)),
        figures=tuple(stated_figures(stated, images, names)),
        ways=simulation.by_way.ways(simulation.emitted_w),
        seen=seen,
        on_bodies=tuple(
            IrradiatedBody.of(view, received.images[:, 0]) for view, received in zip(bodies, on_bodies, strict=True)
        ),
        rays=simulation.rays,
        replicates=len(simulation.received[0].images),
        pixels=side,
        filter=f"3x3 Gaussian, variance {spec.evaluate.filter_variance:g} pixel^2, hard bins",
        lumens_per_watt=None,
        table_nodes=traced.scene.grid.nodes,
        table_error_nm=traced.table_error_nm,
        preset_error=None,
        seed=seed,
        seconds=time.perf_counter() - started,
    )


def _seen(
    traced: TracedLens, source: Source, seed: int, views: Iterable[tuple[EyeView, ReceivedFlux]]
) -> Iterator[SeenLens]:
    """The lens in every view; additional rays determine its outline."""
    exits = None
    for view, received in views:
        exits = exits or traced.trace(source.sample(min(_RAYS_OF_OUTLINE, source.ray_count or _RAYS_OF_OUTLINE), seed))
        yield SeenLens.of(view, received.images, exits)


def receiver_light(
    section: ReceiverSection,
    physics: PossibleLight,
    received: ReceivedFlux,
    variance: float,
    emitted_w: float,
    colour: ColourSection | None = None,
) -> ReceiverLight:
    """Metrics and maps of the light on one receiver, with the physical bounds.

    ``received``: includes the flux in its target. ``variance`` of the filter (pixel^2).
    """
    receiver = physics.receiver
    drawn = drawn_target(section.targets, receiver)
    coarser = coarser_target(section.targets, receiver)
    images = gaussian3(received.images, variance)
    coarse = gaussian3(rebinned(received.images, receiver.grid.halved()), variance)
    target = drawn.light
    mean = images.mean(axis=0)
    raw = received.images.mean(axis=0)
    mask = lit_mask(uniform_region(section.targets, receiver), images)
    measure = receiver.pixel_measure
    metrics = ReplicateMetrics.of(images, target, mask, received.window / emitted_w).metrics()
    flux, missed = _flux_budget(received, emitted_w)
    lost = received.by_fate[:, CAUSES:].mean(axis=0) / emitted_w  # in the bodies behind the lens
    colours = None if colour is None or received.colours is None else gaussian3(received.colours, variance)
    unit = light_unit(None, far_field=receiver.is_far)
    width, height, radius = (side if np.isfinite(side) else None for side in astuple(receiver.window))
    return ReceiverLight(
        name=section.name or section.kind,
        kind=section.kind,
        place=section.place,
        width=receiver.grid.width,
        height=receiver.grid.height,
        window=WindowSize(width=width, height=height, radius=radius),
        nmse=metrics.nmse,
        efficiency=metrics.efficiency,
        share_in_target=jackknife_metric(received.in_regions[:, 0] / emitted_w, float),
        uniformity=metrics.uniformity,
        rsd=metrics.rsd,
        in_region=RegionLight.of(images / measure, target, mask, unit.symbol),
        raw=_raw(mean, target, mask),
        nmse_of_noise=_noise(images),
        nmse_of_raster=metrics.nmse.value - nmse_estimate(coarse, coarser.light).value,
        possible=_possible(physics, drawn, float(mean.sum()) / emitted_w),
        flux=flux,
        missed_by_cause=missed,
        lost_in_bodies=dict(zip((body.name for body in physics.light.media.bodies), lost.tolist(), strict=True)),
        blocked=_blocked(received, receiver, emitted_w),
        map=mean / measure,
        raw_map=raw / measure,
        target_map=target * mean.sum() / measure,
        colour=None if colour is None or colours is None else BeamColour.of(colours, colour.level),
        tristimulus_map=None if colours is None else colours.mean(axis=1) / measure,
    )


def _blocked(received: ReceivedFlux, receiver: PosedReceiver, emitted_w: float) -> tuple[BlockedLight, ...]:
    """Light that each body of the scene blocks, and what it reflects into the window, of those that it meets."""
    if receiver.housing is None or received.by_housing is None:
        return ()
    blocked = []
    by_body = np.moveaxis(received.by_housing, 1, 0)
    finishes = receiver.housing.finishes
    ways = zip(receiver.housing.names, finishes.clear, finishes.reflectances > 0.0, by_body, strict=True)
    for name, is_clear, reflects, amounts in ways:
        *_, met_w, x, y, z = amounts.mean(axis=0)
        if met_w > 0.0:
            taken, kept, onto_window = (jackknife_metric(column / emitted_w, float) for column in amounts[:, :3].T)
            blocked.append(
                BlockedLight(
                    name=name,
                    share=taken,
                    returned=onto_window if reflects else None,
                    passed=onto_window if is_clear else None,
                    trapped=kept if is_clear else None,
                    place_mm=(x / met_w, y / met_w, z / met_w),
                )
            )
    return tuple(blocked)


def _losses(received: ReceivedFlux, by_way: FluxByWay) -> Float[np.ndarray, "r c"]:
    """Flux (W) by cause of loss, in the order of ``scene.light_ends``, in each replicate."""
    ended = received.by_fate[:, : len(Fate)] @ (NUMBER_BY_FATE[:, None] == np.arange(len(LOSSES)))
    ended[:, LOSSES.index("beside")] = received.outside + received.by_fate[:, MISSED_RECEIVER]
    ended[:, LOSSES.index("housing")] = received.by_fate[:, [BLOCKED, SECOND_WALL]].sum(axis=1)
    return np.concatenate([ended, by_way.leaked()], axis=1)


def _possible(physics: PossibleLight, target: DrawnTarget, arriving: float) -> Possible:
    certain = physics.certain
    estimated = physics.light.curve.estimated
    return Possible(
        **_largest_light(certain, target, arriving),
        law=certain.in_region(target.coverage).law,
        estimate=EstimatedLight(**_largest_light(physics, target, arriving)) if estimated else None,
    )


def _largest_light(physics: PossibleLight, target: DrawnTarget, arriving: float) -> dict[str, float]:
    return {
        "efficiency": physics.in_window().value,
        "share_in_target": physics.in_region(target.coverage).value,
        "nmse": physics.least_nmse(target.light, target.coverage > 0.0, arriving),
    }


def _raw(
    mean: Float[np.ndarray, "h w"], target: Float[np.ndarray, "h w"], mask: Bool[np.ndarray, "h w"] | None
) -> RawMetrics:
    return RawMetrics(
        nmse=nmse(mean, target),
        uniformity=None if mask is None else uniformity(mean, mask),
        rsd=None if mask is None else relative_deviation(mean, mask),
    )


def _noise(images: Images) -> float | None:
    """NMSE due to ray noise alone: variance of the mean image over its square."""
    mean = images.mean(axis=0)
    if len(images) < 2 or not mean.any():
        return None
    return float(images.var(axis=0, ddof=1).sum() / len(images) / np.sum(mean**2))


def _flux_budget(received: ReceivedFlux, emitted_w: float) -> tuple[Flux, MissedByCause]:
    share = received.by_fate.mean(axis=0) / emitted_w
    named = named_flux(share)
    missed = MissedByCause(**{name: named[name] for name in MissedByCause.model_fields})
    flux = Flux(
        detected=float(received.window.mean() / emitted_w),
        outside=float(received.outside.mean() / emitted_w),
        missed=sum(missed.model_dump().values()),
        **{name: named[name] for name in Flux.model_fields if name in named},
        reflected=max(0.0, 1.0 - float(share.sum())),  # the rest: all of it may be rounding
    )
    return flux, missed
