"""Corners of the target found in a photograph: the border of the panel on which the light falls.

A bright quadrilateral first encloses a region; straight lines are then fitted to its edges. Points are (column, row) in
pixels, 0 at the centre of the first pixel, rows downwards.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_fill_holes, binary_opening, gaussian_filter, gaussian_filter1d, label, map_coordinates
from scipy.spatial import ConvexHull
from scipy.stats import theilslopes

from lensforge.addons.measure.measurement_result import Located
from lensforge.errors import InputError

_FINE = 4  # samples per pixel across an edge
_ALONG = np.linspace(0.06, 0.94, 161)  # positions on a side without its ends: the camera's lens rounds corners
_BLUR = 1.5  # standard deviation (pixels) across the edge
_AVERAGED = 3.0  # standard deviation (positions) along it, which is straight
_ON_LINE = 1.0  # pixels: edge points farther from the line than this belong to something else


@dataclass(frozen=True)
class Sides:
    """Corners, clockwise as seen, where the lines through the edges meet; and the straightness of each edge.

    ``straight``: share of the edge's points on its line; ``rms``: their scatter (pixels); ``bow``: distance of the
    middle of the edge from the line through its ends (pixels), by distortion of the lens; ``step``: brightness inside
    minus outside.
    """

    corners: Float[np.ndarray, "4 2"]
    straight: Float[np.ndarray, "4"]
    rms: Float[np.ndarray, "4"]
    bow: Float[np.ndarray, "4"]
    step: Float[np.ndarray, "4"]


def enclosing(region: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "4 2"] | None:
    """Enclose ``region`` by a quadrilateral of nearly the least area; None for a region without an area.

    Edges of the convex hull are removed one by one, always that whose neighbours, extended until they meet, add least.
    """
    rows, columns = np.nonzero(region)
    if np.ptp(rows) < 2 or np.ptp(columns) < 2:
        return None
    points = np.stack([columns, rows], axis=1).astype(np.float64)
    outline = points[ConvexHull(points).vertices]
    while len(outline) > 4:
        tips, added = _without_each_edge(outline)
        first = int(np.argmin(added))
        if not np.isfinite(added[first]):
            return None
        second = (first + 1) % len(outline)
        outline[first] = tips[first]
        outline = np.delete(outline, second, axis=0)
    return clockwise(outline) if len(outline) == 4 else None


def _without_each_edge(outline: Float[np.ndarray, "k 2"]) -> tuple[Float[np.ndarray, "k 2"], Float[np.ndarray, " k"]]:
    """Points where the neighbours of each edge meet, and the area that this adds; infinite if they never do."""
    start, end = outline, np.roll(outline, -1, axis=0)
    before, after = start - np.roll(outline, 1, axis=0), end - np.roll(outline, -2, axis=0)
    turn = _cross(before, after)
    gap = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = _cross(gap, after) / turn
        behind = _cross(gap, before) / turn
        tips = start + reach[:, None] * before
        meets = np.isfinite(reach) & (reach > 0.0) & (behind > 0.0)
    area = 0.5 * np.abs(_cross(tips - start, gap))
    return tips, np.where(meets, area, np.inf)


def clockwise(corners: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "4 2"]:
    """Sort corners clockwise as seen, the top left first."""
    offset = corners - corners.mean(axis=0)
    ordered = corners[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))]  # rows run down: clockwise as seen
    return np.roll(ordered, -int(np.argmin(ordered.sum(axis=1))), axis=0)


def listed(corners: Float[np.ndarray, "4 2"]) -> str:
    """Text of corners as column,row to a tenth of a pixel, as the command line takes them."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)


def area(corners: Float[np.ndarray, "4 2"]) -> float:
    """Area (pixels^2) of a quadrilateral."""
    return 0.5 * float(abs(_cross(corners, np.roll(corners, -1, axis=0)).sum()))


