"""Rays through a lens and onto a plane: what most tests of the tracers look at, all in torch."""

from dataclasses import dataclass, fields

import torch

from lensforge.light.device_trace import tables_on
from lensforge.light.sequential_trace import EnteringRays, TracedSurface, trace_sequence
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import Media
from lensforge.scene.as_made import AsMade
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import Landings, ReceiverPose
from lensforge.scene.receiver_shapes import Plane
from lensforge.search.light_path import TableSurface, landed_through
from lensforge.sources.ray_bundle import RayBundle


@dataclass(frozen=True)
class Landed:
    """Exit rays and their landings; ``hits``, ``flux`` and ``sin2_exit`` carry the gradient."""

    exits: ExitRays
    landings: Landings
    sin2_exit: torch.Tensor

    @property
    def hits(self) -> torch.Tensor:
        return self.landings.hits

    @property
    def flux(self) -> torch.Tensor:
        return self.landings.flux

    @property
    def landed(self) -> torch.Tensor:
        return self.landings.landed

    @property
    def missed_receiver(self) -> torch.Tensor:
        return self.landings.missed_receiver

    @property
    def fates(self) -> torch.Tensor:
        return self.exits.fates

    @property
    def carried(self) -> torch.Tensor:
        """Flux (W) that reached the last surface met, without a gradient where the kernels traced."""
        return self.exits.flux


def plane_at(distance: float) -> Plane:
    return Plane(ReceiverPose.facing((0.0, 0.0, 1.0), (0.0, 0.0, distance)), PixelGrid.square(2.0 * distance, 16))


def as_tensors(exits: ExitRays) -> ExitRays:
    """The same rays as tensors on the CPU; what the scene has not is None, and stays so."""
    arrays = (getattr(exits, each.name) for each in fields(exits))
    return ExitRays(*(None if each is None else torch.as_tensor(each).cpu() for each in arrays))


def trace_bundle(tables: list[torch.Tensor], scene: Scene, rays: RayBundle) -> TracedBundle:
    """By the kernels, in NumPy."""
    return TracedBundle.of([table.detach().numpy() for table in tables], scene, rays)


def trace_tables(tables: list[torch.Tensor], scene: Scene, rays: RayBundle) -> ExitRays:
    """By the kernels, without a gradient."""
    return as_tensors(trace_bundle(tables, scene, rays).exits)


def trace_exact(
    inner: TracedSurface,
    outer: TracedSurface,
    media: Media,
    rays: RayBundle,
    made: AsMade | None = None,
    dtype: torch.dtype = torch.float64,
    device: str = "cpu",
    fresnel: bool = True,
) -> ExitRays:
    """Through surfaces that take tensors, differentiable in what these are differentiable in."""
    entering = EnteringRays.of(rays, media, made, lambda array: torch.as_tensor(array).to(torch.device(device), dtype))
    return trace_sequence(inner, outer, entering, fresnel)


def on_device(tables: list[torch.Tensor], scene: Scene, rays: RayBundle, device: str = "cpu") -> ExitRays:
    """Through two tables by the tracer in torch on ``device``, differentiable in them; copied back."""
    surfaces = (TableSurface(table) for table in tables_on(torch.device(device), *tables, scene))
    return as_tensors(trace_exact(*surfaces, scene.media, rays, scene.made, device=device, fresnel=scene.fresnel))


def by_kernels(tables: list[torch.Tensor], scene: Scene, rays: RayBundle, distance: float) -> Landed:
    """Through two tables, differentiable in them."""
    (landings,), sin2_exit = landed_through(torch.stack(list(tables)), scene, rays, (plane_at(distance),))
    return Landed(trace_tables(tables, scene, rays), landings, sin2_exit)


def in_torch(exits: ExitRays, distance: float) -> Landed:
    """Of rays that a tracer in torch has followed."""
    return Landed(exits, plane_at(distance).land_by_arrays(exits), exits.sin2_exit)
