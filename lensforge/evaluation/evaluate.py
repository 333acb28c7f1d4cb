"""Evaluation of a finished lens by the paper's protocol: rays in independent replicates, metrics, :class:`Light`."""

import time

import numpy as np
from jaxtyping import Bool, Float

from lensforge.accuracy import Preset
from lensforge.evaluation.light import Flux, Light, MissedByCause, RawMetrics, TableErrors, light_criteria
from lensforge.evaluation.metrics import nmse, relative_deviation, uniformity
from lensforge.evaluation.minimum import uniformity_without_noise
from lensforge.evaluation.noise_free import Images, nmse_without_noise, rsd_without_noise
from lensforge.evaluation.preset_error import measure_preset
from lensforge.evaluation.simulate import MISSED_RECEIVER, Simulation, TracedLens, simulate
from lensforge.jackknife import jackknife
from lensforge.kernels.fates import Fate
from lensforge.lens import Lens
from lensforge.receivers.pixels import gaussian3
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.targets import target_irradiance
from lensforge.records import Metric
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.spec.target import IN_TARGET


def evaluate_lens(
    lens: Lens,
    source: Source,
    preset: Preset,
    *,
    rays: int | None = None,
    pixels: int | None = None,
    seed: int | None = None,
) -> Light:
    """Simulate ``lens``: rays from the argument, the spec, or the preset, in this order; pixels likewise.

    ``seed``: by default the lens's own. The error of the preset's tables on this scene is measured as well.
    """
    traced = TracedLens.of(lens, preset.evaluate_nodes_per_sigma)
    count = rays or lens.spec.evaluate.rays or preset.evaluate_rays
    light = evaluate_traced(traced, lens.spec, source, count, lens.seed if seed is None else seed, pixels)
    design = TracedLens.of(lens, preset.nodes_per_sigma)
    error = measure_preset(lens, source, design, traced)
    return light.model_copy(update={"preset_error": error, "inputs": {"lens": lens.sha256}})


def evaluate_traced(
    traced: TracedLens, spec: Spec, source: Source, rays: int, seed: int, pixels: int | None = None
) -> Light:
    """Simulate surfaces that are tables already, such as measured ones, under the protocol of ``spec``.

    The luminous efficacy is left open: it is not one of the emitter.
    """
    started = time.perf_counter()
    receiver = PlaneReceiver.of(spec.target, pixels or spec.evaluate.pixels)
    grid = receiver.grid
    window_mm = spec.evaluate.window_mm or spec.target.receiver_mm
    simulation = simulate(traced, source, receiver, window_mm, rays, seed)
    images = np.stack([gaussian3(image, spec.evaluate.filter_variance) for image in simulation.images])
    target, mean, raw = target_irradiance(spec.target, grid), images.mean(axis=0), simulation.images.mean(axis=0)
    area, uniform_mm = receiver.pixel_measure, spec.target.uniform_mm
    mask = None if uniform_mm is None else _lit(grid.square_mask(uniform_mm), mean)
    flux, missed = _flux_budget(simulation)
    return Light(
        nmse=nmse_without_noise(images, target),
        efficiency=_share(simulation.window, simulation.emitted_w),
        share_in_target=_share(_in_target(simulation.images, target), simulation.emitted_w),
        uniformity=None if mask is None else uniformity_without_noise(images, mask),
        rsd=None if mask is None else rsd_without_noise(images, mask),
        raw=_raw(mean, target, mask),
        nmse_of_noise=_noise(images),
        flux=flux,
        missed_by_cause=missed,
        rays=simulation.rays,
        replicates=len(images),
        pixels=grid.pixels,
        filter=f"3x3 Gaussian, variance {spec.evaluate.filter_variance:g} pixel^2, hard bins",
        receiver_mm=grid.side_mm,
        window_mm=window_mm,
        uniform_mm=uniform_mm,
        distance_mm=spec.target.distance_mm,
        lumens_per_watt=None,
        table_nodes=traced.scene.grid.nodes,
        table_error_nm=TableErrors.model_validate(traced.table_error_nm),
        preset_error=None,
        seed=seed,
        seconds=time.perf_counter() - started,
        criteria=light_criteria(flux),
        map=mean / area,
        raw_map=raw / area,
        target_map=target * mean.sum() / area,
        axis_mm=grid.axis_mm(),
    )


def _lit(mask: Bool[np.ndarray, "p p"], mean: Float[np.ndarray, "p p"]) -> Bool[np.ndarray, "p p"] | None:
    """``mask``; None where no pixel lies in it, or no light falls anywhere."""
    return mask if mask.any() and mean.sum() > 0.0 else None


def _raw(
    mean: Float[np.ndarray, "p p"], target: Float[np.ndarray, "p p"], mask: Bool[np.ndarray, "p p"] | None
) -> RawMetrics:
    """Metrics of the mean image, with its noise."""
    return RawMetrics(
        nmse=nmse(mean, target),
        uniformity=None if mask is None else uniformity(mean, mask),
        rsd=None if mask is None else relative_deviation(mean, mask),
    )


def _share(flux_w: Float[np.ndarray, " r"], emitted_w: float) -> Metric:
    """Mean over replicates as a share of the emitted flux."""
    value, error = jackknife(flux_w[:, None], lambda mean: float(mean[0]))
    return Metric(value=value / emitted_w, standard_error=None if error is None else error / emitted_w)


def _in_target(images: Images, target: Float[np.ndarray, "p p"]) -> Float[np.ndarray, " r"]:
    """Flux (W) of each replicate where the target is above a tenth of its maximum."""
    flux: Float[np.ndarray, " r"] = images[:, target > IN_TARGET * target.max()].sum(axis=1)
    return flux


def _noise(images: Images) -> float | None:
    """NMSE due to ray noise alone: variance of the mean image over its square."""
    mean = images.mean(axis=0)
    if len(images) < 2 or not mean.any():
        return None
    return float(images.var(axis=0, ddof=1).sum() / len(images) / np.sum(mean**2))


def _flux_budget(simulation: Simulation) -> tuple[Flux, MissedByCause]:
    """The flux budget, and the flux that missed the receiver's plane by cause."""
    share = simulation.by_fate.mean(axis=0) / simulation.emitted_w
    detected = float(simulation.window.mean() / simulation.emitted_w)
    missed = MissedByCause(
        backward=float(share[Fate.BACKWARD]),
        outside_cavity=float(share[Fate.OUTSIDE_CAVITY]),
        base=float(share[Fate.BASE]),
        missed_receiver=float(share[MISSED_RECEIVER]),
        surfaces_intersect=float(share[Fate.SURFACES_INTERSECT]),
    )
    flux = Flux(
        detected=detected,
        outside=float(share[Fate.LEFT_LENS]) - detected,
        missed=sum(missed.model_dump().values()),
        total_reflection=float(share[Fate.TOTAL_REFLECTION]),
        not_converged=float(share[Fate.NOT_CONVERGED]),
        reflected=1.0 - float(share.sum()),
    )
    return flux, missed