def fit_sides(picture: Float[np.ndarray, "h w"], corners: Float[np.ndarray, "4 2"], reach: float) -> Sides | None:
    """Fit lines through the steepest descents from bright inside to dark outside, up to ``reach`` pixels off the sides.

    Robust: Theil and Sen's slope first, then least squares of the points on that line. None if an edge has no points
    or two lines do not meet.
    """
    lines = []
    quality = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        outward = np.array([along[1], -along[0]])  # to the left of the direction: the outside of a clockwise path
        positions, offsets, step = _edge(picture, start, end, outward, reach)
        slope, level = theilslopes(offsets, positions)[:2]
        on_line = np.abs(offsets - level - slope * positions) < _ON_LINE
        if on_line.sum() < 10:
            return None
        slope, level = np.polyfit(positions[on_line], offsets[on_line], 1)
        residuals = (offsets - level - slope * positions)[on_line]
        bow = np.polyfit(positions[on_line], residuals, 2)[0] * (0.5 * np.ptp(positions)) ** 2
        lines.append((start + level * outward, (end - start) + slope * outward))
        quality.append((float(on_line.mean()), float(np.sqrt(np.mean(residuals**2))), float(abs(bow)), step))
    met = [_meeting(lines[side - 1], lines[side]) for side in range(4)]
    crossings = np.array(met)
    return Sides(crossings, *np.array(quality).T) if np.isfinite(crossings).all() else None


def _edge(
    picture: Float[np.ndarray, "h w"],
    start: Float[np.ndarray, "2"],
    end: Float[np.ndarray, "2"],
    outward: Float[np.ndarray, "2"],
    reach: float,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], float]:
    """Positions on a side (0 to 1), outward offsets (pixels) of the steepest fall there, and the brightness step."""
    across = np.arange(-reach - 3.0, reach + 3.0 + 0.5 / _FINE, 1.0 / _FINE)
    points = start + _ALONG[:, None, None] * (end - start) + across[:, None] * outward
    seen = map_coordinates(picture, [points[..., 1], points[..., 0]], order=1, mode="nearest")
    smooth = gaussian_filter1d(gaussian_filter1d(seen, _BLUR * _FINE, axis=1), _AVERAGED, axis=0)
    fall = -np.gradient(smooth, axis=1)[:, 3 * _FINE : -3 * _FINE]
    peak = np.clip(np.argmax(fall, axis=1), 1, fall.shape[1] - 2)
    row = np.arange(len(fall))
    left = fall[row, peak - 1]
    top = fall[row, peak]
    right = fall[row, peak + 1]
    curve = left - 2.0 * top + right
    shift = np.where(curve < 0.0, 0.5 * (left - right) / np.where(curve < 0.0, curve, 1.0), 0.0)
    offsets = across[3 * _FINE :][peak] + np.clip(shift, -1.0, 1.0) / _FINE
    third = seen.shape[1] // 3
    return _ALONG, offsets, float(np.median(seen[:, :third]) - np.median(seen[:, -third:]))


def _meeting(
    first: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
    second: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
) -> Float[np.ndarray, "2"]:
    turn = float(_cross(first[1], second[1]))
    if turn == 0.0:
        return np.full(2, np.nan)
    return np.asarray(first[0] + float(_cross(second[0] - first[0], second[1])) / turn * first[1])


