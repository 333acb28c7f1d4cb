"""Numbers of the study of tolerances that its page and the report must show, by their label, each from its record."""

import numpy as np
from shown_numbers import shown
from wanted_frame import task_numbers

from lensforge.report.yield_rows import metric_words

_SHARES = ("efficiency", "share_in_target")
_IN_PER_CENT = ("source_flux", "source_size", "shrinkage")
_UNITS = {"deg": "°", "um": " µm", "": ""}
_DRAWN = {
    "truncated": "Gaussian, 2 σ = the amount, none beyond it",
    "normal": "Gaussian, 2 σ = the amount",
    "uniform": "anywhere within the amount",
    "Gaussian field": "a new shape for each part; the amount is its rms",
}
_SPREADS, _WORST, _BUDGET = "How far the light scatters", "The worst parts", "How large each tolerance may be"


def yield_numbers(found, results):
    """Entries of the page on the study ``found``."""
    yield from task_numbers(results.spec)
    yield from passing_numbers(found, "p", "A part passes if")
    yield from _cards(found)
    if found.conditions is not None:
        yield shown("p", "Under other conditions than the lens’s own: {} rays.", found.conditions.rays)
    yield from _spreads(found)
    if found.budget is not None:
        yield from budget_numbers(found, _BUDGET)
    yield from _worst(found)
    yield from _made(found)
    yield shown(f"{_WORST} / footer", f"Written by lensforge {results.lens.version}.")


def passing_numbers(found, sentence, table):
    """Entries of the parts that pass, and of the bounds that they must keep."""
    rate = found.pass_rate
    words = (
        "Of {} parts drawn from the tolerances {} keep every bound: "
        "{}\u2009% (95\u2009% confidence: {}\u2009% to {}\u2009%)."
    )
    shares = [100.0 * share for share in (rate.value, rate.low, rate.high)]
    yield shown(sentence, words, found.parts, round(rate.value * found.parts), *shares)
    for bound in found.bounds:
        row, designed = f"{table} / {metric_words(bound.metric)}", found.metrics[bound.metric].designed
        factor, unit = _of_metric(found, bound.metric)
        yield shown(f"{row} / Bound", f"{_sign(bound)} {{}}{unit}", factor * bound.bound)
        yield shown(f"{row} / As designed", f"{{}}{unit}", factor * designed.value)
        yield shown(f"{row} / Parts that keep it", "{}\u2009%", 100.0 * (~_missed(found, bound)).mean())


def _sign(bound):
    return "≤" if bound.sense == "<=" else "≥"


def _missed(found, bound):
    """True for parts of the table that miss ``bound``."""
    values = found.table[:, found.columns.index(bound.metric)]
    return values > bound.bound if bound.sense == "<=" else values < bound.bound


def _of_metric(found, name):
    """How many of the unit shown a metric is, and that unit."""
    if name.rpartition(": ")[2] in _SHARES:
        return 100.0, "\u2009%"
    unit = found.metrics[name].unit
    return 1.0, unit if unit in ("", "°") else f" {unit}"


def _cards(found):
    rate = found.pass_rate
    low, high = 100.0 * rate.low, 100.0 * rate.high
    yield shown("card / Parts that pass", "{}\u2009%", 100.0 * rate.value)
    yield shown("card / Parts that pass / note", "95 % confidence: {}\u2009% to {}\u2009%", low, high)
    metrics = list(dict.fromkeys(bound.metric for bound in found.bounds))
    failing = {each.metric: _missed(found, each).sum() for each in found.bounds}
    for name in sorted(metrics, key=lambda name: -failing[name])[: 2 if found.variance else 0]:
        cause, words = found.variance[name].causes[0], metric_words(name)
        share, error = 100.0 * cause.share, 100.0 * cause.standard_error
        card = f"card / Main cause, {words if ':' in name else words[0].lower() + words[1:]}"
        yield shown(card, "{}\u2009% ± {}\u2009%", share, error)
        yield shown(f"{card} / note", cause.words + ("" if share > 2.0 * error else "; not certain by so few parts"))
    if found.budget is not None:
        row, note = found.budget.together, "so that {}\u2009% pass"
        yield shown("card / Tolerances", "above × {}" if row.unlimited else "× {}", _most(row))
        yield shown("card / Tolerances / note", note, 100.0 * found.budget.pass_rate)
        if not row.unlimited:
            yield shown("card / Tolerances / note", "pass; × {} to × {}", row.low, row.high)


def _most(row):
    return row.searched_to if row.unlimited else row.at_most


def _spreads(found):
    yield shown(f"{_SPREADS} / columns", "As designed, 5 % of the parts are below, Half, 95 %, Standard deviation")
    for name, each in found.metrics.items():
        row, (factor, unit) = f"{_SPREADS} / {metric_words(name)}", _of_metric(found, name)
        for column, value in (
            ("As designed", each.designed.value),
            ("5 % of the parts are below", each.p5),
            ("Half", each.p50),
            ("95 %", each.p95),
            ("Standard deviation", each.spread),
        ):
            yield shown(f"{row} / {column}", f"{{}}{unit}", factor * value)
    for bound in found.bounds:
        factor, unit = _of_metric(found, bound.metric)
        if _is_far(found, bound.metric, bound.bound):
            caption = f"{_SPREADS} / {metric_words(bound.metric)} / figcaption"
            words = f"The bound, {_sign(bound)} {{}}{unit}, is far from all parts"
            yield shown(caption, words, factor * bound.bound)


