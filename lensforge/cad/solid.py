"""The body as a B-rep solid: optical faces of one patch each, closed by the faces of rim, base, step and bore.

Neighbouring faces are built on the same edges, so the shell is closed by construction: no sewing within a tolerance,
and no boolean operation that could lose the name of a face.

The bore is the cavity's rim extruded straight down, or a circle around it, so the LED can be inserted from below; a
step without setback is the outer rim extruded likewise. Every planar face is horizontal, or a flat side of the base.
Rims are chains of edges, and the walls below them have a face for each edge.
"""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.GeomAbs import GeomAbs_CurveType
from OCP.gp import gp_Dir, gp_Pln, gp_Pnt
from OCP.GProp import GProp_GProps
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS, TopoDS_Shell, TopoDS_Solid

from lensforge.cad.boundary import Boundary, Domain, TrimmedFace
from lensforge.cad.edges import (
    Chain,
    Named,
    Opening,
    circle_edge,
    copies_at,
    crease_edges,
    geom_surface,
    moved,
    normal_at,
    outline_edges,
    rim_edges,
    walls_and_foot,
    walls_below,
    wire,
)
from lensforge.cad.flange import FlangeRing
from lensforge.cad.outline import FULL_TURN, Arc, Outline, circle
from lensforge.cad.patch import Patch
from lensforge.cad.plan import (
    BORE,
    BORE_TOP,
    BOTTOM,
    FLANGE_SIDE,
    FLANGE_TOP,
    FOOT_END,
    FOOT_SIDE,
    OUTER,
    POCKET_SIDE,
    POCKET_TOP,
    RELIEF,
    RIM,
    RIM_FLANGE_BOTTOM,
    RIM_FLANGE_SIDE,
    RIM_FLANGE_TOP,
    SIDE,
    TOP,
    Plan,
    foot_scale,
)
from lensforge.results.brep_size import volume_and_area
from lensforge.surfaces.step_file import parts_of

FLAT = "CLOCKING_FLAT"

Shapes = dict[str, Any]  # by name; the CAD kernel has no types


def body_faces(plan: Plan[Patch], cavity_rim: Chain, envelope_rim: list[Chain], feet: Chain) -> Named:
    """Names and faces that close the body between the two domes, without its feet; ``feet``: wires at their tops.

    ``envelope_rim``: a chain for each arc of the plan. Chains run counter-clockwise; where the outer rim crosses the
    outline they share vertices.
    """
    whole_rim = [edge for chain in envelope_rim for edge in chain]
    if not plan.has_base:
        return [(RIM, planar_face(wire(whole_rim), wire(cavity_rim)))]
    bore, bore_foot = _bore(plan, cavity_rim)
    faces, foot = _outside(plan, envelope_rim, whole_rim)
    pocket, opening = _pocket(plan, bore_foot)
    return [*bore, *faces, *pocket, (BOTTOM, planar_face(foot, opening, *feet))]


def _bore(plan: Plan[Patch], cavity_rim: Chain) -> tuple[Named, Any]:
    """The wall of the bore, with the ring above it if it is set back, and the wire at its foot."""
    if plan.bore is None:
        return walls_below(BORE, cavity_rim, plan.bore_mm, foot_scale(plan, BORE))
    mouth = _circle(plan.bore, 0.0)
    walls, foot = walls_below(BORE, mouth, plan.bore_mm, foot_scale(plan, BORE))
    return [(BORE_TOP, planar_face(wire(mouth), wire(cavity_rim))), *walls], foot


def _outside(plan: Plan[Patch], envelope_rim: list[Chain], whole_rim: Chain) -> tuple[Named, Any]:
    """Faces between the outer rim and the bottom, and the wire at the bottom."""
    if plan.flush:
        faces, foot = walls_below(SIDE, whole_rim, plan.shoulder_mm, foot_scale(plan, SIDE))
    else:
        faces = []
        seat = envelope_rim
        if plan.ring is not None:
            ring = _circle(plan.ring, 0.0)
            walls, seat_wire = walls_below(RELIEF, ring, plan.relief_mm)
            faces = [(RIM, planar_face(wire(whole_rim), wire(ring))), *walls]
            seat = [parts_of(seat_wire, "EDGE")]
        elif plan.relief_mm > 0.0:
            faces, seat_wire = walls_below(RELIEF, whole_rim, plan.relief_mm)
            seat = [parts_of(seat_wire, "EDGE")]
        outline = outline_edges(plan.outline, plan.relief_mm, envelope_rim, plan.arcs)
        side_faces, foot = walls_and_foot(outline, plan.shoulder_mm - plan.relief_mm, foot_scale(plan, SIDE))
        faces += [(_side_name(plan, edge), face) for edge, face in zip(outline, side_faces, strict=True)]
        faces += _between_rim_and_outline(plan, seat, outline)
    if plan.flange is None:
        return faces, foot
    flange = _circle(plan.flange, plan.shoulder_mm)
    sides, flange_foot = walls_below(FLANGE_SIDE, flange, plan.base.flange_height_mm, foot_scale(plan, FLANGE_SIDE))
    return [*faces, (FLANGE_TOP, planar_face(wire(flange), foot)), *sides], flange_foot


