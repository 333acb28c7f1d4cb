"""Rays that are hard to follow to their first crossing, and that crossing by the kernel."""

import numpy as np
from scipy.ndimage import map_coordinates

from lensforge.kernels.compiled import kernel
from lensforge.kernels.first_hit import DX, LENGTH, PX, SIZE, STATUS, empty_packet, first_hits, start_all
from lensforge.surfaces.bicubic_table import TableGrid


@kernel
def _hits(origins, directions, table, origin, inverse_step, bounds, lengths, states, rays):
    """Fill path lengths and states packet by packet."""
    for first in range(0, len(lengths), SIZE):
        count = min(SIZE, len(lengths) - first)
        for k in range(count):
            for axis in range(3):
                rays[PX + axis * SIZE + k] = origins[first + k, axis]
                rays[DX + axis * SIZE + k] = directions[first + k, axis]
        first_hits(rays, start_all(rays, count), table, origin, inverse_step, bounds, False, False)
        for k in range(count):
            lengths[first + k], states[first + k] = rays[LENGTH + k], rays[STATUS + k]


def all_hits(origins, directions, table, origin, inverse_step, bounds, lengths, states):
    """Fill path lengths and states by the kernel."""
    _hits(origins, directions, table, origin, inverse_step, bounds, lengths, states, empty_packet())


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
