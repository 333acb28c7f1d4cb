"""The closed triangle mesh of the body, directly from the spline patches, without CAD or mesh libraries.

The body is one stack of rings: from the outer apex down the outer dome to its rim, around the base (its outline,
flange, bottom, pocket and bore), and from the inner rim up the cavity to the inner apex. Neighbouring rings are
joined by a strip of triangles, so by construction the mesh is closed, its faces share their rims, and its normals
point outwards. Where the outer rim crosses the base's outline the two rings share that vertex, and the strip between
them changes from a ledge (facing up) to an overhang (facing down). Last, facets of the optical faces that are farther
from their surfaces than a tolerance are split.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.geometry.base_profile import INNER, OUTER, RIM, TOP, base_corners
from lensforge.geometry.facet_error import FacetError, facet_error
from lensforge.geometry.patch import Patch
from lensforge.geometry.plan import Plan, rim_directions
from lensforge.geometry.refinement import refined_dome, refined_rim
from lensforge.geometry.rings import MOST_RINGS, Ring, dome_rings, number_rings, rim_azimuths, zip_rings

# Rim and outline closer than this share a vertex; the others are 20 steps of single precision (STL) apart, or more.
_SNAP_MM = 2e-5


@dataclass(frozen=True)
class BodyMesh:
    """Vertices (mm), triangles facing outwards, and for every triangle the index of its face's name."""

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    face: Int[np.ndarray, " t"]
    names: tuple[str, ...]
    rings: int

    def part(self, name: str) -> Int[np.ndarray, "k 3"]:
        """The triangles of the face ``name``."""
        triangles: Int[np.ndarray, "k 3"] = self.triangles[self.face == self.names.index(name)]
        return triangles

    def volume(self) -> float:
        """Enclosed volume (mm^3), by the divergence theorem."""
        a, b, c = np.moveaxis(self.vertices[self.triangles], 1, 0)
        return float(np.sum(np.cross(a, b) * c) / 6.0)

    def area(self) -> float:
        """Total area (mm^2)."""
        a, b, c = np.moveaxis(self.vertices[self.triangles], 1, 0)
        return float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1)) / 2.0)


def build_mesh(plan: Plan[Patch], rings: int, chord_mm: float | None = None) -> BodyMesh:
    """Mesh the body with ``rings`` concentric rings on each optical surface; ring k has 6 k vertices.

    ``chord_mm``: the largest distance of facets from the optical surfaces; facets that are farther away are split.
    Raises :class:`InputError` for fewer than 3 rings or more than 1000, or where ``chord_mm`` takes too many triangles.
    """
    if not 3 <= rings <= MOST_RINGS:
        raise InputError(f"rings = {rings}: from 3 to {MOST_RINGS}; leave it out to have it set by the tolerance")
    rim = rim_azimuths(6 * rings, plan.breaks)
    if chord_mm is not None:
        rim = refined_rim((plan.inner, plan.outer), rim, chord_mm)
    dome = dome_rings(plan.outer, rings, rim, OUTER)
    below = list(_below(plan, rim))
    stack = [*dome[:-1], *below, *reversed(dome_rings(plan.inner, rings, rim, INNER))]
    seat = rings + [ring.strip for ring in below].index(TOP if plan.has_base else RIM)  # it meets the base's outline
    ids = number_rings(stack)
    if plan.has_base:
        _share_crossings(plan, stack, ids, seat)
    strips = [zip_rings(stack[k], stack[k + 1], ids[k], ids[k + 1]) for k in range(len(stack) - 1)]
    labels = [np.full(len(strip), ring.strip) for strip, ring in zip(strips, stack, strict=False)]
    if plan.has_base:
        labels[seat] = _ledge_or_overhang(plan, strips[seat], stack, ids, seat)
    mesh = _collect(stack, np.concatenate(strips), np.concatenate(labels), rings)
    return mesh if chord_mm is None else _refined(mesh, plan, chord_mm)


