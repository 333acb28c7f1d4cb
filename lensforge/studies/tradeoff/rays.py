"""Rays: how fast the noise of efficiency and irradiance falls, quasi-Monte-Carlo against plain Monte Carlo."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.accuracy import PRESETS
from lensforge.evaluation.metrics import nmse
from lensforge.evaluation.simulate import REPLICATES, TracedLens
from lensforge.receivers.bins import bin_flux, flux_in_square
from lensforge.receivers.filter import gaussian3
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.targets import target_irradiance
from lensforge.records import Metric
from lensforge.sources.bundle import Source
from lensforge.spec import Spec
from lensforge.studies.tradeoff.ladder import Errors, Ladder, Rung, orders_of
from lensforge.studies.tradeoff.runs import Run, resample, trace_run

QMC, PLAIN = "quasi-Monte-Carlo", "plain Monte Carlo"
RUNS, PLAIN_RUNS = 8, 16
_OF_SOURCE = "of the source"
SETTINGS = tuple(2**power for power in (12, 14, 16, 18, 20))
MOST_AT_ONCE = 2**20  # longer runs are made of scrambles of so many rays, as in an evaluation: it bounds the memory


class _Seen(NamedTuple):
    """Efficiency and filtered image (W) of a run."""

    efficiency: float
    image: Float[np.ndarray, "p p"]


@dataclass(frozen=True)
class Cost:
    """Of a run that was not kept: its seconds, and the most memory at once (MB)."""

    seconds: float
    peak_mb: float


@dataclass(frozen=True)
class _Scores:
    """Of each run of a rung: efficiency, filtered image (W), NMSE against the target; and that of the mean image."""

    efficiency: Float[np.ndarray, " r"]
    images: Float[np.ndarray, "r p p"]
    nmse: Float[np.ndarray, " r"]
    nmse_of_mean: float

    @staticmethod
    def of(seen: Sequence[_Seen], spec: Spec) -> "_Scores":
        """Judged against the target of ``spec``."""
        target = target_irradiance(spec.target, PixelGrid(spec.target.receiver_mm, spec.evaluate.pixels))

        def to_target(image: Float[np.ndarray, "p p"]) -> float:
            return nmse(image, target) if image.any() else 1.0

        images = np.stack([one.image for one in seen])
        efficiency = np.array([one.efficiency for one in seen])
        return _Scores(efficiency, images, np.array([to_target(image) for image in images]), to_target(images.mean(0)))


_Rung = tuple[int, _Scores, Run | Cost]


def ray_ladder(
    traced: TracedLens, spec: Spec, source: Source, settings: Sequence[int] = SETTINGS, runs: int = RUNS
) -> tuple[Ladder, list[Run]]:
    """The ladder, and the runs of its top rung.

    The reference is the mean of the top rung's runs; errors are those of one run: the standard deviation of the
    efficiency over ``runs`` scrambles, the mean square difference of the filtered images over their mean square, and
    by how much noise raises the NMSE against the target. A measured source has no sequence to scramble: its rays are
    the reference, and only plain Monte Carlo is measured. Runs of more than 2^20 rays are made of several scrambles,
    as those of an evaluation are, and fall as these do, with the power -1; they are not kept.
    """
    judge = _judge(spec, source)
    trace = partial(trace_run, traced, PlaneReceiver.of(spec.target, spec.evaluate.pixels), source)
    rungs: list[Rung] = []
    if source.population is not None:
        kept = [trace(source.population, 0)]
        longest: _Rung = (source.population, _Scores.of([judge(kept[0])], spec), kept[0])
    else:
        found, kept = _quasi(trace, spec, judge, settings, runs)
        longest = found[-1]
        rungs += [_rung(rays, QMC, scores, longest[1], run) for rays, scores, run in found]
    pool = kept[0]
    by_pool = _Scores.of([judge(pool)], spec)
    for rays in (rays for rays in settings if rays <= len(pool)):
        drawn = [resample(pool, rays, np.random.default_rng([rays, k])) for k in range(PLAIN_RUNS)]
        rungs.append(_rung(rays, PLAIN, _Scores.of([judge(run) for run in drawn], spec), by_pool, drawn[0]))
    rungs.append(_reference_rung(*longest))
    orders = {
        series: orders_of(
            [rung for rung in rungs if rung.series == series and rung.setting <= MOST_AT_ONCE],
            ("efficiency", "irradiance_nmse"),
        )
        for series in (QMC, PLAIN)
    }
    return _ladder(tuple(rungs), orders), kept


def _quasi(
    trace: Callable[[int, int], Run], spec: Spec, judge: Callable[[Run], _Seen], settings: Sequence[int], runs: int
) -> tuple[list[_Rung], list[Run]]:
    """Rays, scores and one run's cost of each rung; and the runs of the highest rung that can be kept."""
    found: list[_Rung] = []
    kept: list[Run] = []
    number = 0
    for rays in settings:
        parts = -(-rays // MOST_AT_ONCE)
        if parts == 1:
            kept = [trace(rays, number + k) for k in range(runs)]
            found.append((rays, _Scores.of([judge(run) for run in kept], spec), kept[0]))
        else:
            made = [_long_run(trace, judge, parts, number + k * parts) for k in range(runs)]
            found.append((rays, _Scores.of([seen for seen, _ in made], spec), made[0][1]))
        number += runs * parts
    return found, kept


def _ladder(rungs: tuple[Rung, ...], orders: dict[str, Errors]) -> Ladder:
    return Ladder(
        name="rays",
        title="Rays",
        knob="--rays",
        reference="all runs of the longest rung together",
        plotted=("efficiency", "irradiance_nmse"),
        against="seconds",
        rows=rungs,
        order={series: found for series, found in orders.items() if found},
    )


def _judge(spec: Spec, source: Source) -> Callable[[Run], _Seen]:
    """A function that looks at a run as ``evaluate`` does."""
    grid = PixelGrid(spec.target.receiver_mm, spec.evaluate.pixels)
    window_mm = spec.evaluate.window_mm or spec.target.receiver_mm

    def judge(run: Run) -> _Seen:
        image = gaussian3(bin_flux(run.hits, run.flux, grid), spec.evaluate.filter_variance)
        return _Seen(flux_in_square(run.hits, run.flux, window_mm) / source.flux_w, image)

    return judge


def _long_run(
    trace: Callable[[int, int], Run], judge: Callable[[Run], _Seen], parts: int, number: int
) -> tuple[_Seen, Cost]:
    """What ``parts`` scrambles of :data:`MOST_AT_ONCE` rays show together; none of their rays is kept."""
    efficiency, image, seconds, peak_mb = 0.0, np.zeros(1), 0.0, 0.0
    for part in range(parts):
        run = trace(MOST_AT_ONCE, number + part)
        seen = judge(run)
        efficiency, image = efficiency + seen.efficiency / parts, image + seen.image / parts
        seconds, peak_mb = seconds + run.seconds, max(peak_mb, run.peak_mb)
    return _Seen(efficiency, image), Cost(seconds, peak_mb)


def _rung(rays: int, series: str, scores: _Scores, reference: _Scores, run: Run | Cost) -> Rung:
    count = len(scores.efficiency)
    spread = float(scores.efficiency.std(ddof=1))
    mean = scores.images.mean(axis=0)
    noise = np.sum((scores.images - mean) ** 2, axis=(1, 2)) / np.sum(reference.images.mean(axis=0) ** 2)
    noise *= count / (count - 1)  # each image is part of the mean that it is compared with
    errors = {
        "efficiency": Metric(value=spread, unit=_OF_SOURCE, standard_error=spread / float(np.sqrt(2.0 * (count - 1)))),
        "irradiance_nmse": _mean(noise),
        "nmse_raised": _mean(scores.nmse - reference.nmse_of_mean),
    }
    return Rung(
        setting=rays,
        series=series,
        seconds=run.seconds,
        peak_mb=run.peak_mb,
        errors=errors,
        presets=_users(rays) if series == QMC else (),
    )


def _reference_rung(rays: int, scores: _Scores, run: Run | Cost) -> Rung:
    count = len(scores.efficiency)
    known = float(scores.efficiency.std(ddof=1) / np.sqrt(count)) if count > 1 else None
    errors = {
        "efficiency": Metric(value=0.0, unit=_OF_SOURCE, standard_error=known),
        "irradiance_nmse": Metric(value=0.0),
        "nmse_raised": Metric(value=0.0),
    }
    return Rung(
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
    judged = [
        f"{name}, 1/{REPLICATES} of the evaluation"
        for name, preset in PRESETS.items()
        if preset.evaluate_rays == rays * REPLICATES
    ]
    return (*steps, *judged)
