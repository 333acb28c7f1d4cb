"""Figures of light on the receiver: maps, their difference, lines across them, isolines and encircled energy.

Images are irradiance in W/m^2, indexed [row y, column x], y upwards, and are drawn in the unit of light given to the
figure; ``receiver_mm`` is the side of the square.
"""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from PIL import Image as PictureFile
from scipy.ndimage import map_coordinates

from lensforge.figures.light_unit import WATTS, LightUnit
from lensforge.records import Image
from lensforge.report.figure_style import BLUE, INK, NARROW, add_colour_bar, in_report_style, new_figure, new_map
from lensforge.report.numerals import number

_LINE_HEIGHT = 2.4
ISO_SHARES = {0.1: "#6a4fc4", 0.25: "#2f7fd1", 0.5: "#1f9e89", 0.75: "#d18a1f", 0.9: "#d6453d"}  # of the level: colour
MOST_DRAWN = 512  # pixels per side of a map: more than a screen shows in a third of its width


@in_report_style
def irradiance_map(
    image: Image,
    receiver_mm: float,
    top: float,
    outline: Image | None = None,
    mask_mm: float | None = None,
    unit: LightUnit = WATTS,
    width: float = NARROW,
) -> Figure:
    """``image`` in false colour from 0 to ``top`` W/m^2, with the line at half of the peak of ``outline``.

    ``mask_mm``: side of the square in which uniformity is measured, drawn dashed. ``width``: of the figure, in inches.
    """
    figure, axes, bar = new_map(width)
    shown = _show(axes, unit.per_w_m2 * image, receiver_mm, "inferno", 0.0, unit.per_w_m2 * top)
    if outline is not None and len(outline) > 1 and outline.max() > 0.0:
        outline = drawn(outline)
        axis = pixel_axis_mm(receiver_mm, len(outline))
        axes.contour(axis, axis, outline, levels=[0.5 * outline.max()], colors="white", linewidths=0.7, alpha=0.85)
    if mask_mm is not None:
        corner = (-0.5 * mask_mm, -0.5 * mask_mm)
        dashed = Rectangle(
            corner, mask_mm, mask_mm, fill=False, edgecolor="white", linestyle=(0, (4, 3)), linewidth=0.7
        )
        axes.add_patch(dashed)
    add_colour_bar(bar, shown, unit.label)
    return figure


@in_report_style
def isolines(image: Image, receiver_mm: float, level: float, unit: LightUnit = WATTS) -> Figure:
    """Lines of equal light at the ``ISO_SHARES`` of ``level`` (W/m^2), with the value of each."""
    figure, axes, scale = new_map()
    image = drawn(image)
    axis = pixel_axis_mm(receiver_mm, len(image))
    colours = list(ISO_SHARES.values())
    if len(image) > 1:  # one pixel has no lines
        axes.contour(axis, axis, image, levels=[share * level for share in ISO_SHARES], colors=colours, linewidths=0.9)
    half = 0.5 * receiver_mm
    axes.set(xlabel="x (mm)", ylabel="y (mm)", xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.grid(True)
    for row, (share, colour) in enumerate(ISO_SHARES.items()):
        height = 0.08 + 0.16 * row
        scale.plot([0.0, 1.0], [height, height], color=colour, linewidth=2.0)
        text = f"{100.0 * share:.0f} %\n{number(unit.per_w_m2 * share * level, 3)}"
        scale.text(1.6, height, text, va="center", fontsize=7.5, linespacing=1.15)
    scale.text(0.0, 0.98, unit.symbol, va="top", fontsize=8.0)
    scale.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    scale.set_axis_off()
    return figure


@in_report_style
def difference_map(difference: Image, receiver_mm: float, unit: LightUnit = WATTS) -> Figure:
    """A difference of irradiances, its colours centred on zero."""
    figure, axes, bar = new_map()
    difference = unit.per_w_m2 * difference
    reach = float(np.abs(difference).max()) or 1.0
    label = f"difference ({unit.symbol})"
    add_colour_bar(bar, _show(axes, difference, receiver_mm, "RdBu_r", -reach, reach), label)
    return figure


@in_report_style
def line_comparison(
    line: tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]],
    wanted: Image,
    reached: Image,
    receiver_mm: float,
    unit: LightUnit = WATTS,
    names: tuple[str, str] = ("target", "simulated"),
) -> Figure:
    """Light along the straight ``line`` from one point (x, y in mm) of the receiver to another.

    ``names``: labels of ``wanted`` and ``reached``.
    """
    figure, axes = new_figure(NARROW, _LINE_HEIGHT)
    start, end = line
    position = np.linspace(-0.5, 0.5, 2 * len(wanted)) * float(np.linalg.norm(end - start))
    for image, name, style in (
        (wanted, names[0], {"color": INK, "linestyle": (0, (4, 2)), "linewidth": 1.0}),
        (reached, names[1], {"color": BLUE}),
    ):
        axes.plot(position, unit.per_w_m2 * along(image, start, end, receiver_mm), label=name, **style)
    axes.set(xlabel="position on the line (mm)", ylabel=unit.label, xlim=(position[0], position[-1]))
    axes.set_ylim(bottom=0.0)
    axes.grid(True)
    figure.legend(loc="outside upper right", ncols=2)
    return figure


