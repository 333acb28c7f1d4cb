"""The outline that a STEP file draws, as loops of lines and arcs: the work of a child process.

A file holds one planar face, the body of which one is the top, or the wires around one; in a plane of one z, whatever z
it is. Other curves than lines and arcs are refused: the plate keeps its outline exactly.
"""

import json
from collections.abc import Iterator
from itertools import pairwise
from math import dist, hypot, isfinite, pi
from pathlib import Path
from typing import Any

import numpy as np
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Surface
from OCP.BRepTools import BRepTools_WireExplorer
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.ShapeAnalysis import ShapeAnalysis_FreeBounds
from OCP.TopAbs import TopAbs_Orientation
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_HSequenceOfShape

from lensforge.errors import InputError
from lensforge.results.file_bounds import MOST_MM
from lensforge.results.files import write_json
from lensforge.results.sandbox import serve
from lensforge.surfaces import plane_loop
from lensforge.surfaces.plane_loop import Corner, area_mm2, bulge_of, inside_by_mm, loop_of, points_on, reversed_corners
from lensforge.surfaces.step_file import parts_of, products_in

_FLAT_MM = 1e-5  # the uncertainty that STEP files state
_LEVEL = 1e-7  # of a normal's components along x and y
_CHORD_MM = 1e-2  # of the chords by which loops that cross are found
_SHARE = 1e-6  # of the area within
_FEWEST = 2  # edges of a loop: a circle is read as two halves
_STRAIGHT = 1e-9  # bulge of an arc that is a line to 5e-6 mm, whatever its length
_KINDS = ("GeomAbs_Line", "GeomAbs_Circle")


def _write_loops(folder: Path) -> None:
    """Work of the child process: the loops of the STEP file in ``folder``, the outline first."""
    job = json.loads((folder / plane_loop.JOB).read_text(encoding="utf-8"))
    origin = job["origin"]
    remedy = job["remedy"]
    shapes = [product.shape for product in products_in(folder / plane_loop.DRAWING, origin, remedy)]
    bodies = [solid for shape in shapes for solid in parts_of(shape, "SOLID")]
    faces = [face for shape in shapes for face in parts_of(shape, "FACE")]
    if len(bodies) > 1:
        raise InputError(f"{origin}: holds {len(bodies)} bodies, an outline is of one; export the one alone")
    if faces:
        wires = parts_of(_top(faces, bool(bodies), origin, remedy), "WIRE")
    else:
        wires = _free_wires(shapes, origin, remedy)
    loops = [_counter_clockwise(_corners(wire, origin), origin) for wire in wires]
    if not loops:
        raise InputError(f"{origin}: its plane face has no edges that can be read; {remedy}")
    loops.sort(key=lambda corners: -area_mm2(loop_of(corners)))
    if len(loops) > plane_loop.MOST_LOOPS or max(map(len, loops)) > plane_loop.MOST_CORNERS:
        raise InputError(
            f"{origin}: {len(loops)} loops of up to {max(map(len, loops))} edges, at most {plane_loop.MOST_LOOPS} and "
            f"{plane_loop.MOST_CORNERS} are read; simplify the outline"
        )
    for corners in loops[1:]:
        outline = loop_of(loops[0])
        opening = loop_of(corners)
        for x, y in (edge.start for edge in opening):
            if inside_by_mm(outline, (x, y)) <= 0.0:
                raise InputError(
                    f"{origin}: holds several outlines, one of them at ({x:.6g}, {y:.6g}) mm; export the one alone"
                )
    if not _is_simple(loops):
        raise InputError(f"{origin}: its outline crosses itself or an opening; repair it in CAD")
    write_json(folder / plane_loop.FOUND, loops)


def _is_simple(loops: list[list[Corner]]) -> bool:
    """True if the loops do not cross: their chords then enclose the area computed from their corners."""
    import manifold3d

    chords = [points_on(loop_of(corners), _CHORD_MM) for corners in loops]
    chords = [chords[0], *(chord[::-1] for chord in chords[1:])]
    areas = [np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2.0 for x, y in (chord.T for chord in chords)]
    within = manifold3d.CrossSection(chords, manifold3d.FillRule.Positive).area()
    return bool(abs(within - sum(areas)) <= _SHARE * within)


def _top(faces: list[Any], of_body: bool, origin: str, remedy: str) -> Any:
    """The planar face at constant z; of a body, the highest. Raises :class:`InputError` for none or several."""
    level = list[tuple[float, Any]]()
    for face in faces:
        surface = BRepAdaptor_Surface(face)
        if surface.GetType() == GeomAbs_SurfaceType.GeomAbs_Plane:
            plane = surface.Plane()
            normal = plane.Axis().Direction()
            if hypot(normal.X(), normal.Y()) <= _LEVEL and isfinite(plane.Location().Z()):
                level.append((plane.Location().Z(), face))
    if not level:
        raise InputError(
            f"{origin}: none of its {len(faces)} faces is a plane of one z; draw the outline in the x-y plane, "
            f"and {remedy}"
        )
    top = max(z for z, _ in level)
    tops = [face for z, face in level if not of_body or z >= top - _FLAT_MM]
    if len(tops) > 1:
        where = f"at its top, z = {top:.6g} mm" if of_body else "of one z"
        raise InputError(f"{origin}: holds {len(tops)} plane faces {where}, an outline is one; export the one alone")
    return tops[0]


