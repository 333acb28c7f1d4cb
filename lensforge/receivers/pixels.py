"""Pixels of a square image, and the flux of rays on them: hard bins, the paper's splat, the paper's filter."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import convolve1d

from lensforge.kernels.jit import CHUNKS, in_chunks
from lensforge.kernels.landing import splat


@dataclass(frozen=True)
class PixelGrid:
    """``side_mm`` wide, ``pixels`` x ``pixels``. Images are indexed [row = y, column = x], y upwards."""

    side_mm: float
    pixels: int

    @property
    def pitch_mm(self) -> float:
        """Width of a pixel."""
        return self.side_mm / self.pixels

    def axis_mm(self) -> Float[np.ndarray, " p"]:
        """Coordinates of the pixel centres along either axis."""
        return (np.arange(self.pixels) + 0.5) * self.pitch_mm - self.side_mm / 2.0

    def rectangle_mask(self, width_mm: float, height_mm: float) -> Bool[np.ndarray, "p p"]:
        """Pixels whose centres lie within a centred rectangle, ``width_mm`` along x."""
        distance = np.abs(self.axis_mm())
        mask: Bool[np.ndarray, "p p"] = (distance <= height_mm / 2.0)[:, None] & (distance <= width_mm / 2.0)[None, :]
        return mask

    def square_mask(self, side_mm: float) -> Bool[np.ndarray, "p p"]:
        """Pixels whose centres lie within a centred square of ``side_mm``."""
        return self.rectangle_mask(side_mm, side_mm)


def bin_flux(
    hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], grid: PixelGrid
) -> Float[np.ndarray, "p p"]:
    """Flux (W) in each pixel [row y, column x]; rays outside the grid are left out, as they are in a camera."""
    cell = np.floor((hits / grid.side_mm + 0.5) * grid.pixels)
    inside = np.all((cell >= 0) & (cell < grid.pixels), axis=1) & (flux > 0.0)
    column, row = cell[inside].astype(np.int64).T
    total = np.bincount(row * grid.pixels + column, flux[inside], minlength=grid.pixels**2)
    return total.astype(np.float64).reshape(grid.pixels, grid.pixels)  # no ray inside: bincount gives integers


def flux_in_square(hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], side_mm: float) -> float:
    """Flux (W) within a centred square of ``side_mm``."""
    return float(flux[np.all(np.abs(hits) <= side_mm / 2.0, axis=1)].sum())


def splat_flux(
    hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], grid: PixelGrid
) -> Float[np.ndarray, "p p"]:
    """Flux (W) in each pixel by the splat of the paper's Fig. 3; ``optimisation.collect`` has the gradient."""
    images = np.zeros((CHUNKS, grid.pixels, grid.pixels))
    in_chunks(lambda chunk, part: splat(hits[part], flux[part], grid.side_mm, images[chunk]), len(flux))
    image: Float[np.ndarray, "p p"] = images.sum(axis=0)
    return image


def gaussian3(image: Float[np.ndarray, "p p"], variance: float) -> Float[np.ndarray, "p p"]:
    """Convolve with the normalised 3 x 3 Gaussian; edge pixels are repeated outwards. Variance 0: unchanged."""
    if variance == 0.0:
        return image
    side = float(np.exp(-0.5 / variance))
    taps = np.array([side, 1.0, side]) / (1.0 + 2.0 * side)
    smoothed = convolve1d(convolve1d(image, taps, axis=0, mode="nearest"), taps, axis=1, mode="nearest")
    return np.asarray(smoothed, dtype=np.float64)
