"""Irradiance by the paper's area weights: the four-pixel splat, outside of a search."""

import numpy as np
import torch
from jaxtyping import Float

from lensforge.receiver.plane import Receiver
from lensforge.receiver.splat_kernel import splat
from lensforge.tracing.chunks import CHUNKS, in_chunks


def splat_flux(
    hits: Float[torch.Tensor, "n 2"], flux: Float[torch.Tensor, " n"], receiver: Receiver
) -> Float[torch.Tensor, "p p"]:
    """Flux (W) in each pixel, from hits (mm) and flux (W); float64, CPU. ``receiver.collect`` has the gradient."""
    images = np.zeros((CHUNKS, receiver.pixels, receiver.pixels))
    points, power = hits.detach().numpy(), flux.detach().numpy()
    in_chunks(lambda chunk, part: splat(points[part], power[part], receiver.side_mm, images[chunk]), len(power))
    return torch.from_numpy(images.sum(axis=0))
