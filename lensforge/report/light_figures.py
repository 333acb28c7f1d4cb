"""Figures of light on a receiver: maps, their difference, isolines, lines across, encircled energy, flux budgets.

Images are irradiance in W/m^2, or in the far field intensity in W/sr, indexed [row y, column x], y upwards, and are
drawn in the unit of light given to the figure; a ``chart`` is the receiver's."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle, Polygon
from matplotlib.ticker import PercentFormatter
from PIL import Image as PictureFile
from scipy.ndimage import map_coordinates

from lensforge.light.receiver_light import Flux, MissedByCause
from lensforge.light.seen_lens import SeenLens
from lensforge.results import Image
from lensforge.results.chart import WATTS, Chart, LightUnit, angles_to, on_chart
from lensforge.results.figure_style import (
    BLUE,
    DASHED,
    GREEN,
    INK,
    NARROW,
    ORANGE,
    add_colour_bar,
    in_report_style,
    new_figure,
    new_map,
)
from lensforge.results.numerals import number
from lensforge.results.plots import draw_outline

# Shares of the target's peak: darker places need not be seen.
_WANTED = 0.01
_LANDED = 0.05
_MARGIN = 1.2  # of the frame over what it holds
_WORTH = 0.85  # of the receiver's sides: a frame that cuts less away is no gain
_LONGEST = 1e4  # luminance beside a scale: above in thousands
_FLATTEST = 0.5  # height over width; at most it is 1, where the receiver is wide enough


def lit_frame(target: Image, reached: Image, chart: Chart) -> Chart:
    """The centred part of ``chart`` with target and light ([row y, column x], one unit); all, where most is lit."""
    peak = float(target.max())
    lit = (target > _WANTED * peak) | (reached > _LANDED * peak)
    if not peak > 0.0 or not lit.any():
        return chart
    rows, columns = lit.shape
    wide = _MARGIN * _reach(chart.x(columns), np.asarray(lit.any(axis=0)), chart.width / columns)
    high = _MARGIN * _reach(chart.y(rows), np.asarray(lit.any(axis=1)), chart.height / rows)
    width = min(chart.width, max(wide, high))
    height = min(chart.height, max(high, _FLATTEST * wide))
    if width > _WORTH * chart.width and height > _WORTH * chart.height:
        return chart
    return Chart(width, height, chart.far_field)


def _reach(centres: Float[np.ndarray, " k"], lit: Bool[np.ndarray, " k"], pitch: float) -> float:
    """Length, centred, that holds the ``lit`` pixels."""
    return 2.0 * float(np.abs(centres[lit]).max()) + pitch


ISO_SHARES = {0.1: "#6a4fc4", 0.25: "#2f7fd1", 0.5: "#1f9e89", 0.75: "#d18a1f", 0.9: "#d6453d"}  # of the peak: colour
MOST_DRAWN = 256  # pixels along the longer side of a map: as many as a screen shows in a fifth of its width
_ROUNDED = 1.0 + 1e-9  # of the top of a scale: an image that just reaches it is not beyond
_VALUES_FIT = 0.7  # height over width of the axes: the values of the isolines stand beside them
# Colour and opacity of circles of constant angle.
ON_DARK = ("white", 0.35)
ON_PALE = (INK, 0.25)


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
    light = drawn(unit.per_watt * image)
    most = unit.per_watt * top
    shown = show(axes, light, chart, ON_DARK, frame, cmap="inferno", vmin=0.0, vmax=most)
    if outline is not None:
        draw_outline(axes, drawn(outline), chart)
    if mask is not None and mask.any():
        draw_border(axes, mask, chart)
    add_colour_bar(bar, shown, unit.label, "max" if image.max() > _ROUNDED * top else "neither")
    return figure


def with_level(figure: Figure, level: float) -> Figure:
    """The ``figure`` of a map with a line across its colour bar at ``level``, in the unit of the bar."""
    figure.axes[1].axhline(level, color="white", linewidth=1.2)
    return figure


@in_report_style
def seen_lens(seen: SeenLens, unit: LightUnit) -> Figure:
    """The lens as an eye sees it with its outline, in false colour from 0 to its brightest spot, which has a circle."""
    top = float(seen.map.max()) or 1.0
    side = min(_MARGIN * 2.0 * np.abs(seen.outline).max(initial=0.0), seen.side_mm)
    chart = Chart(seen.side_mm, seen.side_mm)
    (row, column) = np.unravel_index(seen.map.argmax(), seen.map.shape)
    if unit.per_watt * top > _LONGEST:
        unit = LightUnit(unit.quantity, f"k{unit.symbol}", 1e-3 * unit.per_watt)
    figure = irradiance_map(seen.map, chart, top, unit=unit, frame=Chart(side, side) if side else chart)
    place = chart.x(len(seen.map))[column], chart.y(len(seen.map))[row]
    for patch in (Circle(place, 0.5 * seen.spot_mm), Polygon(seen.outline) if side else None):
        if patch is not None:
            patch.set(fill=False, edgecolor="white", linewidth=0.7)
            figure.axes[0].add_patch(patch)
    return figure


@in_report_style
def isolines(image: Image, chart: Chart, unit: LightUnit = WATTS) -> Figure:
    """Lines of equal light at the ``ISO_SHARES`` of the peak of ``image`` as drawn, with the value of each."""
    figure, axes, scale = new_map(tall=max(chart.height / chart.width, _VALUES_FIT))
    image = drawn(image)
    level = float(image.max())
    colours = list(ISO_SHARES.values())
    if min(image.shape) > 1:  # one row of pixels has no lines
        x, y = chart.x(image.shape[1]), chart.y(image.shape[0])
        axes.contour(x, y, image, levels=[share * level for share in ISO_SHARES], colors=colours, linewidths=0.9)
    chart.label(axes)
    _show_all_of(axes, chart)
    axes.set_aspect("equal")
    if chart.far_field:
        _draw_angles(axes, chart, ON_PALE)
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
    shown = show(axes, drawn(difference), chart, ON_PALE, cmap="RdBu_r", vmin=-reach, vmax=reach)
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


def show(
    axes: Axes, image: np.ndarray, chart: Chart, circles: tuple[str, float], frame: Chart | None = None, **colours: Any
) -> AxesImage:
    """Show ``image`` over ``chart``; ``circles``: style of those of constant angle. ``colours``: as imshow takes them.

    ``frame``: what the axes show, by default ``chart``.
    """
    axes.spines[:].set_visible(False)
    shown = axes.imshow(image, origin="lower", extent=chart.extent, interpolation="none", **colours)
    frame = frame or chart
    frame.label(axes)
    _show_all_of(axes, frame)
    _draw_angles(axes, chart, circles)
    return shown


def _show_all_of(axes: Axes, chart: Chart) -> None:
    left, right, lower, upper = chart.extent
    axes.set(xlim=(left, right), ylim=(lower, upper))


def _draw_angles(axes: Axes, chart: Chart, style: tuple[str, float]) -> None:
    colour, opacity = style
    for angle in angles_to(0.5 * min(chart.width, chart.height)) if chart.far_field else []:
        circle = Circle((0.0, 0.0), on_chart(angle), fill=False, edgecolor=colour, linewidth=0.5, alpha=opacity)
        axes.add_patch(circle)


def draw_border(axes: Axes, mask: Bool[np.ndarray, "m n"], chart: Chart) -> None:
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
    for row, (share, colour) in enumerate(ISO_SHARES.items()):
        height = 0.08 + 0.16 * row
        scale.plot([0.0, 1.0], [height, height], color=colour, linewidth=2.0)
        text = f"{100.0 * share:.0f} %\n{number(unit.per_watt * share * level, 3)}"
        scale.text(1.6, height, text, va="center", fontsize=7.5, linespacing=1.15)
    scale.text(0.0, 0.98, unit.symbol, va="top", fontsize=8.0)
    scale.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    scale.set_axis_off()


Ends = tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]

_LINE_HEIGHT = 2.4
# A row is worth its own line where it lies farther from the centre and is brighter than the central row by so much.
_OFF_CENTRE = 0.02  # of the height
_BRIGHTER = 1.05


@in_report_style
def line_comparison(
    line: Ends,
    wanted: Image,
    reached: Image,
    chart: Chart,
    unit: LightUnit = WATTS,
    names: tuple[str, str] = ("target", "simulated"),
) -> Figure:
    """Light along a straight ``line`` on the receiver's chart; ``names``: labels of ``wanted`` and ``reached``."""
    figure, axes = new_figure(NARROW, _LINE_HEIGHT)
    start, end = line
    reach = 0.5 * float(np.linalg.norm(end - start))
    position = np.linspace(-reach, reach, _samples(wanted))
    light = [unit.per_watt * along(image, start, end, chart) for image in (wanted, reached)]
    axes.plot(position, light[0], label=names[0], color=INK, linestyle=DASHED, linewidth=1.0)
    axes.plot(position, light[1], label=names[1], color=BLUE)
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
    axes.plot(radius, share, color=INK, linestyle=DASHED, linewidth=1.0, label="target")
    axes.plot(*encircled_share(reached, chart), color=BLUE, label="simulated, unfiltered")
    reach = float(radius[-1]) or 0.5 * max(chart.width, chart.height)  # 0 for a single pixel
    label_radii(axes, chart, reach)
    axes.set(ylabel="share of the receiver's flux", xlim=(0.0, reach), ylim=(0.0, 1.02))
    axes.grid(True)
    axes.legend(loc="lower right")
    return figure


