"""The closed mesh of the plate: the facets of a lens of each kind, placed for every lens, and the faces around them.

The rims of the lenses are kept as they are: top and bottom have the same vertices on them, so by construction the mesh
is closed. The plane faces are triangulated by manifold3d, which adds no vertex.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from lensforge.cad.boundary import Boundary
from lensforge.cad.facets import CHORD_MM, MOST_TRIANGLES
from lensforge.cad.mesh import BodyMesh, build_mesh
from lensforge.cad.patch import Patch
from lensforge.cad.plan import RIM, Plan, rim_points
from lensforge.cad.plate_layout import (
    BOSS_BORE,
    BOSS_ROOF,
    PIN_END,
    PIN_SIDE,
    PLATE_BORE,
    PLATE_BOTTOM,
    PLATE_HOLE,
    PLATE_SIDE,
    PLATE_TOP,
    PlateLayout,
    RoundWall,
)
from lensforge.surfaces.plane_loop import Loop, circle_at, points_on

_RINGS = 24  # of a lens to begin with: its facets are split where they are too far from their faces

_Ids = Int[np.ndarray, " n"]


@dataclass
class MeshParts:
    """Vertices and triangles of a mesh under construction, triangles by the name of their face."""

    count: int = 0
    vertices: list[Float[np.ndarray, "_ 3"]] = field(default_factory=list)
    triangles: dict[str, list[Int[np.ndarray, "_ 3"]]] = field(default_factory=dict)

    def add_points(self, points: Float[np.ndarray, "n d"], height_mm: float = 0.0) -> _Ids:
        """Add points in space, or points of the plane in z = height, and return their numbers."""
        if points.shape[1] == 2:
            points = np.column_stack([points, np.full(len(points), height_mm)])
        self.vertices.append(points)
        self.count += len(points)
        return np.arange(self.count - len(points), self.count)

    def add_facets(self, name: str, triangles: Int[np.ndarray, "t 3"]) -> None:
        """Add triangles, by the numbers of their vertices, to the face ``name``."""
        self.triangles.setdefault(name, []).append(triangles)

    def add_wall(self, name: str, top: _Ids, foot: _Ids) -> None:
        """Add the wall between two loops with as many vertices; counter-clockwise loops make it face outwards."""
        ahead = np.roll(top, -1)
        below = np.roll(foot, -1)
        self.add_facets(name, np.concatenate([np.stack(c, axis=1) for c in ((top, foot, below), (top, below, ahead))]))

    def add_plane(self, name: str, outline: _Ids, openings: Sequence[Int[np.ndarray, " _"]], *, up: bool) -> None:
        """Add the plane face within ``outline``, without ``openings``; all loops run counter-clockwise."""
        import manifold3d

        loops = [outline, *(opening[::-1] for opening in openings)]
        ids = np.concatenate(loops)
        places = np.concatenate(self.vertices)[:, :2]
        triangles = ids[np.asarray(manifold3d.triangulate([np.ascontiguousarray(places[loop]) for loop in loops]))]
        self.add_facets(name, triangles if up else triangles[:, ::-1])

    def mesh(self, rings: int) -> BodyMesh:
        """Collect the mesh; faces in the order of their names."""
        names = sorted(self.triangles)
        triangles = [np.concatenate(self.triangles[name]) for name in names]
        face = np.repeat(np.arange(len(names)), [len(triangles) for triangles in triangles])
        return BodyMesh(np.concatenate(self.vertices), np.concatenate(triangles), face, tuple(names), rings)


@lru_cache(maxsize=1)  # export and check ask for it
def lens_meshes(plans: tuple[Plan[Patch], ...], kinds: tuple[int, ...]) -> tuple[list[BodyMesh], float]:
    """The meshes of lenses without a base, one of each kind, and the largest distance (mm) allowed of their facets.

    That is 2 um, or as much as lenses of these ``kinds`` of a file that is still read may have.
    """
    chord_mm = CHORD_MM
    while True:
        meshes = [build_mesh(plan, _RINGS, chord_mm) for plan in plans]
        if sum(len(meshes[kind].triangles) for kind in kinds) <= MOST_TRIANGLES:
            return meshes, chord_mm
        chord_mm *= 2.0


def build_plate_mesh(
    plans: Sequence[Plan[Patch]], layout: PlateLayout, meshes: Sequence[BodyMesh], chord_mm: float
) -> BodyMesh:
    """Mesh the plate; ``meshes``: of a lens of each kind without a base, ``chord_mm``: of the plate's round edges."""
    parts = MeshParts()
    thickness = layout.plate.thickness_mm
    by_kind = [
        (mesh, layout.bore_scale(rim_points(plan.cavity)), _rim_of(mesh, plan.envelope), _rim_of(mesh, plan.cavity))
        for plan, mesh in zip(plans, meshes, strict=True)
    ]
    deep = (0.0, thickness)
    sides = (layout.outline, layout.foot)
    outline, foot = _wall(parts, PLATE_SIDE, sides, chord_mm, deep, outwards=True)
    tops = []
    bottoms = []
    for number, (lens, bore_scale, rim, mouth) in enumerate(layout.of_each(by_kind)):
        ids = parts.add_points(layout.placed(lens.vertices, number))
        for name in lens.names:
            if name != RIM:
                parts.add_facets(name, ids[lens.part(name)])
        below = parts.add_points(layout.placed(bore_scale * lens.vertices[mouth, :2], number), -thickness)
        parts.add_wall(PLATE_BORE, ids[mouth][::-1], below[::-1])
        tops.append(ids[rim])
        bottoms.append(below)
    holes = [add_round(parts, PLATE_HOLE, hole, chord_mm, outwards=False) for hole in layout.holes]
    slots = [_wall(parts, PLATE_HOLE, (slot, slot), chord_mm, deep, outwards=False) for slot in layout.slots]
    for edge, below in (*holes, *slots):
        tops.append(edge)
        bottoms.append(below)
    for pin, bore in layout.standing:
        edge, end = add_round(parts, PIN_SIDE, pin, chord_mm, outwards=True)
        mouths = []
        if bore is not None:
            roof, mouth = add_round(parts, BOSS_BORE, bore, chord_mm, outwards=False)
            parts.add_plane(BOSS_ROOF, roof, [], up=False)
            mouths.append(mouth)
        parts.add_plane(PIN_END, end, mouths, up=False)
        bottoms.append(edge)
    parts.add_plane(PLATE_TOP, outline, tops, up=True)
    parts.add_plane(PLATE_BOTTOM, foot, bottoms, up=False)
    return parts.mesh(meshes[0].rings)


