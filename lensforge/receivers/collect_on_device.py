"""The twin of ``collect`` in plain torch, on any device: the same sums, differentiable by autograd."""

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.receivers.collect import Collected
from lensforge.receivers.collect_kernel import SAFE_SIN2, SIN2_SCALE
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.receiver import Landings


def collected_on_device(
    landings: Landings, sin2_exit: Float[Tensor, " n"], emitted: Float[Tensor, " n"], grid: PixelGrid, window_mm: float
) -> Collected:
    """Collect rays that left the source with ``emitted`` (W); all on one device, and so the result."""
    landed = landings.landed
    hits, flux = landings.hits[landed], landings.flux[landed]
    distance, half = hits.abs(), 0.5 * grid.side_mm
    in_window = (distance <= 0.5 * window_mm).all(dim=1)
    beside = ((distance - half).clamp(min=0.0) / half).square().sum(dim=1)
    over = (sin2_exit - SAFE_SIN2).clamp(min=0.0) / SIN2_SCALE
    return Collected(
        image=_splat(hits, flux, grid),
        in_window=flux[in_window].sum(),
        stray=(emitted[landed] * _bounded(beside)).sum(),
        reflected=(emitted * _bounded(over)).sum(),
    )


def _bounded(excess: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """``e/(1+e)``: a few wild rays cannot outvote the image."""
    return excess / (1.0 + excess)


def _splat(hits: Float[Tensor, "n 2"], flux: Float[Tensor, " n"], grid: PixelGrid) -> Float[Tensor, "p p"]:
    """Share each ray's flux among the four nearest pixels; a frame takes what falls beside the outermost ones."""
    pixels = grid.pixels
    position = (hits / grid.side_mm + 0.5) * pixels - 0.5
    near = ((position > -1.0) & (position < pixels)).all(dim=1)
    position, flux = position[near], flux[near]
    first = torch.floor(position.detach())
    (right, up), (column, row) = (position - first).T, (first.to(torch.int64) + 1).T
    shares = torch.stack(((1.0 - up) * (1.0 - right), (1.0 - up) * right, up * (1.0 - right), up * right))
    side = pixels + 2
    corner = torch.tensor([0, 1, side, side + 1], device=flux.device)[:, None]
    # adds in a fixed order, on a GPU too
    image = flux.new_zeros(side * side).index_put((row * side + column + corner,), flux * shares, accumulate=True)
    return image.reshape(side, side)[1:-1, 1:-1]
