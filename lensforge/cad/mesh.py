"""The closed triangle mesh of the body, directly from the spline patches, without CAD or mesh libraries.

The body is one stack of rings: from the outer apex down the envelope to its rim, around the base (its outline, flange,
bottom, pocket and bore), and from the inner rim up the cavity to the inner apex. A crease is one of these rings. Around
an opening the stack begins and ends with the ring of its rim, in place of both apexes.
Neighbouring rings are joined by a strip of triangles, so by construction the mesh is closed, its faces share their rims
and creases, and its normals point outwards. Where the outer rim crosses the base's outline the two rings share that
vertex, and the strip between them changes from a ledge (facing up) to an overhang (facing down). Last, facets of the
optical faces that are farther from their surfaces than a tolerance are split. manifold3d tests in double precision that
a mesh is closed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from lensforge.cad.boundary import Boundary, Crease, TrimmedFace
from lensforge.cad.facets import Curve, facet_error, points_in, refined_azimuths, refined_dome
from lensforge.cad.flange import FlangeRing
from lensforge.cad.outline import FULL_TURN
from lensforge.cad.patch import Patch, even_angles
from lensforge.cad.plan import (
    RIM,
    RIM_FLANGE_BOTTOM,
    RIM_FLANGE_SIDE,
    RIM_FLANGE_TOP,
    TOP,
    Plan,
    base_corners,
    rim_directions,
)
from lensforge.errors import InputError
from lensforge.results import Box
from lensforge.surfaces.surface import to_sphere

_CROSSING_REPLACES = 0.1  # of an azimuth step: a crossing this close to a grid azimuth replaces it
# With 96 rings the verification's cast uses less than half of its deviation limit on the roughest shipped lens, a 7 mm
# one; but the pi of 1,493 functions, whose faces take splines of 214 nodes, uses 1.6 of the limit with 128 rings and
# 0.56 with 160, and the lens for two distances, with 226 nodes and a valley of 0.1 mm in 40 mm, 1.14 with 181 and 0.72
# with 208. A lens of 45 nodes for three LEDs uses 1.15 of it with 55 rings, 0.48 with 68 and a twentieth more facets.
# Quickstart of four seeds uses 0.65 to 0.79 with 1.22 rings a node, 0.47 to 0.57 with 1.35 and a fifth more facets.
# Facets nearer to the face help less: with half of their distance two of these seeds use 0.52 and 0.64.
MIN_RINGS = 68
MOST_RINGS = 1000  # 12 million triangles
_RINGS_PER_NODE = 1.35  # of the finer face's spline
_MOST_FOR_DETAIL = 310  # 1.2 million triangles; a narrow cup of 320 nodes would take 2.2 million, and minutes to read


@dataclass(frozen=True)
class Ring:
    """A closed ring of points (mm) at ascending azimuths (rad); a single point is an apex."""

    azimuths: Float[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    strip: str  # the face between this ring and the next one of the stack


def dome_rings(
    boundary: Boundary[Patch],
    rings: int,
    rim: Float[np.ndarray, " n"],
    chord_mm: float | None,
    flange: FlangeRing | None = None,
) -> list[Ring]:
    """Rings from the apex to the rim, on each face equally spaced in angle; those at creases within ``chord_mm``.

    With a ``flange`` its corners are rings in the place of those on its cylinder.
    """
    first, *lasts = _last_rings(boundary, rings)
    rings_of_dome = [_first_ring(boundary, first, chord_mm)]
    for face, last in zip(boundary.of_material, lasts, strict=True):
        rings_of_dome[-1] = replace(rings_of_dome[-1], strip=face.label)
        on_face = _face_rings(face, first, last, rim, chord_mm)
        if flange is not None and face.is_flange:
            on_face = [*_flange_rings(flange, face.label, len(on_face[-1].azimuths), chord_mm), on_face[-1]]
        rings_of_dome += on_face
        first = last
    return rings_of_dome


def _first_ring(boundary: Boundary[Patch], number: int, chord_mm: float | None) -> Ring:
    """The apex, or the inner rim around an opening."""
    face = boundary.faces[0]
    crease = boundary.opening
    if crease is None:
        return Ring(np.zeros(1), points_in(boundary, np.array([[0.0, 0.0, 1.0]])), face.label)
    azimuths = np.arange(6 * number) * (FULL_TURN / (6 * number))
    line = _line(face.shape, crease)
    if chord_mm is not None:
        azimuths = refined_azimuths((line,), azimuths, chord_mm)
    return Ring(azimuths, line(azimuths), face.label)


def _last_rings(boundary: Boundary[Patch], rings: int) -> list[int]:
    """Number of the first ring, and of the last of each face: a crease by its mean angle from the axis."""
    turns = np.linspace(0.0, FULL_TURN, 6 * rings)
    opening = boundary.opening
    creases = [face.domain.outside for face in boundary.of_material[:-1]]
    shares = [
        float(2.0 * np.arctan(crease.radius(turns)).mean() / (np.pi / 2)) for crease in (opening, *creases) if crease
    ]
    last = [] if opening is not None else [0]
    for number, share in enumerate(shares):  # each face has a ring of its own at least
        least = 1 + (last[-1] if last else 0)
        last.append(min(max(round(rings * share), least), rings - len(shares) + number))
    return [*last, rings]


def _face_rings(
    face: TrimmedFace[Patch], first: int, last: int, rim: Float[np.ndarray, " n"], chord_mm: float | None
) -> list[Ring]:
    """Rings ``first`` + 1 to ``last``, at the edge of the face; ring k has 6 k vertices, or those of ``rim``.

    They are spaced as the spline's nodes are: at even angles those at the mouth of a long cup were 2 mm apart, their
    vertices 0.2 mm, so that the neighbours by which a normal is found lay on one or two of them.
    """
    azimuths = [np.arange(6 * k) * (FULL_TURN / (6 * k)) for k in range(first + 1, last + 1)]
    crease = face.domain.outside
    if crease is None:
        azimuths[-1] = rim
    elif chord_mm is not None:
        azimuths[-1] = refined_azimuths((_line(face.shape, crease),), azimuths[-1], chord_mm)
    directions = []
    for k, turns in enumerate(azimuths, start=1):
        low, high = (2.0 * np.arctan(radius) for radius in face.domain.radii(turns))
        directions.append(_cone(even_angles(low, high, k, last - first, face.domain.extent[0]), turns))
    if crease is None:
        directions[-1] = rim_directions(rim)
    points = np.split(
        points_in(face.shape, np.concatenate(directions)), np.cumsum([len(ring) for ring in azimuths])[:-1]
    )
    return [Ring(ring, part, face.label) for ring, part in zip(azimuths, points, strict=True)]


def _flange_rings(flange: FlangeRing, cylinder: str, least: int, chord_mm: float | None) -> list[Ring]:
    """Rings at the corners of a flange, of at least ``least`` vertices, polygons within ``chord_mm`` of circles."""
    of_chord = 0.0 if chord_mm is None else np.pi * np.sqrt(flange.outer_mm / (2.0 * chord_mm))
    count = max(least, int(np.ceil(of_chord)))
    azimuths = np.arange(count) * (FULL_TURN / count)
    strips = RIM_FLANGE_TOP, RIM_FLANGE_SIDE, RIM_FLANGE_BOTTOM, cylinder
    return [
        Ring(azimuths, radius * rim_directions(azimuths) + np.array([0.0, 0.0, height]), strip)
        for (radius, height), strip in zip(flange.corners.tolist(), strips, strict=True)
    ]


def rim_azimuths(count: int, crossings: Float[np.ndarray, " k"]) -> Float[np.ndarray, " n"]:
    """``count`` equally spaced azimuths and the crossings, ascending over one turn; no two almost equal."""
    step = FULL_TURN / count
    nearest = np.rint(crossings / step).astype(int)
    close = np.abs(crossings - nearest * step) < _CROSSING_REPLACES * step
    regular = np.setdiff1d(np.arange(count), nearest[close] % count) * step
    wrapped = np.where(close & (nearest == count), crossings - FULL_TURN, crossings)
    return np.sort(np.concatenate([regular, wrapped]))


def zip_rings(
    upper: Ring, lower: Ring, upper_ids: Int[np.ndarray, " n"], lower_ids: Int[np.ndarray, " m"]
) -> Int[np.ndarray, "t 3"]:
    """Triangles between two closed rings, counter-clockwise when seen with ``upper`` as the inner one.

    Edges of both rings are taken in the order of their midpoints, which keeps the diagonals short whatever the two
    vertex counts are. Triangles that a shared vertex makes degenerate are left out.
    """
    n = len(upper_ids)
    m = len(lower_ids)
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


def _midpoints(azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    return (azimuths + np.append(azimuths[1:], azimuths[0] + FULL_TURN)) / 2.0


def _cone(polar: Float[np.ndarray, " n"], azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    plane: Float[np.ndarray, "n 3"] = np.sin(polar)[:, None] * rim_directions(azimuths)
    plane[:, 2] = np.cos(polar)
    return plane


def rings_for(plan: Plan[Patch], chord_mm: float, least: int = MIN_RINGS) -> int:
    """Initial number of rings: for the detail of the faces, and to keep the base's cylinder within ``chord_mm``.

    ``least``: number that the light needs.
    """
    of_base = 0.0
    of_detail = min(_RINGS_PER_NODE * max(face.shape.nodes for face in plan.faces), _MOST_FOR_DETAIL)
    if plan.has_base:  # a polygon of 6 n corners is R (pi / 6n)^2 / 2 away from the widest cylinder
        radius = (plan.base.flange_diameter_mm or plan.base.widest_mm) / 2.0
        of_base = np.pi / 6.0 * np.sqrt(radius / (2.0 * chord_mm))
    return min(MOST_RINGS, max(least, int(np.ceil(max(of_detail, of_base)))))


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
        return self.triangles[self.face == self.names.index(name)]

    @property
    def bounds_mm(self) -> Box:
        """Least and largest corner (mm) of the box around the vertices."""
        (x0, y0, z0) = self.vertices.min(axis=0).tolist()
        (x1, y1, z1) = self.vertices.max(axis=0).tolist()
        return (x0, y0, z0), (x1, y1, z1)

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
        rim = refined_azimuths(
            tuple(_line(boundary.faces[-1].shape, None) for boundary in (plan.cavity, plan.envelope)), rim, chord_mm
        )
    dome = dome_rings(plan.envelope, rings, rim, chord_mm, plan.rim_flange)
    hollow = dome_rings(plan.cavity, rings, rim, chord_mm)
    below = list(_below(plan, rim))
    upwards = [replace(ring, strip=above.strip) for above, ring in zip([hollow[0], *hollow[:-1]], hollow, strict=True)]
    stack = [*dome[:-1], *below, *reversed(upwards)]
    # the ring that meets the base's outline
    seat = len(dome) - 1 + [ring.strip for ring in below].index(TOP if plan.has_base else RIM)
    counts = [len(ring.azimuths) for ring in stack]
    ids = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    if plan.cavity.opening is not None:  # around it the last ring is the first one
        ids[-1] = ids[0]
    if plan.has_base:
        _share_crossings(plan, stack, ids, seat)
    strips = [zip_rings(stack[k], stack[k + 1], ids[k], ids[k + 1]) for k in range(len(stack) - 1)]
    labels = [np.full(len(strip), ring.strip) for strip, ring in zip(strips, stack, strict=False)]
    if plan.has_base:
        labels[seat] = _ledge_or_overhang(plan, strips[seat], stack, ids, seat)
    mesh = _collect(stack, np.concatenate(strips), np.concatenate(labels), rings)
    return mesh if chord_mm is None else _refined(mesh, plan, chord_mm)


def mesh_error(mesh: BodyMesh, plan: Plan[Patch]) -> float:
    """Largest distance (mm) between the facets and their optical surfaces."""
    faces = (face for face in plan.faces if not face.is_flange)
    return max(facet_error(face.shape, mesh.vertices, mesh.part(face.label)) for face in faces)


def _line(patch: Patch, crease: Crease | None) -> Curve:
    def points(azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        return points_in(patch, rim_directions(azimuths) if crease is None else to_sphere(crease.chart(azimuths)))

    return points


def _refined(mesh: BodyMesh, plan: Plan[Patch], chord_mm: float) -> BodyMesh:
    """The mesh with the facets of all optical faces within ``chord_mm``; the rest is unchanged."""
    vertices = mesh.vertices
    triangles = mesh.triangles
    face = mesh.face
    for plan_face in plan.faces:
        if plan_face.is_flange:
            continue
        number = mesh.names.index(plan_face.label)
        vertices, split = refined_dome(plan_face.shape, vertices, triangles[face == number], chord_mm)
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
    """Replace vertices of the outline by those of the rim where they meet, so that the optical face stays exact."""
    rim = stack[seat]
    overhang_mm = np.hypot(rim.points[:, 0], rim.points[:, 1]) - plan.outline.radius(rim.azimuths)
    overhangs = _overhangs(plan, rim.azimuths)
    # Crossings that the plan did not resolve share vertices as well: strips never fold over.
    resolved = np.where(overhangs, overhang_mm, -overhang_mm) > _SNAP_MM
    ids[seat + 1] = np.where(resolved, ids[seat + 1], ids[seat])


def _overhangs(plan: Plan[Patch], azimuths: Float[np.ndarray, " n"]) -> np.ndarray:
    """True at azimuths at which the dome overhangs the base, by the plan's arcs."""
    starts = np.array([arc.start for arc in plan.arcs])
    relation = np.array([arc.relation == "overhang" for arc in plan.arcs])
    return relation[np.searchsorted(starts, azimuths, side="right") - 1]