def mesh_error(mesh: BodyMesh, plan: Plan[Patch]) -> FacetError:
    """Largest errors of the facets of both optical surfaces."""
    errors = [facet_error(patch, mesh.vertices, mesh.part(name)) for name, patch in _faces(plan)]
    return FacetError(max(error.chord_mm for error in errors), max(error.normal_rad for error in errors))


def _faces(plan: Plan[Patch]) -> tuple[tuple[str, Patch], tuple[str, Patch]]:
    return (OUTER, plan.outer), (INNER, plan.inner)


def _refined(mesh: BodyMesh, plan: Plan[Patch], chord_mm: float) -> BodyMesh:
    """The mesh with the facets of both optical faces within ``chord_mm``; the rest is unchanged."""
    vertices, triangles, face = mesh.vertices, mesh.triangles, mesh.face
    for name, patch in _faces(plan):
        number = mesh.names.index(name)
        vertices, split = refined_dome(patch, vertices, triangles[face == number], chord_mm)
        triangles = np.concatenate([triangles[face != number], split])
        face = np.concatenate([face[face != number], np.full(len(split), number)])
    return BodyMesh(vertices, triangles, face, mesh.names, mesh.rings)


def _below(plan: Plan[Patch], rim: Float[np.ndarray, " n"]) -> Iterator[Ring]:
    """Rings from the outer rim around the base to the foot or the top of the bore; the inner rim follows."""
    around = rim_directions(rim)
    for corner in base_corners(plan):
        points = corner.radius(rim)[:, None] * around - np.array([0.0, 0.0, corner.depth_mm])
        yield Ring(rim, points, corner.face)


def _share_crossings(plan: Plan[Patch], stack: list[Ring], ids: list[Int[np.ndarray, " _"]], seat: int) -> None:
    """Replace vertices of the outline by those of the rim where the two meet, so that the optical face stays exact."""
    overhang_mm = _overhang_mm(plan, stack[seat])
    overhangs = _overhangs(plan, stack[seat].azimuths)
    # Crossings that the plan did not resolve share vertices as well: strips never fold over.
    resolved = np.where(overhangs, overhang_mm, -overhang_mm) > _SNAP_MM
    ids[seat + 1] = np.where(resolved, ids[seat + 1], ids[seat])


def _overhang_mm(plan: Plan[Patch], rim: Ring) -> Float[np.ndarray, " n"]:
    distance = np.hypot(rim.points[:, 0], rim.points[:, 1])
    overhang: Float[np.ndarray, " n"] = distance - plan.outline.radius(rim.azimuths)
    return overhang


def _overhangs(plan: Plan[Patch], azimuths: Float[np.ndarray, " n"]) -> np.ndarray:
    """True at azimuths where the dome overhangs the base, by the plan's arcs."""
    starts = np.array([arc.start for arc in plan.arcs])
    relation = np.array([arc.relation == "overhang" for arc in plan.arcs])
    overhangs: np.ndarray = relation[np.searchsorted(starts, azimuths, side="right") - 1]
    return overhangs


def _ledge_or_overhang(
    plan: Plan[Patch], strip: Int[np.ndarray, "t 3"], stack: list[Ring], ids: list[Int[np.ndarray, " _"]], seat: int
) -> np.ndarray:
    """Face names of the strip between rim and outline: a triangle overhangs if one of its unshared vertices does."""
    rim, top = ids[seat], ids[seat + 1]
    over = _overhangs(plan, stack[seat].azimuths) & (rim != top)
    return np.where(np.isin(strip, np.concatenate([rim[over], top[over]])).any(axis=1), RIM, TOP)


def _collect(stack: list[Ring], triangles: Int[np.ndarray, "t 3"], labels: np.ndarray, rings: int) -> BodyMesh:
    """Drop unused vertices, and turn labels into indices."""
    used, compact = np.unique(triangles, return_inverse=True)
    names, face = np.unique(labels, return_inverse=True)
    vertices = np.concatenate([ring.points for ring in stack])[used]
    return BodyMesh(vertices, compact.reshape(-1, 3), face, tuple(str(name) for name in names), rings)
