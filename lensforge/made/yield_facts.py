"""Facts of the studies of tolerances: who passes, how far the light spreads, by which causes, what each may be."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from lensforge.light.receiver_light import METRICS
from lensforge.made.tolerance_result import (
    FIELD,
    UNCERTAIN,
    BudgetRow,
    ErrorRow,
    FluxNeeded,
    MetricBound,
    Sensitivity,
    WorstPart,
    Yield,
)
from lensforge.results import Fact, Group, Metric
from lensforge.results.case import Case
from lensforge.results.fact import FactState
from lensforge.results.figure import facts_in
from lensforge.results.numerals import limit_text, percent, quantity
from lensforge.results.verdict import CERTAIN
from lensforge.spec.tolerances_section import amount_words

TOGETHER = "interactions"
_LEADING = 3  # causes that are named
_LEAST = 0.005  # share of the variance of a cause that is named
_UNITS = {"deg": "°", "um": "µm"}
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
        facts = (*_of_limits(before), *facts_in(led.nominal), *facts_in(led))
        designed.append(Group("nominal", case.title("As designed"), facts))
        rows = sorted(led.rows, key=_effect, reverse=True)
        changes += [_change(case, row) for row in rows]
    return [*designed, *changes]


def application_rows(study: Yield) -> list[Group]:
    """A row for each application: parts that hold its class, the figure nearest to its bound, and the main cause."""
    return [Group("application", metric_label(entry.name), tuple(facts_in(study, (), entry))) for entry in study.roads]


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
        facts = tuple(
            Fact(fact.key, fact.label, "undecided")
            if spread.undecided and fact.key != "designed"
            else of_metric(fact.key, fact.label, name, fact.metric.value, spread.unit)
            for fact in facts_in(study, (), spread)
        )
        noise = quantity(spread.standard_error, spread.unit, digits=2)
        note = f"the ray noise of a part, {noise}, exceeds the spread" if spread.undecided else ""
        rows.append(Group("spread", metric_label(name), facts, note))
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
    state: FactState = "fail" if row.is_tight else "pass"
    facts = (replace(fact, state=state) if fact.key == "at_most" else fact for fact in facts_in(row))
    return Group("budget", row.words, tuple(facts))


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
    share = f"{percent(rate.value)} (95\u2009% confidence: {rate.interval})"
    parts = f"{quantity(study.parts)} parts" + (f" of {quantity(study.lamps)} lamps each" if study.lamps > 1 else "")
    every = f" with each of {quantity(len(study.leds))} LEDs" if study.leds else ""
    return f"Yield {share}: {passed} of {parts} drawn from the tolerances meet all limits{every}."


def budget_sentence(study: Yield) -> str:
    """A sentence on the meaning of the budget; empty if there is none."""
    if study.budget is None:
        return ""
    parts = quantity(study.budget.parts)
    return (
        f"Largest amount of each tolerance for a yield of {study.budget.wanted}, the others as specified, "
        f"from {parts} parts. Interval: ± one standard error. Red: less than specified."
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
    label = str(METRICS[metric].label) if metric in METRICS else metric
    return f"{receiver}{colon}{label}" if receiver else f"{label[:1].upper()}{label[1:]}"


def is_share(name: str) -> bool:
    """True for a metric that is shown in per cent."""
    last = name.rpartition(": ")[2]
    is_metric = last in METRICS and METRICS[last].unit == "%"
    return is_metric or last.endswith("share of the flux")


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
    pass_rate, *drawn = facts_in(study)
    yield pass_rate
    for led in study.leds:
        yield Fact.share("passes_with", f"Yield with {led}", float(study.passing_with(led).mean()))
    yield from drawn
    for name in [name for name in failing_first(study) if name in study.variance][:2]:
        label = f"Main cause, {metric_label(name)}"
        for cause in study.variance[name].certain[:1]:
            yield Fact.share("main_cause", label, cause.metric, cause.words)
        if not study.variance[name].certain:
            yield Fact("main_cause", label, UNCERTAIN)
    if study.budget is not None:
        yield from facts_in(study, (), study.budget)
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


def _causes(study: Yield, name: str) -> Iterator[Fact]:
    """The leading causes with their shares of the variance, and that of several together, where they are certain."""
    variance = study.variance[name]
    together = study.variance[name].interactions
    named = [cause for cause in variance.certain[:_LEADING] if cause.share > _LEAST]
    yield from (Fact.share(cause.tolerance, cause.words, cause.metric) for cause in named)
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
