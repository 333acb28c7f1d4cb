"""Rays behind the lens: where they pass a sphere around it, and which way they go.

The tracer knows where rays meet a plane. Behind the lens rays are straight, so two planes give the ray, exactly.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge.evaluation.simulate import TracedLens
from lensforge.sources.bundle import RayBundle
from lensforge.tracing.fates import Fate

_PLANES = (2.0, 1e3)  # distances of the planes, in radii of the sphere: far apart, so that no digit is lost


@dataclass(frozen=True)
class ExitRays:
    """Rays that leave the lens upwards, as ``rays`` starting on the sphere; and the flux (W) of all rays by fate."""

    rays: RayBundle
    by_fate_w: Float[np.ndarray, " f"]


def exit_rays(lens: TracedLens, rays: RayBundle, sphere_mm: float) -> ExitRays:
    """Trace ``rays``; those that arrive start anew on the sphere of radius ``sphere_mm`` that holds the lens."""
    near, far = (replace(lens, scene=replace(lens.scene, distance_mm=k * sphere_mm)) for k in _PLANES)
    arrivals = near.trace(rays)
    arrived = arrivals.arrived.numpy()
    first = arrivals.hits.numpy()[arrived]
    across = far.trace(rays).hits.numpy()[arrived] - first
    step = np.column_stack([across, np.full(len(across), (_PLANES[1] - _PLANES[0]) * sphere_mm)])
    directions = step / np.linalg.norm(step, axis=1, keepdims=True)
    on_plane = np.column_stack([first, np.full(len(first), _PLANES[0] * sphere_mm)])
    by_fate = np.bincount(arrivals.fates.numpy(), arrivals.carried.numpy(), minlength=len(Fate))
    bundle = RayBundle(_on_sphere(on_plane, directions, sphere_mm), directions, arrivals.flux.numpy()[arrived])
    return ExitRays(bundle, by_fate)


def _on_sphere(
    points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], radius_mm: float
) -> Float[np.ndarray, "n 3"]:
    """Where the rays' lines leave the sphere about the origin; every ray comes from inside of it."""
    along = np.sum(points * directions, axis=1)
    closest = points - along[:, None] * directions
    half_chord = np.sqrt(np.maximum(radius_mm**2 - np.sum(closest**2, axis=1), 0.0))
    return closest + half_chord[:, None] * directions
