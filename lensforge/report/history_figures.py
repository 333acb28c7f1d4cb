"""How the search went: loss, efficiency and constraints at every step, level by level."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from lensforge.optimisation.design import Level
from lensforge.report.drawing import BLUE, GREEN, INK, NARROW, ORANGE, RED, in_house_style, new_figure

_HEIGHT = 2.5
_CONSTRAINTS = {
    "cavity_clearance_mm": ("cavity", GREEN),
    "wall_margin_mm": ("thickness", BLUE),
    "radius_margin_mm": ("radius", ORANGE),
}
_COLOURS = {"loss": INK, "nmse": BLUE, "efficiency": GREEN}
_LINEAR_MM = 0.01  # the scale is linear within, so that 0 has a place on it


@in_house_style
def history(levels: Sequence[Level], quantity: Literal["loss", "nmse", "efficiency"]) -> Figure:
    """``quantity`` over the steps of all ``levels``; a band for each level with its number of free functions."""
    figure, axes = new_figure(NARROW, _HEIGHT)
    for start, level in _draw_levels(axes, levels):
        values = np.array(getattr(level, quantity), dtype=np.float64)
        axes.plot(_steps(start, values), values, color=_COLOURS[quantity])
    axes.set_ylabel({"nmse": "NMSE"}.get(quantity, quantity))
    if quantity != "efficiency" and _positive(levels, quantity):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    elif quantity == "efficiency":
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    return figure


def _positive(levels: Sequence[Level], quantity: str) -> bool:
    """Whether a logarithmic scale holds it: a penalty with multipliers may turn the whole loss negative."""
    return all(value > 0.0 for level in levels for value in getattr(level, quantity))


@in_house_style
def constraint_history(levels: Sequence[Level]) -> Figure:
    """The least value (mm) of each constraint over the steps; what lies below 0 is not allowed."""
    figure, axes = new_figure(NARROW, _HEIGHT)
    for start, level in _draw_levels(axes, levels):
        for name, (label, colour) in _CONSTRAINTS.items():
            values = np.array(level.constraints.get(name, ()), dtype=np.float64)
            axes.plot(_steps(start, values), values, color=colour, label=label if start == 0 else None)
    axes.set_yscale("symlog", linthresh=_LINEAR_MM, linscale=0.5)
    axes.set(ylabel="least margin (mm)")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "−")))
    low, high = axes.get_ylim()
    low = min(low, -_LINEAR_MM)
    axes.axhspan(low, 0.0, color=RED, alpha=0.12, linewidth=0)
    axes.axhline(0.0, color=RED, linewidth=0.8)
    axes.set_ylim(low, high)
    figure.legend(loc="outside lower right", ncols=3, handlelength=1.3, columnspacing=1.0)
    return figure


def _steps(start: int, values: np.ndarray) -> np.ndarray:
    return np.arange(start, start + len(values)) + 1


def _draw_levels(axes: Axes, levels: Sequence[Level]) -> list[tuple[int, Level]]:
    """Bands and numbers of functions; (steps before it, level) for each of ``levels``."""
    starts, start = [], 0
    for index, level in enumerate(levels):
        end = start + len(level.nmse)
        if index % 2:
            axes.axvspan(start + 0.5, end + 0.5, color=INK, alpha=0.06, linewidth=0)
        middle = 0.5 * (start + end + 1)
        axes.text(middle, 1.02, f"{level.functions}", transform=axes.get_xaxis_transform(), ha="center", va="bottom")
        starts.append((start, level))
        start = end
    axes.set(xlabel="step", xlim=(0.5, max(start, 1) + 0.5))
    axes.grid(True, axis="y")
    return starts