def _pocket(plan: Plan[Patch], bore_foot: Any) -> tuple[Named, Any]:
    """The faces of the pocket in the bottom, and the wire of the opening in the bottom."""
    if plan.pocket is None:
        return [], bore_foot
    scale = foot_scale(plan, POCKET_SIDE)
    mouth = _circle(circle(scale * plan.pocket.pieces[0].distance_mm), plan.base.height_mm)
    sides, top = walls_below(POCKET_SIDE, mouth, -plan.base.pocket_depth_mm, 1.0 / scale)
    return [*sides, (POCKET_TOP, planar_face(top, bore_foot))], wire(mouth)


def _feet(plan: Plan[Patch]) -> tuple[Named, Chain]:
    feet = plan.base.feet
    faces = Named()
    tops = Chain()
    if feet is None:
        return faces, tops
    root, tip = plan.base.foot_radii_mm
    rim = _circle(circle(root), plan.base.height_mm)
    sides, end = walls_below(FOOT_SIDE, rim, feet.height_mm, tip / root)
    made = [(name, facing(face, AWAY)) for name, face in sides] + [(FOOT_END, facing(planar_face(end), DOWN))]
    for place in feet.places_mm:
        *copies, top = copies_at([*(face for _, face in made), wire(rim)], moved(place))
        faces += [(name, TopoDS.Face_s(face)) for (name, _), face in zip(made, copies, strict=True)]
        tops.append(TopoDS.Wire_s(top))
    return faces, tops


def _circle(outline: Outline, depth_mm: float) -> Chain:
    return outline_edges(outline, depth_mm, [], ())


def _side_name(plan: Plan[Patch], edge: Any) -> str:
    straight = BRepAdaptor_Curve(edge).GetType() == GeomAbs_CurveType.GeomAbs_Line
    return FLAT if straight and plan.base.flat_mm is not None else SIDE


def _between_rim_and_outline(plan: Plan[Patch], rim: list[Chain], outline: Chain) -> Named:
    """Ledges where the rim is inside the outline, overhangs where it is outside: a whole ring, or crescents."""
    relation = plan.arcs[0].relation
    if len(plan.arcs) == 1:
        inside = wire(rim[0])
        around = wire(outline)
        return [(TOP, planar_face(around, inside))] if relation == "ledge" else [(RIM, planar_face(inside, around))]
    faces = []
    for arc, chain in zip(plan.arcs, rim, strict=True):
        name = TOP if arc.relation == "ledge" else RIM
        faces.append((name, planar_face(wire([*chain, *_chain_between(chain, outline)]))))
    return faces


def _chain_between(rim: Chain, outline: Chain) -> Chain:
    """The edges of ``outline`` from the first vertex of ``rim`` to its last."""
    start = TopExp.FirstVertex_s(rim[0])
    end = TopExp.LastVertex_s(rim[-1])
    first = next(k for k, side in enumerate(outline) if TopExp.FirstVertex_s(side).IsSame(start))
    chain = []
    for side in outline[first:] + outline[:first]:
        chain.append(side)
        if TopExp.LastVertex_s(side).IsSame(end):
            break
    return chain


def planar_face(boundary: Any, *holes: Any) -> Any:
    """The horizontal face, its normal up, within a horizontal wire, without ``holes``."""
    height = BRep_Tool.Pnt_s(parts_of(boundary, "VERTEX")[0]).Z()
    return _within(gp_Pln(gp_Pnt(0.0, 0.0, height), gp_Dir(0.0, 0.0, 1.0)), boundary, *holes)


