"""The yield study: parts drawn from the tolerances, the spread of their metrics, the share that passes, the causes.

A cause is the first-order share of a metric's variance that one tolerance makes (Sobol 1993): the part of the variance
explained by its numbers alone. It is the sum of the squared products of the metric with polynomials that are
orthonormal over the parts; a sum over pairs of different parts has no bias by the scatter of so many products (a
U-statistic, as of the NMSE). Numbers that are spread have polynomials to degree 4 in one, and together in two
variables; the hundred numbers of a form error those of degree 1 and 2, all products included: near an optimum a figure
of merit is quadratic in them.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from lensforge.light.simulation import REPLICATES
from lensforge.made.board_light import periods_of
from lensforge.made.measured_parts import KeptParts, MeasuredParts, Progress
from lensforge.made.part_study import PartStudy, Recipe
from lensforge.made.tolerance_budget import budget, flux_needed
from lensforge.made.tolerance_result import (
    PASS_RATE,
    ApplicationYield,
    CauseShare,
    MetricSpread,
    PassRate,
    ToleranceAmount,
    Variance,
    WorstPart,
    Yield,
    drawn_to_mean,
)
from lensforge.results import Metric
from lensforge.results.cluster import WorkerPool
from lensforge.results.estimates import jackknife_error
from lensforge.scene.lens import Lens
from lensforge.scene.perturbations import Draws, orthonormal
from lensforge.search.room_for_parts import require_feasible_tolerances
from lensforge.spec.accuracy import preset_of
from lensforge.spec.application import names_of
from lensforge.spec.tolerances_section import Factor

_DEGREE = 4
_BLOCKS = 20  # of the jackknife over parts


def contributions(draws: Draws, values: Float[np.ndarray, " n"], noise: float) -> Variance:
    """Shares of the variance of ``values`` over the parts; ``noise``: variance by the rays, attributed to no cause."""
    centred = values - values.mean()
    blocks = np.arange(len(values)) % _BLOCKS
    total = _left_out(centred**2, blocks)
    total = total * (len(values) / (len(values) - 1)) - noise
    causes = []
    explained = np.zeros(_BLOCKS + 1)
    for factor in draws.factors:
        by_factor = _explained(
            features(factor, draws.numbers[factor.name], draws.of_lamps(factor.name)), centred, blocks
        )
        explained = explained + by_factor
        share = _metric(by_factor / total)
        causes.append(
            CauseShare(
                tolerance=factor.name,
                words=factor.phrase,
                share=share.value,
                standard_error=share.standard_error or 0.0,
            )
        )
    causes.sort(key=lambda cause: cause.rank)
    return Variance(causes=tuple(causes), interactions=_metric(1.0 - explained / total))


def features(factor: Factor, numbers: Float[np.ndarray, "n k"], lamps: int = 1) -> Float[np.ndarray, "n b"]:
    """Functions of the factor's numbers, orthonormal over the parts.

    Of several ``lamps``, each with its own numbers, there are as many products as parts at most, or none: more of them
    have more noise than they explain.
    """
    count, dimensions = numbers.shape
    if factor.kind == "field" or lamps > 1:
        first, second = numbers, (numbers**2 - 1.0) / np.sqrt(2.0)
        if factor.kind != "field":
            first, second = np.moveaxis(orthonormal(factor, numbers, 2), -1, 0)
        few = lamps == 1 or dimensions * (dimensions - 1) <= 2 * count
        pairs = [first[:, i : i + 1] * first[:, i + 1 :] for i in range(dimensions - 1 if few else 0)]
        return np.concatenate([first, second, *pairs], axis=1)
    single = orthonormal(factor, numbers, _DEGREE)
    columns = [single[:, k] for k in range(dimensions)]
    if dimensions == 2:
        degrees = [(i, j) for i in range(_DEGREE) for j in range(_DEGREE) if i + j + 2 <= _DEGREE]
        columns.append(np.stack([single[:, 0, i] * single[:, 1, j] for i, j in degrees], axis=1))
    return np.concatenate(columns, axis=1).reshape(count, -1)


def _left_out(values: Float[np.ndarray, "n *b"], blocks: np.ndarray) -> Float[np.ndarray, "s *b"]:
    """Mean over all parts, then with each block left out in turn."""
    sums = np.stack([values[blocks == k].sum(axis=0) for k in range(_BLOCKS)])
    sizes = np.bincount(blocks, minlength=_BLOCKS).reshape(-1, *(1 for _ in values.shape[1:]))
    without = (sums.sum(axis=0) - sums) / (len(values) - sizes)
    return np.concatenate([sums.sum(axis=0)[None] / len(values), without])


def _explained(
    basis: Float[np.ndarray, "n b"], centred: Float[np.ndarray, " n"], blocks: np.ndarray
) -> Float[np.ndarray, " s"]:
    """Variance that the functions explain, by pairs of different parts; all parts, then each block left out."""
    products = basis * centred[:, None]
    means = _left_out(products, blocks)
    squares = _left_out(np.sum(products**2, axis=1), blocks)
    sizes = len(centred) - np.concatenate([[0], np.bincount(blocks, minlength=_BLOCKS)])
    return np.asarray((sizes * np.sum(means**2, axis=1) - squares) / (sizes - 1))


def _metric(values: Float[np.ndarray, " s"]) -> Metric:
    """The value of all parts, with its jackknife error over the blocks."""
    return Metric(value=float(values[0]), standard_error=jackknife_error(values[1:]))


PARTS = 1000
_MOST_OF_LAMPS = 2**24  # of one of several lamps as designed, whose pictures are part of that of every board
_PILOT = 32
_LARGEST_ERROR = 0.1  # of a part's metric, as a share of the spread over the parts
_OF_DISTANCE = 0.1
_LARGEST_BUDGET_ERROR = 0.3
_LEAST_SPREAD = 0.01  # of the metric: nobody needs to know a smaller spread to a tenth of it
_WORST = 3


def measure_yield(
    lens: Lens,
    *,
    parts: int = PARTS,
    rays: int | None = None,
    seed: int = 0,
    with_budget: bool = True,
    workers: WorkerPool | None = None,
    file: Path | None = None,
    progress: Progress | None = None,
    announce: Callable[[str], None] | None = None,
) -> Yield:
    """Draw ``parts`` from the tolerances of the lens's spec, and measure the light of each.

    Without ``rays`` as many are traced, within those of the lens's preset, as keep the standard error of a part below a
    tenth of the spread over the parts. ``file``: where measured parts are kept until the study is done. Raises
    :class:`InputError` for tolerances that the part cannot bear.
    """
    started = time.perf_counter()
    announce = announce or (lambda _: None)
    lamps = not lens.spec.all_lamps.is_single
    effort = preset_of(lens.accuracy).studies
    of_lamps = min(lens.spec.evaluate.rays or 0, _MOST_OF_LAMPS) if lamps else 0
    designed_rays = max(effort.designed_rays, of_lamps)
    study = PartStudy(Recipe(lens, parts, rays or effort.part_rays[0], seed, designed_rays))
    require_feasible_tolerances(lens, study.factors)
    parts_measured = MeasuredParts(study, workers, KeptParts.of(file, study), progress)
    if rays is None:
        announce("pilot parts")
        parts_measured = _with_enough_rays(parts_measured, min(_PILOT, parts))
    study = parts_measured.study
    announce("parts")
    measured = parts_measured.of(range(parts))
    in_common = study.noise_in_common(min(_PILOT, parts))
    metrics = {
        name: _spread(study.of_design[name], measured[:, number], in_common[number])
        for number, name in enumerate(study.names)
    }
    excess = study.excess(measured[..., 0])
    passes: Bool[np.ndarray, " n"] = np.all(excess <= 0.0, axis=1)
    variance = {
        name: contributions(study.draws, measured[:, number, 0], float(np.mean(measured[:, number, 1] ** 2)))
        for number, name in enumerate(study.names)
        if metrics[name].spread > 0.0
    }
    wanted = lens.spec.optimise.share or PASS_RATE
    first = excess[: effort.budget_parts]
    limits = budget(_for_budget(parts_measured, measured), first, announce, wanted) if with_budget else None
    bounded = measured[:, [study.names.index(bound.metric) for bound in study.bounds], 0]
    worst, worst_leds = _worst(study, measured)
    columns, table = _table(study, measured)
    announce("worst parts")
    return Yield(
        inputs={"lens": lens.sha256},
        parts=parts,
        lamps=len(study.lamps),
        leds=tuple(led.led for led in study.leds if led.led),
        rays=sum(len(led.light.held) for led in study.leds),
        seed=seed,
        preset=lens.spec.tolerances.preset,
        tolerances=tuple(map(ToleranceAmount.of, study.factors)),
        bounds=study.bounds,
        pass_rate=PassRate.of(int(passes.sum()), parts),
        metrics=metrics,
        variance=variance,
        roads=tuple(_applications(study, measured)),
        budget=limits,
        flux=flux_needed(study.bounds, bounded, wanted),
        worst=worst,
        worst_leds=tuple(filter(None, worst_leds)),
        notes=_notes(study, metrics),
        seconds=time.perf_counter() - started,
        columns=columns,
        table=table,
        worst_maps=_worst_maps(study, worst, worst_leds),
    )


def _with_enough_rays(measured: MeasuredParts, pilot: int) -> MeasuredParts:
    """Parts measured by as many rays as the judged metrics need, estimated from the first ``pilot`` parts."""
    most = preset_of(measured.study.recipe.lens.accuracy).studies.part_rays[1]
    while measured.study.recipe.rays < most and not _is_certain(measured.study, measured.of(range(pilot))):
        measured = measured.with_rays(2 * measured.study.recipe.rays)
    return measured


def _for_budget(parts: MeasuredParts, measured: Float[np.ndarray, "n m 2"]) -> MeasuredParts:
    """Parts measured by the fewest rays that tell whether they pass: noise a third of the distance to the bounds."""
    study = parts.study
    rays = parts.study.recipe.rays
    least = max(preset_of(study.recipe.lens.accuracy).studies.budget_rays, 2 * REPLICATES * len(study.lamps))
    columns = [study.names.index(bound.metric) for bound in study.bounds]
    errors = np.median(measured[:, columns, 1], axis=0)
    apart = np.abs(study.excess(measured[..., 0])).mean(axis=0) * _OF_DISTANCE
    scale = np.maximum(apart, [_true_spread(measured[:, column]) for column in columns])
    while rays > least and np.all(np.sqrt(2.0) * errors <= _LARGEST_BUDGET_ERROR * scale):
        rays = rays // 2
        errors = np.sqrt(2.0) * errors
    return parts.with_rays(rays)


def _is_certain(study: PartStudy, values: Float[np.ndarray, "n m 2"]) -> bool:
    """True if a part's standard error is small against the spread over the parts, in all judged metrics."""
    judged = {*(f"{led.prefix}nmse" for led in study.leds), *(bound.metric for bound in study.bounds)}
    numbers = [number for number, name in enumerate(study.names) if name in judged]
    for number in numbers:
        least = _LEAST_SPREAD * abs(float(values[:, number, 0].mean()))
        error = float(np.median(values[:, number, 1]))
        if error > _LARGEST_ERROR * max(_true_spread(values[:, number]), least):
            return False
    return True


