"""How the search went: loss and efficiency at every step, level by level."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from lensforge.report.drawing import BLUE, GREEN, INK, WIDE, in_house_style, new_figure
from lensforge.report.records import Level


@in_house_style
def history(levels: Sequence[Level], quantity: Literal["nmse", "efficiency"]) -> Figure:
    """``quantity`` over the steps of all ``levels``; a band for each level with its number of free functions."""
    figure, axes = new_figure(WIDE, 2.5)
    start = 0
    for index, level in enumerate(levels):
        values = np.array(getattr(level, quantity), dtype=np.float64)
        end = start + len(values)
        axes.plot(np.arange(start, end) + 1, values, color=BLUE if quantity == "nmse" else GREEN)
        if index % 2:
            axes.axvspan(start + 0.5, end + 0.5, color=INK, alpha=0.06, linewidth=0)
        middle = 0.5 * (start + end + 1)
        axes.text(middle, 1.02, f"{level.functions}", transform=axes.get_xaxis_transform(), ha="center", va="bottom")
        start = end
    axes.set(xlabel="step", xlim=(0.5, max(start, 1) + 0.5))
    axes.grid(True, axis="y")
    if quantity == "nmse":
        axes.set(yscale="log", ylabel="NMSE")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set(ylabel="efficiency")
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    return figure