def add_round(parts: MeshParts, name: str, wall: RoundWall, chord_mm: float, *, outwards: bool) -> tuple[_Ids, _Ids]:
    """Add a round wall; return the numbers of its vertices at top and foot."""
    loops = circle_at(wall.place, wall.radius_mm), circle_at(wall.place, wall.foot_mm)
    return _wall(parts, name, loops, chord_mm, (wall.depth_mm, wall.depth_mm + wall.length_mm), outwards=outwards)


def _wall(
    parts: MeshParts,
    name: str,
    loops: tuple[Loop, Loop],
    chord_mm: float,
    ends_mm: tuple[float, float],
    *,
    outwards: bool,
) -> tuple[_Ids, _Ids]:
    """Add the wall between two loops at depths below z = 0; return the numbers of the vertices on them."""
    points = points_on(loops[0], chord_mm), np.concatenate(list(_at_foot(*loops, chord_mm)))
    top, foot = (parts.add_points(point, -depth) for point, depth in zip(points, ends_mm, strict=True))
    parts.add_wall(name, *((top, foot) if outwards else (top[::-1], foot[::-1])))
    return top, foot


def _at_foot(loop: Loop, foot: Loop, chord_mm: float) -> Iterator[Float[np.ndarray, "_ 2"]]:
    for top, edge in zip(loop, foot, strict=True):
        if top.centre is None or edge.centre is None:
            yield np.array([edge.start])
        else:
            yield edge.centre + (top.points(chord_mm) - top.centre) * (edge.radius_mm / top.radius_mm)


def _rim_of(lens: BodyMesh, boundary: Boundary[Patch]) -> _Ids:
    ids = np.unique(lens.part(boundary.faces[-1].label))
    ids = ids[lens.vertices[ids, 2] == 0.0]
    x, y = lens.vertices[ids, :2].T
    rim: _Ids = ids[np.argsort(np.arctan2(y, x), kind="stable")]
    return rim