def label_positions(axes: Axes, chart: Chart, reach: float) -> None:
    """Label the axis of positions that run as far as ``reach`` to either side of the middle of a line."""
    _label_lengths(axes, chart, reach, f"position on the line ({chart.unit_drawn})")


def label_radii(axes: Axes, chart: Chart, reach: float) -> None:
    """Label the axis of radii up to ``reach``."""
    far = "angle from the axis (°)"
    near = f"radius around the centre ({chart.unit_drawn})"
    _label_lengths(axes, chart, reach, far if chart.far_field else near)


def _label_lengths(axes: Axes, chart: Chart, reach: float, title: str) -> None:
    axes.set_xlabel(title)
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
    """``image`` from ``start`` to ``end`` (x, y on the chart), bilinear, at two points a pixel of the longer side."""
    rows, columns = image.shape
    x, y = start[:, None] + (end - start)[:, None] * np.linspace(0.0, 1.0, _samples(image))
    places = np.stack([y / chart.height * rows + 0.5 * rows - 0.5, x / chart.width * columns + 0.5 * columns - 0.5])
    return map_coordinates(image, places, order=1, mode="nearest")


def profile_lines(target: Image, chart: Chart) -> list[tuple[str, Ends]]:
    """Names and ends of the lines y = 0, x = 0, and a third: the target's brightest row, else the diagonal.

    A pattern that is brightest on the axis gets its diagonal, where a square has its corners. In the far field that
    ends at the largest angle from the axis.
    """
    right = 0.5 * chart.width
    top = 0.5 * chart.height
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
    return 2 * int(max(image.shape))


