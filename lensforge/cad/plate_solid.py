"""The plate as one B-rep solid: the faces of one lens, placed for every lens, and the faces of the plate around them.

The faces of each lens are the same surfaces at other places, and their rims are the edges of the plate's top: the shell
is closed as it is made, without a boolean operation, whatever the number of lenses.
"""

from typing import Any

from lensforge.cad.edges import face_at, moved, normal_at, wire, wire_at
from lensforge.cad.outline import FULL_TURN, Arc
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan
from lensforge.cad.plate_layout import PlateLayout
from lensforge.cad.solid import (
    DOWN,
    FROM_ORIGIN,
    TO_ORIGIN,
    TOWARDS,
    UP,
    Named,
    Solid,
    assembled,
    facing,
    optical_faces,
    planar_face,
    walls_below,
)
from lensforge.spec.plate_section import PlateBoss
from lensforge.surfaces.plane_loop import Loop, LoopEdge, circle_at

PLATE_TOP, PLATE_BOTTOM, PLATE_SIDE, PLATE_BORE = "PLATE_TOP", "PLATE_BOTTOM", "PLATE_SIDE", "PLATE_BORE"
PLATE_HOLE, PIN_SIDE, PIN_END, BOSS_BORE, BOSS_ROOF = "PLATE_HOLE", "PIN_SIDE", "PIN_END", "BOSS_BORE", "BOSS_ROOF"


def build_plate_solid(plan: Plan[Patch], layout: PlateLayout) -> Solid:
    """Build the closed solid; ``plan``: of one lens without a base. Names of faces that stand often end in a number."""
    whole = (Arc(0.0, FULL_TURN, "bare"),)
    envelope, rims = optical_faces(plan.envelope, whole, True, FROM_ORIGIN)
    cavity, (mouth,) = optical_faces(plan.cavity, whole, True, TO_ORIGIN)
    bore, foot = walls_below(PLATE_BORE, mouth, layout.plate.thickness_mm)
    lens = [*envelope, *cavity, *((name, facing(face, TOWARDS)) for name, face in bore)]
    rim = wire([edge for chain in rims for edge in chain])
    faces, openings, feet = Named(), list[Any](), list[Any]()
    for place, turn in zip(layout.lenses.places_mm, layout.lenses.turns_deg, strict=True):
        there = moved(place, turn)
        faces += [(name, face_at(face, there)) for name, face in lens]
        openings.append(wire_at(rim, there))
        feet.append(wire_at(foot, there))
    for opening in layout.openings:
        sides, below, edge = _walls(PLATE_HOLE, opening, 0.0, layout.plate.thickness_mm, outwards=False)
        faces += sides
        openings.append(edge)
        feet.append(below)
    for pin in layout.plate.standing:
        circle = circle_at(pin.place_mm, pin.radius_mm)
        sides, below, edge = _walls(PIN_SIDE, circle, layout.plate.thickness_mm, pin.height_mm, outwards=True)
        ends = [below]
        if isinstance(pin, PlateBoss):
            depth = layout.plate.thickness_mm + pin.height_mm - pin.bore_depth_mm
            drilled = circle_at(pin.place_mm, pin.bore_diameter_mm / 2.0)
            bored, end, roof = _walls(BOSS_BORE, drilled, depth, pin.bore_depth_mm, outwards=False)
            sides += [*bored, (BOSS_ROOF, facing(planar_face(roof), DOWN))]
            ends.append(end)
        faces += [*sides, (PIN_END, facing(planar_face(*ends), DOWN))]
        feet.append(edge)
    sides, bottom, outline = _walls(PLATE_SIDE, layout.outline, 0.0, layout.plate.thickness_mm, outwards=True)
    faces += sides
    faces.append((PLATE_TOP, facing(planar_face(outline, *openings), UP)))
    faces.append((PLATE_BOTTOM, facing(planar_face(bottom, *feet), DOWN)))
    return assembled(faces)


def _walls(name: str, loop: Loop, depth_mm: float, length_mm: float, *, outwards: bool) -> tuple[Named, Any, Any]:
    """The walls of a loop from ``depth_mm`` below z = 0 on, and the wires at its foot and top.

    ``outwards``: their normals point out of the loop, which runs counter-clockwise, else into it.
    """
    edges = _loop_edges(loop, depth_mm)
    sides, foot = walls_below(name, edges, length_mm)
    return (
        [(name, _wall_facing(side, edge, outwards)) for (_, side), edge in zip(sides, loop, strict=True)],
        foot,
        wire(edges),
    )


def _wall_facing(side: Any, edge: LoopEdge, outwards: bool) -> Any:
    """The wall below an edge, its normal to the right of the edge, or to the left."""
    from OCP.TopoDS import TopoDS

    (_, normal), (x, y) = normal_at(side), edge.right
    return side if (normal.X() * x + normal.Y() * y > 0.0) == outwards else TopoDS.Face_s(side.Reversed())


def _loop_edges(loop: Loop, depth_mm: float) -> list[Any]:
    """The edges of a loop in z = -depth, which share their vertices."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeVertex
    from OCP.gp import gp_Pnt

    corners = [BRepBuilderAPI_MakeVertex(gp_Pnt(*edge.start, -depth_mm)).Vertex() for edge in loop]
    edges = []
    for edge, start, end in zip(loop, corners, [*corners[1:], corners[0]], strict=True):
        if edge.centre is None:
            edges.append(BRepBuilderAPI_MakeEdge(start, end).Edge())
        else:
            ends = (-each if edge.clockwise else each for each in edge.azimuths)
            edges.append(BRepBuilderAPI_MakeEdge(_circle(edge, depth_mm), start, end, *ends).Edge())
    return edges


def _circle(edge: LoopEdge, depth_mm: float) -> Any:
    from OCP.Geom import Geom_Circle
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    x, y = edge.centre or (0.0, 0.0)
    up = gp_Dir(0.0, 0.0, -1.0 if edge.clockwise else 1.0)
    return Geom_Circle(gp_Ax2(gp_Pnt(x, y, -depth_mm), up, gp_Dir(1.0, 0.0, 0.0)), edge.radius_mm)
