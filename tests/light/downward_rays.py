"""Rays that start above z = 0 and go sideways or down, and concentric spheres in closed form for them."""

from dataclasses import dataclass

import numpy as np

from lensforge.kernels.fate import Fate
from lensforge.sources.ray_bundle import RayBundle

INDEX = 1.4936


def downward_rays(count: int, seed: int, wall_mm: float, floor: float = 0.0) -> RayBundle:
    """Starts all over a cavity of radius ``wall_mm`` above ``floor`` of it; down, a tenth nearly and a tenth level."""
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3))
    origins *= wall_mm * np.cbrt(rng.random((count, 1))) / np.linalg.norm(origins, axis=1, keepdims=True)
    origins[:, 2] = floor * wall_mm + (1.0 - floor) * np.abs(origins[:, 2])
    directions = rng.normal(size=(count, 3))
    directions[:, 2] = -np.abs(directions[:, 2])
    directions[::10, 2], directions[5::10, 2] = 0.0, -(10.0 ** rng.uniform(-12.0, -1.0, len(directions[5::10])))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return RayBundle(origins, directions, rng.random(count))


def ball_of_light(count: int, seed: int, radius_mm: float, height_mm: float) -> RayBundle:
    """Rays of 1 W from a bright sphere around a point of the axis: from its whole surface, Lambertian."""
    rng = np.random.default_rng(seed)
    outwards = rng.normal(size=(count, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    directions = rng.normal(size=(count, 3))
    directions = outwards + directions / np.linalg.norm(directions, axis=1, keepdims=True)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = radius_mm * outwards + [0.0, 0.0, height_mm]
    return RayBundle(origins, directions, np.full(count, 1.0 / count))


@dataclass(frozen=True)
class Exits:
    """Exit points (mm) and directions, flux (W), fates; points and directions are 0 for rays that stay."""

    points: np.ndarray
    directions: np.ndarray
    flux: np.ndarray
    fates: np.ndarray


def through_spheres(rays: RayBundle, radii: tuple[float, float], index: float = INDEX) -> Exits:
    """Concentric spheres about the origin, in closed form; no ray is totally reflected that starts inside both.

    Angles and Fresnel's laws of sines and tangents, of either half of the light: both spheres have one plane of
    incidence. Nothing is shared with the tracers but the fates' names.
    """
    points = rays.origins
    directions = rays.directions
    halves = np.tile(0.5 * rays.flux, (2, 1))
    down = directions[:, 2] <= 0.0
    height = points[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = np.where(height < 0.0, -height / directions[:, 2], 0.0)[:, None]
        points = points + np.where(np.isfinite(rise), rise, 0.0) * directions
    outside = np.linalg.norm(points, axis=1) >= radii[0]
    fates = np.select([down & (height <= 0.0), outside], [Fate.BACKWARD, Fate.OUTSIDE_CAVITY], Fate.LEFT_LENS)
    for radius, ratio, below in ((radii[0], 1.0 / index, Fate.BACKWARD), (radii[1], index, Fate.BASE)):
        along = np.sum(points * directions, axis=1)
        ahead = np.sqrt(np.maximum(along**2 + radius**2 - np.sum(points**2, axis=1), 0.0)) - along
        points = points + ahead[:, None] * directions
        fates = np.where((fates == Fate.LEFT_LENS) & (points[:, 2] < 0.0), below, fates)
        passed = fates == Fate.LEFT_LENS
        normals = points / radius
        before = np.arccos(np.clip(np.sum(normals * directions, axis=1), -1.0, 1.0))
        behind = np.arcsin(np.clip(ratio * np.sin(before), -1.0, 1.0))
        across = directions - np.cos(before)[:, None] * normals
        size = np.linalg.norm(across, axis=1)
        across /= np.where(size > 1e-12, size, 1.0)[:, None]
        directions = np.cos(behind)[:, None] * normals + np.sin(behind)[:, None] * across
        sines, tangents = (f(before - behind) / f(np.maximum(before + behind, 1e-9)) for f in (np.sin, np.tan))
        reflected = np.where(before > 1e-6, np.array([sines, tangents]), (1.0 - ratio) / (1.0 + ratio)) ** 2
        halves = np.where(passed, halves * (1.0 - reflected), halves)
    kept = (fates == Fate.LEFT_LENS)[:, None]
    return Exits(np.where(kept, points, 0.0), np.where(kept, directions, 0.0), halves.sum(axis=0), fates)
