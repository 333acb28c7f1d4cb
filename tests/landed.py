"""Rays through a lens and onto a plane: what most tests of the tracers look at."""

from dataclasses import dataclass

import torch

from lensforge.light.table_trace import Scene, trace_tables
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.pixel_grid import PixelGrid
from lensforge.scene.receiver import Landings, ReceiverPose
from lensforge.scene.receiver_shapes import Plane
from lensforge.search.light_path import landed_through
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


def by_kernels(tables: list[torch.Tensor], scene: Scene, rays: RayBundle, distance: float) -> Landed:
    """Through two tables, differentiable in them."""
    (landings,), sin2_exit = landed_through(*tables, scene, rays, (plane_at(distance),))
    return Landed(trace_tables(*tables, scene, rays), landings, sin2_exit)


def in_torch(exits: ExitRays, distance: float) -> Landed:
    """Of rays that a tracer in torch has followed."""
    return Landed(exits, plane_at(distance).land_in_torch(exits), exits.sin2_exit)
