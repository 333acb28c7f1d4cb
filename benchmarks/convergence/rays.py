"""Convergence of efficiency and irradiance with the number of rays: quasi-Monte Carlo and plain Monte Carlo.

Both are those of the first receiver, of whatever kind; in the far field intensity stands for irradiance.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from convergence.runs import Cost, RunPicture, TracedRun, long_run, picture_of, resample, trace_run
from convergence.study import ConvergenceStudy, Errors, RefinementLevel, orders_of
from lensforge.light.simulation import REPLICATES, TracedLens
from lensforge.results import Metric
from lensforge.results.estimates import nmse, nmse_estimate
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import PRESETS

QMC, PLAIN = "quasi-Monte-Carlo", "plain Monte Carlo"
RUNS, PLAIN_RUNS = 8, 16
_OF_SOURCE = "of the source"
SETTINGS = tuple(2**power for power in (12, 14, 16, 18, 20))
MOST_AT_ONCE = 2**20  # longer runs are made of scrambles of this many rays, as in an evaluation: bounds the memory


@dataclass(frozen=True)
class _Scores:
    """Efficiency, filtered image (W) and NMSE against the target of each run of a level; that of all without noise."""

    efficiency: Float[np.ndarray, " r"]
    images: Float[np.ndarray, "r h w"]
    nmse: Float[np.ndarray, " r"]
    nmse_without_noise: float

    @staticmethod
    def of(pictures: Sequence[RunPicture], spec: Spec) -> "_Scores":
        """Scores of ``pictures`` against the targets of the first receiver of ``spec``."""
        target = target_light(spec.all_receivers[0].targets, receivers_of(spec, spec.evaluate.pixels)[0])
        images = np.stack([picture.image for picture in pictures])
        efficiency = np.array([picture.efficiency for picture in pictures])
        to_target = np.array([nmse(image, target) for image in images])
        return _Scores(efficiency, images, to_target, nmse_estimate(images, target).metric().value)


_MeasuredLevel = tuple[int, _Scores, TracedRun | Cost]


def ray_study(
    traced: TracedLens, spec: Spec, source: Source, settings: Sequence[int] = SETTINGS, runs: int = RUNS
) -> tuple[ConvergenceStudy, list[TracedRun]]:
    """The study, and the runs of its finest level.

    The reference is the mean of the finest level's runs; errors are those of one run: the standard deviation of the
    efficiency over ``runs`` scrambles, the mean square difference of the filtered images over their mean square, and
    the increase of the NMSE against the target by noise. A measured source has no sequence to scramble: its
    rays are the reference, and only plain Monte Carlo is measured. Runs of more than 2^20 rays are made of several
    scrambles, as in an evaluation; their noise falls with the power -1, and they are not kept.
    """
    picture = partial(picture_of, spec, source.flux_w)
    trace = partial(trace_run, traced, receivers_of(spec, spec.evaluate.pixels)[0], source)
    levels: list[RefinementLevel] = []
    if source.ray_count is not None:
        kept = [trace(source.ray_count, 0)]
        longest: _MeasuredLevel = (source.ray_count, _Scores.of([picture(kept[0])], spec), kept[0])
    else:
        found, kept = _quasi(trace, spec, picture, settings, runs)
        longest = found[-1]
        levels += [_level(rays, QMC, scores, longest[1], run) for rays, scores, run in found]
    pool = kept[0]
    by_pool = _Scores.of([picture(pool)], spec)
    for rays in (rays for rays in settings if rays <= len(pool)):
        drawn = [resample(pool, rays, np.random.default_rng([rays, k])) for k in range(PLAIN_RUNS)]
        levels.append(_level(rays, PLAIN, _Scores.of([picture(run) for run in drawn], spec), by_pool, drawn[0]))
    levels.append(_reference_level(*longest))
    orders = {
        series: orders_of(
            [level for level in levels if level.series == series and level.setting <= MOST_AT_ONCE],
            ("efficiency", "irradiance_nmse"),
        )
        for series in (QMC, PLAIN)
    }
    return _study(tuple(levels), orders), kept


def _quasi(
    trace: Callable[[int, int], TracedRun],
    spec: Spec,
    picture: Callable[[TracedRun], RunPicture],
    settings: Sequence[int],
    runs: int,
) -> tuple[list[_MeasuredLevel], list[TracedRun]]:
    """Rays, scores and one run's cost of each level; and the runs of the finest level that can be kept."""
    found: list[_MeasuredLevel] = []
    kept: list[TracedRun] = []
    number = 0
    for rays in settings:
        parts = -(-rays // MOST_AT_ONCE)
        if parts == 1:
            kept = [trace(rays, number + k) for k in range(runs)]
            found.append((rays, _Scores.of([picture(run) for run in kept], spec), kept[0]))
        else:
            part = partial(trace, MOST_AT_ONCE)
            made = [long_run(part, picture, range(number + k * parts, number + (k + 1) * parts)) for k in range(runs)]
            found.append((rays, _Scores.of([one for one, _ in made], spec), made[0][1]))
        number += runs * parts
    return found, kept


def _study(levels: tuple[RefinementLevel, ...], orders: dict[str, Errors]) -> ConvergenceStudy:
    return ConvergenceStudy(
        name="rays",
        title="Rays",
        knob="--rays",
        reference="all runs of the finest level together",
        plotted=("efficiency", "irradiance_nmse"),
        against="seconds",
        levels=levels,
        order={series: found for series, found in orders.items() if found},
    )


def _level(rays: int, series: str, scores: _Scores, reference: _Scores, run: TracedRun | Cost) -> RefinementLevel:
    count = len(scores.efficiency)
    spread = float(scores.efficiency.std(ddof=1))
    mean = scores.images.mean(axis=0)
    noise = np.sum((scores.images - mean) ** 2, axis=(1, 2)) / np.sum(reference.images.mean(axis=0) ** 2)
    noise *= count / (count - 1)  # each image is part of the mean that it is compared with
    errors = {
        "efficiency": Metric(value=spread, unit=_OF_SOURCE, standard_error=spread / float(np.sqrt(2.0 * (count - 1)))),
        "irradiance_nmse": _mean(noise),
        "nmse_raised": _mean(scores.nmse - reference.nmse_without_noise),
    }
    return RefinementLevel(
        setting=rays,
        series=series,
        seconds=run.seconds,
        peak_mb=run.peak_mb,
        errors=errors,
        used_by=_users(rays) if series == QMC else (),
    )


def _reference_level(rays: int, scores: _Scores, run: TracedRun | Cost) -> RefinementLevel:
    count = len(scores.efficiency)
    known = float(scores.efficiency.std(ddof=1) / np.sqrt(count)) if count > 1 else None
    errors = {
        "efficiency": Metric(value=0.0, unit=_OF_SOURCE, standard_error=known),
        "irradiance_nmse": Metric(value=0.0),
        "nmse_raised": Metric(value=0.0),
    }
    return RefinementLevel(
        setting=count * rays,
        series="reference",
        seconds=count * run.seconds,
        peak_mb=run.peak_mb,
        errors=errors,
        reference=True,
    )


def _mean(values: Float[np.ndarray, " r"]) -> Metric:
    return Metric(value=float(values.mean()), standard_error=float(values.std(ddof=1) / np.sqrt(len(values))))


def _users(rays: int) -> tuple[str, ...]:
    """The presets that trace ``rays`` rays at once: in a gradient step, or in one of the evaluation's scrambles."""
    steps = [f"{name}, gradient step" for name, preset in PRESETS.items() if preset.design_rays == rays]
    evaluated = [
        f"{name}, 1/{REPLICATES} of the evaluation"
        for name, preset in PRESETS.items()
        if preset.evaluate_rays == rays * REPLICATES
    ]
    return (*steps, *evaluated)
