"""Irradiance that gradients flow through: the four-pixel splat as a torch operation."""

from typing import Any

import numpy as np
import torch

from lensforge.receiver.plane import Receiver
from lensforge.receiver.splat_kernel import splat, splat_adjoint
from lensforge.tracing.chunks import CHUNKS, in_chunks


class _Splat(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, hits: torch.Tensor, flux: torch.Tensor, receiver: Receiver) -> torch.Tensor:
        images = np.zeros((CHUNKS, receiver.pixels, receiver.pixels))
        points, power = hits.detach().numpy(), flux.detach().numpy()

        def work(chunk: int, part: slice) -> None:
            splat(points[part], power[part], receiver.side_mm, images[chunk])

        in_chunks(work, len(power))
        ctx.save_for_backward(hits, flux)
        ctx.side_mm = receiver.side_mm
        return torch.from_numpy(images.sum(axis=0))

    @staticmethod
    def backward(ctx: Any, by_image: torch.Tensor) -> Any:
        points, power = (tensor.numpy() for tensor in ctx.saved_tensors)
        by_hits, by_flux = np.empty_like(points), np.empty_like(power)
        sensitivity = by_image.contiguous().numpy()

        def work(_: int, part: slice) -> None:
            splat_adjoint(points[part], power[part], ctx.side_mm, sensitivity, by_hits[part], by_flux[part])

        in_chunks(work, len(power))
        return torch.from_numpy(by_hits), torch.from_numpy(by_flux), None


def splat_flux(hits: torch.Tensor, flux: torch.Tensor, receiver: Receiver) -> torch.Tensor:
    """Flux (W) in each pixel (pixels, pixels), from hits (n, 2) in mm and flux (n,) in W; float64, CPU."""
    image: torch.Tensor = _Splat.apply(hits, flux, receiver)
    return image
