"""A few rays through the exact surfaces, for the drawing of the section and for nothing else.

The lens has no symmetry, so rays that start in a section leave it: what is drawn is their projection.
"""

import numpy as np
from jaxtyping import Bool, Float

from lensforge.lens import Lens
from lensforge.surfaces.surface import Surface

_MARCH = 192  # steps of the search for a first crossing: far finer than a lens's features
_BISECTIONS = 40

Points = Float[np.ndarray, "n 3"]


def trace_fan(lens: Lens, start_mm: Points, directions: Points, reach_mm: float) -> Float[np.ndarray, "n 4 3"]:
    """Start, both surfaces' hits, and a point at ``reach_mm`` from the origin; NaN after the end of a ray.

    A ray ends where it meets z = 0, runs back into the cavity, or is totally reflected.
    """
    at_inner = _first_crossing(lens.inner, start_mm, directions, reach_mm)
    inside = _refract(directions, _normals(lens.inner, at_inner), 1.0 / lens.refractive_index)
    at_outer = _first_crossing(lens.outer, at_inner, inside, reach_mm)
    at_outer[_returns(lens.inner, at_inner, inside, at_outer)] = np.nan
    after = _refract(inside, _normals(lens.outer, at_outer), lens.refractive_index)
    return np.stack([start_mm, at_inner, at_outer, _at_distance(at_outer, after, reach_mm)], axis=1)


def _first_crossing(surface: Surface, start: Points, direction: Points, reach_mm: float) -> Points:
    """Where each ray first leaves the body below ``surface``; NaN where it does not, or only below z = 0."""
    lengths = np.linspace(0.0, 2.0 * reach_mm, _MARCH)
    height = _height(surface, start[:, None] + lengths[:, None] * direction[:, None])
    crossed = (height[:, :-1] < 0.0) & (height[:, 1:] >= 0.0)
    first = np.argmax(crossed, axis=1)
    low, high = lengths[first], lengths[first + 1]
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        outside = _height(surface, start + middle[:, None] * direction) >= 0.0
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    hit: Points = start + high[:, None] * direction
    hit[~crossed.any(axis=1) | ~(hit[:, 2] >= 0.0)] = np.nan
    return hit


def _height(surface: Surface, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
    """Height (mm) of points above the surface along their radius; NaN points stay NaN."""
    distance = np.linalg.norm(points, axis=-1)
    known = distance > 0.0  # false for NaN and for the origin
    height = np.where(np.isnan(distance), np.nan, -np.inf)
    height[known] = distance[known] - surface.radius(points[known] / distance[known][:, None])
    return height


def _returns(surface: Surface, start: Points, direction: Points, end: Points) -> Bool[np.ndarray, " n"]:
    """Whether the way from ``start`` on the cavity to ``end`` dips into the cavity again."""
    share = np.linspace(0.0, 1.0, _MARCH)[1:]
    way = start[:, None] + share[:, None] * (end - start)[:, None]
    with np.errstate(invalid="ignore"):
        return np.asarray((_height(surface, way) < -1e-9).any(axis=1))


def _normals(surface: Surface, points: Points) -> Points:
    normals = np.full_like(points, np.nan)
    known = ~np.isnan(points[:, 0])
    unit = points[known] / np.linalg.norm(points[known], axis=1, keepdims=True)
    normals[known] = surface.normal(unit)
    return normals


def _refract(direction: Points, normal: Points, ratio: float) -> Points:
    """Snell's law; NaN for total reflection. ``ratio``: index before over index behind."""
    cosine = np.sum(direction * normal, axis=1, keepdims=True)
    squared = 1.0 - ratio**2 * (1.0 - cosine**2)
    behind = np.sqrt(np.where(squared >= 0.0, squared, np.nan))
    refracted: Points = ratio * direction + (behind - ratio * cosine) * normal
    return refracted


def _at_distance(point: Points, direction: Points, reach_mm: float) -> Points:
    """Where rays leave the sphere of ``reach_mm`` around the origin."""
    along = np.sum(point * direction, axis=1)
    squared = along**2 + reach_mm**2 - np.sum(point**2, axis=1)
    length = np.sqrt(np.where(squared > 0.0, squared, np.nan)) - along
    end: Points = point + length[:, None] * direction
    return end
