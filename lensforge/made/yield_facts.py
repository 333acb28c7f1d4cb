"""Facts of the studies of tolerances: who passes, how far the light spreads, by which causes, what each may be."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from lensforge.light.receiver_light import METRICS
from lensforge.made.tolerance_result import (
    FIELD,
    BudgetRow,
    CauseShare,
    ErrorRow,
    FluxNeeded,
    MetricBound,
    Sensitivity,
    WorstPart,
    Yield,
)
from lensforge.results import Fact, Group, Metric
from lensforge.results.case import Case
from lensforge.results.figure import facts_in
from lensforge.results.numerals import NOTHING, limit_text, percent, quantity
from lensforge.results.verdict import CERTAIN
from lensforge.spec.tolerances_section import amount_words

TOGETHER = "interactions"
UNCERTAIN = "not significant with so few parts"
_SHARES = ("efficiency", "share_in_target")  # shown in per cent
_UNITS = {"deg": "°", "um": "µm"}
_LEADING = 3  # causes that are named
_LEAST = 0.005  # share of the variance of a cause that is named
_DISTRIBUTIONS = {
    "truncated": ("truncated", "Gaussian, 2 σ = the amount, none beyond it"),
    "normal": ("normal", "Gaussian, 2 σ = the amount"),
    "uniform": ("uniform", "anywhere within the amount"),
    FIELD: ("random shape", "a new shape for each part; the amount is its rms"),
}


def yield_facts(study: Yield) -> list[Group]:
    """A group of the parts that pass, then rows of bounds, spreads, causes and budget."""
    return [
        Group("yield", "Yield", tuple(_passing(study))),
        *application_rows(study),
        *bound_rows(study),
        *spread_rows(study),
        *cause_rows(study),
        *budget_rows(study),
    ]


def sensitivity_facts(study: Sensitivity) -> list[Group]:
    """The lens as designed, then a row for each tolerance at its end, that with the largest effect first.

    Of a lens for several LEDs the light as designed with each of them, then the rows of each, which its name tells
    apart.
    """
    designed = []
    changes = []
    for case in study.cases():
        led = case.result
        before = [
            (limit.name, limit.change.changed(value=limit.value.value - limit.change.value, standard_error=None))
            for row in led.rows[:1]
            for limit in row.limits
        ]
        facts = (*_of_limits(before), *facts_in(led.nominal), Fact("rays", "Rays", led.rays))
        designed.append(Group("nominal", case.title("As designed"), facts))
        rows = sorted(led.rows, key=_effect, reverse=True)
        changes += [_change(case, row) for row in rows]
    return [*designed, *changes]


def application_rows(study: Yield) -> list[Group]:
    """A row for each application: parts that hold its class, the figure nearest to its bound, and the main cause."""
    rows = []
    for entry in study.roads:
        rate = entry.pass_rate
        main = "undecided: within the ray noise"
        if entry.variance is not None:
            certain = entry.variance.certain[:1]
            named = [f"{cause.words}, {Fact.share('', '', _share(cause)).text}" for cause in certain]
            main = named[0] if named else UNCERTAIN
        nearest = f"{entry.nearest.removeprefix(f'{entry.name}: ')}, of {percent(entry.nearest_share)} of the parts"
        facts = (
            Fact("lighting_class", "Class", entry.lighting_class),
            Fact.share("holds", "Yield", rate.value),
            Fact("confidence", "95\u2009% confidence", f"{percent(rate.low)} to {percent(rate.high)}"),
            Fact("nearest", "Most critical figure", nearest),
            Fact("main", "Main cause", main),
        )
        rows.append(Group("application", metric_label(entry.name), facts))
    return rows


def bound_rows(study: Yield) -> list[Group]:
    """A row for each bound that a part must keep."""
    rows = []
    for bound in study.bounds:
        designed = study.metrics[bound.metric].designed.value
        within = float(bound.kept_by(study.column(bound.metric)).mean())
        limit = Fact("bound", "Limit", bound_words(bound))
        facts = (limit, of_metric("designed", "As designed", bound.metric, designed, bound.unit))
        rows.append(Group("bound", metric_label(bound.metric), (*facts, Fact.share("kept", "Parts within", within))))
    return rows


def spread_rows(study: Yield) -> list[Group]:
    """A row for each metric over the parts: as designed, its percentiles, its standard deviation."""
    rows = []
    for name, spread in study.metrics.items():
        facts = [of_metric("designed", "As designed", name, spread.designed.value, spread.unit)]
        for key, label, value in (
            ("p5", "5th percentile", spread.p5),
            ("p50", "Median", spread.p50),
            ("p95", "95th percentile", spread.p95),
            ("spread", "Standard deviation", spread.spread),
        ):
            undecided = Fact(key, label, "undecided")
            facts.append(undecided if spread.undecided else of_metric(key, label, name, value, spread.unit))
        noise = quantity(spread.standard_error, spread.unit, digits=2)
        note = f"the ray noise of a part, {noise}, exceeds the spread" if spread.undecided else ""
        rows.append(Group("spread", metric_label(name), tuple(facts), note))
    return rows


def cause_rows(study: Yield) -> list[Group]:
    """The leading causes of each metric that has a bound and that scatters."""
    return [
        Group("causes", metric_label(name), tuple(_causes(study, name)))
        for name in judged_metrics(study)
        if name in study.variance and not study.metrics[name].undecided
    ]


def budget_rows(study: Yield) -> list[Group]:
    """A row for each tolerance, and last that for all of them together; none where it was not searched for."""
    budget = study.budget
    return [] if budget is None else [budget_row(row) for row in (*budget.alone, budget.together)]


def budget_row(row: BudgetRow) -> Group:
    """One tolerance: as specified, and the largest at which enough parts pass, with its interval or why there is none.

    The state fails if the specified amount is too large.
    """
    factor = row.tolerance == "all"

    def amount_text(value: float) -> str:
        return f"× {quantity(value, digits=3)}" if factor else amount_words(row.tolerance, value, row.unit)

    specified = amount_text(1.0 if factor else row.specified)
    times = ""
    if row.unlimited:
        if row.specified > 0.0 and not factor:
            times = f" ({quantity(row.searched_to / row.specified, digits=3)} times)"
        most = f"above {amount_text(row.searched_to)}"
        interval = f"not searched beyond{times}"
    elif row.at_most is None or row.low is None or row.high is None:
        why = "the other tolerances alone give too low a yield"
        most = NOTHING
        interval = "no factor is small enough" if factor else why
    else:
        most = amount_text(row.at_most)
        interval = f"{amount_text(row.low)} to {amount_text(row.high)}"
    tight = not row.unlimited and (row.at_most is None or row.at_most < row.specified)
    facts = (
        Fact("specified", "Specified", specified),
        Fact("at_most", "At most", most, state="fail" if tight else "pass"),
        Fact("interval", "Interval", interval),
    )
    return Group("budget", row.words, facts)


def drawn_rows(study: Yield) -> list[Group]:
    """A row for each tolerance as it was drawn."""
    rows = []
    for tolerance in study.tolerances:
        name, description = _DISTRIBUTIONS.get(tolerance.distribution, (tolerance.distribution, ""))
        size = Fact("amount", "Amount", amount_words(tolerance.name, tolerance.amount, tolerance.unit))
        facts = (size, Fact("distribution", "Distribution", name), Fact("words", "In words", description))
        rows.append(Group("drawn", tolerance.words, facts))
    return rows


def pass_sentence(study: Yield) -> str:
    """A sentence on the parts that pass, with the confidence interval of their share."""
    rate = study.pass_rate
    passed = quantity(round(rate.value * study.parts))
    between = f"{percent(rate.low)} to {percent(rate.high)}"
    share = f"{percent(rate.value)} (95\u2009% confidence: {between})"
    parts = f"{quantity(study.parts)} parts" + (f" of {quantity(study.lamps)} lamps each" if study.lamps > 1 else "")
    every = f" with each of {quantity(len(study.leds))} LEDs" if study.leds else ""
    return f"Yield {share}: {passed} of {parts} drawn from the tolerances meet all limits{every}."


def budget_sentence(study: Yield) -> str:
    """A sentence on the meaning of the budget; empty if there is none."""
    if study.budget is None:
        return ""
    wanted = percent(study.budget.pass_rate)
    parts = quantity(study.budget.parts)
    return (
        f"Largest amount of each tolerance for a yield of {wanted}, the others as specified, from {parts} parts. "
        "Interval: ± one standard error. Red: less than specified."
    )


def worst_phrase(study: Yield, worst: WorstPart) -> str:
    """Judged metrics of one of the worst parts, each with its bound if it misses that."""
    phrases = []
    for name in judged_metrics(study):
        value = worst.metrics[name]
        missed = [bound for bound in study.bounds if bound.metric == name and not bound.kept_by(np.array([value]))[0]]
        ends = "".join(f", limit {bound_words(bound)}" for bound in missed)
        fact = of_metric("", metric_label(name), name, value, study.metrics[name].unit)
        state = " (undecided)" if study.metrics[name].undecided else ""
        phrases.append(f"{fact.label} {fact.text}{state}{ends}")
    return "; ".join(phrases)


def metric_label(name: str) -> str:
    """Display name of a metric; on a further receiver after that receiver's."""
    receiver, colon, metric = name.rpartition(": ")
    label = METRICS.get(metric, metric)
    return f"{receiver}{colon}{label}" if receiver else f"{label[:1].upper()}{label[1:]}"


