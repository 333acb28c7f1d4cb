"""Outline of a ray set: around the points of a plane from which nearly all of its light seems to come.

The rays of a large file are not in memory. There a sample says about where the middle of the light is, and how far most
of it is from there; only the rays near these limits are kept, and sorted.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lensforge.sources.areas import convex_hull
from lensforge.sources.bundle import RayBundle, Rays
from lensforge.sources.placement import SourcePose
from lensforge.sources.unread_rays import blocks_of

_SHARE = 0.95  # of the flux inside the outline; the rest starts far out, such as at the edge of a window
_SAMPLE = 2**16  # rays that say about where a limit is: its share is then known to 0.002
_MARGINS = (0.02, 0.2, 1.0)  # of the flux, kept on both sides of a limit: more where a few rays have most of the flux
_Crossings = tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]  # points (mm) of the plane, and the flux there
_Key = Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, " n"]]


def outline_of(rays: Rays, pose: SourcePose | None) -> Float[np.ndarray, "k 3"]:
    """Convex hull (mm) of the points where 95 % of the forward flux crosses, or seems to cross, a plane.

    It is the plane z = 0 of the source before ``pose`` turned, tilted and shifted it to its place.
    """
    forward = any(bool(_rises(block, pose).any()) for block in blocks_of(rays))
    if isinstance(rays, RayBundle):
        corners = _around(*_crossings(rays, pose, forward))
    else:
        corners = _around_unread(rays, pose, forward)
    outline = np.column_stack([corners, np.zeros(len(corners))])
    return outline if pose is None else pose.points(outline)


def _rises(rays: RayBundle, pose: SourcePose | None) -> np.ndarray:
    directions = rays.directions if pose is None else pose.own_directions(rays.directions)
    rises: np.ndarray = directions[:, 2] > 0.0
    return rises


def _crossings(rays: RayBundle, pose: SourcePose | None, forward: bool) -> _Crossings:
    """Points where the lines of the rays that go ``forward``, or of the others, meet the plane of the source.

    Rays along that plane stay where they start.
    """
    start, direction = rays.origins, rays.directions
    if pose is not None:
        start, direction = pose.own_points(start), pose.own_directions(direction)
    kept = (direction[:, 2] > 0.0) == forward
    level = np.abs(direction[:, 2]) < 1e-9
    length = np.where(level, 0.0, -start[:, 2] / np.where(level, 1.0, direction[:, 2]))
    points = start[:, :2] + length[:, None] * direction[:, :2]
    return points[kept], rays.flux[kept]


def _around(points: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]) -> Float[np.ndarray, "k 2"]:
    """Corners around all but the farthest points; a few rays far out do not move the median from which they are far."""
    middle = np.array([_reached(column, flux, 0.5 * flux.sum()) for column in points.T])
    distance = np.linalg.norm(points - middle, axis=1)
    order = np.argsort(distance)
    inside = np.searchsorted(np.cumsum(flux[order]), _SHARE * flux.sum())
    return convex_hull(points[order[: inside + 1]])


def _reached(
    values: Float[np.ndarray, " n"], flux: Float[np.ndarray, " n"], wanted: float, below: float = 0.0
) -> float | None:
    """The value up to which there is the flux ``wanted``, ``below`` of it without these; None where it is elsewhere."""
    order = np.argsort(values)
    place = int(np.searchsorted(below + np.cumsum(flux[order]), wanted))
    return float(values[order[place]]) if below < wanted and place < len(order) else None


def _around_unread(rays: Rays, pose: SourcePose | None, forward: bool) -> Float[np.ndarray, "k 2"]:
    """The same corners, in a few passes through the rays."""

    def blocks() -> Iterator[_Crossings]:
        return (_crossings(block, pose, forward) for block in blocks_of(rays))

    some = np.sort(np.random.default_rng(0).choice(len(rays), min(_SAMPLE, len(rays)), replace=False))
    sample = _crossings(rays.take(some), pose, forward)
    middle = np.array(_limits(blocks, sample, [lambda points: points[:, 0], lambda points: points[:, 1]], 0.5))
    (radius,) = _limits(blocks, sample, [lambda points: _distance(points, middle)], _SHARE)
    corners, covered = np.zeros((0, 2)), -1.0
    for points, _ in blocks():
        distance = _distance(points, middle)
        outer = points[(distance <= radius) & (distance > covered)]
        if len(outer):
            corners = convex_hull(np.concatenate([corners, outer]))
            covered = _inner_radius(corners, middle)
    return corners


def _distance(points: Float[np.ndarray, "n 2"], middle: Float[np.ndarray, " 2"]) -> Float[np.ndarray, " n"]:
    away: Float[np.ndarray, " n"] = np.sqrt((points[:, 0] - middle[0]) ** 2 + (points[:, 1] - middle[1]) ** 2)
    return away


def _inner_radius(corners: Float[np.ndarray, "k 2"], middle: Float[np.ndarray, " 2"]) -> float:
    """Radius (mm) of a disc about ``middle`` inside a convex polygon; below 0 where that is outside, or degenerate."""
    if len(corners) < 3:
        return -1.0
    edges, own = np.roll(corners, -1, axis=0) - corners, middle - corners
    left = (edges[:, 0] * own[:, 1] - edges[:, 1] * own[:, 0]) / np.maximum(np.hypot(*edges.T), np.finfo(float).tiny)
    return float(left.min()) * (1.0 - 1e-9)


def _limits(
    blocks: Callable[[], Iterator[_Crossings]], sample: _Crossings, keys: Sequence[_Key], share: float
) -> list[float]:
    """For each of ``keys`` the value up to which there is ``share`` of the flux."""
    for margin in _MARGINS:
        found = [_Near.to_limit(key, sample, share, margin) for key in keys]
        total = 0.0
        for points, flux in blocks():
            total += float(flux.sum())
            for near in found:
                near.add(points, flux)
        limits = [limit for near in found if (limit := near.limit(share * total)) is not None]
        if len(limits) == len(keys):
            break
    return limits


@dataclass(eq=False)
class _Near:
    """Rays whose ``key`` is from ``low`` to ``high``, with their flux, and the flux ``below`` of others."""

    key: _Key
    low: float
    high: float
    below: float = 0.0
    values: list[Float[np.ndarray, " k"]] = field(default_factory=list)
    flux: list[Float[np.ndarray, " k"]] = field(default_factory=list)

    @staticmethod
    def to_limit(key: _Key, sample: _Crossings, share: float, margin: float) -> "_Near":
        """Set both ends by ``sample``, so that the value with ``share`` of the flux below it is well between them."""
        values, flux = key(sample[0]), sample[1]
        total = flux.sum()
        low = _reached(values, flux, (share - margin) * total) if share > margin else None
        high = _reached(values, flux, (share + margin) * total) if share + margin < 1.0 else None
        return _Near(key, -np.inf if low is None else low, np.inf if high is None else high)

    def add(self, points: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]) -> None:
        """Keep what is near of some rays."""
        values = self.key(points)
        near = (values >= self.low) & (values <= self.high)
        self.below += float(flux[values < self.low].sum())
        self.values.append(values[near])
        self.flux.append(flux[near])

    def limit(self, wanted: float) -> float | None:
        """The value up to which there is the flux ``wanted``; None where it is not near."""
        return _reached(np.concatenate(self.values), np.concatenate(self.flux), wanted, self.below)