def _ledge_or_overhang(
    plan: Plan[Patch], strip: Int[np.ndarray, "t 3"], stack: list[Ring], ids: list[Int[np.ndarray, " _"]], seat: int
) -> np.ndarray:
    """Face names of the strip between rim and outline: a triangle overhangs if one of its unshared vertices does."""
    rim = ids[seat]
    top = ids[seat + 1]
    over = _overhangs(plan, stack[seat].azimuths) & (rim != top)
    return np.where(np.isin(strip, np.concatenate([rim[over], top[over]])).any(axis=1), RIM, TOP)


def _collect(stack: list[Ring], triangles: Int[np.ndarray, "t 3"], labels: np.ndarray, rings: int) -> BodyMesh:
    """Drop unused vertices, and turn labels into indices."""
    used, compact = np.unique(triangles, return_inverse=True)
    names, face = np.unique(labels, return_inverse=True)
    vertices = np.concatenate([ring.points for ring in stack])[used]
    return BodyMesh(vertices, compact.reshape(-1, 3), face, tuple(str(name) for name in names), rings)


def manifold_of(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"], faces: Int[np.ndarray, " t"] | None = None
) -> Any:
    """The ``manifold3d.Manifold`` of a mesh whose neighbouring triangles share vertices, empty if it is not closed.

    ``faces``: numbers that its triangles keep through a union.
    """
    import manifold3d

    numbers = {} if faces is None else {"face_id": np.ascontiguousarray(faces, dtype=np.uint64)}
    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(vertices, dtype=np.float64),
        tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
        **numbers,
    )
    return manifold3d.Manifold(mesh)


@dataclass(frozen=True)
class Closure:
    """Result of manifold3d; ``status`` is ``NoError`` for an oriented 2-manifold without boundary.

    ``genus`` counts handles: 0 for a lens, whose cavity and bore are one blind hole; -1 for two bodies.
    """

    status: str
    genus: int
    volume_mm3: float

    @property
    def watertight(self) -> bool:
        """True if closed, oriented outwards, and one body."""
        return self.status == "NoError" and self.volume_mm3 > 0.0 and self.genus >= 0


def check_closed(vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> Closure:
    """Test a mesh whose neighbouring triangles share vertex indices."""
    body = manifold_of(vertices, triangles)
    return Closure(body.status().name, int(body.genus()), float(body.volume()))
