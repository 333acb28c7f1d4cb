"""Figures of a lens and its search: sections with rays, and curves over the steps."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.section import body_outlines
from lensforge.light.ray_lines import trace_fan
from lensforge.light.simulation import TracedLens
from lensforge.results.figure_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    NARROW,
    ORANGE,
    RED,
    WIDE,
    in_report_style,
    new_figure,
)
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Level
from lensforge.surfaces.placed_bodies import depths
from lensforge.surfaces.placed_bodies import reach_mm as bodies_reach_mm

_FAN_DEG = np.linspace(-75.0, 75.0, 21)
_CUT_NODES = 401  # along a side of the raster on which further bodies are cut
_PLACE = (0.11, 0.13, 0.87, 0.78)  # of the axes of a section: left, bottom, width and height; the legend is above
_MARGIN = 1.3  # half the width of the drawing over the largest radius


@in_report_style
def lens_section(
    lens: Lens,
    azimuth_deg: float,
    outline_mm: Float[np.ndarray, "k 3"] | None,
    reach: float | None = None,
    traced: TracedLens | None = None,
) -> Figure:
    """The section at ``azimuth_deg``; ``outline_mm`` is the source's, None if it is not known.

    ``reach``: half the width of the drawing (mm), by default from the size of the lens. Also drawn: the paraboloid that
    must fit into the cavity, the maximum radius, and rays, through ``traced`` where their tables are made already.
    """
    figure = Figure(figsize=(WIDE, 3.3))
    axes = figure.add_axes(_PLACE)
    across = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0.0])
    outlines = body_outlines(lens, azimuth_deg)
    reach = reach or reach_mm(lens)
    _draw_body(axes, outlines)
    _draw_further_bodies(axes, lens, across, reach)
    _draw_fan(axes, lens, across, outline_mm, reach, traced)
    _draw_constraints(axes, lens)
    lowest = min(float(outline[:, 1].min()) for outline in outlines)
    if outline_mm is not None:
        _draw_source(axes, outline_mm @ across, outline_mm[:, 2])
        lowest = min(lowest, float(outline_mm[:, 2].min()))
    axes.set(xlim=(-reach, reach), ylim=(lowest - 0.08 * reach, reach), aspect="equal", anchor="N")
    name = {0.0: "x", 90.0: "y"}.get(azimuth_deg, f"across, at {azimuth_deg:g}°")
    axes.set(xlabel=f"{name} (mm)", ylabel="z (mm)")
    figure.legend(loc="upper center", ncols=5, handlelength=1.3, columnspacing=1.0)
    return figure


def reach_mm(lens: Lens) -> float:
    """Half the width (mm) of a drawing that holds the lens, its maximum radius, and the bodies behind it."""
    largest = float(lens_boundaries(lens)[1].radius(lens.directions(2000)).max())
    return _MARGIN * max(largest, lens.spec.constraints.max_radius_mm, bodies_reach_mm(lens.media.bodies))


def _draw_body(axes: Axes, outlines: list[Float[np.ndarray, "_ 2"]]) -> None:
    for number, outline in enumerate(outlines):
        label = "lens" if number == 0 else None
        axes.add_patch(Polygon(outline, facecolor=BLUE, alpha=0.2, linewidth=0.0, label=label))
        axes.add_patch(Polygon(outline, fill=False, edgecolor=INK, linewidth=1.0, joinstyle="miter"))


def _draw_further_bodies(axes: Axes, lens: Lens, across: Float[np.ndarray, " 3"], reach: float) -> None:
    """The cuts through further bodies, between their faces and above the planes in which they end."""
    place = np.linspace(-reach, reach, _CUT_NODES)
    points = place[None, :, None] * across + place[:, None, None] * np.array([0.0, 0.0, 1.0])
    flat = points.reshape(-1, 3)
    for number, body in enumerate(lens.media.bodies):
        outer, inner = (depths(body, flat, inner=is_inner) for is_inner in (False, True))
        height = body.pose.to_local_points(flat)[:, 2]
        within = np.where(height > 0.0, np.minimum(np.minimum(outer, -inner), height), height)
        within = within.reshape(_CUT_NODES, _CUT_NODES)
        colour = (GREY, GREEN)[number % 2]
        axes.contourf(place, place, within, levels=[0.0, np.inf], colors=[colour], alpha=0.35)
        axes.contour(place, place, within, levels=[0.0], colors=[INK], linewidths=0.7)
        axes.add_patch(Polygon(np.zeros((1, 2)), facecolor=colour, alpha=0.35, label=body.name))


def _draw_fan(
    axes: Axes,
    lens: Lens,
    across: Float[np.ndarray, " 3"],
    outline_mm: Float[np.ndarray, "k 3"] | None,
    reach: float,
    traced: TracedLens | None,
) -> None:
    """Rays from the centre of the source that start in the section, on the side to which its axis points."""
    theta = np.radians(_FAN_DEG)
    axis = np.array(lens.spec.in_first_state.source.pose.axis)
    directions = np.sin(theta)[:, None] * across + np.cos(theta)[:, None] * np.array([0.0, 0.0, 1.0])
    directions = directions[directions @ axis > 0.0]
    centre = np.zeros(3) if outline_mm is None else 0.5 * (outline_mm.min(axis=0) + outline_mm.max(axis=0))
    paths = trace_fan(lens, np.tile(centre, (len(directions), 1)), directions, 2.0 * reach, traced)
    for index, path in enumerate(paths):
        label = "rays" if index == 0 else None
        axes.plot(path @ across, path[:, 2], color=ORANGE, linewidth=0.6, label=label)


def _draw_constraints(axes: Axes, lens: Lens) -> None:
    limits = lens.spec.constraints
    position = np.linspace(-limits.cavity_radius_mm, limits.cavity_radius_mm, 121)
    height = limits.cavity_height_mm * (1.0 - (position / limits.cavity_radius_mm) ** 2)
    axes.plot(position, height, color=GREEN, linewidth=1.1, label="room for the LED")
    style: dict[str, Any] = {"color": GREY, "linestyle": (0, (3, 2)), "linewidth": 0.8}
    if lens.spec.lens.radius_about_axis:
        for side in (-1.0, 1.0):
            axes.axvline(side * limits.max_radius_mm, label="max. radius" if side > 0.0 else None, **style)
        return
    theta = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 181)
    circle = limits.max_radius_mm * np.array([np.sin(theta), np.cos(theta)])
    axes.plot(*circle, label="max. distance", **style)


def _draw_source(axes: Axes, position: Float[np.ndarray, " k"], height: Float[np.ndarray, " k"]) -> None:
    """Silhouette of the emitting area, seen across the section: a line where it is seen edge-on."""
    if np.ptp(height) > 0.0:
        corners = np.column_stack([position, height])
        axes.add_patch(Polygon(corners, facecolor=RED, edgecolor=RED, linewidth=3.0, joinstyle="bevel", label="source"))
        return
    ends = [position.min(), position.max()]
    level = [height[0], height[0]]
    axes.plot(ends, level, color=RED, linewidth=3.0, solid_capstyle="butt", label="source")


_CURVE_HEIGHT = 2.5
_CONSTRAINT_CURVES = {
    "cavity_clearance_mm": ("cavity", GREEN),
    "wall_margin_mm": ("thickness", BLUE),
    "radius_margin_mm": ("radius", ORANGE),
    "largest_wall_margin_mm": ("max. wall", INK),
    "height_margin_mm": ("height", RED),
    "keep_out_clearance_mm": ("keep-out", GREY),
}
_CURVE_COLOURS = {"loss": INK, "nmse": BLUE, "efficiency": GREEN}
_LINEAR_MM = 0.01  # the scale is linear within, so that it includes 0


@in_report_style
def history(levels: Sequence[Level], quantity: Literal["loss", "nmse", "efficiency"]) -> Figure:
    """``quantity`` over the steps of all ``levels``; a band for each level with its number of free functions."""
    figure, axes = new_figure(NARROW, _CURVE_HEIGHT)
    for start, level in _draw_levels(axes, levels):
        values = np.array(getattr(level, quantity), dtype=np.float64)
        axes.plot(_steps(start, values), values, color=_CURVE_COLOURS[quantity])
    axes.set_ylabel({"nmse": "NMSE", "loss": "merit function"}.get(quantity, quantity))
    above_zero = all(value > 0.0 for level in levels for value in getattr(level, quantity))
    if quantity != "efficiency" and above_zero:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    elif quantity == "efficiency":
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=" %"))
    return figure


@in_report_style
def constraint_history(levels: Sequence[Level]) -> Figure:
    """The least value (mm) of each constraint over the steps; below 0 it is violated."""
    figure, axes = new_figure(NARROW, _CURVE_HEIGHT)
    for start, level in _draw_levels(axes, levels):
        for name, (label, colour) in _CONSTRAINT_CURVES.items():
            if name not in level.constraints:
                continue
            values = np.array(level.constraints[name], dtype=np.float64)
            axes.plot(_steps(start, values), values, color=colour, label=label if start == 0 else None)
    axes.set_yscale("symlog", linthresh=_LINEAR_MM, linscale=0.5)
    axes.set(ylabel="min. margin (mm)")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "−")))
    low, high = axes.get_ylim()
    low = min(low, -_LINEAR_MM)
    axes.axhspan(low, 0.0, color=RED, alpha=0.12, linewidth=0)
    axes.axhline(0.0, color=RED, linewidth=0.8)
    axes.set_ylim(low, high)
    figure.legend(loc="outside lower right", ncols=3, handlelength=1.3, columnspacing=1.0)
    return figure


_LEVEL_ROWS = 1.01, 1.075  # of the axes' height: a level may be narrower than its number


def _steps(start: int, values: np.ndarray) -> np.ndarray:
    return np.arange(start, start + len(values)) + 1


def _draw_levels(axes: Axes, levels: Sequence[Level]) -> list[tuple[int, Level]]:
    starts = []
    start = 0
    for index, level in enumerate(levels):
        end = start + len(level.nmse)
        if index % 2:
            axes.axvspan(start + 0.5, end + 0.5, color=INK, alpha=0.06, linewidth=0)
        place = 0.5 * (start + end + 1), _LEVEL_ROWS[index % 2]
        axes.text(*place, f"{level.functions}", transform=axes.get_xaxis_transform(), ha="center", va="bottom")
        starts.append((start, level))
        start = end
    axes.set(xlabel="step", xlim=(0.5, max(start, 1) + 0.5))
    axes.grid(True, axis="y")
    return starts
