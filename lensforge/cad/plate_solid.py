"""The plate as one B-rep solid: the faces of one lens, placed for every lens, and the faces of the plate around them.

The faces of each lens are the same surfaces at other places, and their rims are the edges of the plate's top: the shell
is closed as it is made, without a boolean operation, whatever the number of lenses.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.cad.edges import face_at, moved, wire, wire_at
from lensforge.cad.outline import FULL_TURN, Arc
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan
from lensforge.cad.plate_layout import Loop, LoopEdge, PlateLayout, circle_at
from lensforge.cad.solid import (
    AWAY,
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

PLATE_TOP, PLATE_BOTTOM, PLATE_SIDE, PLATE_BORE = "PLATE_TOP", "PLATE_BOTTOM", "PLATE_SIDE", "PLATE_BORE"
PLATE_HOLE, PIN_SIDE, PIN_END, BOSS_BORE, BOSS_ROOF = "PLATE_HOLE", "PIN_SIDE", "PIN_END", "BOSS_BORE", "BOSS_ROOF"


def build_plate_solid(plan: Plan[Patch], layout: PlateLayout) -> Solid:
    """Build the closed solid; ``plan``: of one lens without a base. Names of faces that stand often end in a number."""
    whole = (Arc(0.0, FULL_TURN, "bare"),)
    envelope, rims = optical_faces(plan.envelope, whole, True, FROM_ORIGIN)
    cavity, (mouth,) = optical_faces(plan.cavity, whole, True, TO_ORIGIN)
    bore, foot = walls_below(PLATE_BORE, mouth, layout.plate.thickness_mm)
    lens = [*envelope, *cavity, *_all_facing(bore, TOWARDS)]
    rim = wire([edge for chain in rims for edge in chain])
    faces, openings, feet = Named(), list[Any](), list[Any]()
    for place, turn in zip(layout.lenses.places_mm, layout.lenses.turns_deg, strict=True):
        there = moved(place, turn)
        faces += [(name, face_at(face, there)) for name, face in lens]
        openings.append(wire_at(rim, there))
        feet.append(wire_at(foot, there))
    for hole in layout.plate.holes:
        sides, below, edge = _round_walls(PLATE_HOLE, hole.radius_mm, 0.0, layout.plate.thickness_mm, TOWARDS)
        there = moved(hole.place_mm)
        faces += [(name, face_at(face, there)) for name, face in sides]
        openings.append(wire_at(edge, there))
        feet.append(wire_at(below, there))
    for pin in layout.plate.standing:
        sides, below, edge = _round_walls(PIN_SIDE, pin.radius_mm, layout.plate.thickness_mm, pin.height_mm, AWAY)
        there, ends = moved(pin.place_mm), [below]
        if isinstance(pin, PlateBoss):
            depth = layout.plate.thickness_mm + pin.height_mm - pin.bore_depth_mm
            bored, mouth, roof = _round_walls(BOSS_BORE, pin.bore_diameter_mm / 2.0, depth, pin.bore_depth_mm, TOWARDS)
            sides += [*bored, (BOSS_ROOF, facing(planar_face(roof), DOWN))]
            ends.append(mouth)
        faces += [(name, face_at(face, there)) for name, face in [*sides, (PIN_END, facing(planar_face(*ends), DOWN))]]
        feet.append(wire_at(edge, there))
    outline = _loop_edges(layout.outline, 0.0)
    sides, bottom = walls_below(PLATE_SIDE, outline, layout.plate.thickness_mm)
    faces += _all_facing(sides, AWAY)
    faces.append((PLATE_TOP, facing(planar_face(wire(outline), *openings), UP)))
    faces.append((PLATE_BOTTOM, facing(planar_face(bottom, *feet), DOWN)))
    return assembled(faces)


def poles_of(face: Any) -> Float[np.ndarray, "n n 3"] | None:
    """Poles (mm) of the spline on which a face lies, at its place; None where it lies on no spline."""
    from OCP.BRep import BRep_Tool
    from OCP.Geom import Geom_BSplineSurface

    surface = BRep_Tool.Surface_s(face.wrapped)
    if not isinstance(surface, Geom_BSplineSurface):
        return None
    poles = surface.Poles()
    rows, columns = range(1, surface.NbUPoles() + 1), range(1, surface.NbVPoles() + 1)
    found = [[(pole.X(), pole.Y(), pole.Z()) for pole in (poles.Value(i, j) for j in columns)] for i in rows]
    return np.array(found, dtype=np.float64)


def _all_facing(faces: Named, outward: str) -> Named:
    return [(name, facing(face, outward)) for name, face in faces]


def _round_walls(
    name: str, radius_mm: float, depth_mm: float, length_mm: float, outward: str
) -> tuple[Named, Any, Any]:
    """The wall of a circle about the axis from ``depth_mm`` below z = 0 on, and the wires at its foot and top."""
    edges = _loop_edges(circle_at((0.0, 0.0), radius_mm), depth_mm)
    faces, foot = walls_below(name, edges, length_mm)
    return _all_facing(faces, outward), foot, wire(edges)


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
            edges.append(BRepBuilderAPI_MakeEdge(_circle(edge, depth_mm), start, end, *edge.azimuths).Edge())
    return edges


def _circle(edge: LoopEdge, depth_mm: float) -> Any:
    from OCP.Geom import Geom_Circle
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt

    x, y = edge.centre or (0.0, 0.0)
    return Geom_Circle(gp_Ax2(gp_Pnt(x, y, -depth_mm), gp_Dir(0.0, 0.0, 1.0)), edge.radius_mm)
