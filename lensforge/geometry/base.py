"""The faces of the body that light does not shape: base, bore, ledge and overhang, on the edges of the rims.

The cylinder and the bore are the rims' own edges drawn straight down, so the LED can be put in from below.
Every planar face lies in z = 0 or z = -height.
"""

from typing import Any

from lensforge.geometry.edges import wire
from lensforge.geometry.mesh import BORE, BOTTOM, RIM, SIDE, TOP
from lensforge.geometry.plan import Plan


def body_faces(plan: Plan, inner_rim: list[Any], outer_rim: list[Any], circle: list[Any]) -> list[tuple[str, Any]]:
    """Names and faces that close the two domes; ``circle`` is the cylinder's edge chain, empty without a base.

    The chains run once around, counter-clockwise; where the outer rim crosses the cylinder they share vertices.
    """
    if not plan.has_base:
        return [(RIM, _annulus(wire(outer_rim), wire(inner_rim)))]
    flush = plan.arcs[0].relation == "flush"
    side, side_wire = (_wall if flush else _cylinder)(circle, plan.base.height_mm)
    bore, bore_wire = _wall(inner_rim, plan.base.height_mm)
    faces = [(SIDE, face) for face in side] + [(BORE, face) for face in bore]
    faces.append((BOTTOM, _annulus(side_wire, bore_wire)))
    return faces + _between_rim_and_circle(plan, outer_rim, circle)


def _between_rim_and_circle(plan: Plan, outer_rim: list[Any], circle: list[Any]) -> list[tuple[str, Any]]:
    """A ledge where the rim is inside the cylinder, an overhang where it is outside: a whole ring, or crescents."""
    relation = plan.arcs[0].relation
    if relation == "flush":
        return []
    if len(plan.arcs) == 1:
        rim, top = wire(outer_rim), wire(circle)
        return [(TOP, _annulus(top, rim))] if relation == "ledge" else [(RIM, _annulus(rim, top))]
    names = [TOP if arc.relation == "ledge" else RIM for arc in plan.arcs]
    return [(name, _planar(wire([rim, edge]))) for name, rim, edge in zip(names, outer_rim, circle, strict=True)]


def _cylinder(circle: list[Any], height: float) -> tuple[list[Any], Any]:
    """The cylinder below the circle, a face for each of its edges, and the wire at its foot."""
    import cadquery as cq
    from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
    from OCP.gp import gp_Vec
    from OCP.TopoDS import TopoDS

    prism = BRepPrimAPI_MakePrism(wire(circle), gp_Vec(0.0, 0.0, -height))
    faces = [face.wrapped for face in cq.Shape.cast(prism.Shape()).Faces()]
    return faces, TopoDS.Wire_s(prism.LastShape())


def _wall(rim: list[Any], height: float) -> tuple[list[Any], Any]:
    """The ruled wall below a rim of one closed edge, and the wire at its foot.

    Ruled, not extruded: the kernel integrates a B-spline span by span, an extruded one with too few points.
    """
    from OCP.BRepBuilderAPI import BRepBuilderAPI_Transform
    from OCP.BRepFill import BRepFill
    from OCP.gp import gp_Trsf, gp_Vec
    from OCP.TopoDS import TopoDS

    (edge,) = rim
    down = gp_Trsf()
    down.SetTranslation(gp_Vec(0.0, 0.0, -height))
    foot = TopoDS.Edge_s(BRepBuilderAPI_Transform(edge, down, True).Shape())
    return [BRepFill.Face_s(edge, foot)], wire([foot])


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
