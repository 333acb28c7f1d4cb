"""Pixels, the four-pixel splat and the evaluation filter: what the picture loses beside the noise of its rays.

A difference between two pictures of the same rays has a mean, the bias that is asked for, and noise. The mean square
of the mean over runs holds both; what the runs' scatter says about the noise is taken off, so an estimate may fall
below zero when the bias is below the noise.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.metrics import nmse
from lensforge.receivers.bins import bin_flux
from lensforge.receivers.filter import gaussian3
from lensforge.receivers.plane import Receiver
from lensforge.receivers.splat import splat_flux
from lensforge.receivers.targets import target_irradiance
from lensforge.spec import Spec
from lensforge.studies.tradeoff.ladder import Estimate, Ladder, Meter, Rung, orders_of
from lensforge.studies.tradeoff.runs import Run

PIXELS = (16, 32, 64, 128, 256)
VARIANCES = (0.0, 0.25, 0.5, 1.0, 2.0)
_MOST_PARTS = 8

Images = Float[np.ndarray, "r p p"]


def pixel_ladder(runs: Sequence[Run], spec: Spec, settings: Sequence[int] = PIXELS) -> Ladder:
    """Unfiltered pictures of ``runs`` at each number of pixels.

    ``splat_nmse``: mean square difference between the splat and hard bins over the mean square, without noise.
    ``nmse_shift``: NMSE against the target, without noise, less that of the finest picture.
    """
    runs = in_parts(runs)
    found = {}
    for pixels in settings:
        receiver = Receiver(spec.target.receiver_mm, pixels)
        with Meter() as meter:
            bins = np.stack([bin_flux(run.hits, run.flux, receiver) for run in runs])
        splats = np.stack([_splat(run, receiver) for run in runs])
        target = target_irradiance(spec.target, receiver)
        found[pixels] = bins, splats, partial(_quiet_nmse, target=target), meter
    finest = max(settings)
    truth = found[finest][2](found[finest][0])
    rungs = []
    for pixels, (bins, splats, to_target, meter) in found.items():
        splat_error = with_error(np.stack([splats, bins], axis=1), lambda both: bias(both[:, 0], both[:, 1]))
        shift = with_error(bins, to_target)
        errors = {"splat_nmse": splat_error, "nmse_shift": Estimate(shift.value - truth, shift.standard_error)}
        if pixels == finest:
            errors["nmse_shift"] = Estimate(0.0)
        rungs.append(_rung(pixels, meter, len(runs), errors, {"nmse": shift.value}, spec))
    orders = {"hard bins": orders_of(rungs, ("splat_nmse",))}
    return Ladder(
        "pixels",
        "Pixels and the splat",
        "--pixels, optimise.pixels",
        f"hard bins; for the NMSE those of {finest} pixels",
        {"splat_nmse": "", "nmse_shift": ""},
        ("splat_nmse",),
        "setting",
        tuple(rungs),
        orders,
    )


def _rung(
    pixels: int, meter: Meter, runs: int, errors: dict[str, Estimate], other: dict[str, float], spec: Spec
) -> Rung:
    users = [
        name
        for name, used in (("the design", spec.optimise.pixels), ("the evaluation", spec.evaluate.pixels))
        if used == pixels
    ]
    return Rung(pixels, "hard bins", meter.seconds / runs, meter.peak_mb, errors, tuple(users), other)


def filter_ladder(runs: Sequence[Run], spec: Spec, variances: Sequence[float] = VARIANCES) -> Ladder:
    """What the 3 x 3 Gaussian takes away: blur (``irradiance_nmse``, without noise), and gives: less noise."""
    runs = in_parts(runs)
    receiver = Receiver(spec.target.receiver_mm, spec.evaluate.pixels)
    bins = np.stack([bin_flux(run.hits, run.flux, receiver) for run in runs])
    rungs = []
    for variance in sorted({*variances, spec.evaluate.filter_variance}):
        with Meter() as meter:
            smooth = np.stack([gaussian3(image, variance) for image in bins])
        blur = with_error(np.stack([smooth, bins], axis=1), lambda both: bias(both[:, 0], both[:, 1]))
        errors = {"irradiance_nmse": Estimate(0.0) if variance == 0.0 else blur}
        errors["noise_nmse"] = with_error(smooth, lambda images: _noise(images) / float(np.sum(images.mean(0) ** 2)))
        users = ("the evaluation",) if variance == spec.evaluate.filter_variance else ()
        seconds = meter.seconds / len(runs)
        rungs.append(Rung(variance, "3 x 3 Gaussian", seconds, meter.peak_mb, errors, users, reference=variance == 0.0))
    return Ladder(
        "filter",
        "Filter of the evaluation",
        "evaluate.filter_variance",
        f"no filter; the noise is that of one run of {len(runs[0])} rays",
        {"irradiance_nmse": "", "noise_nmse": ""},
        ("irradiance_nmse", "noise_nmse"),
        "setting",
        tuple(rungs),
    )


def in_parts(runs: Sequence[Run]) -> list[Run]:
    """``runs`` themselves; a single one, such as a measured source gives, dealt out at random."""
    if len(runs) > 1:
        return list(runs)
    (run,) = runs
    order = np.random.default_rng(0).permutation(len(run))
    rows = np.array_split(order, min(_MOST_PARTS, len(run)))
    return [
        Run(run.hits[kept], run.flux[kept] * len(run) / len(kept), run.seconds / len(rows), 0.0, run.peak_mb)
        for kept in rows
    ]


def bias(images: Images, others: Images) -> float:
    """``|E (images - others)|^2 / |E others|^2`` without the noise of the runs: unbiased in its numerator."""
    difference = images - others
    squared = float(np.sum(difference.mean(axis=0) ** 2)) - _noise(difference) / len(images)
    return squared / float(np.sum(others.mean(axis=0) ** 2))


def with_error(runs: Float[np.ndarray, "r *shape"], statistic: Callable[[np.ndarray], float]) -> Estimate:
    """``statistic`` of all runs, and its standard error by the jackknife over them."""
    count = len(runs)
    left_out = np.array([statistic(np.delete(runs, k, axis=0)) for k in range(count)])
    return Estimate(
        float(statistic(runs)), float(np.sqrt((count - 1) / count * np.sum((left_out - left_out.mean()) ** 2)))
    )


def _noise(images: Images) -> float:
    return float(images.var(axis=0, ddof=1).sum())


def _quiet_nmse(images: Images, target: Float[np.ndarray, "p p"]) -> float:
    """NMSE of the mean image less what noise adds to it."""
    mean = images.mean(axis=0)
    wanted = target * (mean.sum() / target.sum())
    return nmse(mean, target) - _noise(images) / len(images) / float(np.sum(wanted**2))


def _splat(run: Run, receiver: Receiver) -> Float[np.ndarray, "p p"]:
    return splat_flux(run.hits, run.flux, receiver)
