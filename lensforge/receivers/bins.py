"""Irradiance for judging: every ray belongs to the one pixel that it hits."""

import numpy as np
from jaxtyping import Float

from lensforge.receivers.pixels import PixelGrid


def bin_flux(
    hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], grid: PixelGrid
) -> Float[np.ndarray, "p p"]:
    """Flux (W) in each pixel [row y, column x]; rays beside the grid are left out, as they are in a camera."""
    cell = np.floor((hits / grid.side_mm + 0.5) * grid.pixels)
    inside = np.all((cell >= 0) & (cell < grid.pixels), axis=1) & (flux > 0.0)
    column, row = cell[inside].astype(np.int64).T
    total = np.bincount(row * grid.pixels + column, flux[inside], minlength=grid.pixels**2)
    return total.astype(np.float64).reshape(grid.pixels, grid.pixels)  # no ray inside: bincount gives integers


def flux_in_square(hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], side_mm: float) -> float:
    """Flux (W) within a centred square of ``side_mm``."""
    return float(flux[np.all(np.abs(hits) <= side_mm / 2.0, axis=1)].sum())
