"""The dimensioned section: the body cut in the xz plane, to scale, with its datum."""

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from lensforge.geometry.base_profile import base_corners
from lensforge.geometry.cutter_room import base_with_room
from lensforge.geometry.plan import lay_out, rim_radius
from lensforge.geometry.section import Curve, body_outlines
from lensforge.lens import Lens
from lensforge.report.figure_style import BLUE, GREY, INK, WIDE, in_report_style, new_figure

_BOX = {"boxstyle": "square", "facecolor": "white"}
_CLEAR = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"}
_WIDTH, _TALLEST = 1.5 * WIDE, 6.5  # inches

Span = tuple[float, float]


@in_report_style
def dimensioned_section(lens: Lens) -> Figure:
    """The section at y = 0; datum A is the plane z = 0, datum B the axis.

    Heights of the lens are to the right, those of its base to the left, all widths below.
    """
    outlines = body_outlines(lens, 0.0)
    low, high, wide = _extent(outlines)
    above, below = heights(lens, low)
    rows = widths(lens, outlines)
    step = 0.075 * (high - low + wide)
    left, right = -wide - (1.2 + 2.2 * len(below)) * step, wide + (0.8 + 2.2 * len(above)) * step
    bottom, top = low - (1.1 * len(rows) + 0.4) * step, high + 2.0 * step
    figure, axes = new_figure(_WIDTH, min(_WIDTH * (top - bottom) / (right - left) + 0.5, _TALLEST))
    for outline in outlines:
        axes.add_patch(Polygon(outline, facecolor=BLUE, alpha=0.2, linewidth=0.0))
        axes.add_patch(Polygon(outline, fill=False, edgecolor=INK, linewidth=1.0, joinstyle="miter"))
    for k, span in enumerate(above):
        _vertical(axes, wide + (0.7 + 2.2 * k) * step, span, 0.0, step)
    for k, span in enumerate(below):
        _vertical(axes, -wide - (0.7 + 2.2 * k) * step, span, -wide, -step)
    for k, span in enumerate(rows, start=1):
        _horizontal(axes, low - 1.1 * k * step, span, low, step)
    axes.plot([left, right], [0.0, 0.0], color=GREY, linewidth=0.7, linestyle="dashed")
    axes.plot([0.0, 0.0], [low - 0.3 * step, high + step], color=GREY, linewidth=0.7, linestyle="dashdot")
    axes.text(left, 0.0, "A", bbox=_BOX, va="center", ha="right")
    axes.text(0.0, high + step, "B", bbox=_BOX, ha="center")
    axes.set(xlim=(left - step, right), ylim=(bottom, top), aspect="equal", xlabel="x (mm)", ylabel="z (mm)")
    return figure


def _extent(outlines: list[Curve]) -> tuple[float, float, float]:
    """Lowest and highest z, and the largest distance from the axis."""
    points = np.concatenate(outlines)
    return float(points[:, 1].min()), float(points[:, 1].max()), float(np.abs(points[:, 0]).max())


def heights(lens: Lens, lowest_mm: float) -> tuple[list[Span], list[Span]]:
    """Heights (z from, z to) of the lens and of its base, smallest first."""
    apexes = [float(surface.radius(np.array([[0.0, 0.0, 1.0]]))[0]) for surface in (lens.inner, lens.outer)]
    base, found = base_with_room(lens), [(lowest_mm, 0.0)]
    if base.kind in ("cylinder", "square"):
        found += [(-base.step_mm, 0.0)] if base.step_mm > 0.0 else []
        found += [(lowest_mm, lowest_mm + base.pocket_depth_mm)] if base.pocket_diameter_mm is not None else []
        found += [(lowest_mm, lowest_mm + base.flange_height_mm)] if base.flange_diameter_mm is not None else []
    return [(0.0, apex) for apex in apexes], _by_size(found) if lowest_mm < 0.0 else []


def widths(lens: Lens, outlines: list[Curve]) -> list[Span]:
    """Widths (x from, x to) in the section, smallest first: rims, bore, wall of the step, pocket, base, flange."""
    base = base_with_room(lens)
    corners = base_corners(lay_out(lens.inner, lens.outer, base))
    turns = np.array([0.0, np.pi])
    found = {tuple(each.radius(turns)) for each in corners}
    found |= {tuple(rim_radius(surface)(turns)) for surface in (lens.inner, lens.outer)}
    spans = [(-float(left), float(right)) for right, left in found]
    if base.kind == "step":
        across = np.concatenate(outlines)[:, 0]
        spans.append((float(across.min()), float(across.max())))
    return _by_size(spans)


def _by_size(spans: list[Span]) -> list[Span]:
    return sorted(spans, key=lambda span: span[1] - span[0])


def _vertical(axes: Axes, x: float, span: Span, body: float, step: float) -> None:
    """Draw a height at ``x``, extension lines from ``body``; the number is on the side to which ``step`` points."""
    for z in span:
        _extension_line(axes, [body, x + 0.15 * step], [z, z])
    _arrows(axes, span, abs(step), lambda z: (x, z))
    side = "left" if step > 0.0 else "right"
    axes.text(x + 0.15 * step, sum(span) / 2.0, f"{span[1] - span[0]:.3f}", ha=side, va="center", bbox=_CLEAR)


def _horizontal(axes: Axes, z: float, span: Span, body: float, step: float) -> None:
    """Draw a width at height ``z``, extension lines from ``body``."""
    for x in span:
        _extension_line(axes, [x, x], [body, z - 0.15 * step])
    _arrows(axes, span, step, lambda x: (x, z))
    axes.text(sum(span) / 2.0, z + 0.1 * step, f"{span[1] - span[0]:.3f}", ha="center", va="bottom", bbox=_CLEAR)


def _extension_line(axes: Axes, x: list[float], z: list[float]) -> None:
    """Draw an extension line, from the body to a dimension."""
    axes.plot(x, z, color=INK, linewidth=0.4, alpha=0.5)


def _arrows(axes: Axes, span: Span, step: float, at: Callable[[float], Span]) -> None:
    """Draw arrows between the ends of ``span``, or, where that is too narrow for two heads, from outside."""
    low, high = span
    style = {"linewidth": 0.7, "color": INK, "shrinkA": 0.0, "shrinkB": 0.0, "mutation_scale": 8.0}
    if high - low > step:
        axes.annotate("", at(low), at(high), arrowprops={"arrowstyle": "<->", **style})
        return
    for end, start in ((low, low - 0.6 * step), (high, high + 0.6 * step)):
        axes.annotate("", at(end), at(start), arrowprops={"arrowstyle": "->", **style})
