"""Errors of flat facets against the surface that they stand for: largest distance, and largest angle between normals.

The distance has its maxima at the middle of an edge or inside the facet, the angle mostly at a corner: looked at above
the facets' centres alone, the distance is up to 30 % too small, the angle a third. A few points of each facet show
which facets are worst; on these, grids that shrink about the best point find the maximum.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lensforge.geometry.patch import Patch
from lensforge.surfaces.chart import to_chart

_WORST = 64  # facets on which the maximum is sought
_LATTICE, _ROUNDS = 6, 4
CORNERS = np.eye(3)
MIDDLES = (CORNERS + np.roll(CORNERS, -1, axis=0)) / 2.0  # of the edges, each from a corner to the next
CENTRE = np.full((1, 3), 1.0 / 3.0)
INSIDE = np.concatenate([MIDDLES, CENTRE])  # where a facet is far from its surface

Measure = Callable[[Patch, Float[np.ndarray, "t 3 3"], Float[np.ndarray, "t m 3"]], Float[np.ndarray, "t m"]]


@dataclass(frozen=True)
class FacetError:
    """Largest distance (mm) and angle (rad) between facets and their surface."""

    chord_mm: float
    normal_rad: float


def facet_error(patch: Patch, vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> FacetError:
    """Largest errors of facets with corners among ``vertices`` (mm) against ``patch``, anywhere on the facets."""
    corners = vertices[triangles]
    away = distances(patch, corners, np.broadcast_to(INSIDE, (len(corners), *INSIDE.shape)))
    normal = _largest(patch, corners, angles, _corner_angles(patch, vertices, triangles))
    return FacetError(largest_distance(patch, corners, away), normal)


def largest_distance(patch: Patch, corners: Float[np.ndarray, "t 3 3"], away: Float[np.ndarray, "t 4"]) -> float:
    """Largest distance (mm) of any facet; ``away``: those at the points ``INSIDE`` of each."""
    return _largest(patch, corners, distances, away.max(axis=1))


def distances(
    patch: Patch, corners: Float[np.ndarray, "t 3 3"], barycentric: Float[np.ndarray, "t m 3"]
) -> Float[np.ndarray, "t m"]:
    """Distance (mm) from the facet's plane of the surface above points of the facet."""
    from_corner = patch.points(to_chart(barycentric @ corners)) - corners[:, :1]
    distance: Float[np.ndarray, "t m"] = np.abs(from_corner @ facet_normals(corners)[:, :, None])[..., 0]
    return distance


def angles(
    patch: Patch, corners: Float[np.ndarray, "t 3 3"], barycentric: Float[np.ndarray, "t m 3"]
) -> Float[np.ndarray, "t m"]:
    """Angle (rad) between the facet's normal and that of the surface above points of the facet."""
    return _angles_to(patch.normals(to_chart(barycentric @ corners)), corners)


def _angles_to(normals: Float[np.ndarray, "t m 3"], corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t m"]:
    """Angle (rad) between the normal of each facet and some of the surface's."""
    facet = facet_normals(corners)
    facet *= np.sign(np.sum(facet * corners[:, 0], axis=1, keepdims=True))  # away from the origin, as the patch's
    chord = np.linalg.norm(normals - facet[:, None], axis=-1)
    angle: Float[np.ndarray, "t m"] = 2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))
    return angle


def facet_normals(corners: Float[np.ndarray, "t 3 3"]) -> Float[np.ndarray, "t 3"]:
    """Unit normals of facets, by the right-hand rule."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals: Float[np.ndarray, "t 3"] = across / np.linalg.norm(across, axis=1, keepdims=True)
    return normals


def _corner_angles(
    patch: Patch, vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]
) -> Float[np.ndarray, " t"]:
    """Largest angle (rad) at the corners of each facet; six facets share a vertex, whose normal is taken once."""
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True
    normals = np.full(vertices.shape, np.nan)
    normals[used] = patch.normals(to_chart(vertices[used]))
    largest: Float[np.ndarray, " t"] = _angles_to(normals[triangles], vertices[triangles]).max(axis=1)
    return largest


def _largest(
    patch: Patch, corners: Float[np.ndarray, "t 3 3"], measure: Measure, known: Float[np.ndarray, " t"]
) -> float:
    """Largest ``measure`` of any facet: the facets whose values ``known`` are largest are searched."""
    worst = corners[np.argsort(-known)[:_WORST]]
    steps = np.arange(_LATTICE + 1) / _LATTICE
    lattice = np.array([(a, b, 1.0 - a - b) for a in steps for b in steps if a + b < 1.0 + 1e-9])
    best, reach, largest = np.repeat(CENTRE, len(worst), axis=0), 1.0, 0.0
    for _ in range(_ROUNDS):
        points = _inside(best[:, None] + reach * (lattice - CENTRE))
        values = measure(patch, worst, points)
        top = np.argmax(values, axis=1)
        best, largest = points[np.arange(len(worst)), top], max(largest, float(values.max()))
        reach *= 2.0 / _LATTICE
    return largest


def _inside(barycentric: Float[np.ndarray, "t m 3"]) -> Float[np.ndarray, "t m 3"]:
    """Points moved into their facet."""
    clipped = np.maximum(barycentric, 0.0)
    inside: Float[np.ndarray, "t m 3"] = clipped / clipped.sum(axis=-1, keepdims=True)
    return inside
