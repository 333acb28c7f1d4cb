"""What a search wants to know of the traced rays, as one torch operation."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.receivers.collect_kernel import collect, collect_adjoint
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.receiver import Landings
from lensforge.tracing.chunks import CHUNKS, in_chunks


@dataclass(frozen=True)
class Collected:
    """Sums over rays, all in W and differentiable in the landings and the exit sines.

    ``image``: flux per pixel by the four-pixel splat. ``in_window``: flux in the efficiency window. ``stray``: flux
    beside the receiver, each ray by ``e^2/(1+e^2)``, e its distance from the receiver in half widths. ``reflected``:
    flux whose squared exit sine exceeds 0.97, likewise bounded: fetches totally reflected rays back and keeps others
    away. The last two count the flux with which a ray left the source, as a constant.
    """

    image: Float[Tensor, "p p"]
    in_window: Float[Tensor, ""]
    stray: Float[Tensor, ""]
    reflected: Float[Tensor, ""]


class _Collect(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, hits: Tensor, flux: Tensor, sin2_exit: Tensor, landed: Tensor, emitted: Tensor, grid: PixelGrid,
        window_mm: float,
    ) -> Any:  # fmt: skip
        images, sums = np.zeros((CHUNKS, grid.pixels, grid.pixels)), np.zeros((CHUNKS, 3))
        rays = [tensor.detach().numpy() for tensor in (hits, flux, sin2_exit, landed, emitted)]

        def work(chunk: int, part: slice) -> None:
            collect(*(array[part] for array in rays), grid.side_mm, window_mm, images[chunk], sums[chunk])

        in_chunks(work, len(emitted))
        ctx.rays, ctx.lengths_mm = rays, (grid.side_mm, window_mm)
        return torch.from_numpy(images.sum(axis=0)), torch.from_numpy(sums.sum(axis=0))

    @staticmethod
    def backward(ctx: Any, by_image: Tensor, by_sums: Tensor) -> Any:
        rays = ctx.rays
        by_hits, by_flux, by_sin2 = (np.empty_like(array) for array in rays[:3])
        pixels, sums = by_image.contiguous().numpy(), by_sums.contiguous().numpy()

        def work(_: int, part: slice) -> None:
            collect_adjoint(
                *(array[part] for array in rays), *ctx.lengths_mm, pixels, sums,
                by_hits[part], by_flux[part], by_sin2[part],
            )  # fmt: skip

        in_chunks(work, len(by_flux))
        return *(torch.from_numpy(array) for array in (by_hits, by_flux, by_sin2)), None, None, None, None


def collected(
    landings: Landings, sin2_exit: Float[Tensor, " n"], emitted: Float[Tensor, " n"], grid: PixelGrid, window_mm: float
) -> Collected:
    """Collect rays that left the source with ``emitted`` (W); float64, CPU. The window is a centred square."""
    image, sums = _Collect.apply(  # type: ignore[no-untyped-call]  # as torch has it
        landings.hits, landings.flux, sin2_exit, landings.landed, emitted, grid, window_mm
    )
    return Collected(image, sums[0], sums[1], sums[2])