def is_share(name: str) -> bool:
    """True for a metric that is shown in per cent."""
    last = name.rpartition(": ")[2]
    return last in _SHARES or last.endswith("share of the flux")


def of_metric(key: str, label: str, name: str, value: float, unit: str) -> Fact:
    """A value of the metric ``name``."""
    return Fact.share(key, label, value) if is_share(name) else Fact(key, label, value, unit, digits=3)


def bound_words(bound: MetricBound) -> str:
    """Display text of a bound: sense, value and unit."""
    percents = is_share(bound.metric)
    value, unit = (100.0 * bound.bound, "%") if percents else (bound.bound, bound.unit)
    return limit_text(bound.sense, value, unit)


def judged_metrics(study: Yield) -> list[str]:
    """Metrics that have a bound, in the order of the bounds."""
    return list(dict.fromkeys(bound.metric for bound in study.bounds))


def failing_first(study: Yield) -> list[str]:
    """Metrics that have a bound, that with the most failing parts first."""
    failing = dict.fromkeys(judged_metrics(study), 0.0)
    for bound in study.bounds:
        failing[bound.metric] += float((~bound.kept_by(study.column(bound.metric))).mean())
    return sorted(failing, key=lambda name: -failing[name])


def _passing(study: Yield) -> Iterator[Fact]:
    """Main numbers: the parts that pass, what decides, and by how much all tolerances may be scaled."""
    low, high = percent(study.pass_rate.low), percent(study.pass_rate.high)
    yield Fact.share("pass_rate", "Yield", study.pass_rate.value, f"95\u2009% confidence: {low} to {high}")
    for led in study.leds:
        yield Fact.share("passes_with", f"Yield with {led}", float(study.passing_with(led).mean()))
    yield Fact("parts", "Parts", study.parts)
    if study.lamps > 1:
        yield Fact("lamps", "Lamps of each part", study.lamps, note="drawn apart")
    yield Fact("rays", "Rays of each part", study.rays)
    for name in [name for name in failing_first(study) if name in study.variance][:2]:
        label = f"Main cause, {metric_label(name)}"
        for cause in study.variance[name].certain[:1]:
            yield Fact.share("main_cause", label, _share(cause), cause.words)
        if not study.variance[name].certain:
            yield Fact("main_cause", label, UNCERTAIN)
    if study.budget is not None:
        most, interval = (budget_row(study.budget.together).fact(key) for key in ("at_most", "interval"))
        note = f"one factor on all, for a yield of {percent(study.budget.pass_rate)}; {interval.text}"
        yield Fact("together", "Tolerances together", most.value, note=note)
        yield Fact.share("wanted", "Required yield", study.budget.pass_rate)
    yield from _remedies(study)


