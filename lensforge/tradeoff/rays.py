"""Rays: how fast the noise of efficiency and irradiance falls, quasi-Monte-Carlo against plain Monte Carlo."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.evaluation.metrics import nmse
from lensforge.evaluation.simulate import REPLICATES, TracedLens
from lensforge.receiver.bins import bin_flux, flux_in_square
from lensforge.receiver.filter import gaussian3
from lensforge.receiver.plane import Receiver
from lensforge.receiver.targets import target_irradiance
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.tradeoff.ladder import Estimate, Ladder, Rung, orders_of
from lensforge.tradeoff.runs import Run, resample, trace_run

QMC, PLAIN = "quasi-Monte-Carlo", "plain Monte Carlo"
RUNS, PLAIN_RUNS = 8, 16
SETTINGS = tuple(2**power for power in (12, 14, 16, 18, 20))


@dataclass(frozen=True)
class _Scores:
    """Of each run of a rung: efficiency, filtered image (W), NMSE against the target; and that of the mean image."""

    efficiency: Float[np.ndarray, " r"]
    images: Float[np.ndarray, "r p p"]
    nmse: Float[np.ndarray, " r"]
    nmse_of_mean: float


def ray_ladder(
    traced: TracedLens, spec: Spec, source: Source, settings: Sequence[int] = SETTINGS, runs: int = RUNS
) -> tuple[Ladder, list[Run]]:
    """The ladder, and the runs of its top rung.

    The reference is the mean of the top rung's runs; errors are those of one run: the standard deviation of the
    efficiency over ``runs`` scrambles, the mean square difference of the filtered images over their mean square, and
    by how much noise raises the NMSE against the target. A measured source has no sequence to scramble: its rays are
    the reference, and only plain Monte Carlo is measured.
    """
    score = _scorer(spec, source)
    rungs: list[Rung] = []
    number = 0
    if source.population is not None:
        kept = [trace_run(traced, source, source.population, 0)]
        reference = score(kept)
    else:
        found = []
        for rays in settings:
            kept = [trace_run(traced, source, rays, number + k) for k in range(runs)]
            number += runs
            found.append((rays, score(kept), kept[0]))
        reference = found[-1][1]
        rungs += [_rung(rays, QMC, scores, reference, run) for rays, scores, run in found]
    pool = kept[0]
    settings = [rays for rays in settings if rays <= len(pool)]
    by_pool = score([pool])
    for rays in settings:
        drawn = [resample(pool, rays, np.random.default_rng([rays, k])) for k in range(PLAIN_RUNS)]
        rungs.append(_rung(rays, PLAIN, score(drawn), by_pool, drawn[0]))
    rungs.append(_reference_rung(kept, reference))
    orders = {
        series: orders_of([rung for rung in rungs if rung.series == series], ("efficiency", "irradiance_nmse"))
        for series in (QMC, PLAIN)
    }
    return _ladder(tuple(rungs), orders), kept


def _ladder(rungs: tuple[Rung, ...], orders: dict[str, dict[str, Estimate]]) -> Ladder:
    return Ladder(
        "rays",
        "Rays",
        "--rays",
        "all runs of the longest rung together",
        {"efficiency": "of the source", "irradiance_nmse": "", "nmse_raised": ""},
        ("efficiency", "irradiance_nmse"),
        "seconds",
        rungs,
        {series: found for series, found in orders.items() if found},
    )


def _scorer(spec: Spec, source: Source) -> Callable[[Sequence[Run]], _Scores]:
    """A function that judges runs as ``evaluate`` does."""
    receiver = Receiver(spec.target.receiver_mm, spec.evaluate.pixels)
    window_mm = spec.evaluate.window_mm or spec.target.receiver_mm
    target = target_irradiance(spec.target, receiver)

    def to_target(image: Float[np.ndarray, "p p"]) -> float:
        return nmse(image, target) if image.any() else 1.0

    def score(runs: Sequence[Run]) -> _Scores:
        images = np.stack(
            [gaussian3(bin_flux(run.hits, run.flux, receiver), spec.evaluate.filter_variance) for run in runs]
        )
        efficiency = np.array([flux_in_square(run.hits, run.flux, window_mm) / source.flux_w for run in runs])
        return _Scores(efficiency, images, np.array([to_target(image) for image in images]), to_target(images.mean(0)))

    return score


def _rung(rays: int, series: str, scores: _Scores, reference: _Scores, run: Run) -> Rung:
    count = len(scores.efficiency)
    spread = float(scores.efficiency.std(ddof=1))
    mean = scores.images.mean(axis=0)
    noise = np.sum((scores.images - mean) ** 2, axis=(1, 2)) / np.sum(reference.images.mean(axis=0) ** 2)
    noise *= count / (count - 1)  # each image is part of the mean that it is compared with
    errors = {
        "efficiency": Estimate(spread, spread / float(np.sqrt(2.0 * (count - 1)))),
        "irradiance_nmse": _mean(noise),
        "nmse_raised": _mean(scores.nmse - reference.nmse_of_mean),
    }
    return Rung(rays, series, run.seconds, run.peak_mb, errors, _users(rays) if series == QMC else ())


def _reference_rung(runs: list[Run], scores: _Scores) -> Rung:
    count = len(runs)
    known = float(scores.efficiency.std(ddof=1) / np.sqrt(count)) if count > 1 else None
    errors = {
        "efficiency": Estimate(0.0, known),
        "irradiance_nmse": Estimate(0.0),
        "nmse_raised": Estimate(0.0),
    }
    seconds = sum(run.seconds for run in runs)
    return Rung(count * len(runs[0]), "reference", seconds, runs[0].peak_mb, errors, reference=True)


def _mean(values: Float[np.ndarray, " r"]) -> Estimate:
    return Estimate(float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values))))


def _users(rays: int) -> tuple[str, ...]:
    """The presets that trace ``rays`` rays at once: in a gradient step, or in one of the evaluation's scrambles."""
    steps = [f"{name}, gradient step" for name, preset in PRESETS.items() if preset.design_rays == rays]
    judged = [
        f"{name}, 1/{REPLICATES} of the evaluation"
        for name, preset in PRESETS.items()
        if preset.evaluate_rays == rays * REPLICATES
    ]
    return (*steps, *judged)