@in_report_style
def encircled_energy(wanted: Image, reached: Image, receiver_mm: float) -> Figure:
    """The share of the receiver's flux within a circle around the axis, over the circle's radius."""
    figure, axes = new_figure(NARROW, 2.75)
    radius, share = encircled_share(wanted, receiver_mm)
    axes.plot(radius, share, color=INK, linestyle=(0, (4, 2)), linewidth=1.0, label="target")
    axes.plot(*encircled_share(reached, receiver_mm), color=BLUE, label="simulated, unfiltered")
    axes.set(xlabel="radius around the axis (mm)", ylabel="share of the receiver's flux")
    axes.set(xlim=(0.0, float(radius[-1]) or 0.5 * receiver_mm), ylim=(0.0, 1.02))  # 0 for a single pixel
    axes.grid(True)
    axes.legend(loc="lower right")
    return figure


def encircled_share(image: Image, receiver_mm: float) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Radii (mm) and the share of the image's sum in pixels whose centres are no farther from the axis."""
    axis = pixel_axis_mm(receiver_mm, len(image))
    distance = np.hypot(axis[:, None], axis[None, :]).ravel()
    order = np.argsort(distance, kind="stable")
    gathered = np.cumsum(image.ravel()[order])
    radii = np.linspace(0.0, distance.max(), 200)
    within = np.searchsorted(distance[order], radii, side="right")
    share = np.concatenate([[0.0], gathered])[within]
    return radii, share / gathered[-1] if gathered[-1] > 0.0 else share


def along(
    image: Image, start: Float[np.ndarray, " 2"], end: Float[np.ndarray, " 2"], receiver_mm: float
) -> Float[np.ndarray, " k"]:
    """``image`` at two points per pixel of the line from ``start`` to ``end`` (x, y in mm), bilinear between pixels."""
    pixels = len(image)
    x, y = (start[:, None] + (end - start)[:, None] * np.linspace(0.0, 1.0, 2 * pixels)) / receiver_mm
    rows_columns = np.stack([y, x]) * pixels + 0.5 * pixels - 0.5
    values: Float[np.ndarray, " k"] = map_coordinates(image, rows_columns, order=1, mode="nearest")
    return values


def profile_lines(target: Image, receiver_mm: float) -> list[tuple[str, tuple[np.ndarray, np.ndarray]]]:
    """Names and ends (mm) of the lines y = 0, x = 0, and a third: the target's brightest row, else the diagonal.

    A pattern that is brightest on the axis gets its diagonal, where a square has its corners.
    """
    half = 0.5 * receiver_mm
    axis = pixel_axis_mm(receiver_mm, len(target))
    level = float(axis[int(np.argmax(target.sum(axis=1)))])
    lines = [("y = 0", (-half, 0.0), (half, 0.0)), ("x = 0", (0.0, -half), (0.0, half))]
    if target.sum(axis=1).max() > 1.05 * _row(target, 0.5) and abs(level) > 0.02 * receiver_mm:
        lines.append((f"y = {level:.4g} mm (brightest row)", (-half, level), (half, level)))
    else:
        lines.append(("x = y (diagonal)", (-half, -half), (half, half)))
    return [(name, (np.array(start), np.array(end))) for name, start, end in lines]


def pixel_axis_mm(receiver_mm: float, pixels: int) -> Float[np.ndarray, " p"]:
    """Coordinates of the pixel centres."""
    return ((np.arange(pixels) + 0.5) / pixels - 0.5) * receiver_mm


def drawn(image: Image) -> Float[np.ndarray, "q q"]:
    """``image``, or its area means on ``MOST_DRAWN`` pixels per side if it has more."""
    if len(image) <= MOST_DRAWN:
        return image
    picture = PictureFile.fromarray(image.astype(np.float32))
    return np.asarray(picture.resize((MOST_DRAWN, MOST_DRAWN), PictureFile.Resampling.BOX), dtype=np.float64)


def _row(image: Image, height: float) -> float:
    """Sum of the row at ``height`` of the image, from 0 to 1."""
    return float(image[min(len(image) - 1, int(height * len(image)))].sum())


def _show(axes: Axes, image: Image, receiver_mm: float, colours: str, low: float, high: float) -> AxesImage:
    half = 0.5 * receiver_mm
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    axes.spines[:].set_visible(False)
    return axes.imshow(
        drawn(image),
        origin="lower",
        extent=(-half, half, -half, half),
        cmap=colours,
        vmin=low,
        vmax=high,
        interpolation="none",
    )
