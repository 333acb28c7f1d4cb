"""Light of one gradient step: from two tables and fresh rays, through the lens, to the sums of the merit function.

On the CPU the compiled kernels trace, and the whole path is one torch operation: the backward pass recomputes each
exit ray from its path lengths, a few last bits away from the ray that landed, and lens and receiver have to be
differentiated at the same one. On another device torch does all, in chunks of rays whose graph is built again in the
backward pass: only the start and the two crossings of each ray are kept, 84 bytes.
"""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from lensforge.optimisation.collect import Collected, collected, collected_on_device
from lensforge.receivers.receiver import Landings, Receiver
from lensforge.sources.bundle import RayBundle
from lensforge.tracing.device_search import first_crossing
from lensforge.tracing.device_table import DeviceTable, tables_on
from lensforge.tracing.sequence import Crossing, TensorRays, trace_sequence
from lensforge.tracing.tables import Scene, TracedBundle

_CHUNK = 2**19  # rays; their graph takes 2.5 GiB


@dataclass
class TableSurface:
    """A table as a surface for :func:`trace_sequence`, for one set of rays.

    Crossings are searched once, not again when the graph is rebuilt for the backward pass.
    """

    table: DeviceTable
    found: Crossing | None = None

    def first_crossing(self, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Crossing:
        """First crossings of rays from inside, at z >= 0; without a gradient."""
        if self.found is None:
            self.found = first_crossing(self.table, origins, directions)
        return self.found

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|`` (mm), Eq. (5): positive inside."""
        return self.table.gap(points)

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        return self.table.normal(points)


@dataclass(frozen=True)
class LightPath:
    """Path of the light through lens and receiver; the efficiency window is a centred square."""

    scene: Scene
    receiver: Receiver
    window_mm: float
    device: torch.device | None = None
    chunk: int = _CHUNK

    def collect(
        self, inner: Float[Tensor, "side side"], outer: Float[Tensor, "side side"], rays: RayBundle
    ) -> Collected:
        """Trace ``rays`` through two tables on the CPU and collect them there; differentiable in the tables.

        The same rays give the same bits on the same device; on another one they agree to rounding.
        """
        if self.device is None:
            landings, sin2_exit = landed_through(inner, outer, self.scene, rays, self.receiver)
            return collected(landings, sin2_exit, torch.from_numpy(rays.flux), self.receiver.grid, self.window_mm)
        tables = tables_on(self.device, inner, outer, self.scene)
        starts = range(0, len(rays), self.chunk)
        parts = [self._part(tables, rays.take(slice(start, start + self.chunk))) for start in starts]
        return Collected(*(torch.stack(sums).sum(dim=0).cpu() for sums in zip(*parts, strict=True)))

    def _part(self, tables: tuple[DeviceTable, DeviceTable], rays: RayBundle) -> tuple[Tensor, ...]:
        inner, outer = (TableSurface(table) for table in tables)
        on_device = TensorRays.of(rays, self.scene.refractive_index, torch.float64, tables[0].coefficients.device)

        def light() -> tuple[Tensor, ...]:
            exit_rays = trace_sequence(inner, outer, on_device, self.scene.fresnel)
            found = collected_on_device(
                self.receiver.land_in_torch(exit_rays),
                exit_rays.sin2_exit,
                on_device.flux,
                self.receiver.grid,
                self.window_mm,
            )
            return found.image, found.in_window, found.outside_receiver, found.total_reflection

        parts: tuple[Tensor, ...] = checkpoint(light, use_reentrant=False, preserve_rng_state=False)
        return parts


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
    hits, flux, landed, missed_receiver, sin2_exit = _Landing.apply(  # type: ignore[no-untyped-call]  # as torch has it
        inner, outer, scene, rays, receiver
    )
    return Landings(hits, flux, landed, missed_receiver), sin2_exit


class _Landing(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, inner: Tensor, outer: Tensor, scene: Scene, rays: RayBundle, receiver: Receiver) -> Any:
        traced = TracedBundle.of(inner, outer, scene, rays)
        landings = receiver.land(traced.exits)
        ctx.traced, ctx.receiver, ctx.missed_receiver = traced, receiver, landings.missed_receiver
        ctx.mark_non_differentiable(landings.landed, landings.missed_receiver)
        return landings.hits, landings.flux, landings.landed, landings.missed_receiver, traced.exits.sin2_exit

    @staticmethod
    def backward(ctx: Any, by_hits: Tensor, by_flux: Tensor, _: Any, __: Any, by_sin2: Tensor) -> Any:
        if ctx.missed_receiver.any():  # their hit and flux are constants; those of rays lost in the lens never count
            by_hits, by_flux = (
                by_hits.masked_fill(ctx.missed_receiver[:, None], 0.0),
                by_flux.masked_fill(ctx.missed_receiver, 0.0),
            )
        hits, flux, sin2 = (by.contiguous().numpy() for by in (by_hits, by_flux, by_sin2))
        return *ctx.traced.gradients(ctx.receiver.sensitivities(hits), flux, sin2), None, None, None
