"""From a tilted camera's picture to the target plane in mm, by the homography of four corners."""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates

from lensforge.errors import InputError
from lensforge.receivers.pixels import PixelGrid

_MOST_SAMPLES = 16  # a side, for each pixel of the result
_ORDER = "top left, top right, bottom right, bottom left of the simulated picture (y upwards)"


def rectify(
    picture: Float[np.ndarray, "h w"], corners: Float[np.ndarray, "4 2"], target_mm: float, grid: PixelGrid
) -> Float[np.ndarray, "p p"]:
    """The mean of ``picture`` over each pixel of ``grid``, indexed [y, x] with y upwards.

    ``corners``: column and row in the picture, 0 at the centre of the first pixel, of the corners of the centred square
    of ``target_mm``: top left, top right, bottom right, bottom left as the simulation shows them. A camera behind the
    panel sees them mirrored; given in this order, they turn the picture back. Light outside of the picture is NaN.
    Raises :class:`InputError` for corners that do not bound a square seen from one side.
    """
    transform = _homography(corners, target_mm)
    samples = _samples(corners, target_mm, grid)
    fine = PixelGrid(grid.side_mm, grid.pixels * samples)
    y, x = np.meshgrid(fine.axis_mm(), fine.axis_mm(), indexing="ij")
    columns, rows = transform(np.stack([x.ravel(), y.ravel()], axis=1)).T
    values = map_coordinates(picture, [rows, columns], order=1, mode="constant", cval=np.nan)
    blocks = values.reshape(grid.pixels, samples, grid.pixels, samples)
    mean: Float[np.ndarray, "p p"] = blocks.mean(axis=(1, 3))
    return mean


def _homography(corners: Float[np.ndarray, "4 2"], target_mm: float) -> Any:
    """From mm on the target to column and row: a ``skimage.transform.ProjectiveTransform``."""
    from skimage.transform import ProjectiveTransform

    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    if not (np.isfinite(corners).all() and ((turns > 1.0).all() or (turns < -1.0).all())):
        raise InputError(f"--corners: {listed(corners)} bound no convex quadrangle; the order is {_ORDER}")
    half = target_mm / 2.0
    square = np.array([[-half, half], [half, half], [half, -half], [-half, -half]])
    return ProjectiveTransform.from_estimate(square, corners)


def _samples(corners: Float[np.ndarray, "4 2"], target_mm: float, grid: PixelGrid) -> int:
    """Samples a side of a pixel: as many as the picture has pixels there, so that none of them is left out."""
    longest = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).max()
    return int(np.clip(np.ceil(longest / target_mm * grid.pitch_mm), 2, _MOST_SAMPLES))


def listed(corners: Float[np.ndarray, "4 2"]) -> str:
    """Corners as they are written after --corners, to a tenth of a pixel."""
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