# Outward direction of each face: along +z or -z, away from the axis or towards it; of an optical one, from the origin.
UP = "+z"
DOWN = "-z"
AWAY = "+r"
TOWARDS = "-r"
FROM_ORIGIN = "+u"
TO_ORIGIN = "-u"
_OUTWARD = {
    **{RIM: DOWN, TOP: UP, SIDE: AWAY, BOTTOM: DOWN, BORE: TOWARDS},
    **{RELIEF: AWAY, FLAT: AWAY, FLANGE_TOP: UP, FLANGE_SIDE: AWAY, POCKET_SIDE: TOWARDS, POCKET_TOP: DOWN},
    **{BORE_TOP: DOWN},
}


@dataclass(frozen=True)
class Solid:
    """A solid (TopoDS_Solid, mm) and its faces (TopoDS_Face) by name; ``is_prism``: long, and extruded."""

    shape: Any
    faces: Shapes
    is_prism: bool = False

    @cached_property
    def valid(self) -> bool:
        """True if the CAD kernel finds one closed, outward-facing solid with consistent wires, edges and tolerances."""
        return _is_valid(self.shape) and len(parts_of(self.shape, "SHELL")) == 1 and self.default_volume_mm3 > 0.0

    @property
    def faults(self) -> list[str]:
        """Names of the faces that the CAD kernel finds invalid, each tested by itself; empty for a valid solid."""
        return [] if self.valid else [name for name, face in self.faces.items() if not _is_valid(face)]

    @property
    def volume_mm3(self) -> float:
        """Volume, negative if the faces face inwards."""
        return self._size[0]

    @property
    def area_mm2(self) -> float:
        """Area of all faces."""
        return self._size[1]

    @cached_property
    def _size(self) -> tuple[float, float]:
        return volume_and_area(self.shape, by_sectors=self.is_prism)

    @cached_property
    def default_volume_mm3(self) -> float:
        """Volume by the kernel's integration without a precision: the same points on the same faces.

        A file that was written and read back has the same to rounding. Its own error is 1e-7 on a lens of two faces,
        1e-2 on one of four, and 1e-4 on the planes of other solids with long edges.
        """
        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(self.shape, properties)
        return float(properties.Mass())

    @property
    def genus(self) -> int:
        """Handles of the boundary, by Euler and Poincaré: ``V - E + F - (L - F) = 2 (S - G)``, L: loops, S: shells."""
        faces, vertices, shells = (parts_of(self.shape, kind) for kind in ("FACE", "VERTEX", "SHELL"))
        edges = sum(not BRep_Tool.Degenerated_s(edge) for edge in parts_of(self.shape, "EDGE"))
        loops = sum(len(parts_of(face, "WIRE")) for face in faces)
        return len(shells) - (len(vertices) - edges + 2 * len(faces) - loops) // 2


def _is_valid(shape: Any) -> bool:
    return bool(BRepCheck_Analyzer(shape).IsValid())


def build_solid(plan: Plan[Patch]) -> Solid:
    """Build the closed solid of a plan."""
    split = len(plan.arcs) == 1
    ring = plan.rim_flange
    opening = Opening.of(plan)
    envelope_faces, envelope_rim = optical_faces(plan.envelope, plan.arcs, split, FROM_ORIGIN, opening, ring)
    cavity_faces, (cavity_rim,) = optical_faces(plan.cavity, (Arc(0.0, FULL_TURN, "bare"),), True, TO_ORIGIN, opening)
    feet, tops = _feet(plan)
    closing = body_faces(plan, cavity_rim, envelope_rim, tops)
    faces = [(name, facing(face, _OUTWARD[name])) for name, face in closing]
    return assembled([*envelope_faces, *cavity_faces, *faces, *feet])


