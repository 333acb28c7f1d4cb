"""The exact tracer: rays through the surfaces themselves, not through their tables.

It shares no intersection code with the compiled kernels. Crossings are bracketed by a scan, of the exact surface
(``DenseScan``, the reference for the kernels) or of its table (``TableScan``, 50 times faster), and refined by
bisection; the Newton step of :func:`~lensforge.light.sequential_trace.trace_sequence` then ends on the exact surface.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.light.sequential_trace import Crossing, TensorRays, TracedSurface, trace_sequence
from lensforge.optics.media import Media
from lensforge.scene.as_made import AsMade
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import RayBundle
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

    The error is ``reach_mm / steps / 2^bisections``; the Newton step that follows squares it.
    """

    steps: int = 256
    bisections: int = 60
    reach_mm: float | None = None  # None: as far as the surface may reach

    def first_crossing(
        self, surface: BoundedSurface, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]
    ) -> Crossing:
        """First sign change within reach; no search is ever given up."""

        def inside(lengths: Float[Tensor, " n"]) -> Bool[Tensor, " n"]:
            return surface.gap(origins + lengths[:, None] * directions) >= 0.0

        with torch.no_grad():
            reach = torch.full_like(origins[:, 0], surface.reach_mm if self.reach_mm is None else self.reach_mm)
            return _bracketed(inside, reach, _to_plane(origins, directions), self.steps, self.bisections)


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
        self, surface: TracedSurface, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]
    ) -> Crossing:
        """First crossing of the table's surface, moved onto the exact one."""

        def inside(lengths: Float[Tensor, " n"]) -> Bool[Tensor, " n"]:
            points = origins + lengths[:, None] * directions
            distance = torch.linalg.norm(points, dim=1)
            # rays end at z = 0, to rounding; the origin has no direction, and is inside whatever it is taken for
            height = points[:, 2].clamp(min=0.0)
            at_origin = (points[:, :2] == 0.0).all(dim=1) & (height == 0.0)
            seen = torch.column_stack([points[:, :2], torch.where(at_origin, 1.0, height)])
            rho: Tensor = torch.from_numpy(evaluate_table(self.grid, self.table, seen.numpy()))
            return torch.ge(rho, distance)

        with torch.no_grad():
            reach = torch.full_like(origins[:, 0], 2.5 * float(self.table.max()))
            crossing = _bracketed(inside, reach, _to_plane(origins, directions), self.steps, self.bisections)
            lengths = crossing.lengths
            for _ in range(self.newton_steps):
                points = origins + lengths[:, None] * directions
                slope = -torch.sum(surface.normal(points) * directions, dim=1)
                lengths = lengths - surface.gap(points) / torch.where(slope < 0.0, slope, -torch.inf)
            return crossing._replace(lengths=lengths)


def _to_plane(origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """Path (mm) of each ray from z >= 0 down to the plane z = 0, below which no surface counts; infinite upwards."""
    fall = -directions[:, 2]
    return torch.where(fall > 0.0, origins[:, 2] / torch.where(fall > 0.0, fall, 1.0), torch.inf)


def _bracketed(
    inside: Callable[[Float[Tensor, " n"]], Bool[Tensor, " n"]],
    reach: Float[Tensor, " n"],
    end: Float[Tensor, " n"],
    steps: int,
    bisections: int,
) -> Crossing:
    """First change of ``inside`` along each ray in ``steps`` equal steps up to ``reach`` (mm), bisected.

    No ray is followed beyond ``end`` (mm).
    """
    low, high, found = torch.zeros_like(reach), torch.minimum(reach, end), torch.zeros_like(reach, dtype=torch.bool)
    for step in range(1, steps + 1):
        if bool(found.all()):
            break
        here = torch.minimum(reach * step / steps, end)
        outside = ~inside(here)
        high = torch.where(outside & ~found, here, high)
        found |= outside
        low = torch.where(found, low, here)
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        before = inside(middle)
        low, high = torch.where(before, middle, low), torch.where(before, high, middle)
    return Crossing(0.5 * (low + high), found, torch.zeros_like(found))


@dataclass(frozen=True)
class FixedSurface:
    """A surface whose shape is constant, by its own radius and gradient: float64 on the CPU."""

    surface: Surface
    scan: DenseScan | TableScan

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        directions, distance = _directions(points), torch.linalg.norm(points, dim=1, keepdim=True)
        turned: Tensor = torch.from_numpy(self.surface.gradient(directions)) / distance
        return torch.from_numpy(directions) - turned

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|`` (mm): positive inside."""
        rho: Tensor = torch.from_numpy(self.surface.radius(_directions(points)))
        return torch.sub(rho, torch.linalg.norm(points, dim=1))

    def first_crossing(self, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Crossing:
        """First crossing by ``scan``."""
        return self.scan.first_crossing(self, origins, directions)

    @property
    def reach_mm(self) -> float:
        """Twice the largest radius, and a little more."""
        return 2.2 * float(self.surface.radius(fibonacci_hemisphere(_SIZE_DIRECTIONS)).max())


def _directions(points: Float[Tensor, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit directions of points; the origin has none, and is inside whatever it is taken for."""
    distance = torch.linalg.norm(points, dim=1, keepdim=True)
    upwards = torch.tensor([0.0, 0.0, 1.0], dtype=points.dtype)
    return torch.where(distance > 0.0, points / torch.where(distance > 0.0, distance, 1.0), upwards).numpy()


def exact_surfaces(
    lens: Lens, scans: tuple[DenseScan | TableScan, DenseScan | TableScan]
) -> tuple[TracedSurface, TracedSurface]:
    """Inner and outer surface of ``lens``, of constant shape, by compiled sums; their crossings found by ``scans``."""
    return FixedSurface(lens.inner, scans[0]), FixedSurface(lens.outer, scans[1])


def trace_exact(
    inner: TracedSurface,
    outer: TracedSurface,
    media: Media,
    rays: RayBundle,
    made: AsMade | None = None,
    dtype: torch.dtype = torch.float64,
) -> ExitRays:
    """Trace ``rays`` through exact surfaces on the CPU; differentiable in what the surfaces are differentiable in.

    Slow by design: a dense scan evaluates all functions 300 times for each ray. Rays keep indices of their own.
    """
    return trace_sequence(inner, outer, TensorRays.of(rays, media, dtype, torch.device("cpu"), made))