def _remedies(study: Yield) -> Iterator[Fact]:
    """The least tightening of one tolerance that reaches the required yield if it is missed; the flux for it."""
    if study.budget is not None and study.pass_rate.value < study.budget.pass_rate:
        row = study.budget.cheapest
        wanted = percent(study.budget.pass_rate)
        of_parts = f"by {quantity(study.budget.parts)} parts"
        if row is not None:
            specified, most, interval = (budget_row(row).fact(key).text for key in ("specified", "at_most", "interval"))
            change = f"{row.words}, from {specified} to {most}"
            note = f"for a yield of {wanted}, the others as specified; {interval}, {of_parts}"
        elif study.budget.reached:
            change = "none"
            note = f"{of_parts} alone the yield is {wanted} or more"
        else:
            change = "none is enough"
            note = f"no tolerance alone, however small, gives a yield of {wanted}, {of_parts}"
        yield Fact("cheapest", "Smallest tightening", change, note=note)
    if study.flux is not None:
        yield _flux(study.flux)


def _flux(flux: FluxNeeded) -> Fact:
    wanted = f"for a yield of {percent(flux.pass_rate)}, tolerances as specified"
    if flux.factor is None:
        most = "no part passes at any flux"
        if flux.best is not None:
            most = f"× {quantity(flux.best, digits=4)} gives the highest, {percent(flux.most)}"
        return Fact("flux", "Required LED flux", "none is enough", note=f"{wanted}; {most}")
    low, factor = (f"× {quantity(multiple, digits=4)}" for multiple in (flux.low, flux.factor))
    between = f"{low} at least" if flux.high is None else f"{low} to × {quantity(flux.high, digits=4)}"
    return Fact("flux", "Required LED flux", factor, note=f"{wanted}; {between}")


