"""The dimensioned section: the body cut open in the plane of x and z, to scale, with its datum."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from lensforge.lens import Lens
from lensforge.report.drawing import BLUE, GREY, INK, WIDE, in_house_style, new_figure
from lensforge.report.section_figures import profile

_X = np.array([1.0, 0.0, 0.0])


@in_house_style
def dimensioned_section(lens: Lens) -> Figure:
    """Both halves of the section at y = 0; datum A is the plane z = 0, datum B the axis."""
    figure, axes = new_figure(WIDE, 4.4)
    inner, outer = profile(lens.inner, _X), profile(lens.outer, _X)
    for side in (1.0, -1.0):
        axes.add_patch(Polygon(half_section(lens, side), facecolor=BLUE, alpha=0.2, linewidth=0.0))
        axes.plot(*half_section(lens, side)[1:-1].T, color=INK, linewidth=1.0)
    low, high = (-lens.spec.base.height_mm if lens.spec.base.kind != "none" else 0.0), float(outer[:, 1].max())
    wide = max(np.abs(half_section(lens, side)[:, 0]).max() for side in (1.0, -1.0))
    step = 0.09 * (high - low + wide)
    axes.axvline(0.0, color=GREY, linewidth=0.7, linestyle="dashdot")
    axes.axhline(0.0, color=GREY, linewidth=0.7, linestyle="dashed")
    axes.text(-wide - 3.6 * step, 0.0, "A", bbox={"boxstyle": "square", "facecolor": "white"}, va="center")
    axes.text(0.0, high + 1.2 * step, "B", bbox={"boxstyle": "square", "facecolor": "white"}, ha="center")
    right = wide + 0.9 * step
    middle = len(outer) // 2
    _vertical(axes, right, 0.0, outer[middle, 1])
    _vertical(axes, right + 1.6 * step, 0.0, inner[middle, 1])
    if low < 0.0:
        _vertical(axes, right, low, 0.0)
    for row, curve in enumerate((inner, outer), start=1):
        _horizontal(axes, low - row * step, curve[0, 0], curve[-1, 0])
    if low < 0.0:
        _horizontal(axes, low - 3.0 * step, -half_width(lens, -1.0), half_width(lens, 1.0))
    axes.set(xlim=(-wide - 4.5 * step, wide + 5.0 * step), ylim=(low - 4.0 * step, high + 2.2 * step), aspect="equal")
    axes.set(xlabel="x (mm)", ylabel="z (mm)")
    return figure


def half_width(lens: Lens, side: float) -> float:
    """Distance (mm) from the axis to the base's outline along +x or -x, its flange apart."""
    base = lens.spec.base
    if base.kind == "square":
        return base.side_mm / 2.0
    return base.flat_mm if base.flat_mm is not None and side > 0.0 else base.diameter_mm / 2.0


def half_section(lens: Lens, side: float) -> Float[np.ndarray, "n 2"]:
    """The closed outline (x, z) in mm of the half on the side of +x (1) or -x (-1): from the outer apex around."""
    inner, outer = (profile(surface, side * _X) for surface in (lens.inner, lens.outer))
    middle = len(outer) // 2
    dome, cavity = outer[middle:], inner[middle:][::-1]
    base = lens.spec.base
    corners: list[tuple[float, float]] = []
    if base.kind != "none":
        edge, bottom = half_width(lens, side), -base.height_mm
        corners = [(dome[-1, 0], -base.relief_step_mm), (edge, -base.relief_step_mm)]
        if base.flange_diameter_mm is not None:
            shoulder, flange = bottom + base.flange_height_mm, base.flange_diameter_mm / 2.0
            corners += [(edge, shoulder), (flange, shoulder), (flange, bottom)]
        else:
            corners.append((edge, bottom))
        if base.pocket_diameter_mm is not None:
            pocket, ceiling = base.pocket_diameter_mm / 2.0, bottom + base.pocket_depth_mm
            corners += [(pocket, bottom), (pocket, ceiling), (cavity[0, 0], ceiling)]
        else:
            corners.append((cavity[0, 0], bottom))
    around = np.concatenate([dome, np.array(corners).reshape(-1, 2), cavity, dome[:1]])
    return around * np.array([side, 1.0])


def _vertical(axes: Axes, x: float, low: float, high: float) -> None:
    axes.annotate("", (x, low), (x, high), arrowprops={"arrowstyle": "<->", "linewidth": 0.7, "color": INK})
    axes.text(x, 0.5 * (low + high), f" {abs(high - low):.3f}", ha="left", va="center")


def _horizontal(axes: Axes, z: float, low: float, high: float) -> None:
    axes.annotate("", (low, z), (high, z), arrowprops={"arrowstyle": "<->", "linewidth": 0.7, "color": INK})
    axes.text(0.5 * (low + high), z, f"{high - low:.3f}", ha="center", va="bottom")
