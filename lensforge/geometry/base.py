"""The non-optical faces of the body: rim, base, step, flange, pocket and bore, built on the edges of the rims.

The bore is the cavity's rim extruded straight down, or a circle around it, so the LED can be inserted from below; a
step without setback is the outer rim extruded likewise. Every planar face is horizontal, or a flat side of the base.
Rims are chains of edges, and the walls below them have a face for each edge.
"""

from typing import Any

from lensforge.geometry.base_profile import (
    BORE,
    BORE_TOP,
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
from lensforge.geometry.edges import outline_edges, wire
from lensforge.geometry.outline import Outline
from lensforge.geometry.patch import Patch
from lensforge.geometry.plan import Plan

FLAT = "CLOCKING_FLAT"

Named = list[tuple[str, Any]]
Chain = list[Any]  # of edges


def body_faces(plan: Plan[Patch], inner_rim: Chain, outer_rim: list[Chain]) -> Named:
    """Names and faces that close the body between the two domes.

    ``outer_rim``: a chain for each arc of the plan. Chains run counter-clockwise; where the outer rim crosses the
    outline they share vertices.
    """
    whole_rim = [edge for chain in outer_rim for edge in chain]
    if not plan.has_base:
        return [(RIM, _annulus(wire(whole_rim), wire(inner_rim)))]
    bore, bore_foot = _bore(plan, inner_rim)
    faces, foot = _outside(plan, outer_rim, whole_rim)
    pocket, opening = _pocket(plan, bore_foot)
    return [*bore, *faces, *pocket, (BOTTOM, _annulus(foot, opening))]


def _bore(plan: Plan[Patch], inner_rim: Chain) -> tuple[Named, Any]:
    """The wall of the bore, with the ring above it where it is set back, and the wire at its foot."""
    if plan.bore is None:
        return _walls(BORE, inner_rim, plan.bore_mm)
    mouth = _circle(plan.bore, 0.0)
    walls, foot = _walls(BORE, mouth, plan.bore_mm)
    return [(BORE_TOP, _annulus(wire(mouth), wire(inner_rim))), *walls], foot


def _outside(plan: Plan[Patch], outer_rim: list[Chain], whole_rim: Chain) -> tuple[Named, Any]:
    """Faces between the outer rim and the bottom, and the wire at the bottom."""
    if plan.flush:
        faces, foot = _walls(SIDE, whole_rim, plan.shoulder_mm)
    else:
        faces, seat = [], outer_rim
        if plan.ring is not None:
            ring = _circle(plan.ring, 0.0)
            walls, seat_wire = _walls(RELIEF, ring, plan.relief_mm)
            faces, seat = [(RIM, _annulus(wire(whole_rim), wire(ring))), *walls], [_edges(seat_wire)]
        elif plan.relief_mm > 0.0:
            faces, seat_wire = _walls(RELIEF, whole_rim, plan.relief_mm)
            seat = [_edges(seat_wire)]
        outline = outline_edges(plan.outline, plan.relief_mm, outer_rim, plan.arcs)
        side_faces, foot = _prism(outline, plan.shoulder_mm - plan.relief_mm)
        faces += [(_side_name(plan, edge), face) for edge, face in zip(outline, side_faces, strict=True)]
        faces += _between_rim_and_outline(plan, seat, outline)
    if plan.flange is None:
        return faces, foot
    flange = _circle(plan.flange, plan.shoulder_mm)
    sides, flange_foot = _walls(FLANGE_SIDE, flange, plan.base.flange_height_mm)
    return [*faces, (FLANGE_TOP, _annulus(wire(flange), foot)), *sides], flange_foot


def _pocket(plan: Plan[Patch], bore_foot: Any) -> tuple[Named, Any]:
    """The faces of the pocket in the bottom, and the wire of the opening in the bottom."""
    if plan.pocket is None:
        return [], bore_foot
    mouth = _circle(plan.pocket, plan.base.height_mm)
    sides, top = _walls(POCKET_SIDE, mouth, -plan.base.pocket_depth_mm)
    return [*sides, (POCKET_TOP, _annulus(top, bore_foot))], wire(mouth)


def _circle(outline: Outline, depth_mm: float) -> Chain:
    return outline_edges(outline, depth_mm, [], ())


def _side_name(plan: Plan[Patch], edge: Any) -> str:
    from OCP.BRepAdaptor import BRepAdaptor_Curve
    from OCP.GeomAbs import GeomAbs_CurveType

    straight = BRepAdaptor_Curve(edge).GetType() == GeomAbs_CurveType.GeomAbs_Line
    return FLAT if straight and plan.base.flat_mm is not None else SIDE


def _between_rim_and_outline(plan: Plan[Patch], rim: list[Chain], outline: Chain) -> Named:
    """Ledges where the rim is inside the outline, overhangs where it is outside: one whole ring, or crescents."""
    relation = plan.arcs[0].relation
    if len(plan.arcs) == 1:
        inside, around = wire(rim[0]), wire(outline)
        return [(TOP, _annulus(around, inside))] if relation == "ledge" else [(RIM, _annulus(inside, around))]
    faces = []
    for arc, chain in zip(plan.arcs, rim, strict=True):
        name = TOP if arc.relation == "ledge" else RIM
        faces.append((name, _planar(wire([*chain, *_chain_between(chain, outline)]))))
    return faces


def _chain_between(rim: Chain, outline: Chain) -> Chain:
    """The edges of ``outline`` from the first vertex of ``rim`` to its last."""
    from OCP.TopExp import TopExp

    start, end = TopExp.FirstVertex_s(rim[0]), TopExp.LastVertex_s(rim[-1])
    first = next(k for k, side in enumerate(outline) if TopExp.FirstVertex_s(side).IsSame(start))
    chain = []
    for side in outline[first:] + outline[:first]:
        chain.append(side)
        if TopExp.LastVertex_s(side).IsSame(end):
            break
    return chain


def _walls(name: str, edges: Chain, depth_mm: float) -> tuple[Named, Any]:
    """Walls of one name below ``edges``, and the wire at their foot."""
    faces, foot = _prism(edges, depth_mm)
    return [(name, face) for face in faces], foot


def _prism(edges: Chain, depth_mm: float) -> tuple[list[Any], Any]:
    """Walls extruded down by ``depth_mm`` (up where it is negative), one for each edge, and the wire at their foot."""
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec
    from OCP.TopoDS import TopoDS

    prism = BRepPrimAPI_MakePrism(wire(edges), gp_Vec(0.0, 0.0, -depth_mm))
    faces = [TopoDS.Face_s(prism.Generated(edge).First()) for edge in edges]
    return faces, TopoDS.Wire_s(prism.LastShape())


def _edges(boundary: Any) -> Chain:
    import cadquery as cq

    return [edge.wrapped for edge in cq.Shape.cast(boundary).Edges()]


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
