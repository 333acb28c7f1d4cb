"""Figures of light on a receiver: maps, their difference, and isolines.

Images are irradiance in W/m^2, or in the far field intensity in W/sr, indexed [row y, column x], y upwards, and are
drawn in the unit of light given to the figure; a ``chart`` is the receiver's.
"""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle
from PIL import Image as PictureFile

from lensforge.report.figure_style import INK, NARROW, add_colour_bar, in_report_style, new_map
from lensforge.report.numerals import number
from lensforge.results import Image
from lensforge.results.chart import WATTS, Chart, LightUnit, angles_to, on_chart

ISO_SHARES = {0.1: "#6a4fc4", 0.25: "#2f7fd1", 0.5: "#1f9e89", 0.75: "#d18a1f", 0.9: "#d6453d"}  # of the level: colour
MOST_DRAWN = 256  # pixels along the longer side of a map: as many as a screen shows in a fifth of its width
_ROUNDED = 1.0 + 1e-9  # of the top of a scale: an image that just reaches it is not beyond
_VALUES_FIT = 0.7  # height over width of the axes: the values of the isolines stand beside them
_ON_DARK, _ON_PALE = ("white", 0.35), (INK, 0.25)  # colour and opacity of circles of constant angle


@in_report_style
def irradiance_map(
    image: Image,
    chart: Chart,
    top: float,
    outline: Image | None = None,
    mask: Bool[np.ndarray, "m n"] | None = None,
    unit: LightUnit = WATTS,
    width: float = NARROW,
    frame: Chart | None = None,
) -> Figure:
    """``image`` in false colour from 0 to ``top`` (W/m^2 or W/sr), with the line at half of the peak of ``outline``.

    Where ``image`` is brighter than ``top``, the colour bar ends in an arrow. ``mask``: pixels, of any size, in which
    uniformity is measured; their border is dashed. ``width``: of the figure, in inches. ``frame``: what the axes show,
    by default ``chart``.
    """
    frame = frame or chart
    figure, axes, bar = new_map(width, tall=frame.height / frame.width)
    shown = _show(axes, unit.per_watt * image, chart, "inferno", 0.0, unit.per_watt * top, frame)
    _draw_angles(axes, chart, _ON_DARK)
    if outline is not None and min(outline.shape) > 1 and outline.max() > 0.0:
        line = drawn(outline)
        x, y = chart.x(line.shape[1]), chart.y(line.shape[0])
        axes.contour(x, y, line, levels=[0.5 * line.max()], colors="white", linewidths=0.7, alpha=0.85)
    if mask is not None and mask.any():
        _draw_border(axes, mask, chart)
    add_colour_bar(bar, shown, unit.label, "max" if image.max() > _ROUNDED * top else "neither")
    return figure


@in_report_style
def isolines(image: Image, chart: Chart, level: float, unit: LightUnit = WATTS) -> Figure:
    """Lines of equal light at the ``ISO_SHARES`` of ``level`` (W/m^2 or W/sr), with the value of each."""
    figure, axes, scale = new_map(tall=max(chart.height / chart.width, _VALUES_FIT))
    image = drawn(image)
    colours = list(ISO_SHARES.values())
    if min(image.shape) > 1:  # one row of pixels has no lines
        x, y = chart.x(image.shape[1]), chart.y(image.shape[0])
        axes.contour(x, y, image, levels=[share * level for share in ISO_SHARES], colors=colours, linewidths=0.9)
    chart.label(axes)
    _frame(axes, chart)
    axes.set_aspect("equal")
    if chart.far_field:
        _draw_angles(axes, chart, _ON_PALE)
    else:
        axes.grid(True)
    _draw_values(scale, level, unit)
    return figure


@in_report_style
def difference_map(difference: Image, chart: Chart, unit: LightUnit = WATTS) -> Figure:
    """A difference of light, its colours centred on zero."""
    figure, axes, bar = new_map(tall=chart.height / chart.width)
    difference = unit.per_watt * difference
    reach = float(np.abs(difference).max()) or 1.0
    shown = _show(axes, difference, chart, "RdBu_r", -reach, reach)
    _draw_angles(axes, chart, _ON_PALE)
    add_colour_bar(bar, shown, f"difference ({unit.symbol})")
    return figure


def drawn(image: Image) -> Float[np.ndarray, "q s"]:
    """``image``, or its area means on ``MOST_DRAWN`` pixels along its longer side if it has more."""
    rows, columns = image.shape
    if max(rows, columns) <= MOST_DRAWN:
        return image
    size = [max(1, round(MOST_DRAWN * side / max(rows, columns))) for side in (columns, rows)]
    picture = PictureFile.fromarray(image.astype(np.float32))
    return np.asarray(picture.resize((size[0], size[1]), PictureFile.Resampling.BOX), dtype=np.float64)


def _show(
    axes: Axes, image: Image, chart: Chart, colours: str, low: float, high: float, frame: Chart | None = None
) -> AxesImage:
    axes.spines[:].set_visible(False)
    shown = axes.imshow(
        drawn(image), origin="lower", extent=chart.extent, cmap=colours, vmin=low, vmax=high, interpolation="none"
    )
    frame = frame or chart
    frame.label(axes)
    _frame(axes, frame)
    return shown


def _frame(axes: Axes, chart: Chart) -> None:
    """Show the chart, no more and no less."""
    left, right, lower, upper = chart.extent
    axes.set(xlim=(left, right), ylim=(lower, upper))


def _draw_angles(axes: Axes, chart: Chart, style: tuple[str, float]) -> None:
    """Circles of the angles from the axis that are labelled; none where the chart is in mm."""
    colour, opacity = style
    for angle in angles_to(0.5 * min(chart.width, chart.height)) if chart.far_field else []:
        circle = Circle((0.0, 0.0), on_chart(angle), fill=False, edgecolor=colour, linewidth=0.5, alpha=opacity)
        axes.add_patch(circle)


def _draw_border(axes: Axes, mask: Bool[np.ndarray, "m n"], chart: Chart) -> None:
    """Border of a region, dashed; where it reaches the edge of the chart, along that edge."""
    rows, columns = mask.shape
    x, y = _framed(chart.x(columns), chart.width), _framed(chart.y(rows), chart.height)
    inside = np.pad(mask.astype(np.float64), 1)
    axes.contour(x, y, inside, levels=[0.5], colors="white", linewidths=0.7, linestyles=[(0, (4, 3))])


def _framed(centres: Float[np.ndarray, " k"], length: float) -> Float[np.ndarray, " l"]:
    """Centres of pixels, with one more before and after them."""
    pitch = length / len(centres)
    return np.concatenate([[centres[0] - pitch], centres, [centres[-1] + pitch]])


def _draw_values(scale: Axes, level: float, unit: LightUnit) -> None:
    """The colour, share and value of each isoline."""
    for row, (share, colour) in enumerate(ISO_SHARES.items()):
        height = 0.08 + 0.16 * row
        scale.plot([0.0, 1.0], [height, height], color=colour, linewidth=2.0)
        text = f"{100.0 * share:.0f} %\n{number(unit.per_watt * share * level, 3)}"
        scale.text(1.6, height, text, va="center", fontsize=7.5, linespacing=1.15)
    scale.text(0.0, 0.98, unit.symbol, va="top", fontsize=8.0)
    scale.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    scale.set_axis_off()
