"""Agreement of a yield study with its own table of parts, and with the tolerances of the lens's spec."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from lensforge.agreement.comparing import beyond, differing, unlike
from lensforge.deviations.factors import factors_of
from lensforge.errors import InputError
from lensforge.lens import Lens
from lensforge.spec.tolerance_presets import PRESET_AMOUNTS
from lensforge.tolerancing.yield_result import (
    PASS_RATE,
    BudgetRow,
    MetricSpread,
    PassRate,
    ToleranceAmount,
    WorstPart,
    Yield,
    drawn_to_mean,
)

_TABLE = "the table of parts"


def yield_contradictions(found: Yield, lens: Lens) -> Iterator[str]:
    """Contradictions of the record of a yield study."""
    wrong_form = list(_form(found))
    yield from wrong_form
    if wrong_form:
        return  # columns cannot be told from each other
    yield from _drawn(found, lens)
    passes = found.passing
    yield from _pass_rate(found, passes)
    for name, spread in found.metrics.items():
        yield from _spread(f"metrics.{name}", spread, found.column(name))
    yield from _variance(found)
    yield from _budget(found, passes)
    if len(found.worst) != len(found.worst_maps):
        yield f"worst: {len(found.worst)} parts, but pictures of {len(found.worst_maps)}"
    for index, worst in enumerate(found.worst):
        yield from _worst(f"worst.{index}", worst, found, passes)


def _form(found: Yield) -> Iterator[str]:
    """The table has a row for each part, and a column for each number and metric."""
    rows, columns = found.table.shape
    yield from unlike("parts", found.parts, rows, f"{_TABLE} has")
    if len(found.columns) != columns:
        yield f"columns: {len(found.columns)} names, but {_TABLE} has {columns}"
        return
    if len(set(found.columns)) < columns:
        yield "columns: two have the same name"
    drawn, metrics = found.columns[: columns - len(found.metrics)], found.columns[columns - len(found.metrics) :]
    if metrics != tuple(found.metrics):
        yield "columns: do not end with the metrics"
    names = list(dict.fromkeys(name.partition(" ")[0] for name in drawn))
    if names != [each.name for each in found.tolerances]:
        yield "columns: do not begin with the tolerances"
    for bound in found.bounds:
        if bound.metric not in found.metrics:
            yield f"bounds: {bound.metric!r} is no metric"


def _drawn(found: Yield, lens: Lens) -> Iterator[str]:
    """Tolerances, preset and seed are those of the spec, but for what the conditions name."""
    conditions = found.conditions
    yield from unlike("seed", found.seed, (conditions.seed if conditions else None) or 0, "its conditions say")
    if conditions is not None and conditions.tolerances is not None:
        if conditions.tolerances in PRESET_AMOUNTS:  # a name of one's own says nothing of the preset
            yield from unlike("preset", found.preset, conditions.tolerances, "its conditions say")
        return
    section = lens.spec.tolerances
    yield from unlike("preset", found.preset, section.preset, "the spec has")
    try:
        factors = factors_of(section)
    except InputError:
        factors = ()
    wanted = tuple(map(ToleranceAmount.of, factors))
    if found.tolerances != wanted:
        yield "tolerances: not those of the spec"


def _pass_rate(found: Yield, passes: Bool[np.ndarray, " n"]) -> Iterator[str]:
    """The share of rows within all bounds, and its interval by Wilson's score."""
    derived = PassRate.of(int(passes.sum()), len(passes))
    for field, stated in found.pass_rate:
        yield from differing(f"pass_rate.{field}", stated, getattr(derived, field), f"{_TABLE} and the bounds")


def _spread(name: str, stated: MetricSpread, values: Float[np.ndarray, " n"]) -> Iterator[str]:
    """Mean and percentiles of the column; these after the noise of the rays was taken off it."""
    mean, scatter = float(values.mean()), float(values.std(ddof=1))
    yield from unlike(f"{name}.unit", stated.unit, stated.designed.unit, "as designed it is")
    yield from unlike(f"{name}.mean.unit", stated.mean.unit, stated.unit, "the metric has")
    yield from differing(f"{name}.mean", stated.mean.value, mean, _TABLE)
    error = scatter / float(np.sqrt(len(values)))
    yield from differing(f"{name}.mean.standard_error", stated.mean.standard_error, error, _TABLE)
    yield from beyond(f"{name}.spread", stated.spread, 0.0, scatter, _TABLE)
    own = drawn_to_mean(values, stated.spread)
    for field, share in (("p5", 5.0), ("p50", 50.0), ("p95", 95.0)):
        derived = float(np.percentile(own, share))
        yield from differing(f"{name}.{field}", getattr(stated, field), derived, f"{_TABLE} and the spread")


