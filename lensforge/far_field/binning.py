"""From exit directions to an intensity table whose integral is the flux, ray by ray.

Each ray's flux is split among the four nodes around its direction by bilinear shares, and a node's intensity is its
flux over the solid angle that it stands for. Shares add up to 1, and those solid angles are the integrals of the same
bilinear functions: so the integral of the table, interpolated linearly as its readers do, is the flux of the rays.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.sources.bundle import RayBundle
from lensforge.sources.intensity import TabulatedIntensity, flux_up_to


@dataclass(frozen=True)
class AngularGrid:
    """Half-planes every 360/``planes`` degrees, gamma from 0 to 90 degrees in ``steps`` steps."""

    planes: int = 72
    steps: int = 90

    def deposit(self, rays: RayBundle) -> Float[np.ndarray, "planes nodes"]:
        """Flux (W) that falls to each node."""
        azimuth = np.arctan2(rays.directions[:, 1], rays.directions[:, 0]) / (2.0 * np.pi) % 1.0 * self.planes
        gamma = np.arccos(np.clip(rays.directions[:, 2], 0.0, 1.0)) / (0.5 * np.pi) * self.steps
        plane, cell = np.floor(azimuth).astype(int), np.minimum(gamma.astype(int), self.steps - 1)
        right, below = azimuth - plane, gamma - cell
        flux = np.zeros(self.planes * (self.steps + 1))
        for next_plane, share_plane in ((0, 1.0 - right), (1, right)):
            for next_cell, share_cell in ((0, 1.0 - below), (1, below)):
                node = (plane + next_plane) % self.planes * (self.steps + 1) + cell + next_cell
                flux += np.bincount(node, rays.weights * share_plane * share_cell, minlength=len(flux))
        return flux.reshape(self.planes, self.steps + 1)

    def table(self, flux_w: Float[np.ndarray, "planes nodes"]) -> TabulatedIntensity:
        """Intensity (W/sr); on the axis, where all half-planes meet, it is that of all of them together."""
        gamma = np.linspace(0.0, 90.0, self.steps + 1)
        bands = flux_up_to(np.deg2rad(gamma), np.eye(self.steps + 1))[:, -1]
        intensity = flux_w / (bands * (2.0 * np.pi / self.planes))
        intensity[:, 0] = intensity[:, 0].mean()
        closed = np.concatenate([intensity, intensity[:1]])
        return TabulatedIntensity(np.linspace(0.0, 360.0, self.planes + 1), gamma, closed)