def _free_wires(shapes: list[Any], origin: str, remedy: str) -> list[Any]:
    """The wires that the edges of a file without faces make."""
    edges = TopTools_HSequenceOfShape()
    wires = TopTools_HSequenceOfShape()
    for shape in shapes:
        for edge in parts_of(shape, "EDGE"):
            edges.Append(edge)
    if edges.IsEmpty():
        raise InputError(f"{origin}: holds no face and no wire; {remedy}")
    ShapeAnalysis_FreeBounds.ConnectEdgesToWires_s(edges, _FLAT_MM, False, wires)
    return [TopoDS.Wire_s(wires.Value(k + 1)) for k in range(wires.Length())]


def _corners(wire: Any, origin: str) -> list[Corner]:
    """The corners of a wire in its order. Raises :class:`InputError` for one that is open, not level, or a spline."""
    in_order = list(_in_order(wire))
    if len(in_order) != len(parts_of(wire, "EDGE")):
        raise InputError(
            f"{origin}: its outline is not one closed loop: edges of it branch or lie apart; close it in CAD"
        )
    edges = [end for edge in in_order for end in _arcs(edge, origin)]
    if len(edges) < _FEWEST:
        raise InputError(
            f"{origin}: its outline has {len(edges)} edges of more than {_FLAT_MM:g} mm; draw a closed one"
        )
    heights = [z for start, end, _ in edges for z in (start[2], end[2])]
    if max(heights) - min(heights) > _FLAT_MM:
        raise InputError(
            f"{origin}: its outline lies between z = {min(heights):.6g} and {max(heights):.6g} mm, must have one z; "
            "draw it in the x-y plane"
        )
    for (_, end, _), (start, _, _) in zip(edges, [*edges[1:], edges[0]], strict=True):
        if dist(end, start) > _FLAT_MM:
            raise InputError(
                f"{origin}: its outline is not closed: it ends {dist(end, start):.4g} mm from its next edge, at "
                f"({end[0]:.6g}, {end[1]:.6g}) mm; close it in CAD"
            )
    return [(start[0], start[1], bulge) for start, _, bulge in edges]


def _in_order(wire: Any) -> Iterator[Any]:
    explorer = BRepTools_WireExplorer(wire)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()


_Point = tuple[float, float, float]


def _arcs(edge: Any, origin: str) -> Iterator[tuple[_Point, _Point, float]]:
    """Start, end and bulge of an edge along its wire; a whole circle in two halves."""
    curve = BRepAdaptor_Curve(edge)
    backwards = edge.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
    first = curve.FirstParameter()
    last = curve.LastParameter()
    kind = curve.GetType().name
    if kind not in _KINDS:
        x, y, _ = curve.Value(first).Coord()
        raise InputError(
            f"{origin}: its outline has a curve that is no line or arc ({kind.removeprefix('GeomAbs_')}) from "
            f"({x:.6g}, {y:.6g}) mm; draw it by lines and arcs, which stay exact"
        )
    up = 1.0 if kind == _KINDS[0] else curve.Circle().Axis().Direction().Z()
    if abs(up) < 1.0 - _LEVEL:
        raise InputError(f"{origin}: its outline has an arc that is not in a plane of one z; draw it in the x-y plane")
    if not last - first <= 2.0 * pi + _LEVEL and kind == _KINDS[1]:
        raise InputError(f"{origin}: its outline has an arc of more than a whole circle; repair it in CAD")
    parts = 2 if kind == _KINDS[1] and last - first > pi + _LEVEL else 1
    marks = [first + (last - first) * k / parts for k in range(parts + 1)]
    if backwards:
        marks.reverse()
    for start, end in pairwise(marks):
        bulge = 0.0 if kind == _KINDS[0] else bulge_of((end - start) * (1.0 if up > 0.0 else -1.0))
        places = _point(curve, start, origin), _point(curve, end, origin)
        if dist(*places) > _FLAT_MM:  # shorter ones are corners
            yield *places, (bulge if abs(bulge) > _STRAIGHT else 0.0)


def _point(curve: Any, at: float, origin: str) -> _Point:
    x, y, z = curve.Value(at).Coord()
    if not all(abs(coordinate) <= MOST_MM for coordinate in (x, y, z)):
        raise InputError(f"{origin}: its outline reaches beyond {MOST_MM:g} mm; export it in its own unit")
    return x, y, z


def _counter_clockwise(corners: list[Corner], origin: str) -> list[Corner]:
    area = area_mm2(loop_of(corners))
    if not abs(area) > _FLAT_MM**2:
        raise InputError(f"{origin}: a loop of it from ({corners[0][0]:.6g}, {corners[0][1]:.6g}) mm has no area")
    return corners if area > 0.0 else reversed_corners(corners)


if __name__ == "__main__":
    serve(_write_loops)