def _true_spread(values: Float[np.ndarray, "n 2"]) -> float:
    """Standard deviation over the parts, less the noise of the rays."""
    variance = float(values[:, 0].var(ddof=1)) - float(np.mean(values[:, 1] ** 2))
    return float(np.sqrt(max(variance, 0.0)))


def _spread(designed: Metric, values: Float[np.ndarray, "n 2"], in_common: float) -> MetricSpread:
    """Distribution of one metric, without the scatter that ray noise adds.

    The mean is uncertain by the choice of the parts, by the light of the lens as designed, from which all of them are
    changes, and by what the changes have ``in_common`` of the variance of the rays, which are the same for all.
    """
    spread = _true_spread(values)
    scatter = float(values[:, 0].std(ddof=1))
    mean = float(values[:, 0].mean())
    noise = float(np.sqrt(np.mean(values[:, 1] ** 2)))
    of_parts = scatter / float(np.sqrt(len(values)))
    of_rays = float(np.sqrt(in_common)) * noise
    error = float(np.linalg.norm([of_parts, designed.standard_error or 0.0, of_rays]))
    p5, p50, p95 = np.percentile(drawn_to_mean(values[:, 0], spread), [5.0, 50.0, 95.0]).tolist()
    return MetricSpread(
        unit=designed.unit,
        designed=designed,
        p5=p5,
        p50=p50,
        p95=p95,
        mean=Metric(value=mean, unit=designed.unit, standard_error=error),
        spread=spread,
        standard_error=float(np.median(values[:, 1])),
    )


