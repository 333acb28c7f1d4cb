"""The light of one step of a search: from two tables and fresh rays to what the receiver collects.

Without a device the compiled kernels do it on the CPU. On a device their twin does it in torch, in chunks of rays whose
graph is built again in the backward pass: what is kept of every ray are its start and its two path lengths, 84 bytes.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from lensforge.optimisation.landing import landed_through
from lensforge.receivers.collect import Collected, collected
from lensforge.receivers.collect_on_device import collected_on_device
from lensforge.receivers.receiver import Receiver
from lensforge.sources.bundle import RayBundle
from lensforge.tracing.device_table import DeviceTable
from lensforge.tracing.fused import Scene
from lensforge.tracing.on_device import TableSurface, tables_on
from lensforge.tracing.sequence import Crossing, TensorRays, trace_sequence

_CHUNK = 2**19  # rays; their graph takes 2.5 GiB


@dataclass
class _SearchedOnce(TableSurface):
    """For one chunk of rays: when its graph is built again, the search for their crossings is not made again."""

    found: Crossing | None = None

    def first_crossing(self, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Crossing:
        if self.found is None:
            self.found = super().first_crossing(origins, directions)
        return self.found


@dataclass(frozen=True)
class LightPath:
    """What rays meet, and where they are collected; the efficiency window is a centred square."""

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
            return collected(landings, sin2_exit, torch.from_numpy(rays.weights), self.receiver.grid, self.window_mm)
        tables = tables_on(self.device, inner, outer, self.scene)
        starts = range(0, len(rays), self.chunk)
        parts = [self._part(tables, rays.take(slice(start, start + self.chunk))) for start in starts]
        return Collected(*(torch.stack(sums).sum(dim=0).cpu() for sums in zip(*parts, strict=True)))

    def _part(self, tables: tuple[DeviceTable, DeviceTable], rays: RayBundle) -> tuple[Tensor, ...]:
        inner, outer = (_SearchedOnce(table) for table in tables)
        on_device = TensorRays.of(rays, self.scene.refractive_index, torch.float64, tables[0].coefficients.device)

        def light() -> tuple[Tensor, ...]:
            exit_rays = trace_sequence(inner, outer, on_device, self.scene.fresnel)
            found = collected_on_device(
                self.receiver.land_in_torch(exit_rays),
                exit_rays.sin2_exit,
                on_device.weights,
                self.receiver.grid,
                self.window_mm,
            )
            return found.image, found.in_window, found.stray, found.reflected

        parts: tuple[Tensor, ...] = checkpoint(light, use_reentrant=False, preserve_rng_state=False)
        return parts