def _is_far(found, name, value):
    """True for a value so far from all parts that a picture would show little else."""
    values = curve_of(found, metric_words(name))[:, 0]
    reach = 1.5 * (values[-1] - values[0])
    return not values[0] - reach <= value <= values[-1] + reach


def curve_of(found, title):
    """Values of all parts in their order, drawn to their mean until they scatter as without noise; share up to each."""
    name = next(name for name in found.metrics if metric_words(name) == title)
    values = np.sort(found.table[:, found.columns.index(name)])
    away = values - values.mean()
    drawn = values.mean() + away * found.metrics[name].spread / np.sqrt(away @ away / (len(away) - 1))
    return np.column_stack([drawn, 100.0 * (np.arange(len(drawn)) + 1) / len(drawn)])


def line_numbers(found):
    """Entries of the lines in the distributions: the value as designed, and the bound with its wrong side in red."""
    for name, each in found.metrics.items():
        words, designed, factor = metric_words(name), each.designed.value, _of_metric(found, name)[0]
        sign = " %" if factor == 100.0 else ""
        axis = f"{{}}{sign} on {words}" + (f" ({each.unit})" if each.unit else "")
        if not _is_far(found, name, designed):
            yield shown(f"{words} / as designed", axis, factor * designed)
        for bound in found.bounds:
            if bound.metric == name and not _is_far(found, name, bound.bound):
                yield shown(f"{words} / bound", axis, factor * bound.bound)
                side = "above" if bound.sense == "<=" else "below"
                yield shown(f"{words} / red", f"{side} {{}}{sign}", factor * bound.bound)


def bar_numbers(found):
    """Entries of the bars: the eight largest causes of each metric with a bound, and several together."""
    for name in {bound.metric: None for bound in found.bounds if bound.metric in found.variance}:
        variance, title = found.variance[name], metric_words(name)
        together = ("several together", variance.interactions.value, variance.interactions.standard_error)
        for words, share, error in (*((c.words, c.share, c.standard_error) for c in variance.causes[:8]), together):
            label = f"{title} / {words}"
            yield shown(label, "{} ± {} share of the variance (%)", 100.0 * share, 100.0 * error)


def budget_numbers(found, heading):
    """Entries of the largest amount of each tolerance."""
    budget = found.budget
    wanted = "The largest amount at which {}\u2009% of the parts pass, the other tolerances as specified; by {} parts."
    yield shown(f"{heading} / p", wanted, 100.0 * budget.pass_rate, budget.parts)
    for row in (*budget.alone, budget.together):
        label = f"{heading} / {row.words}"
        factor, unit, before = _of_tolerance(row.tolerance, row.unit)
        yield shown(f"{label} / Specified", *((f"{before}1",) if before else (f"{{}}{unit}", factor * row.specified)))
        if row.unlimited:
            yield shown(f"{label} / At most", f"above {before}{{}}{unit}", factor * row.searched_to)
            if not before:
                yield shown(f"{label} / Interval", "({} times)", row.searched_to / row.specified)
        elif row.at_most is None:
            yield shown(f"{label} / At most", "–")
        else:
            yield shown(f"{label} / At most", f"{before}{{}}{unit}", factor * row.at_most)
            interval = f"{before}{{}}{unit} to {before}{{}}{unit}"
            yield shown(f"{label} / Interval", interval, factor * row.low, factor * row.high)


def _of_tolerance(name, unit):
    """Factor, unit, and what stands before the amount of a tolerance."""
    if name == "all":
        return 1.0, "", "× "
    return (100.0, "\u2009%", "") if name in _IN_PER_CENT else (1.0, _UNITS.get(unit, f" {unit}"), "")


def _worst(found):
    judged = list(dict.fromkeys(bound.metric for bound in found.bounds))
    for each in found.worst:
        title = f"Part {each.part}: {'passes' if each.passes else 'fails'}"
        yield shown(f"{_WORST} / {title} / title", title)
        for name in judged:
            factor, unit = _of_metric(found, name)
            value, words, values = each.metrics[name], f"{metric_words(name)} {{}}{unit}", ()
            for bound in found.bounds:
                over = value - bound.bound if bound.sense == "<=" else bound.bound - value
                if bound.metric == name and over > 0.0:
                    words, values = f"{words}, bound {_sign(bound)} {{}}{unit}", (factor * bound.bound,)
            end = "." if name == judged[-1] else "; "
            yield shown(f"{_WORST} / {title} / figcaption", f"{words}{end}", factor * value, *values)


def _made(found):
    for each in found.tolerances:
        row = f"{_WORST} / Which tolerances were drawn / {each.words}"
        factor, unit, _ = _of_tolerance(each.name, each.unit)
        yield shown(f"{row} / Amount", f"{{}}{unit}", factor * each.amount)
        yield shown(f"{row} / In words", _DRAWN[each.distribution])
    made = "{} parts from a scrambled Sobol sequence, seed {}; {} rays for each part, the same for all; {} s."
    yield shown(f"{_WORST} / How it was made / p", made, found.parts, found.seed, found.rays, found.seconds)
