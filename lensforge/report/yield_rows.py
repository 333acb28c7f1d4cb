"""Rows on the yield of a lens: who passes, how far the light scatters, by which causes, what each tolerance may be."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lensforge.made.tolerance_result import FIELD, BudgetRow, MetricBound, Variance, WorstPart, Yield
from lensforge.report.numerals import NOTHING, number, percent
from lensforge.report.shown_receivers import capitalised
from lensforge.results import Metric

_IN_PER_CENT = ("source_flux", "source_size", "shrinkage")
SHARES = ("efficiency", "share_in_target")  # shown in per cent
_WORDS = {
    "nmse": "error of the pattern (NMSE)",
    "efficiency": "efficiency",
    "share_in_target": "light in the target",
    "uniformity": "uniformity",
    "rsd": "RSD",
}
_SIGNS = {">=": "≥", "<=": "≤"}
_LEADING = 3  # causes in a sentence; the plot and the record have more
_LEAST = 0.005  # of a cause, as a share of the variance: less is not worth naming
TOGETHER = "several together"
_DISTRIBUTIONS = {
    "truncated": "Gaussian, 2 σ = the amount, none beyond it",
    "normal": "Gaussian, 2 σ = the amount",
    "uniform": "anywhere within the amount",
    FIELD: "a new shape for each part; the amount is its rms",
}
_DRAWN = {"truncated": "truncated", "normal": "normal", "uniform": "uniform", FIELD: "random shape"}


@dataclass(frozen=True)
class BoundRow:
    """A bound that a part must keep, the value as designed, and the share of the parts that keep it."""

    name: str
    bound: str
    designed: str
    kept: str


@dataclass(frozen=True)
class SpreadRow:
    """One metric over the parts: as designed, its percentiles, and its standard deviation."""

    name: str
    designed: str
    p5: str
    p50: str
    p95: str
    spread: str


@dataclass(frozen=True)
class CausesRow:
    """The leading causes of the spread of one metric, in words."""

    name: str
    causes: str


@dataclass(frozen=True)
class BudgetLine:
    """One tolerance: as specified, and the largest at which enough parts pass, with its interval or why there is none.

    ``tight``: the amount that is specified is too large.
    """

    name: str
    specified: str
    at_most: str
    interval: str
    tight: bool


@dataclass(frozen=True)
class DrawnRow:
    """One tolerance as it was drawn."""

    name: str
    amount: str
    distribution: str
    words: str


def metric_words(name: str) -> str:
    """Name of a metric for a reader; on a further receiver after that receiver's."""
    receiver, _, metric = name.rpartition(": ")
    words = _WORDS.get(metric, metric)
    return f"{receiver}: {words}" if receiver else capitalised(words)


def is_share(name: str) -> bool:
    """True for a metric that is shown in per cent."""
    return name.rpartition(": ")[2] in SHARES


def shown(name: str, value: float, unit: str = "") -> str:
    """A value of the metric ``name`` with its unit."""
    return percent(value, 2) if is_share(name) else with_unit(number(value, 3), unit)


def with_unit(words: str, unit: str) -> str:
    """A number and its unit."""
    return f"{words}{'' if unit in ('', '°') else ' '}{unit}"


def amount(name: str, value: float, unit: str) -> str:
    """Amount of the tolerance ``name`` with its unit; shares in per cent."""
    if name in _IN_PER_CENT:
        return f"{number(100.0 * value, 3)}\u2009%"
    return with_unit(number(value, 3), {"deg": "°", "um": "µm"}.get(unit, unit))


def pass_sentence(result: Yield) -> str:
    """A sentence on the parts that pass, with the confidence interval of their share."""
    found = result.pass_rate
    share = f"{percent(found.value)} (95\u2009% confidence: {percent(found.low)} to {percent(found.high)})"
    passed = round(found.value * result.parts)
    return f"Of {number(result.parts)} parts drawn from the tolerances {number(passed)} keep every bound: {share}."


def budget_sentence(result: Yield) -> str:
    """A sentence on the meaning of the budget; empty where there is none."""
    if result.budget is None:
        return ""
    wanted, parts = percent(result.budget.pass_rate, 0), number(result.budget.parts)
    return (
        f"The largest amount at which {wanted} of the parts pass, the other tolerances as specified; by {parts} parts. "
        "The interval is one standard error to either side. Red: less than specified."
    )


def bound_words(bound: MetricBound) -> str:
    """The bound alone: its sense, value and unit."""
    return f"{_SIGNS[bound.sense]} {shown(bound.metric, bound.bound, bound.unit)}"


