"""Concentric rings of points over a dome, the strips of triangles between them, and the count that a tolerance needs.

The count is measured, not assumed. The distance from a facet to its surface falls as rings^-2 and the angle between
their normals as rings^-1, so one trial mesh predicts the count, and a second one confirms it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lensforge.geometry.outline import FULL_TURN
from lensforge.geometry.patch import Patch
from lensforge.geometry.plan import Plan, rim_directions
from lensforge.surfaces.chart import to_chart

_CROSSING_REPLACES = 0.1  # of an azimuth step: a crossing this close to a grid azimuth replaces it
_TRIAL_RINGS = 48
_TRIALS = 3
_MARGIN = 1.02
# With 96 rings the verification's cast uses less than half of its deviation limit on the roughest shipped lens, a 7 mm
# one; with 128 a quarter. More would only help programs that trace flat facets, without fitted normals; but the pi of
# 1,493 functions, whose faces take splines of 214 nodes, uses 1.6 of the limit with 128 rings and 0.56 with 160.
MIN_RINGS, MAX_RINGS = 96, 128
_RINGS_PER_NODE = 0.8  # of the finer face's spline, where that makes more than 128


@dataclass(frozen=True)
class Ring:
    """A closed ring of points (mm) at ascending azimuths (rad); a single point is an apex."""

    azimuths: Float[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    strip: str  # the face between this ring and the next one of the stack


def dome_rings(patch: Patch, rings: int, rim: Float[np.ndarray, " n"], name: str) -> list[Ring]:
    """Rings from the apex to the rim, equally spaced in angle from the axis."""
    azimuths: list[Float[np.ndarray, " _"]] = [np.zeros(1)]
    azimuths += [np.arange(6 * k) * (FULL_TURN / (6 * k)) for k in range(1, rings)]
    directions = [_cone(k * np.pi / (2 * rings), ring) for k, ring in enumerate(azimuths)]
    azimuths.append(rim)
    directions.append(rim_directions(rim))
    together = np.concatenate(directions)
    points = patch.radius(together)[:, None] * together
    parts = np.split(points, np.cumsum([len(ring) for ring in azimuths])[:-1])
    return [Ring(ring, part, name) for ring, part in zip(azimuths, parts, strict=True)]


def dome_mesh(patch: Patch, rings: int) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]:
    """Vertices and outward-facing triangles of one open dome, rim included."""
    stack = dome_rings(patch, rings, rim_azimuths(6 * rings, np.array([])), "")
    ids = number_rings(stack)
    strips = [zip_rings(stack[k], stack[k + 1], ids[k], ids[k + 1]) for k in range(rings)]
    return np.concatenate([ring.points for ring in stack]), np.concatenate(strips)


def rim_azimuths(count: int, crossings: Float[np.ndarray, " k"]) -> Float[np.ndarray, " n"]:
    """``count`` equally spaced azimuths and the crossings, ascending over one turn; no two almost equal."""
    step = FULL_TURN / count
    nearest = np.rint(crossings / step).astype(int)
    close = np.abs(crossings - nearest * step) < _CROSSING_REPLACES * step
    kept = np.setdiff1d(np.arange(count), nearest[close] % count) * step
    wrapped = np.where(close & (nearest == count), crossings - FULL_TURN, crossings)
    return np.sort(np.concatenate([kept, wrapped]))


def zip_rings(
    upper: Ring, lower: Ring, upper_ids: Int[np.ndarray, " n"], lower_ids: Int[np.ndarray, " m"]
) -> Int[np.ndarray, "t 3"]:
    """Triangles between two closed rings, counter-clockwise when seen with ``upper`` as the inner one.

    Edges of both rings are taken in the order of their midpoints, which keeps the diagonals short whatever the two
    vertex counts are. Triangles that a shared vertex makes degenerate are left out.
    """
    n, m = len(upper_ids), len(lower_ids)
    if n == 1:
        around = np.roll(lower_ids, -1)
        return np.stack([np.full(m, upper_ids[0]), lower_ids, around], axis=1)
    if m == 1:
        return np.stack([upper_ids, np.full(n, lower_ids[0]), np.roll(upper_ids, -1)], axis=1)
    order = np.argsort(np.concatenate([_midpoints(upper.azimuths), _midpoints(lower.azimuths)]), kind="stable")
    on_upper = order < n
    i = np.concatenate([[0], np.cumsum(on_upper)])[:-1]
    j = np.arange(n + m) - i
    advanced = np.where(on_upper, upper_ids[(i + 1) % n], lower_ids[(j + 1) % m])
    triangles = np.stack([upper_ids[i % n], lower_ids[j % m], advanced], axis=1)
    distinct = (np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)
    return triangles[distinct]


def number_rings(stack: list[Ring]) -> list[Int[np.ndarray, " _"]]:
    """Vertex numbers of each ring, counted through the stack."""
    counts = [len(ring.azimuths) for ring in stack]
    return np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])


def _midpoints(azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    midpoints: Float[np.ndarray, " n"] = (azimuths + np.append(azimuths[1:], azimuths[0] + FULL_TURN)) / 2.0
    return midpoints


def _cone(polar: float, azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    plane: Float[np.ndarray, "n 3"] = np.sin(polar) * rim_directions(azimuths)
    plane[:, 2] = np.cos(polar)
    return plane


@dataclass(frozen=True)
class MeshTolerance:
    """Distance (mm) and angle (rad) between facets of the optical surfaces and the surface above their centres."""

    chord_mm: float = 1e-3
    normal_rad: float = 0.01


def rings_for(plan: Plan[Patch], tolerance: MeshTolerance) -> int:
    """Rings for which both optical surfaces and the base's cylinder are within ``tolerance``.

    From 96 to 128, or to 0.8 of the nodes of the faces, which are as many as their detail takes.
    """
    rings, most = _TRIAL_RINGS, _most_rings(plan)
    for _ in range(_TRIALS):
        reached = mesh_error(plan, rings)
        by_chord = np.sqrt(reached.chord_mm / tolerance.chord_mm)
        by_normal = reached.normal_rad / tolerance.normal_rad
        if rings > _TRIAL_RINGS and max(by_chord, by_normal) <= 1.0:
            break
        needed = int(np.ceil(rings * _MARGIN * max(by_chord, by_normal)))
        rings = int(np.clip(needed, _rings_of_base(plan, tolerance), most))
        if needed >= most:
            break
    return rings


def _most_rings(plan: Plan[Patch]) -> int:
    return max(MAX_RINGS, int(np.ceil(_RINGS_PER_NODE * max(plan.inner.nodes, plan.outer.nodes))))


def mesh_error(plan: Plan[Patch], rings: int) -> MeshTolerance:
    """Errors of a mesh of ``rings``: the larger ones of the two optical surfaces."""
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


def _rings_of_base(plan: Plan[Patch], tolerance: MeshTolerance) -> int:
    """Rings for the widest cylinder, from which a polygon of 6 n corners is R (pi / 6n)^2 / 2 away."""
    if not plan.has_base:
        return MIN_RINGS
    radius = (plan.base.flange_diameter_mm or plan.base.widest_mm) / 2.0
    rings = np.pi / 6.0 * np.sqrt(radius / (2.0 * tolerance.chord_mm))
    return int(np.clip(np.ceil(rings), MIN_RINGS, MAX_RINGS))
