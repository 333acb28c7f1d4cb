"""Figures of the yield: distributions of the light over the parts, causes of their spread, light of the worst parts."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from lensforge.made.tolerance_result import MetricBound, Variance
from lensforge.report.figure_style import BLUE, GREY, INK, NARROW, RED, WIDE, in_report_style, new_figure
from lensforge.report.yield_rows import TOGETHER

_HEIGHT = 2.6
_FAR = 1.5  # of the width of the distribution: a bound farther away would squeeze it
_BARS = 8
_BAR_HEIGHT = 0.24  # inches
_DASHED = (0, (4, 2))


@in_report_style
def distribution(
    values: Float[np.ndarray, " n"], designed: float, bounds: Sequence[MetricBound], label: str, *, share: bool
) -> Figure:
    """Share of the parts with at most the value on the axis, the value as designed, and the bounds.

    The wrong side of a bound is red. A bound or a designed value far from all parts is left out: see :func:`beyond`.
    """
    figure, axes = new_figure(NARROW, _HEIGHT)
    ordered = np.sort(values)
    axes.step(ordered, 100.0 * np.arange(1, len(values) + 1) / len(values), where="post", color=BLUE, label="parts")
    near = [each.bound for each in bounds if not beyond(values, each.bound)]
    if not beyond(values, designed):
        axes.axvline(designed, color=INK, linewidth=1.0, linestyle=_DASHED, label="as designed")
        near.append(designed)
    ends = np.array([*ordered[[0, -1]], *near])
    margin = 0.04 * float(np.ptp(ends)) or 0.01 * abs(float(ends[0])) or 1.0
    left, right = float(ends.min()) - margin, float(ends.max()) + margin
    for number, each in enumerate(each for each in bounds if not beyond(values, each.bound)):
        wrong = (each.bound, right) if each.sense == "<=" else (left, each.bound)
        axes.axvspan(*wrong, color=RED, alpha=0.1, linewidth=0.0)
        axes.axvline(each.bound, color=RED, label="bound" if number == 0 else None)
    axes.set(xlim=(left, right), ylim=(0.0, 101.0), xlabel=label, ylabel="parts with at most this (%)")
    axes.xaxis.set_major_locator(MaxNLocator(5))
    if share:
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, symbol=" %"))
    axes.grid(True)
    figure.legend(loc="outside upper left", ncols=3, handlelength=1.3)
    return figure


def beyond(values: Float[np.ndarray, " n"], value: float) -> bool:
    """True for a value that lies much farther from the parts than these from each other."""
    low, high = float(values.min()), float(values.max())
    reach = _FAR * (high - low)
    return not low - reach <= value <= high + reach


@in_report_style
def cause_bars(variance: Variance) -> Figure:
    """The largest shares of a metric's variance and that of several tolerances together, with standard errors."""
    causes = variance.causes[:_BARS]
    names = [*(cause.words for cause in causes), TOGETHER]
    values = 100.0 * np.array([*(cause.share for cause in causes), variance.interactions.value])
    errors = 100.0 * np.array(
        [*(cause.standard_error for cause in causes), variance.interactions.standard_error or 0.0]
    )
    figure, axes = new_figure(WIDE, 0.6 + _BAR_HEIGHT * len(names))
    colours = [BLUE] * len(causes) + [GREY]
    axes.barh(np.arange(len(names)), values, xerr=errors, color=colours, ecolor=INK, error_kw={"elinewidth": 0.8})
    axes.set_yticks(np.arange(len(names)), names)
    axes.invert_yaxis()
    axes.set(xlabel="share of the variance (%)")
    axes.axvline(0.0, color=INK, linewidth=0.6)
    axes.grid(True, axis="x")
    return figure
