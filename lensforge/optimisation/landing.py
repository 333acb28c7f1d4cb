"""From two tables to landings on a receiver, by the compiled kernels, as one torch operation.

It is one and not two because the way back meets the same exit ray, to the last bit, at the lens and at the receiver.
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
        ctx.traced, ctx.receiver, ctx.landed = traced, receiver, landings.landed
        ctx.mark_non_differentiable(landings.landed, landings.averted)
        return landings.hits, landings.flux, landings.landed, landings.averted, traced.exits.sin2_exit

    @staticmethod
    def backward(ctx: Any, by_hits: Tensor, by_flux: Tensor, _: Any, __: Any, by_sin2: Tensor) -> Any:
        by_hits, by_flux = by_hits * ctx.landed[:, None], by_flux * ctx.landed
        by_exits = ctx.receiver.sensitivities(by_hits.numpy())
        return *ctx.traced.gradients(by_exits, by_flux.numpy(), by_sin2.contiguous().numpy()), None, None, None
