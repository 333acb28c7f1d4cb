"""Ray set of files or of another program as a source: placed in lens coordinates, drawn by seed."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.areas import convex_hull
from lensforge.sources.bundle import RayBundle
from lensforge.sources.placement import SourcePose
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.ray_source import Placement

_OUTLINE_SHARE = 0.95  # of the flux inside the drawn outline; the rest starts far out, such as at the edge of a window
# Proper rotations that take the named direction of the file to +z.
_TO_LENS_AXIS = {
    "+x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    "-x": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0)),
    "+y": ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "-y": ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "+z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "-z": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
}
_MIRROR = {"none": (1.0, 1.0, 1.0), "x": (-1.0, 1.0, 1.0), "y": (1.0, -1.0, 1.0)}


def placed(rays: RayBundle, origin_mm: Float[np.ndarray, " 3"], placement: Placement) -> RayBundle:
    """Transform ``rays`` of a file to lens coordinates; ``origin_mm``, a point of the file, becomes the lens origin."""
    pose = SourcePose.of(placement)
    matrix = pose.rotation @ np.diag(_MIRROR[placement.mirror]) @ _TO_LENS_AXIS[placement.axis]
    origins = placement.scale * (rays.origins - origin_mm) @ matrix.T
    if pose.position_mm.any():
        origins = origins + pose.position_mm
    return replace(rays, origins=origins, directions=rays.directions @ matrix.T)


@dataclass(frozen=True, eq=False)
class RaySetEmitter:
    """Usable rays of a ray set in lens coordinates; their flux adds up to ``flux_w``.

    Rays that go backwards, or start below z = 0 or beyond the cavity, are kept: the tracer counts them as lost, by
    cause. Only unusable rays are dropped; ``summary`` holds their number, and what else was done to a file: None for
    rays made by a program. ``pose``: of the source in the lens, None at the origin; the outline is drawn there.
    """

    rays: RayBundle
    flux_w: float
    summary: SourceSummary | None = None
    symmetry: str = "none"
    pose: SourcePose | None = None

    def __len__(self) -> int:
        return len(self.rays)

    @property
    def ray_count(self) -> int:
        """Number of distinct rays: drawing more adds no information."""
        return len(self)

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays whose flux adds up to ``flux_w``; the same seed gives the same rays.

        Fewer than the file holds: a random choice without replacement, never the first ones, because files are not
        always shuffled. As many: all, in the order of the file. More: every ray is split into equal parts, some into
        one part more than others. Splitting leaves each ray's flux as it is, so a result is exactly that of the whole
        file, and its noise too: a file of n rays never gives more than n rays do. Jitter would only hide that, and blur
        the source.
        """
        if count < 1:
            raise InputError(f"{count} rays: at least 1")
        copies, rest = divmod(count, len(self))
        extra = np.sort(np.random.default_rng(seed).choice(len(self), rest, replace=False))
        times = np.full(len(self), copies)
        times[extra] += 1
        index = np.repeat(np.arange(len(self)), times)
        flux = self.rays.flux[index] / times[index]
        return replace(self.rays.take(index), flux=flux * (self.flux_w / flux.sum()))

    def split(self, fraction: float, seed: int) -> tuple["RaySetEmitter", "RaySetEmitter"]:
        """Divide the rays between two emitters of the same flux: ``fraction`` to design with, the rest to evaluate.

        A lens that was fitted to the noise of its own rays shows it on the others.
        """
        training = round(fraction * len(self))
        if not 0 < training < len(self):
            raise InputError(f"fraction = {fraction} of {len(self)} rays leaves one part empty: try 0.8")
        order = np.random.default_rng(seed).permutation(len(self))
        return self._only(np.sort(order[:training])), self._only(np.sort(order[training:]))

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Convex hull (mm) of the points where 95 % of the forward flux crosses, or seems to cross, a plane.

        It is the plane z = 0 of the source before it was turned, tilted and shifted to its place.
        """
        start, direction = self.rays.origins, self.rays.directions
        if self.pose is not None:
            start, direction = self.pose.own_points(start), self.pose.own_directions(direction)
        forward = direction[:, 2] > 0.0
        if not forward.any():
            forward = ~forward
        points, flux = _crossings(start, direction)[forward], self.rays.flux[forward]
        distance = np.linalg.norm(points - _median(points, flux), axis=1)
        order = np.argsort(distance)
        inside = np.searchsorted(np.cumsum(flux[order]), _OUTLINE_SHARE * flux.sum())
        corners = convex_hull(points[order[: inside + 1]])
        outline = np.column_stack([corners, np.zeros(len(corners))])
        return outline if self.pose is None else self.pose.points(outline)

    def _only(self, index: np.ndarray) -> "RaySetEmitter":
        part = self.rays.take(index)
        return replace(self, rays=replace(part, flux=part.flux * (self.flux_w / part.flux.sum())))


def _crossings(start: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Points (mm) where the lines of the rays meet z = 0; rays along that plane stay where they start."""
    level = np.abs(direction[:, 2]) < 1e-9
    length = np.where(level, 0.0, -start[:, 2] / np.where(level, 1.0, direction[:, 2]))
    crossings: Float[np.ndarray, "n 2"] = start[:, :2] + length[:, None] * direction[:, :2]
    return crossings


def _median(points: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 2"]:
    """Flux-weighted median of each coordinate: a few rays far out do not move it."""
    order = np.argsort(points, axis=0)
    middle = [np.searchsorted(np.cumsum(flux[column]), 0.5 * flux.sum()) for column in order.T]
    return np.array([points[order[row, axis], axis] for axis, row in enumerate(middle)])
