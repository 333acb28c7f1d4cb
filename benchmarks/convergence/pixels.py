"""Pixels, the four-pixel splat and the evaluation's filter: the bias of the picture, apart from ray noise.

A difference between two pictures of the same rays has a mean, the bias, and noise. The mean square of the mean over
runs holds both; the noise is estimated from the scatter of the runs and subtracted, so an estimate may be negative
where the bias is below the noise.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from convergence.runs import TracedRun
from convergence.study import ConvergenceStudy, Errors, Meter, RefinementLevel, Setting, orders_of
from lensforge.results import Metric
from lensforge.results.estimates import Images, jackknife_error, nmse_estimate
from lensforge.scene.pixel_grid import PixelGrid, bin_flux, gaussian3, splat_flux
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.spec import Spec

PIXELS = (16, 32, 64, 128, 256)
VARIANCES = (0.0, 0.25, 0.5, 1.0, 2.0)
_MOST_PARTS = 8


def pixel_study(runs: Sequence[TracedRun], spec: Spec, settings: Sequence[int] = PIXELS) -> ConvergenceStudy:
    """Unfiltered pictures of ``runs`` at each number of pixels along the longer side of the first receiver.

    ``splat_nmse``: mean square difference between the splat and hard bins over the mean square, without noise.
    ``nmse_shift``: NMSE against the target, without noise, minus that of the finest picture.
    """
    runs = in_parts(runs)
    found = {}
    for pixels in settings:
        receiver = receivers_of(spec, pixels)[0]
        grid, wanted = receiver.grid, target_light(spec.all_receivers[0].targets, receiver)
        with Meter() as meter:
            bins = np.stack([bin_flux(run.hits, run.flux, grid) for run in runs])
        splats = np.stack([_splat(run, grid) for run in runs])
        found[pixels] = bins, splats, nmse_estimate(bins, wanted).metric(), meter
    finest = max(settings)
    finest_nmse = found[finest][2].value
    levels = []
    for pixels, (bins, splats, shift, meter) in found.items():
        splat_error = with_error(np.stack([splats, bins], axis=1), lambda both: bias(both[:, 0], both[:, 1]))
        shifted = Metric(value=shift.value - finest_nmse, standard_error=shift.standard_error)
        errors = {"splat_nmse": splat_error, "nmse_shift": Metric(value=0.0) if pixels == finest else shifted}
        levels.append(_level(pixels, meter, len(runs), errors, {"nmse": shift.value}, spec))
    orders = {"hard bins": orders_of(levels, ("splat_nmse",))}
    return ConvergenceStudy(
        name="pixels",
        title="Pixels and the splat",
        knob="--pixels, optimise.pixels",
        reference=f"hard bins; for the NMSE those of {finest} pixels",
        plotted=("splat_nmse",),
        against="setting",
        levels=tuple(levels),
        order=orders,
    )


def _level(
    pixels: int, meter: Meter, runs: int, errors: Errors, other: dict[str, Setting], spec: Spec
) -> RefinementLevel:
    users = [
        name
        for name, used in (("the design", spec.optimise.pixels), ("the evaluation", spec.evaluate.pixels))
        if used == pixels
    ]
    return RefinementLevel(
        setting=pixels,
        series="hard bins",
        seconds=meter.seconds / runs,
        peak_mb=meter.peak_mb,
        errors=errors,
        used_by=tuple(users),
        other=other,
    )


def filter_study(runs: Sequence[TracedRun], spec: Spec, variances: Sequence[float] = VARIANCES) -> ConvergenceStudy:
    """The 3 x 3 Gaussian at several variances: blur (``irradiance_nmse``, without noise), and the remaining noise."""
    runs = in_parts(runs)
    grid = receivers_of(spec, spec.evaluate.pixels)[0].grid
    bins = np.stack([bin_flux(run.hits, run.flux, grid) for run in runs])
    levels = []
    for variance in sorted({*variances, spec.evaluate.filter_variance}):
        with Meter() as meter:
            smooth = np.stack([gaussian3(image, variance) for image in bins])
        blur = with_error(np.stack([smooth, bins], axis=1), lambda both: bias(both[:, 0], both[:, 1]))
        errors = {"irradiance_nmse": Metric(value=0.0) if variance == 0.0 else blur}
        errors["noise_nmse"] = with_error(smooth, lambda images: _noise(images) / float(np.sum(images.mean(0) ** 2)))
        users = ("the evaluation",) if variance == spec.evaluate.filter_variance else ()
        seconds = meter.seconds / len(runs)
        levels.append(
            RefinementLevel(
                setting=variance,
                series="3 x 3 Gaussian",
                seconds=seconds,
                peak_mb=meter.peak_mb,
                errors=errors,
                used_by=users,
                reference=variance == 0.0,
            )
        )
    return ConvergenceStudy(
        name="filter",
        title="Filter of the evaluation",
        knob="evaluate.filter_variance",
        reference=f"no filter; the noise is that of one run of {len(runs[0])} rays",
        plotted=("irradiance_nmse", "noise_nmse"),
        against="setting",
        levels=tuple(levels),
    )


def in_parts(runs: Sequence[TracedRun]) -> list[TracedRun]:
    """``runs`` themselves; a single one, as of a measured source, split at random."""
    if len(runs) > 1:
        return list(runs)
    (run,) = runs
    order = np.random.default_rng(0).permutation(len(run))
    rows = np.array_split(order, min(_MOST_PARTS, len(run)))
    return [
        TracedRun(run.hits[kept], run.flux[kept] * len(run) / len(kept), run.seconds / len(rows), 0.0, run.peak_mb)
        for kept in rows
    ]


def bias(images: Images, others: Images) -> float:
    """``|E (images - others)|^2 / |E others|^2`` without the noise of the runs: unbiased in its numerator."""
    difference = images - others
    squared = float(np.sum(difference.mean(axis=0) ** 2)) - _noise(difference) / len(images)
    return squared / float(np.sum(others.mean(axis=0) ** 2))


def with_error(runs: Float[np.ndarray, "r *shape"], statistic: Callable[[np.ndarray], float]) -> Metric:
    """``statistic`` of all runs, and its standard error by the jackknife over them."""
    left_out = [statistic(np.delete(runs, k, axis=0)) for k in range(len(runs))]
    return Metric(value=float(statistic(runs)), standard_error=jackknife_error(np.array(left_out)))


def _noise(images: Images) -> float:
    return float(images.var(axis=0, ddof=1).sum())


def _splat(run: TracedRun, grid: PixelGrid) -> Float[np.ndarray, "h w"]:
    return splat_flux(run.hits, run.flux, grid)
