"""Rays through the exact SRBF sum, quickly: the table only says where to begin, Newton's steps end on the sum itself.

It takes nothing from the fused kernels: the search runs on the table by plain NumPy, refraction is that of
:mod:`lensforge.optics`.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from lensforge.lens import Lens
from lensforge.optics.dielectric import fresnel_transmittance, refract, transmitted_cosine_squared
from lensforge.sources.bundle import RayBundle
from lensforge.surfaces.spline import TableGrid, evaluate_table
from lensforge.surfaces.surface import Surface

_SCAN_STEPS, _BISECTIONS = 48, 40
_NEWTON_STEPS = 2  # from some nm: the first leaves the square of that, the second rounding


@dataclass(frozen=True)
class ExactHits:
    """Hits (mm) and flux (W) at the receiver's plane; 0 for rays that do not arrive."""

    hits: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]

    @property
    def arrived(self) -> Bool[np.ndarray, " n"]:
        """Rays that reached the plane."""
        return self.flux > 0.0


def trace_exact_sum(
    lens: Lens, grid: TableGrid, tables: dict[str, Float[np.ndarray, "side side"]], rays: RayBundle
) -> ExactHits:
    """Trace ``rays`` through the exact surfaces; ``tables`` of both, by name, bracket the first crossings."""
    origins, directions, carried = rays.origins.copy(), rays.directions.copy(), rays.weights.copy()
    alive = np.flatnonzero((directions[:, 2] > 0.0) & (origins[:, 2] >= 0.0))
    own = rays.refractive_indices
    index = np.full(len(rays), lens.refractive_index) if own is None else own
    for name, ratios in (("inner", 1.0 / index), ("outer", index)):
        surface: Surface = getattr(lens, name)
        lengths, found = _search(grid, tables[name], origins[alive], directions[alive])
        alive, lengths = alive[found], lengths[found]
        points, normals = _polish(surface, origins[alive], directions[alive], lengths)
        cosine = np.sum(directions[alive] * normals, axis=1)
        ratio = torch.from_numpy(ratios[alive])
        behind_squared = transmitted_cosine_squared(torch.from_numpy(cosine), ratio).numpy()
        passes = (behind_squared > 0.0) & (cosine > 0.0) & (points[:, 2] >= 0.0)
        alive, points, normals, cosine = alive[passes], points[passes], normals[passes], cosine[passes]
        ratio = ratio[torch.from_numpy(passes)]
        origins[alive] = points
        directions[alive] = refract(torch.from_numpy(directions[alive]), torch.from_numpy(normals), ratio).numpy()
        carried[alive] *= fresnel_transmittance(torch.from_numpy(cosine), ratio).numpy()
    alive = alive[directions[alive, 2] > 0.0]
    way = (lens.spec.target.distance_mm - origins[alive, 2]) / directions[alive, 2]
    hits, flux = np.zeros((len(rays), 2)), np.zeros(len(rays))
    hits[alive] = (origins[alive] + way[:, None] * directions[alive])[:, :2]
    flux[alive] = carried[alive]
    return ExactHits(hits, flux)


def _search(
    grid: TableGrid,
    table: Float[np.ndarray, "side side"],
    origins: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
) -> tuple[Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Path length to the first crossing of the table above z = 0, and whether there is one."""

    def inside(lengths: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        points = origins + lengths[:, None] * directions
        distance = np.maximum(np.linalg.norm(points, axis=1), 1e-300)
        rising = points / distance[:, None]
        rising[:, 2] = np.maximum(rising[:, 2], -0.2)  # the chart's table ends a little below the horizon
        return evaluate_table(grid, table, rising) > distance

    reach = 2.5 * float(table.max())
    low, high = np.zeros(len(origins)), np.full(len(origins), reach)
    found = np.zeros(len(origins), dtype=bool)
    for step in range(1, _SCAN_STEPS + 1):
        here = np.full(len(origins), reach * step / _SCAN_STEPS)
        outside = ~inside(here)
        high = np.where(outside & ~found, here, high)
        found |= outside
        low = np.where(found, low, here)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        before = inside(middle)
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return 0.5 * (low + high), found


def _polish(
    surface: Surface,
    origins: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    lengths: Float[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points on the exact surface and their unit normals, from lengths that are nearly right."""
    normals = np.empty_like(origins)
    for step in range(_NEWTON_STEPS + 1):
        points = origins + lengths[:, None] * directions
        distance = np.linalg.norm(points, axis=1)
        u = points / distance[:, None]
        normals = u - surface.gradient(u) / distance[:, None]  # of |p| - rho(p/|p|), not yet of length 1
        if step < _NEWTON_STEPS:
            gap = surface.radius(u) - distance
            lengths = lengths + gap / np.sum(normals * directions, axis=1)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)