_WORDS = {
    "backward": "emitted backwards",
    "outside_cavity": "started outside the cavity",
    "base": "hit the base",
    "missed_receiver": "missed the receiver",
    "surfaces_intersect": "met intersecting surfaces",
    "event_limit": "still in the lens at the event limit",
    "flange": "absorbed at the flange",
    "total_reflection": "totally reflected",
    "not_converged": "not converged",
    "absorbed": "absorbed in the lens",
    "reflected": "reflected at the surfaces",
    "cover_glass": "lost in the cover glass",
    "bodies": "",  # each by its name
    "housing": "blocked by housing",
    "second_wall": "met a further wall",
    "outside": "outside the window",
}


def losses(flux: Flux, missed: MissedByCause, bodies: Mapping[str, float] | None = None) -> list[tuple[str, float]]:
    """Every loss above zero as (words, share of the emitted flux), in the order in which they occur along a ray.

    ``bodies``: the losses in further bodies by their names.
    """
    shares = {**missed.model_dump(), **flux.model_dump()}
    rows = []
    for name, label in _WORDS.items():
        if name == "bodies":
            rows += [(f"lost in the {body}", share) for body, share in (bodies or {}).items()]
        elif shares[name] > 0.0:
            rows.append((label, shares[name]))
    return rows


def flux_budget(flux: Flux, missed: MissedByCause, bodies: Mapping[str, float] | None = None) -> Figure:
    """A waterfall from the emitted flux through each loss to the detected flux; shares of the emitted flux."""
    return waterfall(losses(flux, missed, bodies), [("detected", flux.detected)])


@in_report_style
def waterfall(lost: Sequence[tuple[str, float]], kept: Sequence[tuple[str, float]]) -> Figure:
    """A bar for the emitted flux, one for each share of it that is ``lost``, one for each that is ``kept``.

    Both as (words, share of the emitted flux). Bars of ``kept`` stand end to end from 0.
    """
    count = len(lost) + len(kept)
    figure, axes = new_figure(NARROW, max(2.75, 0.55 + 0.4 * (count + 1)))
    left = 1.0
    _bar(axes, 0, "emitted", 0.0, 1.0, BLUE)
    for row, (label, share) in enumerate(lost, start=1):
        left -= share
        _bar(axes, row, label, left, share, ORANGE)
    left = 0.0
    for row, (label, share) in enumerate(kept, start=len(lost) + 1):
        _bar(axes, row, label, left, share, GREEN)
        left += share
    axes.set(xlim=(0.0, 1.0), ylim=(count + 0.45, -0.75), yticks=[], xlabel="share of the emitted flux")
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.grid(True, axis="x")
    axes.set_axisbelow(True)
    return figure


def _bar(axes: Axes, row: int, label: str, left: float, width: float, colour: str) -> None:
    axes.barh(row + 0.16, width, left=left, height=0.42, color=colour, linewidth=0)
    axes.text(0.0, row - 0.12, label, ha="left", va="bottom")
    share = "< 0.01 %" if 0.0 < width < 5e-5 else f"{100.0 * width:.2f} %"
    axes.text(1.0, row - 0.12, share, ha="right", va="bottom")
