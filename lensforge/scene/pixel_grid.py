"""Pixels of a rectangular image, and the flux of rays on them: hard bins, the paper's splat, the paper's filter."""

from dataclasses import dataclass
from math import inf

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.ndimage import convolve1d

from lensforge.kernels.image_sums import add_to_bins, splat
from lensforge.kernels.parallel import CHUNKS, in_chunks


@dataclass(frozen=True)
class PixelGrid:
    """``columns`` x ``rows`` pixels on ``width`` x ``height``, in the unit of the receiver's chart; centred.

    Images are indexed [row = y, column = x], y upwards.
    """

    width: float
    height: float
    columns: int
    rows: int

    @staticmethod
    def square(side: float, pixels: int) -> "PixelGrid":
        """A square grid."""
        return PixelGrid(side, side, pixels, pixels)

    @staticmethod
    def of(width: float, height: float, pixels: int) -> "PixelGrid":
        """Pixels as nearly square as they can be, ``pixels`` of them along the longer side."""
        longer = max(width, height)
        columns, rows = (max(1, round(pixels * side / longer)) for side in (width, height))
        return PixelGrid(width, height, columns, rows)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of an image: rows, columns."""
        return self.rows, self.columns

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, as the kernels take them."""
        return self.width, self.height

    @property
    def pixel(self) -> tuple[float, float]:
        """Width and height of a pixel."""
        return self.width / self.columns, self.height / self.rows

    def x(self) -> Float[np.ndarray, " w"]:
        """Coordinates of the columns' centres."""
        return _centres(self.width, self.columns)

    def y(self) -> Float[np.ndarray, " h"]:
        """Coordinates of the rows' centres."""
        return _centres(self.height, self.rows)

    def finer(self, times: int) -> "PixelGrid":
        """A grid of ``times`` x ``times`` sub-pixels in every pixel."""
        return PixelGrid(self.width, self.height, times * self.columns, times * self.rows)

    def halved(self) -> "PixelGrid":
        """A grid of half as many pixels along both sides, one at least."""
        return PixelGrid(self.width, self.height, max(1, self.columns // 2), max(1, self.rows // 2))


def _centres(length: float, count: int) -> Float[np.ndarray, " k"]:
    return (np.arange(count) + 0.5) * (length / count) - length / 2.0


@dataclass(frozen=True)
class Window:
    """Part of a receiver in which flux counts as detected: a centred rectangle, a circle, or where both overlap."""

    width: float = inf
    height: float = inf
    radius: float = inf

    def packed(self) -> tuple[float, float, float]:
        """Half the width, half the height, and the squared radius, as the kernels take them."""
        return 0.5 * self.width, 0.5 * self.height, self.radius**2

    def contains(self, hits: Float[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "*n"]:
        """True for hits in the window."""
        x, y = hits[..., 0], hits[..., 1]
        half_width, half_height, square = self.packed()
        inside: Bool[np.ndarray, "*n"] = (
            (np.abs(x) <= half_width) & (np.abs(y) <= half_height) & (x * x + y * y <= square)
        )
        return inside

    def pixels(self, grid: PixelGrid) -> Bool[np.ndarray, "h w"]:
        """Pixels of ``grid`` whose centres are in the window."""
        x, y = np.meshgrid(grid.x(), grid.y())
        return self.contains(np.stack([x, y], axis=-1))


def bin_flux(
    hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], grid: PixelGrid
) -> Float[np.ndarray, "h w"]:
    """Flux (W) in each pixel [row y, column x]; rays outside the grid are left out, as they are in a camera."""
    return bin_replicates(hits, flux, grid, np.zeros(1, dtype=np.int64), 1)[0]


def bin_replicates(
    hits: Float[np.ndarray, "n 2"],
    flux: Float[np.ndarray, " n"],
    grid: PixelGrid,
    replicate: Int[np.ndarray, " k"],
    replicates: int,
) -> Float[np.ndarray, "r h w"]:
    """Flux (W) in each pixel of the image of each ray's ``replicate``, a number for each ray or one for all."""
    images = np.zeros((replicates, *grid.shape))
    add_to_bins(hits, flux, grid.size, replicate, images)
    return images


def flux_in(hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], window: Window) -> float:
    """Flux (W) within ``window``."""
    return float(flux[window.contains(hits)].sum())


def rebinned(image: Float[np.ndarray, "*r h w"], grid: PixelGrid) -> Float[np.ndarray, "*r k l"]:
    """Flux in the pixels of a coarser ``grid`` on the same receiver; pixels that two of these share are divided."""
    for axis, count in ((-2, grid.rows), (-1, grid.columns)):
        size = image.shape[axis]
        edges = np.arange(count + 1) * (size / count)
        old = np.arange(size + 1)
        held = np.clip(edges[1:, None] - old[:-1], 0.0, 1.0) - np.clip(edges[:-1, None] - old[:-1], 0.0, 1.0)
        image = np.moveaxis(np.tensordot(image, held, axes=(axis, 1)), -1, axis)
    return image


def splat_flux(
    hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], grid: PixelGrid
) -> Float[np.ndarray, "h w"]:
    """Flux (W) in each pixel by the splat of the paper's Fig. 3; ``search.collected_light`` has the gradient."""
    images = np.zeros((CHUNKS, *grid.shape))
    in_chunks(lambda chunk, part: splat(hits[part], flux[part], grid.size, images[chunk]), len(flux))
    return images.sum(axis=0)


def gaussian3(image: Float[np.ndarray, "*r h w"], variance: float) -> Float[np.ndarray, "*r h w"]:
    """Convolve one or several images with the normalised 3 x 3 Gaussian; edge pixels are repeated outwards.

    Variance 0: unchanged.
    """
    if variance == 0.0:
        return image
    side = float(np.exp(-0.5 / variance))
    taps = np.array([side, 1.0, side]) / (1.0 + 2.0 * side)
    smoothed = convolve1d(convolve1d(image, taps, axis=-2, mode="nearest"), taps, axis=-1, mode="nearest")
    return np.asarray(smoothed, dtype=np.float64)


def bilinear(grid: PixelGrid, x: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"]) -> sparse.csr_array:
    """Matrix from pixels to places on the chart, bilinear between their centres, as at the edge beyond the last."""
    column = np.maximum((x / grid.width + 0.5) * grid.columns - 0.5, 0.0)
    row = np.maximum((y / grid.height + 0.5) * grid.rows - 0.5, 0.0)
    left = column.astype(int)
    below = row.astype(int)
    right = column - left
    up = row - below
    entries = []
    rows = []
    pixels = []
    for more_x, share_x in ((0, 1.0 - right), (1, right)):
        for more_y, share_y in ((0, 1.0 - up), (1, up)):
            entries.append(share_x * share_y)
            rows.append(np.arange(len(column)))
            pixels.append(
                np.minimum(below + more_y, grid.rows - 1) * grid.columns + np.minimum(left + more_x, grid.columns - 1)
            )
    together = np.concatenate(entries), (np.concatenate(rows), np.concatenate(pixels))
    return sparse.csr_array(together, shape=(len(column), grid.rows * grid.columns))
