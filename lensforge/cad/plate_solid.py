"""The plate as one B-rep solid: the faces of one lens, placed for every lens, and the faces of the plate around them.

The faces of each lens are the same surfaces at other places, and their rims are the edges of the plate's top: the shell
is closed as it is made, without a boolean operation, whatever the number of lenses.
"""

from typing import Any

from lensforge.cad.edges import face_at, moved, normal_at, wire, wire_at
from lensforge.cad.outline import FULL_TURN, Arc
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan, rim_points
from lensforge.cad.plate_layout import PlateLayout, RoundWall
from lensforge.cad.solid import (
    DOWN,
    FROM_ORIGIN,
    TO_ORIGIN,
    TOWARDS,
    UP,
    Chain,
    Named,
    Solid,
    assembled,
    facing,
    optical_faces,
    planar_face,
    walls_below,
)
from lensforge.surfaces.plane_loop import Loop, LoopEdge, circle_at
from lensforge.surfaces.step_file import parts_of

PLATE_TOP, PLATE_BOTTOM, PLATE_SIDE, PLATE_BORE = "PLATE_TOP", "PLATE_BOTTOM", "PLATE_SIDE", "PLATE_BORE"
PLATE_HOLE, PIN_SIDE, PIN_END, BOSS_BORE, BOSS_ROOF = "PLATE_HOLE", "PIN_SIDE", "PIN_END", "BOSS_BORE", "BOSS_ROOF"


def build_plate_solid(plan: Plan[Patch], layout: PlateLayout) -> Solid:
    """Build the closed solid; ``plan``: of one lens without a base. Names of faces that stand often end in a number."""
    whole = (Arc(0.0, FULL_TURN, "bare"),)
    envelope, rims = optical_faces(plan.envelope, whole, True, FROM_ORIGIN)
    cavity, (mouth,) = optical_faces(plan.cavity, whole, True, TO_ORIGIN)
    bore, foot = _bore_below(mouth, layout.plate.thickness_mm, layout.bore_scale(rim_points(plan.cavity)))
    lens = [*envelope, *cavity, *((name, facing(face, TOWARDS)) for name, face in bore)]
    rim = wire([edge for chain in rims for edge in chain])
    faces, openings, feet = Named(), list[Any](), list[Any]()
    for place, turn in zip(layout.lenses.places_mm, layout.lenses.turns_deg, strict=True):
        there = moved(place, turn)
        faces += [(name, face_at(face, there)) for name, face in lens]
        openings.append(wire_at(rim, there))
        feet.append(wire_at(foot, there))
    holes = [_round(PLATE_HOLE, hole, outwards=False) for hole in layout.holes]
    slots = [_walls(PLATE_HOLE, slot, 0.0, layout.plate.thickness_mm, outwards=False) for slot in layout.slots]
    for sides, below, edge in (*holes, *slots):
        faces += sides
        openings.append(edge)
        feet.append(below)
    for pin, drilled in layout.standing:
        sides, below, edge = _round(PIN_SIDE, pin, outwards=True)
        ends = [below]
        if drilled is not None:
            bored, end, roof = _round(BOSS_BORE, drilled, outwards=False)
            sides += [*bored, (BOSS_ROOF, facing(planar_face(roof), DOWN))]
            ends.append(end)
        faces += [*sides, (PIN_END, facing(planar_face(*ends), DOWN))]
        feet.append(edge)
    sides, bottom, outline = _walls(PLATE_SIDE, layout.outline, 0.0, layout.plate.thickness_mm, outwards=True)
    faces += sides
    faces.append((PLATE_TOP, facing(planar_face(outline, *openings), UP)))
    faces.append((PLATE_BOTTOM, facing(planar_face(bottom, *feet), DOWN)))
    return assembled(faces)


def _bore_below(mouth: Chain, length_mm: float, scale: float) -> tuple[Named, Any]:
    """The walls of a bore from the rim of a cavity down, and the wire at their foot, ``scale`` times as wide."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.BRepFill import BRepFill
    from OCP.gp import gp_Pnt, gp_Trsf
    from OCP.TopoDS import TopoDS

    if scale == 1.0:
        return walls_below(PLATE_BORE, mouth, length_mm)
    about_apex, rim = gp_Trsf(), wire(mouth)
    about_apex.SetScale(gp_Pnt(0.0, 0.0, length_mm / (scale - 1.0)), scale)
    foot = TopoDS.Wire_s(BRepBuilderAPI_Transform(rim, about_apex, True).Shape())
    return [(PLATE_BORE, face) for face in parts_of(BRepFill.Shell_s(rim, foot), "FACE")], foot


def _round(name: str, wall: RoundWall, *, outwards: bool) -> tuple[Named, Any, Any]:
    """The face of a round wall, and the wires at its foot and top."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeCone
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    circle = circle_at(wall.place, wall.radius_mm)
    if wall.foot_mm == wall.radius_mm:
        return _walls(name, circle, wall.depth_mm, wall.length_mm, outwards=outwards)
    axes = gp_Ax2(gp_Pnt(*wall.place, -wall.depth_mm - wall.length_mm), gp_Dir(0.0, 0.0, 1.0))
    side = BRepPrimAPI_MakeCone(axes, wall.foot_mm, wall.radius_mm, wall.length_mm).Face()
    foot, top = sorted(_circles_of(side), key=_height_mm)
    return [(name, _wall_facing(side, circle[0], outwards))], wire([foot]), wire([top])


def _circles_of(side: Any) -> Chain:
    """The two closed edges of a face of revolution, without its seam, both counter-clockwise."""
    from OCP.TopAbs import TopAbs_Orientation
    from OCP.TopExp import TopExp
    from OCP.TopoDS import TopoDS

    edges = [TopoDS.Edge_s(edge.Oriented(TopAbs_Orientation.TopAbs_FORWARD)) for edge in parts_of(side, "EDGE")]
    return [edge for edge in edges if TopExp.FirstVertex_s(edge).IsSame(TopExp.LastVertex_s(edge))]


def _height_mm(edge: Any) -> float:
    from OCP.BRep import BRep_Tool
    from OCP.TopExp import TopExp

    return float(BRep_Tool.Pnt_s(TopExp.FirstVertex_s(edge)).Z())


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
