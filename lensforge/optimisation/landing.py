"""From two tables to landings on a receiver, by the compiled kernels, as one torch operation.

One and not two: the way back finds each exit ray anew from its path lengths, a few last bits away from the ray that
landed, and lens and receiver have to be differentiated at the same one.
"""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.receivers.receiver import Landings, Receiver
from lensforge.sources.bundle import RayBundle
from lensforge.tracing.fused import Scene, TracedBundle


def landed_through(
    inner: Float[Tensor, "side side"],
    outer: Float[Tensor, "side side"],
    scene: Scene,
    rays: RayBundle,
    receiver: Receiver,
) -> tuple[Landings, Float[Tensor, " n"]]:
    """Landings of ``rays``, and their ``sin2_exit``; differentiable in both tables, float64 on the CPU.

    Raises :class:`InputError` when a surface has a radius that is not positive.
    """
    hits, flux, landed, averted, sin2_exit = _Landing.apply(  # type: ignore[no-untyped-call]  # as torch has it
        inner, outer, scene, rays, receiver
    )
    return Landings(hits, flux, landed, averted), sin2_exit


class _Landing(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, inner: Tensor, outer: Tensor, scene: Scene, rays: RayBundle, receiver: Receiver) -> Any:
        traced = TracedBundle.of(inner, outer, scene, rays)
        landings = receiver.land(traced.exits)
        ctx.traced, ctx.receiver, ctx.averted = traced, receiver, landings.averted
        ctx.mark_non_differentiable(landings.landed, landings.averted)
        return landings.hits, landings.flux, landings.landed, landings.averted, traced.exits.sin2_exit

    @staticmethod
    def backward(ctx: Any, by_hits: Tensor, by_flux: Tensor, _: Any, __: Any, by_sin2: Tensor) -> Any:
        if ctx.averted.any():  # their hit and flux are constants; those of rays lost in the lens never count
            by_hits, by_flux = by_hits.masked_fill(ctx.averted[:, None], 0.0), by_flux.masked_fill(ctx.averted, 0.0)
        hits, flux, sin2 = (by.contiguous().numpy() for by in (by_hits, by_flux, by_sin2))
        return *ctx.traced.gradients(ctx.receiver.sensitivities(hits), flux, sin2), None, None, None
