"""Far-field intensity of the lens: exit rays on a sphere around it, and the intensity table made from them.

Each ray's flux is split among the four nodes of the table around its direction by bilinear shares, and a node's
intensity is its flux over the solid angle that it stands for. The shares add up to 1, and these solid angles are the
integrals of the same bilinear functions: so the integral of the table, interpolated linearly as its readers do, is the
flux of the rays.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.simulate import TracedLens, flux_by_fate
from lensforge.sources.bundle import RayBundle
from lensforge.sources.intensity import TabulatedIntensity, flux_up_to


@dataclass(frozen=True)
class RaysOnSphere:
    """Rays that leave the lens upwards, starting on the sphere; and the flux (W) of all rays by fate.

    The last of ``by_fate_w`` is the flux of rays that leave the lens, but not upwards.
    """

    rays: RayBundle
    by_fate_w: Float[np.ndarray, " f"]


def exit_rays(lens: TracedLens, rays: RayBundle, sphere_mm: float) -> RaysOnSphere:
    """Trace ``rays`` and start those that leave upwards on the sphere of radius ``sphere_mm`` around the lens."""
    found = lens.trace(rays)
    upwards = found.left_lens & (found.directions[:, 2] > 0.0)
    points, directions, flux = (each[upwards].numpy() for each in (found.points, found.directions, found.flux))
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    by_fate = flux_by_fate(found, found.left_lens & ~upwards)
    return RaysOnSphere(RayBundle(_on_sphere(points, directions, sphere_mm), directions, flux), by_fate)


def _on_sphere(
    points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], radius_mm: float
) -> Float[np.ndarray, "n 3"]:
    """Points at which rays from inside the sphere about the origin leave it."""
    along = np.sum(points * directions, axis=1)
    closest = points - along[:, None] * directions
    half_chord = np.sqrt(np.maximum(radius_mm**2 - np.sum(closest**2, axis=1), 0.0))
    left: Float[np.ndarray, "n 3"] = closest + half_chord[:, None] * directions
    return left


@dataclass(frozen=True)
class AngularGrid:
    """Nodes of an intensity table: C every 360/``planes`` degrees, gamma from 0 to 90 degrees in ``steps`` steps."""

    planes: int = 72
    steps: int = 90

    def deposit(self, rays: RayBundle) -> Float[np.ndarray, "planes nodes"]:
        """Split the flux (W) of ``rays`` among the nodes."""
        azimuth = np.arctan2(rays.directions[:, 1], rays.directions[:, 0]) / (2.0 * np.pi) % 1.0 * self.planes
        gamma = np.arccos(np.clip(rays.directions[:, 2], 0.0, 1.0)) / (0.5 * np.pi) * self.steps
        plane, cell = np.floor(azimuth).astype(int), np.minimum(gamma.astype(int), self.steps - 1)
        right, below = azimuth - plane, gamma - cell
        flux = np.zeros(self.planes * (self.steps + 1))
        for next_plane, share_plane in ((0, 1.0 - right), (1, right)):
            for next_cell, share_cell in ((0, 1.0 - below), (1, below)):
                node = (plane + next_plane) % self.planes * (self.steps + 1) + cell + next_cell
                flux += np.bincount(node, rays.flux * share_plane * share_cell, minlength=len(flux))
        return flux.reshape(self.planes, self.steps + 1)

    def table(self, flux_w: Float[np.ndarray, "planes nodes"]) -> TabulatedIntensity:
        """Intensity (W/sr) from the flux at the nodes; on the axis, where all planes meet, the mean of all of them."""
        gamma = np.linspace(0.0, 90.0, self.steps + 1)
        bands = flux_up_to(np.deg2rad(gamma), np.eye(self.steps + 1))[:, -1]
        intensity = flux_w / (bands * (2.0 * np.pi / self.planes))
        intensity[:, 0] = intensity[:, 0].mean()
        closed = np.concatenate([intensity, intensity[:1]])
        return TabulatedIntensity(np.linspace(0.0, 360.0, self.planes + 1), gamma, closed)
