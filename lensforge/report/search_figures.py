"""Figures of the search: merit function, efficiency and constraints over its steps; lens and light after a level."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from lensforge.report.figure_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    NARROW,
    ORANGE,
    RED,
    add_colour_bar,
    in_report_style,
    new_figure,
)
from lensforge.report.irradiance_figures import drawn
from lensforge.results.chart import WATTS, Chart, LightUnit
from lensforge.search.design_result import Level

_CURVE_HEIGHT = 2.5
_CONSTRAINT_CURVES = {
    "cavity_clearance_mm": ("cavity", GREEN),
    "wall_margin_mm": ("thickness", BLUE),
    "radius_margin_mm": ("radius", ORANGE),
    "largest_wall_margin_mm": ("largest wall", INK),
    "height_margin_mm": ("height", RED),
    "keep_out_clearance_mm": ("keep-out", GREY),
}
_CURVE_COLOURS = {"loss": INK, "nmse": BLUE, "efficiency": GREEN}
_LINEAR_MM = 0.01  # the scale is linear within, so that it includes 0
_LEVEL_WIDTH, _LEVEL_HEIGHT = 2.7, 5.0
_SLOPES, _LIGHT = "coolwarm", "inferno"
_SHADE = 0.35  # brightness lost by a facet turned away from the light
_TOWARDS_LIGHT = np.array([0.35, -0.75, 0.56])


@in_report_style
def history(levels: Sequence[Level], quantity: Literal["loss", "nmse", "efficiency"]) -> Figure:
    """``quantity`` over the steps of all ``levels``; a band for each level with its number of free functions."""
    figure, axes = new_figure(NARROW, _CURVE_HEIGHT)
    for start, level in _draw_levels(axes, levels):
        values = np.array(getattr(level, quantity), dtype=np.float64)
        axes.plot(_steps(start, values), values, color=_CURVE_COLOURS[quantity])
    axes.set_ylabel({"nmse": "NMSE", "loss": "merit function"}.get(quantity, quantity))
    if quantity != "efficiency" and _positive(levels, quantity):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
    elif quantity == "efficiency":
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    return figure


def _positive(levels: Sequence[Level], quantity: str) -> bool:
    """True where a logarithmic scale can show it: penalties with multipliers may make the merit function negative."""
    return all(value > 0.0 for level in levels for value in getattr(level, quantity))


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


@in_report_style
def snapshot_figure(
    surface_mm: Float[np.ndarray, "i j 3"],
    slope: Float[np.ndarray, "i j"],
    irradiance: Float[np.ndarray, "h w"],
    chart: Chart,
    unit: LightUnit = WATTS,
    steepest: float | None = None,
    top: float | None = None,
) -> Figure:
    """Above: ``surface_mm`` coloured by ``slope`` (mm/rad) from -``steepest`` to it. Below: the light, 0 to ``top``.

    ``chart``: of the receiver. ``steepest`` and ``top`` (W/m^2 or W/sr) are by default the largest values; give them to
    put several levels on one scale.
    """
    figure = Figure(figsize=(_LEVEL_WIDTH, _LEVEL_HEIGHT))
    steepest = steepest or float(np.abs(slope).max()) or 1.0
    top = top or float(irradiance.max()) or 1.0
    slopes = ScalarMappable(Normalize(-steepest, steepest), _SLOPES)
    _draw_surface(figure, surface_mm, slope, slopes)
    add_colour_bar(_bar(figure, 0.625), slopes, "dρ/dθ (mm/rad)", orientation="horizontal")
    axes = figure.add_axes((0.15, 0.15, 0.7, 0.7 * _LEVEL_WIDTH / _LEVEL_HEIGHT))
    light = axes.imshow(
        unit.per_watt * drawn(irradiance), origin="lower", extent=chart.extent, cmap=_LIGHT, vmin=0.0,
        vmax=unit.per_watt * top, interpolation="none",
    )  # fmt: skip
    axes.set_axis_off()
    add_colour_bar(_bar(figure, 0.12), light, unit.label, orientation="horizontal")
    return figure


def _bar(figure: Figure, height: float) -> Axes:
    return figure.add_axes((0.15, height, 0.7, 0.016))


def _draw_surface(
    figure: Figure, points: Float[np.ndarray, "i j 3"], slope: Float[np.ndarray, "i j"], slopes: ScalarMappable
) -> None:
    """Draw the surface from above, as one raster image within the vector drawing."""
    axes: Any = figure.add_axes((0.0, 0.64, 1.0, 0.36), projection="3d", computed_zorder=False)
    colours = np.asarray(colormaps[_SLOPES](slopes.norm(slope[:-1, :-1])))
    colours[..., :3] *= _brightness(points)[..., None]
    x, y, z = np.moveaxis(points, -1, 0)
    surface = axes.plot_surface(
        x, y, z, facecolors=colours, rcount=len(x), ccount=x.shape[1], linewidth=0, antialiased=False, shade=False
    )
    surface.set_rasterized(True)
    reach = float(np.abs(points).max())
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(0.0, reach))
    axes.set_box_aspect((2.0, 2.0, 1.0), zoom=1.6)
    axes.view_init(elev=32.0, azim=-60.0)
    axes.set_axis_off()


def _brightness(points: Float[np.ndarray, "i j 3"]) -> Float[np.ndarray, "k l"]:
    """Brightness of each facet, never so low that its colour is illegible."""
    down, around = points[1:, :-1] - points[:-1, :-1], points[1:, 1:] - points[1:, :-1]
    normal = np.cross(down, around)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    lit: Float[np.ndarray, "k l"] = np.clip(normal @ _TOWARDS_LIGHT, 0.0, 1.0)
    return 1.0 - _SHADE * (1.0 - lit)
