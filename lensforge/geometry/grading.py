"""How fine the mesh must be: the ring count that keeps facets close to the surface, measured and not assumed.

The distance from a facet to its surface falls as rings^-2 and the angle between their normals as rings^-1, so
one trial mesh nearly tells the count that a tolerance needs, and a second one confirms it.
"""

from dataclasses import dataclass

import numpy as np

from lensforge.geometry.patch import Patch
from lensforge.geometry.plan import Plan
from lensforge.geometry.rings import dome_mesh
from lensforge.surfaces.chart import to_chart

_TRIAL_RINGS = 48
_TRIALS = 3
_MARGIN = 1.02
# 96 rings: the verification's cast then uses less than half of its deviation limit on the roughest shipped lens, a
# 7 mm one; 128 a quarter. What more rings would gain is facets that stand in for the surface without fitted normals.
MIN_RINGS, MAX_RINGS = 96, 128


@dataclass(frozen=True)
class MeshTolerance:
    """Distance (mm) and angle (rad) between facets of the optical surfaces and the surface above their centres."""

    chord_mm: float = 1e-3
    normal_rad: float = 0.01


def rings_for(plan: Plan, tolerance: MeshTolerance) -> int:
    """Rings that keep both optical surfaces and the base's cylinder within ``tolerance``, 96 to 128."""
    rings = _TRIAL_RINGS
    for _ in range(_TRIALS):
        reached = mesh_error(plan, rings)
        by_chord = np.sqrt(reached.chord_mm / tolerance.chord_mm)
        by_normal = reached.normal_rad / tolerance.normal_rad
        if rings > _TRIAL_RINGS and max(by_chord, by_normal) <= 1.0:
            break
        needed = int(np.ceil(rings * _MARGIN * max(by_chord, by_normal)))
        rings = int(np.clip(needed, _rings_of_base(plan, tolerance), MAX_RINGS))
        if needed >= MAX_RINGS:
            break
    return rings


def mesh_error(plan: Plan, rings: int) -> MeshTolerance:
    """What a mesh of ``rings`` reaches: the worse of the two optical surfaces."""
    inner, outer = facet_error(plan.inner, rings), facet_error(plan.outer, rings)
    return MeshTolerance(max(inner.chord_mm, outer.chord_mm), max(inner.normal_rad, outer.normal_rad))


def facet_error(patch: Patch, rings: int) -> MeshTolerance:
    """Largest distance and angle between the facets of a dome and its surface, above the facets' centres."""
    vertices, triangles = dome_mesh(patch, rings)
    corners = vertices[triangles]
    facet = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facet /= np.linalg.norm(facet, axis=1, keepdims=True)
    chart = to_chart(corners.mean(axis=1))
    distance = np.abs(np.sum((patch.points(chart) - corners[:, 0]) * facet, axis=1))
    sine = np.linalg.norm(np.cross(patch.normals(chart), facet), axis=1)
    return MeshTolerance(float(distance.max()), float(np.arcsin(np.minimum(sine, 1.0)).max()))


def _rings_of_base(plan: Plan, tolerance: MeshTolerance) -> int:
    """The widest cylinder's polygon of 6 n corners is R (pi / 6n)^2 / 2 away from it."""
    if not plan.has_base:
        return MIN_RINGS
    radius = (plan.base.flange_diameter_mm or plan.base.widest_mm) / 2.0
    rings = np.pi / 6.0 * np.sqrt(radius / (2.0 * tolerance.chord_mm))
    return int(np.clip(np.ceil(rings), MIN_RINGS, MAX_RINGS))
