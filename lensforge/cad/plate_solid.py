"""The plate as one B-rep solid: the faces of a lens of each kind, placed for every lens, and the plate around them.

The faces of each lens are the same surfaces at other places, and their rims are the edges of the plate's top: the shell
is closed as it is made, without a boolean operation, whatever the number of lenses.
"""

from collections.abc import Sequence
from typing import Any

from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeVertex
from OCP.Geom import Geom_Circle
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
from OCP.TopoDS import TopoDS

from lensforge.cad.edges import Named, face_at, moved, normal_at, walls_below, walls_between, wire, wire_at
from lensforge.cad.outline import FULL_TURN, Arc
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan, rim_points
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
from lensforge.cad.solid import (
    DOWN,
    FROM_ORIGIN,
    TO_ORIGIN,
    TOWARDS,
    UP,
    Solid,
    assembled,
    facing,
    optical_faces,
    planar_face,
)
from lensforge.surfaces.plane_loop import Loop, LoopEdge, circle_at


def build_plate_solid(plans: Sequence[Plan[Patch]], layout: PlateLayout) -> Solid:
    """Build the closed solid; ``plans``: of a lens of each kind without a base.

    Names of repeated faces end in a number.
    """
    faces = Named()
    openings = list[Any]()
    feet = list[Any]()
    lenses = layout.of_each([_lens_with_bore(plan, layout) for plan in plans])
    for (lens, rim, foot), lamp in zip(lenses, layout.lenses.lamps, strict=True):
        location = moved(lamp.place_mm[:2], lamp.turn_deg)
        faces += [(name, face_at(face, location)) for name, face in lens]
        openings.append(wire_at(rim, location))
        feet.append(wire_at(foot, location))
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
    sides, bottom, outline = _walls(
        PLATE_SIDE, layout.outline, 0.0, layout.plate.thickness_mm, layout.foot, outwards=True
    )
    faces += sides
    faces.append((PLATE_TOP, facing(planar_face(outline, *openings), UP)))
    faces.append((PLATE_BOTTOM, facing(planar_face(bottom, *feet), DOWN)))
    return assembled(faces)


def _lens_with_bore(plan: Plan[Patch], layout: PlateLayout) -> tuple[Named, Any, Any]:
    whole = (Arc(0.0, FULL_TURN, "bare"),)
    envelope, rims = optical_faces(plan.envelope, whole, True, FROM_ORIGIN)
    cavity, (mouth,) = optical_faces(plan.cavity, whole, True, TO_ORIGIN)
    scale = layout.bore_scale(rim_points(plan.cavity))
    bore, foot = walls_below(PLATE_BORE, mouth, layout.plate.thickness_mm, scale)
    lens = [*envelope, *cavity, *((name, facing(face, TOWARDS)) for name, face in bore)]
    return lens, wire([edge for chain in rims for edge in chain]), foot


def _round(name: str, wall: RoundWall, *, outwards: bool) -> tuple[Named, Any, Any]:
    top, foot = (circle_at(wall.place, radius_mm) for radius_mm in (wall.radius_mm, wall.foot_mm))
    return _walls(name, top, wall.depth_mm, wall.length_mm, foot, outwards=outwards)


def _walls(
    name: str, loop: Loop, depth_mm: float, length_mm: float, foot: Loop | None = None, *, outwards: bool
) -> tuple[Named, Any, Any]:
    """The walls of a loop from ``depth_mm`` below z = 0, and the wires at their ``foot`` and top.

    ``foot``: the loop there, by default the same. ``outwards``: normals point out of the loop, which runs
    counter-clockwise, else into it.
    """
    edges = _loop_edges(loop, depth_mm)
    if foot in (None, loop):
        named, end = walls_below(name, edges, length_mm)
        sides = [side for _, side in named]
    else:
        end = wire(_loop_edges(foot, depth_mm + length_mm))
        sides = walls_between(edges, end)
    facing_sides = (_wall_facing(side, edge, outwards=outwards) for side, edge in zip(sides, loop, strict=True))
    return [(name, side) for side in facing_sides], end, wire(edges)


def _wall_facing(side: Any, edge: LoopEdge, *, outwards: bool) -> Any:
    """The wall below an edge, its normal to the right of the edge, or to the left."""
    (_, normal) = normal_at(side)
    (x, y) = edge.right
    return side if (normal.X() * x + normal.Y() * y > 0.0) == outwards else TopoDS.Face_s(side.Reversed())


def _loop_edges(loop: Loop, depth_mm: float) -> list[Any]:
    corners = [BRepBuilderAPI_MakeVertex(gp_Pnt(*edge.start, -depth_mm)).Vertex() for edge in loop]
    edges = []
    for edge, start, end in zip(loop, corners, [*corners[1:], corners[0]], strict=True):
        if edge.centre is None:
            edges.append(BRepBuilderAPI_MakeEdge(start, end).Edge())
        else:
            ends = (-azimuth if edge.clockwise else azimuth for azimuth in edge.azimuths)
            edges.append(BRepBuilderAPI_MakeEdge(_circle(edge, depth_mm), start, end, *ends).Edge())
    return edges


def _circle(edge: LoopEdge, depth_mm: float) -> Any:
    x, y = edge.centre or (0.0, 0.0)
    up = gp_Dir(0.0, 0.0, -1.0 if edge.clockwise else 1.0)
    return Geom_Circle(gp_Ax2(gp_Pnt(x, y, -depth_mm), up, gp_Dir(1.0, 0.0, 0.0)), edge.radius_mm)
