"""The exact tracer: rays through the surfaces themselves, not through their tables.

It shares no intersection code with the compiled kernels. Crossings are bracketed by a scan, of the exact surface
(``DenseScan``, the reference for the kernels) or of its table (``TableScan``, 50 times faster), and refined by
bisection; the Newton step of :func:`~lensforge.light.sequential_trace.trace_sequence` then ends on the exact surface.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float

from lensforge.light.sequential_trace import Crossing, TracedSurface
from lensforge.optics.arrays import Array, lengths, like, module_of, without_gradient
from lensforge.surfaces.bicubic_table import TableGrid, evaluate_table
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

_SIZE_DIRECTIONS = 1000  # over the hemisphere, at which the reach of a fixed surface is sampled


class BoundedSurface(TracedSurface, Protocol):
    """A surface that no ray from inside is still within after ``reach_mm``."""

    @property
    def reach_mm(self) -> float:
        """Length (mm) of that path."""
        ...


@dataclass(frozen=True)
class DenseScan:
    """Scan of the exact surface: ``steps`` over its reach bracket a crossing, ``bisections`` refine it.

    The error is ``reach_mm / steps / 2^bisections``; the Newton step that follows squares it. Slow by design: all
    functions are evaluated 300 times for each ray.
    """

    steps: int = 256
    bisections: int = 60

    def first_crossing(
        self, surface: BoundedSurface, origins: Float[Array, "n 3"], directions: Float[Array, "n 3"]
    ) -> Crossing:
        """First sign change within reach; no search is ever given up."""

        def inside(paths: Float[Array, " n"]) -> Bool[Array, " n"]:
            return surface.gap(origins + paths[:, None] * directions) >= 0.0

        with without_gradient(origins):
            return bracketed(inside, surface.reach_mm, to_plane(origins, directions), self.steps, self.bisections)


@dataclass(frozen=True)
class TableScan:
    """Scan of a table (mm) of the surface, which has its crossings to the table's error of some nm.

    For a coarser table ``newton_steps`` on the exact surface follow.
    """

    grid: TableGrid
    table: Float[np.ndarray, "side side"]
    newton_steps: int = 0
    steps: int = 48
    bisections: int = 30

    def first_crossing(
        self, surface: TracedSurface, origins: Float[Array, "n 3"], directions: Float[Array, "n 3"]
    ) -> Crossing:
        """First crossing of the table's surface, moved onto the exact one."""

        def inside(paths: Float[Array, " n"]) -> Bool[Array, " n"]:
            points = np.asarray(origins + paths[:, None] * directions)
            # rays end at z = 0, to rounding; the origin has no direction, and is inside whatever it is taken for
            height = np.maximum(points[:, 2], 0.0)
            at_origin = (points[:, :2] == 0.0).all(axis=1) & (height == 0.0)
            seen = np.column_stack([points[:, :2], np.where(at_origin, 1.0, height)])
            within: Bool[np.ndarray, " n"] = evaluate_table(self.grid, self.table, seen) >= lengths(points)
            return like(paths > 0.0, within)

        with without_gradient(origins):
            reach = 2.5 * float(self.table.max())
            crossing = bracketed(inside, reach, to_plane(origins, directions), self.steps, self.bisections)
            paths, xp = crossing.lengths, module_of(origins)
            for _ in range(self.newton_steps):
                points = origins + paths[:, None] * directions
                slope = -(surface.normal(points) * directions).sum(1)
                paths = paths - surface.gap(points) / xp.where(slope < 0.0, slope, -np.inf)
            return crossing._replace(lengths=paths)


def to_plane(origins: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Path (mm) of each ray from z >= 0 down to the plane z = 0, below which no surface counts; infinite upwards."""
    fall, xp = -directions[:, 2], module_of(directions)
    return xp.where(fall > 0.0, origins[:, 2] / xp.where(fall > 0.0, fall, 1.0), np.inf)


def bracketed(
    inside: Callable[[Float[Array, " n"]], Bool[Array, " n"]],
    reach: float,
    end: Float[Array, " n"],
    steps: int,
    bisections: int,
) -> Crossing:
    """First change of ``inside`` along each ray in ``steps`` equal steps up to ``reach`` (mm), bisected.

    No ray is followed beyond ``end`` (mm).
    """
    xp = module_of(end)
    low, high = xp.zeros_like(end), xp.where(end < reach, end, reach)
    found = low > 0.0
    for step in range(1, steps + 1):
        if bool(found.all()):
            break
        here = xp.where(end < reach * step / steps, end, reach * step / steps)
        outside = ~inside(here)
        high = xp.where(outside & ~found, here, high)
        found = found | outside
        low = xp.where(found, low, here)
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        before = inside(middle)
        low, high = xp.where(before, middle, low), xp.where(before, high, middle)
    return Crossing(0.5 * (low + high), found, xp.zeros_like(found))


@dataclass(frozen=True)
class FixedSurface:
    """A surface whose shape is constant, by its own radius and gradient: NumPy arrays."""

    surface: Surface
    scan: DenseScan | TableScan

    def normal(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        directions = _directions(points)
        normal: Float[np.ndarray, "n 3"] = directions - self.surface.gradient(directions) / lengths(points)[:, None]
        return normal

    def gap(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``F = rho - |p|`` (mm): positive inside."""
        gap: Float[np.ndarray, " n"] = self.surface.radius(_directions(points)) - lengths(points)
        return gap

    def first_crossing(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> Crossing:
        """First crossing by ``scan``."""
        return self.scan.first_crossing(self, origins, directions)

    @property
    def reach_mm(self) -> float:
        """Twice the largest radius, and a little more."""
        return 2.2 * float(self.surface.radius(fibonacci_hemisphere(_SIZE_DIRECTIONS)).max())


def _directions(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit directions of points; the origin has none, and is inside whatever it is taken for."""
    distance = lengths(points)[:, None]
    return np.where(distance > 0.0, points / np.where(distance > 0.0, distance, 1.0), (0.0, 0.0, 1.0))
