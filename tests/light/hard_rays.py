"""Rays that are hard to follow to their first crossing, and that crossing by the kernel."""

import numpy as np
import torch
from scipy.ndimage import map_coordinates

from lensforge.kernels.fate import Fate
from lensforge.light.reference_hits import Approach
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import Media, Medium
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

_UNMET = Fate.BACKWARD, Fate.OUTSIDE_CAVITY, Fate.NOT_CONVERGED


def all_hits(
    starts: np.ndarray, directions: np.ndarray, table: np.ndarray, grid: TableGrid
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path lengths to crossings by the kernels, where there are any above z = 0, and where the search gave up.

    The table is the inner face of a lens of air, within a wide sphere.
    """
    tables = np.stack([table, np.full_like(table, 2.0 * table.max())])
    rays = RayBundle(starts, directions, np.ones(len(starts)))
    traced = TracedBundle.of(tables, Scene(Media(Medium(1.0)), grid), rays)
    fates = traced.exits.fates
    return traced.lengths[:, 0], ~np.isin(fates, _UNMET), fates == Fate.NOT_CONVERGED


def approach(starts: np.ndarray, directions: np.ndarray, sense: float = 1.0, device: str = "cpu") -> Approach:
    """These rays on their way to a face, from inside or, with a ``sense`` of -1, from outside."""
    points = torch.from_numpy(starts).to(device)
    along = torch.from_numpy(directions).to(device)
    ones = torch.ones_like(points[:, 0])
    return Approach(points, along, sense * ones, ones < 0.0, torch.inf * ones)


def gap(points: np.ndarray, table: np.ndarray, grid: TableGrid) -> np.ndarray:
    """rho - |p| (mm) with scipy's spline evaluation."""
    r = np.linalg.norm(points, axis=-1)
    position = (points[..., :2] / (r + points[..., 2])[..., None] - grid.origin) / grid.step
    return map_coordinates(table, np.moveaxis(position, -1, 0), order=3, prefilter=False) - r


def hard_rays(table: np.ndarray, grid: TableGrid, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts from deep inside to a hair below the surface; directions from radial to tangent, up and down."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(count, 3))
    u[:, 2] = np.abs(u[:, 2])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    rho = gap(u, table, grid) + 1.0
    starts = u * (rho * (1.0 - 10.0 ** rng.uniform(-9, -0.01, count)))[:, None]
    across = np.cross(u, rng.normal(size=u.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    lean = rng.normal(size=count) * 10.0 ** rng.uniform(-6, 0.5, count)
    d = across + lean[:, None] * u
    return starts, d / np.linalg.norm(d, axis=1, keepdims=True)