def _applications(study: PartStudy, measured: Float[np.ndarray, "n m 2"]) -> Iterator[ApplicationYield]:
    """The share of parts that keep the class of each application, and the causes of the least distance to a bound."""
    entries = study.recipe.lens.spec.applications
    every = study.excess(measured[..., 0])
    first = 0
    for led in study.leds:
        for number, (entry, name) in enumerate(zip(entries, names_of(entries), strict=True)):
            rows = [first + row for row, limit in enumerate(led.limits) if limit.application == number]
            bounds = [study.bounds[row] for row in rows]
            scale = np.array([bound.bound for bound in bounds])
            beyond = every[:, rows] / scale
            nearest = beyond.argmax(axis=1)
            parts = np.arange(len(beyond))
            columns = np.array([study.names.index(bound.metric) for bound in bounds])
            margin = np.stack([-beyond.max(axis=1), measured[parts, columns[nearest], 1] / scale[nearest]], axis=1)
            noise = float(np.mean(margin[:, 1] ** 2))
            counts = np.bincount(nearest, minlength=len(bounds))
            decided = _true_spread(margin) > float(np.median(margin[:, 1]))
            yield ApplicationYield(
                name=f"{led.prefix}{name}",
                lighting_class=entry.lighting_class,
                pass_rate=PassRate.of(int((beyond <= 0.0).all(axis=1).sum()), len(beyond)),
                nearest=bounds[int(counts.argmax())].metric,
                nearest_share=float(counts.max() / len(beyond)),
                variance=contributions(study.draws, margin[:, 0], noise) if decided else None,
            )
        first += len(led.bounds)


