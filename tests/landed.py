"""Rays through a lens and onto a plane: what most tests of the tracers look at."""

from dataclasses import dataclass

import torch

from lensforge.optimisation.light_path import landed_through
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.plane import Plane
from lensforge.receivers.pose import ReceiverPose
from lensforge.receivers.receiver import Landings
from lensforge.sources.bundle import RayBundle
from lensforge.tracing.exit_rays import ExitRays
from lensforge.tracing.tables import Scene, trace_tables


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