def _variance(found: Yield) -> Iterator[str]:
    """Shares of each tolerance once, the surest first, and with those of several together 1."""
    yield from unlike(
        "variance", sorted(found.variance), sorted(name for name in found.metrics if found.metrics[name].spread > 0.0),
        "the metrics that scatter are",
    )  # fmt: skip
    names = sorted((each.name, each.words) for each in found.tolerances)
    for metric, variance in found.variance.items():
        if sorted((cause.tolerance, cause.words) for cause in variance.causes) != names:
            yield f"variance.{metric}: not the tolerances that were drawn"
        shares = [cause.share for cause in variance.causes]
        if [cause.rank for cause in variance.causes] != sorted(cause.rank for cause in variance.causes):
            yield f"variance.{metric}: the surest share is not the first"
        rest = 1.0 - sum(shares)
        yield from differing(f"variance.{metric}.interactions", variance.interactions.value, rest, "its shares")


def _budget(found: Yield, passes: Bool[np.ndarray, " n"]) -> Iterator[str]:
    """A row for each tolerance as it was drawn, and an interval around each amount."""
    if found.budget is None:
        return
    yield from unlike("budget.pass_rate", found.budget.pass_rate, PASS_RATE, "it must be")
    enough = bool(passes[: found.budget.parts].mean() >= PASS_RATE) if found.budget.parts else False
    yield from beyond("budget.parts", found.budget.parts, 1, found.parts, _TABLE)
    drawn = [(each.name, each.words, each.unit, each.amount) for each in found.tolerances]
    if [(row.tolerance, row.words, row.unit, row.specified) for row in found.budget.alone] != drawn:
        yield "budget.alone: not the tolerances that were drawn"
    together = found.budget.together
    yield from unlike("budget.together", (together.tolerance, together.specified), ("all", 1.0), "it must be")
    rows = [row for row in (*found.budget.alone, together) if row.specified > 0.0]
    if len({round(row.searched_to / row.specified, 6) for row in rows}) > 1:
        yield "budget: not all tolerances were searched to the same multiple"
    for row in (*found.budget.alone, together):
        yield from _budget_row(f"budget: {row.tolerance}", row, enough)


def _budget_row(name: str, row: BudgetRow, enough: bool) -> Iterator[str]:
    """A row; ``enough``: as specified, so many of the parts pass that an amount without end may be found."""
    amounts = (row.at_most, row.low, row.high)
    if row.at_most is None or row.low is None or row.high is None:
        if amounts != (None, None, None):
            yield f"{name}: an amount without its interval"
        yield from unlike(f"{name}.unlimited", row.unlimited, enough, f"{_TABLE} and the bounds say")
    else:
        if row.unlimited:
            yield f"{name}: unlimited, but with a largest amount"
        yield from beyond(f"{name}.at_most", row.at_most, row.low, row.high, "its interval")
        yield from beyond(f"{name}.high", row.high, 0.0, row.searched_to, "the amounts that were tried")


def _worst(name: str, worst: WorstPart, found: Yield, passes: Bool[np.ndarray, " n"]) -> Iterator[str]:
    """One of the worst parts is a row of the table."""
    if worst.part >= len(found.table):
        yield f"{name}.part = {worst.part}, but {_TABLE} ends at {len(found.table) - 1}"
        return
    yield from unlike(f"{name}.passes", worst.passes, bool(passes[worst.part]), f"{_TABLE} and the bounds say")
    yield from unlike(f"{name}.metrics", list(worst.metrics), list(found.metrics), "the study has")
    for metric in found.metrics:
        value = float(found.column(metric)[worst.part])
        yield from differing(f"{name}.{metric}", worst.metrics.get(metric), value, _TABLE)
