"""Emitting areas in the plane z = 0, which map points of the unit square to start points of equal flux.

The points are scrambled Sobol sequences (Owen 1998; Matousek's linear scramble), by scipy.
"""

import warnings
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError
from scipy.stats import qmc

from lensforge.sources.inverse_cdf import choose
from lensforge.surfaces.mirror_group import largest_symmetry


def sobol(count: int, dimensions: int, seed: int) -> Float[np.ndarray, "n d"]:
    """Draw ``count`` points of the unit cube, scrambled by ``seed``; a power of two is best balanced."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # scipy warns unless the count is a power of two
        points: Float[np.ndarray, "n d"] = qmc.Sobol(dimensions, scramble=True, rng=seed).random(count)
        return points


_SAME_MM = 1e-9


@runtime_checkable
class Area(Protocol):
    """An emitting area."""

    @property
    def symmetry(self) -> str:
        """Largest mirror group that leaves the area and its flux as they are."""
        ...

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Map points of the unit square to start points (mm); equal areas get equal flux."""
        ...

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Share of the flux per mm^2 at ``points`` (mm) of the area; infinite where it has no extent."""
        ...

    def corners(self) -> Float[np.ndarray, "k 2"]:
        """A convex polygon (mm) around the area."""
        ...


@dataclass(frozen=True)
class Disc:
    """A uniform disc about the axis."""

    radius_mm: float
    symmetry: str = "square"

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Take the radius from the square root of the first number, the azimuth from the second."""
        radius, azimuth = self.radius_mm * np.sqrt(points[:, 0]), 2.0 * np.pi * points[:, 1]
        return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=1)

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """The same everywhere."""
        return np.full(len(points), 1.0 / (np.pi * self.radius_mm**2))

    def corners(self) -> Float[np.ndarray, "k 2"]:
        """A polygon of 64 corners around the disc."""
        azimuth = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
        corners: Float[np.ndarray, "k 2"] = (
            self.radius_mm / np.cos(np.pi / 64) * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
        )
        return corners


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Uniform rectangles: centres and sides (mm), and the share of the flux of each."""

    centres: Float[np.ndarray, "k 2"]
    sides: Float[np.ndarray, "k 2"]
    shares: Float[np.ndarray, " k"]

    @property
    def symmetry(self) -> str:
        """Largest mirror group found by comparing the rectangles with their mirror images."""
        original = self._sorted(np.eye(3))
        return largest_symmetry(lambda mirror: np.allclose(self._sorted(mirror), original, rtol=0.0, atol=_SAME_MM))

    def _sorted(self, mirror: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "k 5"]:
        matrix = mirror[:2, :2]
        table = np.column_stack([self.centres @ matrix.T, self.sides @ np.abs(matrix).T, self.shares])
        return table[np.lexsort(np.round(table / _SAME_MM).T)]

    def place(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Choose the rectangle by the first number; its remainder and the second number give the position in it."""
        index, rest = choose(np.cumsum(self.shares), points[:, 0])
        inside = np.stack([rest, points[:, 1]], axis=1) - 0.5
        placed: Float[np.ndarray, "n 2"] = self.centres[index] + inside * self.sides[index]
        return placed

    def density(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Sum over the rectangles in which a point lies."""
        found = np.zeros(len(points))
        for centre, side, share in zip(self.centres, self.sides, self.shares, strict=True):
            inside = (np.abs(points - centre) <= 0.5 * side + _SAME_MM).all(axis=1)
            found[inside] += share / float(np.prod(side))
        return found

    def corners(self) -> Float[np.ndarray, "k 2"]:
        """Convex hull of all rectangles."""
        signs = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
        points = (self.centres[:, None] + signs * self.sides[:, None]).reshape(-1, 2)
        return convex_hull(points)


def convex_hull(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """Corners of the convex hull in order; of the bounding box where the points lie on one line."""
    try:
        corners: Float[np.ndarray, "k 2"] = points[ConvexHull(points).vertices]
        return corners
    except (QhullError, ValueError):
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
