"""Measured rays as a source, in lens coordinates: drawn by seed, with weights that add up to a stated power."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull, QhullError

from lensforge.errors import InputError
from lensforge.sources.account import SourceAccount
from lensforge.sources.bundle import RayBundle

_OUTLINE_SHARE = 0.95  # of the flux inside the drawn outline; the rest is stray light, far out


@dataclass(frozen=True, eq=False)
class RayfileEmitter:
    """The usable rays of one file or several in lens coordinates, their weights adding up to ``flux_w``.

    Rays that go backwards, or start below z = 0 or beyond the cavity, are kept: the tracer accounts for them by
    cause. Only rows that are no rays are left out; ``account`` says how many, and what else was done to each file. It
    is None for rays of which nothing is to be said.
    """

    rays: RayBundle
    flux_w: float
    account: SourceAccount | None = None
    symmetry: str = "none"

    def __len__(self) -> int:
        return len(self.rays)

    @property
    def population(self) -> int:
        """Number of distinct rays: more than these say nothing new."""
        return len(self)

    def sample(self, count: int, seed: int) -> RayBundle:
        """``count`` rays whose weights add up to ``flux_w``; the same seed gives the same rays.

        Fewer than the file holds: a random choice without replacement, never the first ones, because files are not
        always shuffled. As many: all, in the order of the file. More: every ray is split into equal parts, some into
        one part more than others. Splitting leaves each ray's flux as it is, so a result is exactly that of the whole
        file, and its noise too: a file of n rays never says more than n rays do. Jitter would only hide that, at the
        price of a blurred source.
        """
        if count < 1:
            raise InputError(f"rays = {count}: at least 1")
        copies, rest = divmod(count, len(self))
        extra = np.sort(np.random.default_rng(seed).choice(len(self), rest, replace=False))
        times = np.full(len(self), copies)
        times[extra] += 1
        index = np.repeat(np.arange(len(self)), times)
        weights = self.rays.weights[index] / times[index]
        return replace(self.rays.take(index), weights=weights * (self.flux_w / weights.sum()))

    def split(self, fraction: float, seed: int) -> tuple["RayfileEmitter", "RayfileEmitter"]:
        """Two emitters of the same flux that share no ray: ``fraction`` of the rays to design on, the rest to judge.

        A lens that was fitted to the noise of its own rays shows it on the others.
        """
        training = round(fraction * len(self))
        if not 0 < training < len(self):
            raise InputError(f"fraction = {fraction} of {len(self)} rays leaves one part empty: try 0.8")
        order = np.random.default_rng(seed).permutation(len(self))
        return self._only(np.sort(order[:training])), self._only(np.sort(order[training:]))

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """The convex hull (mm) of where 95 % of the forward flux crosses, or seems to cross, the plane z = 0."""
        forward = self.rays.directions[:, 2] > 0.0
        if not forward.any():
            forward = ~forward
        points, weights = self._crossings()[forward], self.rays.weights[forward]
        distance = np.linalg.norm(points - _median(points, weights), axis=1)
        order = np.argsort(distance)
        inside = np.searchsorted(np.cumsum(weights[order]), _OUTLINE_SHARE * weights.sum())
        corners = _hull(points[order[: inside + 1]])
        return np.column_stack([corners, np.zeros(len(corners))])

    def share_outside_cavity(self, cavity_height_mm: float, cavity_radius_mm: float) -> float:
        """Share of the flux that starts outside the paraboloid which every feasible cavity contains, Eq. (10).

        A ray that starts below z = 0 is outside if it does not come up through the paraboloid's foot.
        """
        start = self.rays.origins
        squared = np.where(start[:, 2] < 0.0, np.sum(self._crossings() ** 2, axis=1), np.sum(start[:, :2] ** 2, axis=1))
        height = cavity_height_mm * (1.0 - squared / cavity_radius_mm**2)
        rises = (start[:, 2] >= 0.0) | (self.rays.directions[:, 2] > 0.0)
        inside: Bool[np.ndarray, " n"] = rises & (np.maximum(start[:, 2], 0.0) <= height)
        return float(self.rays.weights[~inside].sum() / self.flux_w)

    def _crossings(self) -> Float[np.ndarray, "n 2"]:
        """Where the lines of the rays meet z = 0 (mm); rays along that plane stay where they start."""
        start, direction = self.rays.origins, self.rays.directions
        level = np.abs(direction[:, 2]) < 1e-9
        length = np.where(level, 0.0, -start[:, 2] / np.where(level, 1.0, direction[:, 2]))
        crossings: Float[np.ndarray, "n 2"] = start[:, :2] + length[:, None] * direction[:, :2]
        return crossings

    def _only(self, index: np.ndarray) -> "RayfileEmitter":
        part = self.rays.take(index)
        return replace(self, rays=replace(part, weights=part.weights * (self.flux_w / part.weights.sum())))


def _median(points: Float[np.ndarray, "n 2"], weights: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 2"]:
    """The flux-weighted median of each coordinate: stray light does not move it."""
    order = np.argsort(points, axis=0)
    middle = [np.searchsorted(np.cumsum(weights[column]), 0.5 * weights.sum()) for column in order.T]
    return np.array([points[order[row, axis], axis] for axis, row in enumerate(middle)])


def _hull(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """Corners of the convex hull in order; of the bounding box where the points lie on one line."""
    try:
        corners: Float[np.ndarray, "k 2"] = points[ConvexHull(points).vertices]
        return corners
    except (QhullError, ValueError):
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
