"""The plane receiver: a square, pixelled window of the plane ``z = distance_mm``, centred on the axis."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from lensforge.kernels.jit import in_chunks
from lensforge.kernels.landing import LEAST_RISE, land
from lensforge.receivers.pixels import PixelGrid
from lensforge.receivers.receiver import Landings
from lensforge.spec import Target
from lensforge.tracing.exit_rays import ExitRays, Sensitivities


@dataclass(frozen=True)
class PlaneReceiver:
    """A plane receiver of irradiance; every ray with a component along +z reaches its plane."""

    distance_mm: float
    grid: PixelGrid

    @staticmethod
    def of(target: Target, pixels: int) -> "PlaneReceiver":
        """The receiver of ``target``."""
        return PlaneReceiver(target.distance_mm, PixelGrid(target.receiver_mm, pixels))

    @property
    def pixel_measure(self) -> float:
        """Area of a pixel in m^2, so that flux (W) over it is irradiance (W/m^2)."""
        return (self.grid.pitch_mm * 1e-3) ** 2

    def land(self, rays: ExitRays) -> Landings:
        """Land ``rays``, float64 on the CPU, by a compiled kernel; without a gradient."""
        exits = [tensor.numpy() for tensor in (rays.points, rays.directions, rays.flux, rays.fates)]
        count = len(rays.fates)
        landings = np.empty((count, 2)), np.empty(count), np.empty(count, dtype=bool), np.empty(count, dtype=bool)

        def work(_: int, part: slice) -> None:
            land(*(array[part] for array in exits), self.distance_mm, *(array[part] for array in landings))

        in_chunks(work, count)
        return Landings(*(torch.from_numpy(array) for array in landings))

    def sensitivities(self, by_hits: Float[np.ndarray, "n 2"]) -> Sensitivities:
        """Sensitivities to exit rays from those to their hits, which are crossings already."""
        return Sensitivities(self.distance_mm, by_hits, np.empty((0, 3)))

    def land_in_torch(self, rays: ExitRays) -> Landings:
        """``land`` in plain torch, on any device and in any precision; differentiable."""
        landed = rays.left_lens & (rays.directions[:, 2].detach() > LEAST_RISE)
        rows = torch.nonzero(landed)[:, 0]
        points, directions = rays.points[rows], rays.directions[rows]
        reached = points + ((self.distance_mm - points[:, 2]) / directions[:, 2])[:, None] * directions
        hits = torch.zeros_like(rays.points[:, :2]).index_put((rows,), reached[:, :2])
        return Landings(hits, rays.flux * landed, landed, rays.left_lens & ~landed)
