"""Figures of light along lines across a receiver, and of the light within circles about its centre.

Images are indexed [row y, column x], y upwards; a ``chart`` is the receiver's. Of the far field places are labelled in
degrees from its axis.
"""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import map_coordinates

from lensforge.report.figure_style import BLUE, INK, NARROW, in_report_style, new_figure
from lensforge.results import Image
from lensforge.results.chart import WATTS, Chart, LightUnit

Ends = tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]

_LINE_HEIGHT = 2.4
_DASHED = (0, (4, 2))
_OFF_CENTRE, _BRIGHTER = 0.02, 1.05  # of the height and of the central row: a row worth its own line is beyond


@in_report_style
def line_comparison(
    line: Ends,
    wanted: Image,
    reached: Image,
    chart: Chart,
    unit: LightUnit = WATTS,
    names: tuple[str, str] = ("target", "simulated"),
) -> Figure:
    """Light along the straight ``line`` from one point (x, y) of the receiver's chart to another.

    ``names``: labels of ``wanted`` and ``reached``.
    """
    figure, axes = new_figure(NARROW, _LINE_HEIGHT)
    start, end = line
    reach = 0.5 * float(np.linalg.norm(end - start))
    position = np.linspace(-reach, reach, _samples(wanted))
    axes.plot(
        position,
        unit.per_watt * along(wanted, start, end, chart),
        label=names[0], color=INK, linestyle=_DASHED, linewidth=1.0,
    )  # fmt: skip
    axes.plot(position, unit.per_watt * along(reached, start, end, chart), label=names[1], color=BLUE)
    label_positions(axes, chart, reach)
    axes.set(ylabel=unit.label, xlim=(-reach, reach))
    axes.set_ylim(bottom=0.0)
    axes.grid(True)
    figure.legend(loc="outside upper right", ncols=2)
    return figure


@in_report_style
def encircled_energy(wanted: Image, reached: Image, chart: Chart) -> Figure:
    """The share of the receiver's flux within a circle around its centre, over the circle's radius."""
    figure, axes = new_figure(NARROW, 2.75)
    radius, share = encircled_share(wanted, chart)
    axes.plot(radius, share, color=INK, linestyle=_DASHED, linewidth=1.0, label="target")
    axes.plot(*encircled_share(reached, chart), color=BLUE, label="simulated, unfiltered")
    reach = float(radius[-1]) or 0.5 * max(chart.width, chart.height)  # 0 for a single pixel
    label_radii(axes, chart, reach)
    axes.set(ylabel="share of the receiver's flux", xlim=(0.0, reach), ylim=(0.0, 1.02))
    axes.grid(True)
    axes.legend(loc="lower right")
    return figure


def label_positions(axes: Axes, chart: Chart, reach: float) -> None:
    """Label the axis of positions that run as far as ``reach`` to either side of the middle of a line."""
    axes.set_xlabel(f"position on the line ({chart.unit_drawn})")
    chart.label_metres(axes.xaxis)
    if chart.far_field:
        chart.label_angles(axes, x=reach)


def label_radii(axes: Axes, chart: Chart, reach: float) -> None:
    """Label the axis of radii up to ``reach``."""
    axes.set_xlabel("angle from the axis (°)" if chart.far_field else f"radius around the centre ({chart.unit_drawn})")
    chart.label_metres(axes.xaxis)
    if chart.far_field:
        chart.label_angles(axes, x=reach)


def encircled_share(image: Image, chart: Chart) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Radii on the chart, and the share of the image's sum in pixels whose centres are no farther from its centre."""
    rows, columns = image.shape
    distance = np.hypot(chart.y(rows)[:, None], chart.x(columns)[None, :]).ravel()
    order = np.argsort(distance, kind="stable")
    gathered = np.cumsum(image.ravel()[order])
    radii = np.linspace(0.0, distance.max(), 200)
    within = np.searchsorted(distance[order], radii, side="right")
    share = np.concatenate([[0.0], gathered])[within]
    return radii, share / gathered[-1] if gathered[-1] > 0.0 else share


def along(
    image: Image, start: Float[np.ndarray, " 2"], end: Float[np.ndarray, " 2"], chart: Chart
) -> Float[np.ndarray, " k"]:
    """``image`` along the line from ``start`` to ``end`` (x, y on the chart), bilinear between pixels.

    At two points for each pixel of the longer side.
    """
    rows, columns = image.shape
    x, y = start[:, None] + (end - start)[:, None] * np.linspace(0.0, 1.0, _samples(image))
    places = np.stack([y / chart.height * rows + 0.5 * rows - 0.5, x / chart.width * columns + 0.5 * columns - 0.5])
    values: Float[np.ndarray, " k"] = map_coordinates(image, places, order=1, mode="nearest")
    return values


def profile_lines(target: Image, chart: Chart) -> list[tuple[str, Ends]]:
    """Names and ends of the lines y = 0, x = 0, and a third: the target's brightest row, else the diagonal.

    A pattern that is brightest on the axis gets its diagonal, where a square has its corners. In the far field that
    ends at the largest angle from the axis.
    """
    right, top = 0.5 * chart.width, 0.5 * chart.height
    sums = target.sum(axis=1)
    level = float(chart.y(len(target))[int(np.argmax(sums))])
    lines = [("y = 0", (-right, 0.0), (right, 0.0)), ("x = 0", (0.0, -top), (0.0, top))]
    if sums.max() > _BRIGHTER * sums[len(sums) // 2] and abs(level) > _OFF_CENTRE * chart.height:
        name = f"y = {chart.labelled(level):.4g}{'°' if chart.far_field else ' mm'} (brightest row)"
        lines.append((name, (-right, level), (right, level)))
    else:
        share = 0.5**0.5 if chart.far_field else 1.0
        name = "x = y (diagonal)" if chart.width == chart.height else "the diagonal"
        lines.append((name, (-share * right, -share * top), (share * right, share * top)))
    return [(name, (np.array(start), np.array(end))) for name, start, end in lines]


def _samples(image: Image) -> int:
    """Number of points on a line across ``image``."""
    return 2 * int(max(image.shape))