def bound_rows(result: Yield) -> list[BoundRow]:
    """A row for each bound."""
    return [_bound_row(result, bound) for bound in result.bounds]


def _bound_row(result: Yield, bound: MetricBound) -> BoundRow:
    values, designed = result.column(bound.metric), result.metrics[bound.metric].designed
    return BoundRow(
        metric_words(bound.metric),
        bound_words(bound),
        shown(bound.metric, designed.value, bound.unit),
        percent(float(bound.kept_by(values).mean())),
    )


def spread_rows(result: Yield) -> list[SpreadRow]:
    """A row for each metric."""
    rows = []
    for name, each in result.metrics.items():
        values = (each.designed.value, each.p5, each.p50, each.p95, each.spread)
        designed, *of_parts = (shown(name, value, each.unit) for value in values)
        rows.append(SpreadRow(metric_words(name), designed, *(["undecided"] * 4 if each.undecided else of_parts)))
    return rows


def judged(result: Yield) -> list[str]:
    """Metrics that have a bound, in the order of the bounds."""
    return list(dict.fromkeys(bound.metric for bound in result.bounds))


def cause_rows(result: Yield) -> list[CausesRow]:
    """The leading causes of each metric that has a bound and that scatters."""
    found = [name for name in judged(result) if name in result.variance and not result.metrics[name].undecided]
    return [CausesRow(metric_words(name), causes_words(result.variance[name])) for name in found]


def causes_words(variance: Variance) -> str:
    """The leading causes with their shares of the variance, and that of several together."""
    return "; ".join(_causes(variance)) or NOTHING


def _causes(variance: Variance) -> Iterator[str]:
    for cause in variance.causes[:_LEADING]:
        if cause.share > _LEAST:
            metric = Metric(value=cause.share, standard_error=cause.standard_error)
            yield f"{cause.words} {share_words(metric)}"
    if variance.interactions.value > _LEAST:
        yield f"{TOGETHER} {share_words(variance.interactions)}"


def share_words(share: Metric) -> str:
    """A share of the variance in whole per cent, with its standard error."""
    value, error = percent(share.value, 0), share.standard_error
    return value if error is None else f"{value} ± {percent(error, 0)}"


def budget_lines(result: Yield) -> list[BudgetLine]:
    """A line for each tolerance, and last that for all of them together; none where it was not searched for."""
    found = result.budget
    return [] if found is None else [budget_line(row) for row in (*found.alone, found.together)]


def budget_line(row: BudgetRow) -> BudgetLine:
    """The line of one tolerance."""
    factor = row.tolerance == "all"
    specified = "× 1" if factor else amount(row.tolerance, row.specified, row.unit)

    def words(value: float) -> str:
        return f"× {number(value, 3)}" if factor else amount(row.tolerance, value, row.unit)

    if row.unlimited:
        times = f" ({number(row.searched_to / row.specified, 3)} times)" if row.specified > 0.0 and not factor else ""
        return BudgetLine(row.words, specified, f"above {words(row.searched_to)}", f"not searched beyond{times}", False)
    if row.at_most is None or row.low is None or row.high is None:
        why = "" if factor else "none is small enough: the others alone let too few parts pass"
        return BudgetLine(row.words, specified, NOTHING, why or "no factor is small enough", True)
    interval = f"{words(row.low)} to {words(row.high)}"
    return BudgetLine(row.words, specified, words(row.at_most), interval, row.at_most < row.specified)


def drawn_rows(result: Yield) -> list[DrawnRow]:
    """A row for each tolerance."""
    return [
        DrawnRow(
            each.words,
            amount(each.name, each.amount, each.unit),
            _DRAWN.get(each.distribution, each.distribution),
            _DISTRIBUTIONS.get(each.distribution, ""),
        )
        for each in result.tolerances
    ]


def worst_words(result: Yield, worst: WorstPart) -> str:
    """Judged metrics of one of the worst parts, each with its bound where it misses it."""
    found = []
    for name in judged(result):
        value = worst.metrics[name]
        missed = [each for each in result.bounds if each.metric == name and not each.kept_by(np.array(value))]
        ends = "".join(f", bound {bound_words(bound)}" for bound in missed)
        state = " (undecided)" if result.metrics[name].undecided else ""
        found.append(f"{metric_words(name)} {shown(name, value, result.metrics[name].unit)}{state}{ends}")
    return "; ".join(found)
