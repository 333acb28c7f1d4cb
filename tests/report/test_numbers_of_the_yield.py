"""The page on tolerances and yield: each number on it is that of the study, also of limits with a unit of their own."""

import numpy as np
import pytest
from kept_figures import kept_figures
from made_yield import make_yield
from matplotlib.ticker import PercentFormatter
from page_places import places_of
from result_folders import make_results, small_lens
from shown_numbers import Place, problems
from told_apart import told_apart
from undrawn import undrawn
from wanted_yield import bar_numbers, curve_of, line_numbers, yield_numbers

from lensforge.light.evaluation_result import Light
from lensforge.made.tolerance_result import MetricBound, WorstPart
from lensforge.report.yield_page import render_yield
from lensforge.results import Conditions, Metric
from lensforge.runs.results import Results

_NAMES = {"nmse": "HV: light", "share_in_target": "wall: efficiency"}


def as_specified():
    """The bounds of the verdict, and a lens that was simulated."""
    lens = small_lens()
    return told_apart(make_yield(lens)), make_results(("evaluate",), lens)


def limits_of_the_spec():
    """A limit in W/m², two on another receiver; tolerances that are never small enough; causes that are not certain."""
    lens, found = small_lens(), make_yield(small_lens())
    metrics = {_NAMES[name]: each for name, each in found.metrics.items()} | {"wall: nmse": found.metrics["nmse"]}
    metrics["HV: light"] = metrics["HV: light"].model_copy(update={"unit": "W/m²"})
    variance = {_NAMES[name]: each for name, each in found.variance.items()} | {"wall: nmse": found.variance["nmse"]}
    first, *others = variance["HV: light"].causes
    unsure = first.model_copy(update={"standard_error": 0.4})
    variance["HV: light"] = variance["HV: light"].model_copy(update={"causes": (unsure, *others)})
    never = {"at_most": None, "low": None, "high": None}
    alone = [row.model_copy(update=never) if number == 2 else row for number, row in enumerate(found.budget.alone)]
    together = found.budget.together.model_copy(update={**never, "unlimited": True})
    table = np.column_stack([found.table, found.table[:, -2]])
    changed = found.model_copy(
        update={
            "columns": (*found.columns[:-2], *metrics), "table": table, "metrics": metrics, "variance": variance,
            "bounds": (
                MetricBound(metric="wall: nmse", sense="<=", bound=0.15, unit=""),  # kept by all
                MetricBound(metric="HV: light", sense=">=", bound=0.0295, unit="W/m²"),
                MetricBound(metric="wall: efficiency", sense=">=", bound=0.801, unit=""),
            ),
            "budget": found.budget.model_copy(update={"alone": tuple(alone), "together": together}),
            "worst": (
                WorstPart(part=3, metrics=dict(zip(metrics, (0.0244, 0.817, 0.0321), strict=True)), passes=False),
                WorstPart(part=27, metrics=dict(zip(metrics, (0.0444, 0.823, 0.0278), strict=True)), passes=True),
            ),
            "worst_maps": np.stack([np.eye(16), 2.0 * np.eye(16)]), "notes": (),
        }
    )  # fmt: skip
    return told_apart(changed), Results(lens, {})


def other_conditions():
    """A study by fewer rays, without causes and without a budget."""
    lens = small_lens()
    designed = {name: Metric(value=0.5 * each.p5) for name, each in make_yield(lens).metrics.items()}
    found = told_apart(make_yield(lens))
    metrics = {name: each.model_copy(update={"designed": designed[name]}) for name, each in found.metrics.items()}
    other = {"conditions": Conditions.of(rays=640), "budget": None, "variance": {}, "metrics": metrics, "parts": 12345}
    return found.model_copy(update=other), make_results((), lens)


@pytest.mark.parametrize("make", [as_specified, limits_of_the_spec, other_conditions])
def test_every_number_of_the_page_on_the_yield_is_that_of_the_study(make):
    found, results = make()
    with undrawn():
        places = places_of(render_yield(found, results, "yield.csv"))
    assert "\n".join(problems(places, yield_numbers(found, results))) == ""


@pytest.mark.parametrize("make", [as_specified, limits_of_the_spec, other_conditions])
def test_every_bar_and_curve_of_the_page_on_the_yield_is_that_of_the_study(make):
    found, results = make()
    with kept_figures() as figures:
        render_yield(found, results, "yield.csv")
    of_kind = {kind: [] for kind in ("distribution", "causes", "worst")}
    for name, (title, figure) in figures.items():
        of_kind[name.rstrip("0123456789")].append((title, figure.axes[0]))
    bars = [place for title, axes in of_kind["causes"] for place in _bars(title, axes)]
    assert "\n".join(problems(bars, bar_numbers(found))) == ""
    lines = [place for title, axes in of_kind["distribution"] for place in _lines(title, axes)]
    assert "\n".join(problems(lines, line_numbers(found))) == ""
    for title, axes in of_kind["distribution"]:
        np.testing.assert_allclose(axes.lines[0].get_xydata(), curve_of(found, title), rtol=1e-12)
    light = results.find(Light)
    wanted = [*([] if light is None else [light.first.map]), *found.worst_maps]
    np.testing.assert_array_equal([axes.images[0].get_array() for _, axes in of_kind["worst"]], wanted)


def _bars(title, axes):
    """Lengths of the bars, with half those of the lines on them."""
    bars = next(each for each in axes.containers if hasattr(each, "errorbar") and each.errorbar is not None)
    (errors,) = bars.errorbar.lines[2]
    names = [label.get_text() for label in axes.get_yticklabels()]
    for name, bar, ends in zip(names, bars, errors.get_segments(), strict=True):
        error = 0.5 * float(np.ptp(ends[:, 0]))
        yield Place(f"{title} / {name}", f"{bar.get_width():.6g} ± {error:.6g} {axes.get_xlabel()}")


def _lines(title, axes):
    """Places of the upright lines, which are labelled in the legend, and sides of the red areas."""
    ticks, factor, unit = axes.xaxis.get_major_formatter(), 1.0, ""
    if isinstance(ticks, PercentFormatter):
        factor, unit = 100.0 / ticks.xmax, ticks.symbol
    for line in axes.lines[1:]:
        yield Place(f"{title} / {line.get_label()}", f"{factor * line.get_xdata()[0]:.6g}{unit} on {axes.get_xlabel()}")
    ends = axes.get_xlim()
    for area in axes.patches:
        left, right = factor * area.get_x(), factor * (area.get_x() + area.get_width())
        side = f"above {left:.6g}" if np.isclose(right, factor * ends[1]) else f"below {right:.6g}"
        yield Place(f"{title} / red", f"{side}{unit}")
