"""Bright quadrilaterals in a picture: one that encloses a region, then straight lines fitted to its edges.

Points are (column, row) in pixels, 0 at the centre of the first pixel, rows downwards.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.spatial import ConvexHull
from scipy.stats import theilslopes

_FINE = 4  # samples per pixel across an edge
_ALONG = np.linspace(0.06, 0.94, 161)  # positions on a side without its ends: the camera's lens rounds corners
_BLUR, _AVERAGED = 1.5, 3.0  # standard deviations: pixels across the edge, positions along it, which is straight
_ON_LINE = 1.0  # pixels: edge points farther from the line than this belong to something else


@dataclass(frozen=True)
class Sides:
    """Corners, clockwise as seen, at which the lines through the four edges meet; and the straightness of each edge.

    ``straight``: share of the edge's points on its line; ``rms``: their scatter (pixels); ``bow``: distance of
    the middle of the edge from the line through its ends (pixels), by distortion of the lens; ``step``: brightness
    inside minus outside.
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
    """Points where the neighbours of each edge meet, and the area that this adds; infinite where they never do."""
    start, end = outline, np.roll(outline, -1, axis=0)
    before, after = start - np.roll(outline, 1, axis=0), end - np.roll(outline, -2, axis=0)
    turn = _cross(before, after)
    gap = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        reach, other = _cross(gap, after) / turn, _cross(gap, before) / turn
        tips = start + reach[:, None] * before
        meets = np.isfinite(reach) & (reach > 0.0) & (other > 0.0)
    area = 0.5 * np.abs(_cross(tips - start, gap))
    return tips, np.where(meets, area, np.inf)


def clockwise(corners: Float[np.ndarray, "4 2"]) -> Float[np.ndarray, "4 2"]:
    """Sort corners clockwise as seen, the top left first."""
    offset = corners - corners.mean(axis=0)
    ordered = corners[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))]  # rows run down: clockwise as seen
    return np.roll(ordered, -int(np.argmin(ordered.sum(axis=1))), axis=0)


def area(corners: Float[np.ndarray, "4 2"]) -> float:
    """Area (pixels^2) of a quadrilateral."""
    return 0.5 * float(abs(_cross(corners, np.roll(corners, -1, axis=0)).sum()))


def fit_sides(picture: Float[np.ndarray, "h w"], corners: Float[np.ndarray, "4 2"], reach: float) -> Sides | None:
    """Fit lines through the steepest descents from bright inside to dark outside, up to ``reach`` pixels off the sides.

    Robust: Theil and Sen's slope first, then least squares of the points on that line. None where an edge has no points
    or two lines do not meet.
    """
    lines, quality = [], []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - start) / np.linalg.norm(end - start)
        outward = np.array([along[1], -along[0]])  # to the left of the direction: the outside of a clockwise path
        positions, offsets, step = _edge(picture, start, end, outward, reach)
        slope, level = theilslopes(offsets, positions)[:2]
        on_line = np.abs(offsets - level - slope * positions) < _ON_LINE
        if on_line.sum() < 10:
            return None
        slope, level = np.polyfit(positions[on_line], offsets[on_line], 1)
        rest = (offsets - level - slope * positions)[on_line]
        bow = np.polyfit(positions[on_line], rest, 2)[0] * (0.5 * np.ptp(positions)) ** 2
        lines.append((start + level * outward, (end - start) + slope * outward))
        quality.append((float(on_line.mean()), float(np.sqrt(np.mean(rest**2))), float(abs(bow)), step))
    met = [_meeting(lines[side - 1], lines[side]) for side in range(4)]
    found = np.array(met)
    return Sides(found, *np.array(quality).T) if np.isfinite(found).all() else None


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
    left, top, right = fall[row, peak - 1], fall[row, peak], fall[row, peak + 1]
    curve = left - 2.0 * top + right
    shift = np.where(curve < 0.0, 0.5 * (left - right) / np.where(curve < 0.0, curve, 1.0), 0.0)
    offsets = across[3 * _FINE :][peak] + np.clip(shift, -1.0, 1.0) / _FINE
    third = seen.shape[1] // 3
    return _ALONG, offsets, float(np.median(seen[:, :third]) - np.median(seen[:, -third:]))


def _meeting(
    one: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
    other: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
) -> Float[np.ndarray, "2"]:
    turn = float(_cross(one[1], other[1]))
    if turn == 0.0:
        return np.full(2, np.nan)
    return np.asarray(one[0] + float(_cross(other[0] - one[0], other[1])) / turn * one[1])


def _cross(one: Float[np.ndarray, "*n 2"], other: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n"]:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