def _worst(study: PartStudy, measured: Float[np.ndarray, "n m 2"]) -> tuple[tuple[WorstPart, ...], tuple[str, ...]]:
    """The parts that miss their bounds most, in units of the spread over the parts, and the LED of that bound."""
    excess = study.excess(measured[..., 0])
    of_bound = [led.led for led in study.leds for _ in led.bounds]
    width = excess.std(axis=0)
    relative = excess / np.where(width > 0.0, width, 1.0)
    order = np.argsort(-relative.max(axis=1), kind="stable")[:_WORST]
    parts = tuple(
        WorstPart(
            part=int(number),
            metrics=dict(zip(study.names, measured[number, :, 0].tolist(), strict=True)),
            passes=bool((excess[number] <= 0.0).all()),
        )
        for number in order
    )
    return parts, tuple(of_bound[int(bound)] for bound in relative[order].argmax(axis=1))


def _worst_maps(study: PartStudy, worst: Sequence[WorstPart], names: Sequence[str]) -> Float[np.ndarray, "k h w"]:
    """Light of the worst parts on the first receiver, per measure of its pixels, each by its LED and by more rays."""
    rays = max(preset_of(study.recipe.lens.accuracy).studies.worst_rays, study.recipe.rays)
    finer = {led.led: led for led in study.with_rays(rays).leds}  # of lamps, their share of the rays is new as well
    leds = [finer[name] for name in names]
    parts = [led.made(study.deviations(worst_part.part)) for worst_part, led in zip(worst, leds, strict=True)]
    images = [led.light.received(part)[0].images.mean(axis=0) for part, led in zip(parts, leds, strict=True)]
    measures = [led.light.receivers[0].pixel_measure for led in leds]
    return np.stack([image / measure for image, measure in zip(images, measures, strict=True)])


def _table(study: PartStudy, measured: Float[np.ndarray, "n m 2"]) -> tuple[tuple[str, ...], Float[np.ndarray, "n c"]]:
    """Numbers drawn for every part, in the unit of the spec, except those of each lamp; and its metrics."""
    columns = list[str]()
    drawn = list[Float[np.ndarray, "n k"]]()
    for factor in study.factors:
        if study.draws.of_lamps(factor.name) > 1:
            continue
        numbers = study.draws.numbers[factor.name] * factor.amount
        columns += [factor.name if factor.numbers == 1 else f"{factor.name} {k + 1}" for k in range(factor.numbers)]
        drawn.append(numbers)
    return (*columns, *study.names), np.concatenate([*drawn, measured[..., 0]], axis=1)


def _of_lamps(study: PartStudy) -> str:
    spec = study.recipe.lens.spec
    columns, rows = periods_of(study.recipe.lens.spec)
    common = "; ".join(factor.phrase for factor in study.factors if factor.name in study.draws.common) or "nothing"
    piece = "board" if spec.plate is None else "plate"
    if spec.all_lamps.period_mm is not None:
        piece = f"{piece} of {columns} × {rows} periods of the lattice, repeated without end,"
    return f"each part is a {piece} with {len(study.lamps)} lamps, drawn apart; in common: {common}"


def _without_limits(study: PartStudy) -> str:
    bounds = "; ".join(map(str, study.bounds))
    return (
        f"the spec has no [[limits]]: parts pass by what any pattern must keep ({bounds}); add what the lamp must keep"
    )


def _notes(study: PartStudy, metrics: dict[str, MetricSpread]) -> tuple[str, ...]:
    notes = [] if study.lamps.is_single else [_of_lamps(study)]
    if len(study.leds) > 1:
        names = ", ".join(led.led for led in study.leds)
        notes.append(f"each part is measured with every LED ({names}), whose place, size and flux are off alike")
    for name, error in study.kinds[0].maker.errors.items():
        if error.slope > 0.0 and study.spec.part_tolerances.given(name) is not None:  # nobody has chosen a preset's
            factor_name = next(factor.phrase for factor in study.factors if factor.name == name)
            notes.append(f"{factor_name}: finer parts than the tables resolve are taken as roughness")
    for bound in study.bounds:
        spread = metrics[bound.metric]
        if spread.undecided:
            why = f"a part's standard error of {spread.standard_error:.2g} outweighs the spread over the parts"
            notes.append(f"{bound.metric}: undecided which parts pass: {why}; take more rays")
        elif spread.standard_error is not None and spread.standard_error > _LARGEST_ERROR * spread.spread:
            share = spread.standard_error / spread.spread
            notes.append(f"{bound.metric}: a part's standard error is {share:.2g} of the spread over the parts")
    if not any(led.designed_light.limits for led in study.leds):
        notes.append(_without_limits(study))
    return tuple(notes)