def _cross(first: Float[np.ndarray, "*n 2"], second: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


_COARSE = 400  # pixels of the longer side of the reduced picture in which regions are found
_LEVELS = 32  # thresholds per picture
_LEAST_AREA = 0.02  # of the picture
_MOST_AREA = 0.97
_FILLED = 0.94  # of its quadrilateral, by a region that is one: perspective leaves the sides straight
_STRAIGHT = 0.7  # share of an edge's points on its line, of a border
_SCATTER = 0.6  # rms (pixels) of these points
_BOW = 3e-3  # of the side: more is a lens's distortion that four corners cannot undo
_SAME = 0.02  # of the quadrilateral's size: corners nearer than this are the same
_HELD = 0.9  # of the bright pixels lie within the target
_LIT = 0.3  # of the light's peak, just inside a border: then it is the pattern's edge, not the panel's
_ROLL_RAD = np.radians(30.0)


@dataclass(frozen=True)
class Square:
    """Corners of the target (column, row) from the top left clockwise, and the quality of their detection."""

    corners: Float[np.ndarray, "4 2"]
    located: Located


def locate(
    on: Float[np.ndarray, "h w"], off: Float[np.ndarray, "h w"] | None, *, border_share: float, lit_square: bool = False
) -> Square:
    """Find the one square panel in the photographs ``on`` and ``off`` (linear light) that holds the light.

    ``border_share``: the simulation's mean along its border over its peak. ``lit_square``: take the edges of a square
    pattern where no panel is seen. Raises :class:`InputError`, with what to do, where no border, several, a bent or a
    rolled one is seen: nothing is guessed.
    """
    light = on if off is None else on - off
    squares = [square for square in _quadrilaterals(on, off, light) if _holds(square.corners, light)]
    squares = [_with_lit(panel, light, border_share) for panel in squares]
    panels, lit = ([panel for panel in squares if panel.located.lit == seen] for seen in (False, True))
    chosen = _only(panels) if panels or not lit else _only(lit)
    if chosen.located.lit and not lit_square:
        raise InputError(
            f"on: the only square seen is the edge of the light itself, at {listed(chosen.corners)}, not a target's "
            "border; give target_mm, the side of that square of light, or the corners of the target"
        )
    return _sound(chosen)


def _quadrilaterals(
    on: Float[np.ndarray, "h w"], off: Float[np.ndarray, "h w"] | None, light: Float[np.ndarray, "h w"]
) -> list[Square]:
    """Distinct quadrilaterals with four straight edges; of nearly equal ones, that with the straightest edges."""
    pictures = {"on": on} if off is None else {"off": off, "on": on, "the light": light}
    seen = []
    for name, picture in pictures.items():
        for rough in _rough(picture):
            sides = _refined(picture, rough)
            if sides is not None:
                rms = float(sides.rms.max())
                bow = float(sides.bow.max())
                located = Located(seen_in=name, lit=name == "the light", edge_rms_px=rms, edge_bow_px=bow)
                seen.append(Square(clockwise(sides.corners), located))
    distinct: list[Square] = []
    for square in sorted(seen, key=lambda square: square.located.edge_rms_px):
        if not any(_same(square.corners, known.corners) for known in distinct):
            distinct.append(square)
    return distinct


def _rough(picture: Float[np.ndarray, "h w"]) -> Iterator[Float[np.ndarray, "4 2"]]:
    """Quadrilaterals around bright regions at many thresholds, near-duplicates left out, in pixels of ``picture``."""
    factor = max(1, int(np.ceil(max(picture.shape) / _COARSE)))
    coarse = gaussian_filter(means(picture, factor), 1.0)
    low, high = np.quantile(coarse, (0.005, 0.995))
    known: list[Float[np.ndarray, "4 2"]] = []
    # Thresholds are closer together where it is dark: a panel's border may be a hundredth of the peak.
    for threshold in low + (high - low) * (np.arange(1, _LEVELS) / _LEVELS) ** 3:
        for region in _regions(coarse > threshold):
            corners = enclosing(region)
            if corners is None or region.sum() < _FILLED * area(corners):
                continue
            if not any(_same(corners, known_corners) for known_corners in known):
                known.append(corners)
                yield (corners + 0.5) * factor - 0.5


def means(picture: Float[np.ndarray, "h w"], factor: int) -> Float[np.ndarray, "i j"]:
    """Means over ``factor`` x ``factor`` pixels; rows and columns that are left over are dropped."""
    rows, columns = (size // factor for size in picture.shape)
    blocks = picture[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    return np.asarray(blocks.mean(axis=(1, 3)))


def _regions(bright: Bool[np.ndarray, "h w"]) -> Iterator[Bool[np.ndarray, "h w"]]:
    """Connected regions of sufficient size, holes filled, that do not touch the picture's border."""
    numbered, count = label(binary_opening(binary_fill_holes(bright), iterations=2))
    sizes = np.bincount(numbered.ravel(), minlength=count + 1)
    edge = np.concatenate([numbered[0], numbered[-1], numbered[:, 0], numbered[:, -1]])
    for number in range(1, count + 1):
        if _LEAST_AREA * bright.size < sizes[number] < _MOST_AREA * bright.size and number not in edge:
            yield numbered == number


def _refined(picture: Float[np.ndarray, "h w"], rough: Float[np.ndarray, "4 2"]) -> Sides | None:
    """Fit the edges twice, the second time close to the first lines; None unless all four are edges."""
    size = float(np.sqrt(area(rough)))
    sides = fit_sides(picture, rough, max(6.0, 0.03 * size))
    if sides is not None:
        sides = fit_sides(picture, clockwise(sides.corners), max(4.0, 0.01 * size))
    if sides is None or sides.straight.min() < _STRAIGHT or sides.step.min() <= 0.0:
        return None
    inside = (sides.corners >= 0.0) & (sides.corners <= np.array(picture.shape[::-1]) - 1.0)
    return sides if inside.all() and sides.rms.max() < _SCATTER else None


def _same(first: Float[np.ndarray, "4 2"], second: Float[np.ndarray, "4 2"]) -> bool:
    return bool(np.abs(first - second).max() < _SAME * np.sqrt(area(first)))


def _holds(corners: Float[np.ndarray, "4 2"], light: Float[np.ndarray, "h w"]) -> bool:
    """True if the brightest of the light lies within the quadrilateral."""
    rows, columns = np.nonzero(light > 0.5 * np.quantile(light, 0.999))
    inside = np.ones(len(rows), dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= (end[0] - start[0]) * (rows - start[1]) - (end[1] - start[1]) * (columns - start[0]) >= -1.0
    return bool(inside.mean() >= _HELD) if len(rows) else False


def _with_lit(square: Square, light: Float[np.ndarray, "h w"], border_share: float) -> Square:
    """Set ``lit`` by the light just inside the border; a square seen with the LED off is a panel in any case."""
    if square.located.seen_in == "off":
        return square
    centre = square.corners.mean(axis=0)
    t = np.linspace(0.0, 1.0, 50)[:, None, None]
    border = ((1.0 - t) * square.corners + t * np.roll(square.corners, -1, axis=0)).reshape(-1, 2)
    ring = np.concatenate([centre + inset * (border - centre) for inset in (0.9, 0.93, 0.96)])
    share = float(np.median(map_coordinates(light, [ring[:, 1], ring[:, 0]], order=1)) / np.quantile(light, 0.999))
    return replace(square, located=square.located.changed(lit=share > _LIT + border_share))


def _only(squares: list[Square]) -> Square:
    """The only square. Raises :class:`InputError`, with a remedy, for none or several."""
    if not squares:
        raise InputError(
            "on: no square with four straight edges is seen around the light, the target's border is too faint; "
            "give corners, or a second photograph, off, with some room light on the target"
        )
    if len(squares) > 1:
        by_size = sorted(squares, key=lambda square: -area(square.corners))[:3]
        listing = "; or ".join(listed(square.corners) for square in by_size)
        raise InputError(f"on: {len(squares)} squares are seen around the light; give the target's corners: {listing}")
    return squares[0]


def _sound(square: Square) -> Square:
    """``square`` itself. Raises :class:`InputError` if four corners do not suffice: bent edges, a rolled target."""
    corners = square.corners
    side = float(np.sqrt(area(square.corners)))
    bow = square.located.edge_bow_px
    if bow > _BOW * side:
        raise InputError(
            f"on: the target's edges are bent by {bow:.1f} pixels, so its corners are uncertain; "
            f"undo the distortion of the camera's lens first, or give corners {listed(corners)}"
        )
    top = corners[1] - corners[0]
    if abs(np.arctan2(top[1], top[0])) > _ROLL_RAD:
        raise InputError(
            f"on: the target is rolled by {np.degrees(np.arctan2(top[1], top[0])):.0f} deg, so its top left is "
            f"uncertain; give corners, such as {listed(corners)}"
        )
    return square
