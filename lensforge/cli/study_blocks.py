"""Studies on the screen: effect of each tolerance, yield, sweep, accuracy against time."""

from collections.abc import Iterator

from lensforge.cli.rounded import count, figure, in_percent, measured, share
from lensforge.cli.screen import Block, Row
from lensforge.made.tolerance_result import BudgetRow, ErrorRow, MetricSpread, Sensitivity, Yield
from lensforge.results import Metric

_MOST_ERRORS, _MOST_METRICS, _MOST_CAUSES, _MOST_AMOUNTS, _MOST_BOUNDS = 10, 3, 3, 5, 4


def sensitivity_block(found: Sensitivity) -> Block:
    """The tolerances that change the light by most, each at its end."""
    ordered = sorted(found.rows, key=_effect, reverse=True)
    rows = [("As designed", f"NMSE {_value(found.nominal.nmse)}, efficiency {_percent(found.nominal.efficiency)}")]
    rows += [(f"{row.amount:g} {row.unit}", _change(row)) for row in ordered[:_MOST_ERRORS]]
    if len(ordered) > _MOST_ERRORS:
        rows.append(("", f"and {len(ordered) - _MOST_ERRORS} that change less, in the record"))
    title = f"Change of the light by each tolerance at its end (largest first; {count(found.rays)} rays each)"
    return Block(title, rows)


def _effect(row: ErrorRow) -> float:
    return 0.0 if row.change.nmse is None else abs(row.change.nmse.value)


def _change(row: ErrorRow) -> str:
    parts = [f"NMSE {_value(row.change.nmse)}", f"efficiency {_percent(row.change.efficiency)}"]
    if row.change.uniformity is not None:
        parts.append(f"uniformity {measured(row.change.uniformity)}")
    return f"{row.name}: {', '.join(parts)}"


def _value(metric: Metric | None) -> str:
    return "not known" if metric is None else measured(metric)


def _percent(metric: Metric | None) -> str:
    return "not known" if metric is None else in_percent(metric)


def yield_block(found: Yield) -> Block:
    """The share that passes, the spread of the metrics with its causes, and what each tolerance may be."""
    rate = found.pass_rate
    title = f"Yield: {share(rate.value)} of {count(found.parts)} parts pass"
    rows = [("Confidence", f"95 % that it is {share(rate.low)} to {share(rate.high)}; {count(found.rays)} rays a part")]
    rows += [("Must keep", str(bound)) for bound in found.bounds[:_MOST_BOUNDS]]
    for name, spread in list(found.metrics.items())[:_MOST_METRICS]:
        rows.append((name, _spread(spread)))
        rows += _causes(found, name)
    rows += _budget(found)
    return Block(title, [*rows, *(("Note", note) for note in found.notes)])


def _spread(spread: MetricSpread) -> str:
    if spread.undecided:
        noise = figure(spread.standard_error or 0.0, digits=2)
        why = f"a part's ray noise of {noise} outweighs their spread"
        return f"designed {measured(spread.designed)}; the parts are undecided: {why}"
    low, middle, high = (figure(value, digits=3) for value in (spread.p5, spread.p50, spread.p95))
    return f"designed {measured(spread.designed)}; of the parts 5 % below {low}, half below {middle}, 95 % below {high}"


def _causes(found: Yield, name: str) -> Iterator[Row]:
    if name in found.variance and not found.metrics[name].undecided:
        causes = found.variance[name].causes[:_MOST_CAUSES]
        shares = (Metric(value=each.share, standard_error=each.standard_error) for each in causes)
        words = (f"{in_percent(part)} {each.words}" for part, each in zip(shares, causes, strict=True))
        yield "  by", ", ".join(words)


def _budget(found: Yield) -> Iterator[Row]:
    """The tolerances that leave the least room first."""
    if found.budget is None:
        return
    for row in sorted(found.budget.alone, key=_room)[:_MOST_AMOUNTS]:
        yield "At most", f"{row.words}: {budget_words(row)}"
    yield "All together", f"by the factor {budget_words(found.budget.together)}"


def _room(row: BudgetRow) -> float:
    if row.unlimited or row.specified == 0.0:
        return float("inf")
    return 0.0 if row.at_most is None else row.at_most / row.specified


def budget_words(row: BudgetRow) -> str:
    """Largest amount of a tolerance, beside the one that is specified."""
    unit = f" {row.unit}" if row.unit else ""
    specified = f"(specified {row.specified:.3g}{unit})"
    if row.unlimited:
        return f"above {row.searched_to:.3g}{unit} {specified}"
    if row.at_most is None:
        return f"no amount is small enough: the others alone let too few parts pass {specified}"
    return f"{row.at_most:.3g}{unit}, {row.low:.2g} to {row.high:.2g} {specified}"