def _share(cause: CauseShare) -> Metric:
    return Metric(value=cause.share, standard_error=cause.standard_error)


def _causes(study: Yield, name: str) -> Iterator[Fact]:
    """The leading causes with their shares of the variance, and that of several together, where they are certain."""
    variance = study.variance[name]
    together = study.variance[name].interactions
    named = [cause for cause in variance.certain[:_LEADING] if cause.share > _LEAST]
    yield from (Fact.share(cause.tolerance, cause.words, _share(cause)) for cause in named)
    stands_out = together.value > max(_LEAST, CERTAIN * (together.standard_error or 0.0))
    if stands_out:
        yield Fact.share("together", TOGETHER, together)
    elif not named:
        yield Fact("together", "Causes", UNCERTAIN)


def _effect(row: ErrorRow) -> float:
    """Largest change of a limit's deciding value, relative to it; without limits that of the NMSE."""
    if not row.limits:
        return abs(row.change.nmse.value)
    return max(abs(limit.change.value) / max(abs(limit.value.value), 1e-300) for limit in row.limits)


def _of_limits(named: Iterable[tuple[str, Metric]]) -> Iterator[Fact]:
    for number, (name, metric) in enumerate(named):
        fact = Fact.share if is_share(name) else Fact.measured
        yield fact(f"limit_{number}", metric_label(name), metric)


def _change(case: Case[Sensitivity], row: ErrorRow) -> Group:
    size = Fact("amount", "Amount", row.amount, _UNITS.get(row.unit, row.unit), digits=3)
    limits = _of_limits((limit.name, limit.change) for limit in row.limits)
    changes = (replace(fact, is_square=False) for fact in facts_in(row.change))
    return Group("error", case.title(row.name), (size, *limits, *changes))
