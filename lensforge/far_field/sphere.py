"""Exit rays of the lens, started on a sphere around it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.simulate import TracedLens, flux_by_fate
from lensforge.sources.bundle import RayBundle


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
