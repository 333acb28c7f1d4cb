"""The non-optical faces of the body: rim, base, step, flange, pocket and bore, built on the edges of the rims.

The bore is the cavity's rim extruded straight down, so the LED can be inserted from below; a step without setback is
the outer rim extruded likewise. Every planar face is horizontal, or a flat side of the base.
"""

from typing import Any

from lensforge.geometry.edges import outline_edges, wire
from lensforge.geometry.mesh import (
    BORE,
    BOTTOM,
    FLANGE_SIDE,
    FLANGE_TOP,
    POCKET_SIDE,
    POCKET_TOP,
    RELIEF,
    RIM,
    SIDE,
    TOP,
)
from lensforge.geometry.outline import Outline
from lensforge.geometry.plan import Plan

FLAT = "CLOCKING_FLAT"

Named = list[tuple[str, Any]]


def body_faces(plan: Plan, inner_rim: list[Any], outer_rim: list[Any]) -> Named:
    """Names and faces that close the body between the two domes.

    The edge chains run once around, counter-clockwise; where the outer rim crosses the outline they share vertices.
    """
    if not plan.has_base:
        return [(RIM, _annulus(wire(outer_rim), wire(inner_rim)))]
    bore, bore_foot = _wall(inner_rim, plan.bore_mm)
    faces, foot = _outside(plan, outer_rim)
    pocket, opening = _pocket(plan, bore_foot)
    return [(BORE, bore), *faces, *pocket, (BOTTOM, _annulus(foot, opening))]


def _outside(plan: Plan, outer_rim: list[Any]) -> tuple[Named, Any]:
    """Faces between the outer rim and the bottom, and the wire at the bottom."""
    if plan.flush:
        side, foot = _wall(outer_rim, plan.shoulder_mm)
        faces = [(SIDE, side)]
    else:
        faces, seat = [], outer_rim
        if plan.ring is not None:
            ring = _circle(plan.ring, 0.0)
            walls, seat_wire = _prism(ring, plan.relief_mm)
            faces, seat = [(RIM, _annulus(wire(outer_rim), wire(ring))), (RELIEF, walls[0])], _edges(seat_wire)
        elif plan.relief_mm > 0.0:
            wall, seat_wire = _wall(outer_rim, plan.relief_mm)
            faces, seat = [(RELIEF, wall)], _edges(seat_wire)
        outline = outline_edges(plan.outline, plan.relief_mm, outer_rim, plan.arcs)
        side_faces, foot = _prism(outline, plan.shoulder_mm - plan.relief_mm)
        faces += [(_side_name(plan, edge), face) for edge, face in zip(outline, side_faces, strict=True)]
        faces += _between_rim_and_outline(plan, seat, outline)
    if plan.flange is None:
        return faces, foot
    flange = _circle(plan.flange, plan.shoulder_mm)
    sides, flange_foot = _prism(flange, plan.base.flange_height_mm)
    return [*faces, (FLANGE_TOP, _annulus(wire(flange), foot)), (FLANGE_SIDE, sides[0])], flange_foot


def _pocket(plan: Plan, bore_foot: Any) -> tuple[Named, Any]:
    """The faces of the pocket in the bottom, and the wire of the opening in the bottom."""
    if plan.pocket is None:
        return [], bore_foot
    mouth = _circle(plan.pocket, plan.base.height_mm)
    sides, top = _prism(mouth, -plan.base.pocket_depth_mm)
    return [(POCKET_SIDE, sides[0]), (POCKET_TOP, _annulus(top, bore_foot))], wire(mouth)


def _circle(outline: Outline, depth_mm: float) -> list[Any]:
    return outline_edges(outline, depth_mm, [], ())


def _side_name(plan: Plan, edge: Any) -> str:
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GeomAbs import GeomAbs_CurveType

    straight = BRepAdaptor_Curve(edge).GetType() == GeomAbs_CurveType.GeomAbs_Line
    return FLAT if straight and plan.base.flat_mm is not None else SIDE


def _between_rim_and_outline(plan: Plan, rim: list[Any], outline: list[Any]) -> Named:
    """Ledges where the rim is inside the outline, overhangs where it is outside: one whole ring, or crescents."""
    relation = plan.arcs[0].relation
    if len(plan.arcs) == 1:
        inside, around = wire(rim), wire(outline)
        return [(TOP, _annulus(around, inside))] if relation == "ledge" else [(RIM, _annulus(inside, around))]
    faces = []
    for arc, edge in zip(plan.arcs, rim, strict=True):
        name = TOP if arc.relation == "ledge" else RIM
        faces.append((name, _planar(wire([edge, *_chain_between(edge, outline)]))))
    return faces


def _chain_between(edge: Any, outline: list[Any]) -> list[Any]:
    """The edges of ``outline`` from the first vertex of ``edge`` to its last."""
    from OCP.TopExp import TopExp

    first = next(k for k, side in enumerate(outline) if TopExp.FirstVertex_s(side).IsSame(TopExp.FirstVertex_s(edge)))
    chain = []
    for side in outline[first:] + outline[:first]:
        chain.append(side)
        if TopExp.LastVertex_s(side).IsSame(TopExp.LastVertex_s(edge)):
            break
    return chain


def _prism(edges: list[Any], depth_mm: float) -> tuple[list[Any], Any]:
    """Walls extruded down by ``depth_mm`` (up where it is negative), one for each edge, and the wire at their foot."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec
    from OCP.TopoDS import TopoDS

    prism = BRepPrimAPI_MakePrism(wire(edges), gp_Vec(0.0, 0.0, -depth_mm))
    faces = [TopoDS.Face_s(prism.Generated(edge).First()) for edge in edges]
    return faces, TopoDS.Wire_s(prism.LastShape())


def _edges(boundary: Any) -> list[Any]:
    import cadquery as cq

    return [edge.wrapped for edge in cq.Shape.cast(boundary).Edges()]


def _wall(rim: list[Any], height: float) -> tuple[Any, Any]:
    """The ruled wall below a rim of one closed edge, and the wire at its foot.

    Ruled, not extruded: the CAD kernel integrates a B-spline span by span, but an extruded one with too few points.
    """
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.BRepFill import BRepFill
    from OCP.gp import gp_Trsf, gp_Vec
    from OCP.TopoDS import TopoDS

    (edge,) = rim
    down = gp_Trsf()
    down.SetTranslation(gp_Vec(0.0, 0.0, -height))
    foot = TopoDS.Edge_s(BRepBuilderAPI_Transform(edge, down, True).Shape())
    return BRepFill.Face_s(edge, foot), wire([foot])


def _annulus(outside: Any, hole: Any) -> Any:
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
    from OCP.TopoDS import TopoDS

    maker = BRepBuilderAPI_MakeFace(_plane_of(outside), outside, True)
    maker.Add(TopoDS.Wire_s(hole.Reversed()))
    return maker.Face()


def _planar(boundary: Any) -> Any:
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    return BRepBuilderAPI_MakeFace(_plane_of(boundary), boundary, True).Face()


def _plane_of(boundary: Any) -> Any:
    """The horizontal plane through a horizontal wire, its normal up."""
    import cadquery as cq
    from OCP.gp import gp_Dir, gp_Pln, gp_Pnt

    height = cq.Shape.cast(boundary).Vertices()[0].Z
    return gp_Pln(gp_Pnt(0.0, 0.0, height), gp_Dir(0.0, 0.0, 1.0))
