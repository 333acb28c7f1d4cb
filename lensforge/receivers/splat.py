"""Irradiance by the paper's area weights: the four-pixel splat, outside of a search."""

import numpy as np
from jaxtyping import Float

from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.splat_kernel import splat
from lensforge.tracing.chunks import CHUNKS, in_chunks


def splat_flux(
    hits: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"], grid: PixelGrid
) -> Float[np.ndarray, "p p"]:
    """Flux (W) in each pixel, from hits (mm) and flux (W); ``collect`` has the gradient."""
    images = np.zeros((CHUNKS, grid.pixels, grid.pixels))
    in_chunks(lambda chunk, part: splat(hits[part], flux[part], grid.side_mm, images[chunk]), len(flux))
    image: Float[np.ndarray, "p p"] = images.sum(axis=0)
    return image
