"""Emitting areas in the plane z = 0, which map points of the unit square to start points of equal flux."""

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, QhullError

from lensforge.sources.inverse_cdf import choose
from lensforge.surfaces.mirror_group import largest_symmetry

_SAME_MM = 1e-9


@runtime_checkable
class Area(Protocol):
    """An emitting area of any kind."""

    @property
    def symmetry(self) -> str:
        """Largest mirror group that maps it onto itself."""

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Points (mm) distributed as its light, from pairs of uniform numbers."""

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Density (1/mm^2) of light at points (mm): its integral is 1."""

    def corners(self) -> Float[np.ndarray, "k 2"]:
        """Corners (mm) of a polygon around it."""


@dataclass(frozen=True)
class Disc:
    """A uniform disc about the axis."""

    radius_mm: float
    symmetry: str = "square"

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Take the radius from the square root of the first number, the azimuth from the second."""
        radius = self.radius_mm * np.sqrt(points[:, 0])
        azimuth = 2.0 * np.pi * points[:, 1]
        return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=1)

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Density (1/mm^2) at each point: uniform over the disc."""
        return np.full(len(points), 1.0 / (np.pi * self.radius_mm**2))

    def corners(self) -> Float[np.ndarray, "k 2"]:
        """A polygon of 64 corners around the disc."""
        azimuth = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
        return np.asarray(self.radius_mm / np.cos(np.pi / 64) * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1))


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Uniform rectangles: centres and sides (mm), the share of the flux of each, and the number of its spectrum.

    ``spectra``: empty if all have the same.
    """

    centres: Float[np.ndarray, "k 2"]
    sides: Float[np.ndarray, "k 2"]
    shares: Float[np.ndarray, " k"]
    spectra: Int[np.ndarray, " _"] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def symmetry(self) -> str:
        """Largest mirror group found by comparing the rectangles with their mirror images."""
        original = self._sorted(np.eye(3))
        return largest_symmetry(lambda mirror: np.allclose(self._sorted(mirror), original, rtol=0.0, atol=_SAME_MM))

    def _sorted(self, mirror: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "k _"]:
        matrix = mirror[:2, :2]
        colours = [self.spectra] if len(self.spectra) else []
        table = np.column_stack([self.centres @ matrix.T, self.sides @ np.abs(matrix).T, self.shares, *colours])
        return table[np.lexsort(np.round(table / _SAME_MM).T)]

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Choose the rectangle by the first number; its remainder and the second number give the position in it."""
        index, remainder = choose(np.cumsum(self.shares), points[:, 0])
        inside = np.stack([remainder, points[:, 1]], axis=1) - 0.5
        return np.asarray(self.centres[index] + inside * self.sides[index])

    def numbers(self, numbers: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
        """Number of the rectangle that :meth:`place` chooses by each first number."""
        return choose(np.cumsum(self.shares), numbers)[0]

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Sum over the rectangles that contain each point."""
        density = np.zeros(len(points))
        for centre, side, share in zip(self.centres, self.sides, self.shares, strict=True):
            inside = (np.abs(points - centre) <= 0.5 * side + _SAME_MM).all(axis=1)
            density[inside] += share / float(np.prod(side))
        return density

    def corners(self) -> Float[np.ndarray, "k 2"]:
        """Convex hull of all rectangles."""
        signs = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
        points = (self.centres[:, None] + signs * self.sides[:, None]).reshape(-1, 2)
        return convex_hull(points)


@dataclass(frozen=True, eq=False)
class LuminanceImage:
    """Image centred on the axis, row 0 at its top (+y); each pixel uniform, ``values`` relative luminance."""

    values: Float[np.ndarray, "h w"]
    pitch_mm: float

    @classmethod
    def of(cls, values: Float[np.ndarray, "h w"], width_mm: float) -> "LuminanceImage":
        """Image of ``values``, not all 0, that is ``width_mm`` wide."""
        return cls(values / values.sum(), width_mm / values.shape[1])

    @property
    def symmetry(self) -> str:
        """Largest mirror group found by comparing the image with its mirror images, bit by bit."""
        return largest_symmetry(lambda mirror: np.array_equal(self._mirrored(mirror), self.values))

    def _mirrored(self, mirror: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "a b"]:
        upright = self.values[::-1].T  # first index x, second y
        turned = upright.T if mirror[0, 0] == 0.0 else upright
        signs = mirror.sum(axis=1)
        return turned[:: int(signs[0]), :: int(signs[1])].T[::-1]

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Choose the row by the first number, the column by the second given the row; uniform inside the pixel."""
        height, width = self.values.shape
        row, down = choose(np.cumsum(self.values.sum(axis=1)), points[:, 0])
        cumulative = np.cumsum(self.values)  # flat: a row's own distribution is a stretch of it
        first = np.where(row > 0, cumulative[row * width - 1], 0.0)
        last = cumulative[row * width + width - 1]
        flat, across = choose(cumulative, (first + points[:, 1] * (last - first)) / cumulative[-1])
        column = np.clip(flat - row * width, 0, width - 1)
        x = (column + across) - 0.5 * width
        y = 0.5 * height - (row + down)
        return self.pitch_mm * np.stack([x, y], axis=1)

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Share of the flux per mm^2 in the pixel in which each point (mm) lies."""
        height, width = self.values.shape
        column = np.clip(np.floor(points[:, 0] / self.pitch_mm + 0.5 * width), 0, width - 1).astype(int)
        row = np.clip(np.floor(0.5 * height - points[:, 1] / self.pitch_mm), 0, height - 1).astype(int)
        return np.asarray(self.values[row, column] / self.pitch_mm**2)

    def corners(self) -> Float[np.ndarray, "4 2"]:
        """Rectangle (mm) around the pixels that emit."""
        height, width = self.values.shape
        rows, columns = np.nonzero(self.values)
        left = columns.min() - 0.5 * width
        right = columns.max() + 1 - 0.5 * width
        top = 0.5 * height - rows.min()
        bottom = 0.5 * height - rows.max() - 1
        return self.pitch_mm * np.array([[left, bottom], [right, bottom], [right, top], [left, top]])


def hull_points(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """Corners of the convex hull of the points, in order; only both ends if all are collinear."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return np.unique(points, axis=0)[[0, -1]] if len(points) else points


def convex_hull(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """Corners of the convex hull in order; of the bounding box if the points are collinear."""
    corners = hull_points(points)
    if len(corners) > 2:
        return corners
    (x0, y0) = points.min(axis=0)
    (x1, y1) = points.max(axis=0)
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
