"""Irradiance for judging: every ray belongs to the one pixel that it hits."""

import numpy as np
from jaxtyping import Float

from lensforge.receivers.plane import Receiver


def bin_flux(
    hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], receiver: Receiver
) -> Float[np.ndarray, "p p"]:
    """Flux (W) in each pixel [row y, column x]; rays beside the receiver are left out, as they are in a camera."""
    cell = np.floor((hits / receiver.side_mm + 0.5) * receiver.pixels)
    inside = np.all((cell >= 0) & (cell < receiver.pixels), axis=1) & (flux > 0.0)
    column, row = cell[inside].astype(np.int64).T
    total = np.bincount(row * receiver.pixels + column, flux[inside], minlength=receiver.pixels**2)
    return total.astype(np.float64).reshape(receiver.pixels, receiver.pixels)  # no ray inside: bincount gives integers


def flux_in_square(hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], side_mm: float) -> float:
    """Flux (W) within a centred square of ``side_mm``."""
    return float(flux[np.all(np.abs(hits) <= side_mm / 2.0, axis=1)].sum())