def optical_faces(
    boundary: Boundary[Patch],
    arcs: tuple[Arc, ...],
    split: bool,
    outward: str,
    opening: Opening | None = None,
    ring: FlangeRing | None = None,
) -> tuple[Named, list[Chain]]:
    """The optical faces of a boundary, on shared edges along its creases, and the chains of its rim over ``arcs``.

    ``opening``: around which the first face lies. With a ``ring``: its faces, and the rest of its cylinder.
    """
    within = boundary.of_material
    patches = [face.shape for face in within]
    surfaces = [geom_surface(face.shape.bounded(face.domain.extent[1])) for face in within]
    if opening is not None:
        surfaces[0] = opening.plane if within[0].is_ring else opening.beside
    pairs = zip(pairwise(patches), pairwise(surfaces), strict=True)
    inner = [face.domain.outside for face in within[:-1] if face.domain.outside is not None]
    creases = [crease_edges(crease, *sides) for crease, sides in zip(inner, pairs, strict=True)]
    rim = rim_edges(patches[-1], surfaces[-1], arcs, split=split)
    outlines = [*creases, [edge for chain in rim for edge in chain]]
    holes = [[], *([crease] for crease in creases)]
    if opening is not None:
        holes[0] = [opening.edges]
    faces = []
    for face, surface, outline, hole in zip(within, surfaces, outlines, holes, strict=True):
        if ring is not None and face.is_flange:
            faces += _with_ring(face, surface, (wire(outline), *map(wire, hole)), ring)
            continue
        trimmed = _within(surface, wire(outline), *map(wire, hole))
        faces.append((face.label, facing(trimmed, outward, face.domain)))
    return faces, rim


def _with_ring(face: TrimmedFace[Patch], surface: Any, ends: tuple[Any, Any], ring: FlangeRing) -> Named:
    """Faces of a flange, and the bands of the cylinder below and above it between the wires ``ends``."""
    low, high = (circle_edge(ring.inner_mm, height, (face.shape, surface)) for height in (ring.low_mm, ring.high_mm))
    rim = [circle_edge(ring.outer_mm, ring.high_mm)]
    scale = ring.foot_mm / ring.outer_mm
    sides, foot = walls_below(RIM_FLANGE_SIDE, rim, ring.thickness_mm, scale)
    bands = _within(surface, ends[0], wire([low])), _within(surface, wire([high]), ends[1])
    planes = (
        (RIM_FLANGE_TOP, planar_face(wire(rim), wire([high])), UP),
        (RIM_FLANGE_BOTTOM, planar_face(foot, wire([low])), DOWN),
    )
    return [
        *((face.label, facing(band, FROM_ORIGIN, face.domain)) for band in bands),
        *((name, facing(side, AWAY)) for name, side in sides),
        *((name, facing(plane, outward)) for name, plane, outward in planes),
    ]


def untrimmed_faces(patches: dict[str, Patch], envelope: Collection[str] = (OUTER,)) -> Shapes:
    """A face (TopoDS_Face) over the whole of each patch, its normal out of the material of a lens.

    ``envelope``: names of those that bound the body outwards.
    """
    faces = {name: BRepBuilderAPI_MakeFace(geom_surface(patch), 1e-7).Face() for name, patch in patches.items()}
    return {name: facing(face, FROM_ORIGIN if name in envelope else TO_ORIGIN) for name, face in faces.items()}


def _within(surface: Any, boundary: Any, *holes: Any) -> Any:
    maker = BRepBuilderAPI_MakeFace(surface, boundary, True)
    for hole in holes:
        maker.Add(TopoDS.Wire_s(hole.Reversed()))
    return maker.Face()


def facing(face: Any, outward: str, domain: Domain | None = None) -> Any:
    """``face`` with the orientation that makes its normal point outwards, judged in the middle or in its ``domain``."""
    inside = None if domain is None else (sum(float(radius[0]) for radius in domain.radii(np.zeros(1))) / 2.0, 0.0)
    (x, y, z), normal = (point.Coord() for point in normal_at(face, inside))
    radial = normal[0] * x + normal[1] * y
    ahead = radial + normal[2] * z
    up = normal[2]
    along = {UP: up, DOWN: -up, AWAY: radial, TOWARDS: -radial, FROM_ORIGIN: ahead, TO_ORIGIN: -ahead}
    return face if along[outward] > 0.0 else TopoDS.Face_s(face.Reversed())


def assembled(faces: Named) -> Solid:
    """The solid within ``faces``, which share their edges."""
    builder = BRep_Builder()
    shell = TopoDS_Shell()
    solid = TopoDS_Solid()
    builder.MakeShell(shell)
    for _, face in faces:
        builder.Add(shell, face)
    shell.Closed(True)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return Solid(solid, uniquely_named(faces))


def uniquely_named(faces: list[tuple[str, Any]]) -> Shapes:
    """Names made unique: a number is added where several faces share one."""
    total = Counter(name for name, _ in faces)
    seen = Counter[str]()
    named = {}
    for name, face in faces:
        seen[name] += 1
        named[name if total[name] == 1 else f"{name}_{seen[name]}"] = face
    return named
