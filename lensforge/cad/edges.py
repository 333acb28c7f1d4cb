"""The rims, creases and outlines of the body as B-rep edges, shared between the faces that meet in them.

A rim edge has two curves with the same parameter, the azimuth: a spline in space, and an exact arc of the unit
circle in the parameter plane of its optical face. An edge of a crease has a spline in the plane of each of its faces.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from math import radians
from typing import Any

import numpy as np
from jaxtyping import Float
from OCP.BRep import BRep_Builder, BRep_Tool
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeEdge,
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakeVertex,
    BRepBuilderAPI_MakeWire,
    BRepBuilderAPI_Transform,
)
from OCP.BRepFill import BRepFill_Generator
from OCP.BRepGProp import BRepGProp_Face
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
from OCP.BRepTools import BRepTools
from OCP.Geom import Geom_BSplineCurve, Geom_BSplineSurface, Geom_Circle, Geom_Line
from OCP.Geom2d import Geom2d_BSplineCurve, Geom2d_Circle
from OCP.gp import gp_Ax1, gp_Ax2, gp_Ax2d, gp_Dir, gp_Dir2d, gp_Pnt, gp_Pnt2d, gp_Trsf, gp_Vec
from OCP.TColgp import TColgp_Array1OfPnt, TColgp_Array1OfPnt2d, TColgp_Array2OfPnt
from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal
from OCP.TopExp import TopExp
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS, TopoDS_Compound, TopoDS_Vertex
from scipy.interpolate import BSpline, make_interp_spline

from lensforge.cad.boundary import Crease
from lensforge.cad.outline import FULL_TURN, Arc, Outline, Piece
from lensforge.cad.patch import DEGREE, Patch
from lensforge.cad.plan import Plan, rim_directions
from lensforge.surfaces.step_file import parts_of

# The rim curve lies in z = 0; the patch's own boundary is within its form error of it.
_MIN_TOLERANCE_MM = 1e-6
_GAP_MARGIN = 2.0
_NEWTON_STEPS = 3  # from tens of nanometres
_DECIMALS = 10  # of the poles of an edge, in mm or of the chart; with 8 the volume of one file changed by 1e-8
_RIM_NODES_PER_NODE = 2.5  # along the whole rim, for each node across the patch: 0.8 times as dense
# Spans of one rim edge. CAD programs integrate over the wall below an edge by one Gauss formula of at most 61 points,
# however many spans it has: of a plate of 36 lenses the volume is 3e-6 wrong with 32 spans an edge, 4e-8 with 24.
_SPANS_PER_EDGE = 24


Named = list[tuple[str, Any]]  # faces; the CAD kernel has no types
Chain = list[Any]  # of edges
_Ends = tuple[float, float]  # azimuths (rad)


def geom_surface(patch: Patch) -> Any:
    """``Geom_BSplineSurface`` of a patch: the same control points, knots and parameters."""
    poles = TColgp_Array2OfPnt(1, len(patch.control), 1, len(patch.control))
    for row, points in enumerate(patch.control.tolist(), start=1):
        for column, (x, y, z) in enumerate(points, start=1):
            poles.SetValue(row, column, gp_Pnt(x, y, z))
    knots, multiplicities = _knots(patch.knots)
    return Geom_BSplineSurface(poles, knots, knots, multiplicities, multiplicities, DEGREE, DEGREE)


def rim_edges(patch: Patch, face_surface: Any, arcs: tuple[Arc, ...], *, split: bool) -> list[list[Any]]:
    """Chains of edges, one chain for each arc of the patch's rim, together closed: where it crosses z = 0.

    ``split``: split long arcs so that each edge has few spans; arcs between crossings may be too shallow for that.
    """
    chains = [_split(arc, patch.nodes) if split else [(arc.start, arc.end)] for arc in arcs]
    return _edges_on(chains, lambda azimuths: _at_rim(patch, azimuths), (patch,), (face_surface,))


def crease_edges(crease: Crease, patches: tuple[Patch, Patch], surfaces: tuple[Any, Any]) -> list[Any]:
    """The closed chain of edges of ``crease``, exact to rounding on both fitted faces."""
    chain = _split(Arc(0.0, FULL_TURN, "bare"), max(patch.nodes for patch in patches))
    return _edges_on([chain], lambda azimuths: _on_both(patches, crease.chart(azimuths)), patches, surfaces)[0]


def _edges_on(
    chains: list[list[_Ends]],
    places: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n d"]],
    patches: tuple[Patch, ...],
    surfaces: tuple[Any, ...],
) -> list[list[Any]]:
    """Edges over the azimuths of ``chains``; ``places``: chart points of each of the ``patches``, and points (mm)."""
    nodes = max(patch.nodes for patch in patches)
    of_space = 2 * len(patches)
    gap = 0.0
    curves: list[list[tuple[BSpline, tuple[Any, ...]]]] = []
    for chain in chains:
        curves.append([])
        for ends in chain:
            along = _spline_along(places, ends, nodes)
            planes = [_columns(along, 2 * k, 2) for k in range(len(patches))]
            space = _columns(along, of_space, 3)
            between = np.linspace(*ends, 4 * len(space.c))
            for patch, plane in zip(patches, planes, strict=True):
                gap = max(gap, float(np.linalg.norm(patch.points(plane(between)) - space(between), axis=1).max()))
            curves[-1].append((space, tuple(map(curve_of, planes))))
    return _chains(chains, curves, lambda azimuths: places(azimuths)[:, of_space:], gap, surfaces)


def _at_rim(patch: Patch, azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 5"]:
    """Chart points where a patch crosses z = 0, beside the unit circle by its form error, and points (mm) there."""
    outwards = rim_directions(azimuths)[:, :2]
    radius = np.ones(len(azimuths))
    for _ in range(_NEWTON_STEPS):
        point, by_x, by_y = patch.tangents(radius[:, None] * outwards)
        radius = radius - point[:, 2] / (by_x[:, 2] * outwards[:, 0] + by_y[:, 2] * outwards[:, 1])
    place = radius[:, None] * outwards
    points = patch.points(place)
    points[:, 2] = 0.0  # to rounding
    return np.concatenate([place, points], axis=1)


def _on_both(patches: tuple[Patch, Patch], chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 7"]:
    """Chart points of two patches where they meet, near ``chart`` points, and points (mm) there."""
    radius = np.linalg.norm(chart, axis=1)
    chart_behind = chart.copy()
    outwards = chart / radius[:, None]
    for _ in range(_NEWTON_STEPS):
        point, by_x, by_y = patches[0].tangents(radius[:, None] * outwards)
        point_behind, *across = patches[1].tangents(chart_behind)
        slopes = np.stack([by_x * outwards[:, :1] + by_y * outwards[:, 1:], -across[0], -across[1]], axis=-1)
        step = np.linalg.solve(slopes, (point_behind - point)[..., None])[..., 0]
        radius = radius + step[:, 0]
        chart_behind = chart_behind + step[:, 1:]
    place = radius[:, None] * outwards
    return np.concatenate([place, chart_behind, patches[0].points(place)], axis=1)


def _columns(spline: BSpline, first: int, count: int) -> BSpline:
    return BSpline(spline.t, spline.c[:, first : first + count], spline.k)


def circle_edge(radius_mm: float, height_mm: float, on: tuple[Patch, Any] | None = None) -> Any:
    """A circle about the axis as an edge, also ``on`` a patch and its surface that hold it."""
    made = BRepBuilderAPI_MakeEdge(_piece_curve(Piece(0.0, FULL_TURN, radius_mm), -height_mm)).Edge()
    if on is not None:
        (patch, surface) = on
        chart = float(np.tan(0.5 * np.arctan2(radius_mm, height_mm)))
        around = rim_directions(np.linspace(0.0, FULL_TURN, int(4 * _RIM_NODES_PER_NODE * patch.nodes)))
        gap = float(
            np.linalg.norm(patch.points(chart * around[:, :2]) - (radius_mm * around + (0, 0, height_mm)), axis=1).max()
        )
        chart_circle = Geom2d_Circle(gp_Ax2d(gp_Pnt2d(0.0, 0.0), gp_Dir2d(1.0, 0.0)), chart)
        BRep_Builder().UpdateEdge(made, chart_circle, surface, TopLoc_Location(), _tolerance_mm(gap))
    return made


def _tolerance_mm(gap: float) -> float:
    return max(_MIN_TOLERANCE_MM, _GAP_MARGIN * gap)


def _chains(
    chains: list[list[_Ends]],
    curves: list[list[tuple[BSpline, tuple[Any, ...]]]],
    points: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n 3"]],
    gap: float,
    surfaces: tuple[Any, ...],
) -> list[list[Any]]:
    """Edges over the azimuths of ``chains``, together closed, each with a curve in space and in its surfaces' planes.

    ``gap``: the largest distance (mm) between the curves in space and those on the surfaces.
    """
    tolerance = _tolerance_mm(gap)
    starts = [start for chain in chains for start, _ in chain]
    vertices = dict(zip(starts, _corners(points(np.array(starts)), tolerance), strict=True))
    following = dict(zip(starts, [*starts[1:], starts[0]], strict=True))

    def edge(ends: _Ends, space: BSpline, planes: tuple[Any, ...]) -> Any:
        start, end = ends
        made = BRepBuilderAPI_MakeEdge(curve_of(space), vertices[start], vertices[following[start]], start, end).Edge()
        for plane, surface in zip(planes, surfaces, strict=True):
            BRep_Builder().UpdateEdge(made, plane, surface, TopLoc_Location(), tolerance)
        return made

    return [
        [edge(ends, *pair) for ends, pair in zip(chain, along, strict=True)]
        for chain, along in zip(chains, curves, strict=True)
    ]


def _split(arc: Arc, nodes: int) -> list[_Ends]:
    """Azimuths (rad) at the ends of an arc's edges, all equally long."""
    spans = _RIM_NODES_PER_NODE * nodes * (arc.end - arc.start) / FULL_TURN
    ends = np.linspace(arc.start, arc.end, 1 + int(np.ceil(spans / _SPANS_PER_EDGE))).tolist()
    return list(pairwise(ends))


def outline_edges(outline: Outline, depth_mm: float, rims: list[list[Any]], arcs: tuple[Arc, ...]) -> list[Any]:
    """The edges of ``outline`` in z = -depth, one for each piece, split at crossings.

    Where the rim crosses the outline (more than one arc) they share the vertices at which the chains of ``rims`` begin.
    """
    crossings = [arc.start for arc in arcs] if len(arcs) > 1 else []
    vertices = {start: TopExp.FirstVertex_s(rim[0]) for start, rim in zip(crossings, rims, strict=False)}
    if not crossings and len(outline.pieces) == 1:
        return [BRepBuilderAPI_MakeEdge(_piece_curve(outline.pieces[0], depth_mm)).Edge()]
    for corner in outline.corners.tolist():
        point = float(outline.radius(np.array([corner]))[0]) * rim_directions(np.array([corner]))[0]
        vertices[corner] = BRepBuilderAPI_MakeVertex(gp_Pnt(point[0], point[1], -depth_mm)).Vertex()
    breaks = sorted(vertices)
    edges = []
    for start, end in zip(breaks, [*breaks[1:], breaks[0] + FULL_TURN], strict=True):
        piece = outline.piece_at(0.5 * (start + end))
        ends = [start, end]
        if piece.normal is not None:
            ends = [piece.distance_mm * float(np.tan(azimuth - piece.normal)) for azimuth in ends]
        following = vertices[end if end in vertices else breaks[0]]
        edges.append(BRepBuilderAPI_MakeEdge(_piece_curve(piece, depth_mm), vertices[start], following, *ends).Edge())
    return edges


def _piece_curve(piece: Piece, depth_mm: float) -> Any:
    """A circle parametrised by azimuth, or a line parametrised by the length from its foot."""
    if piece.normal is None:
        return Geom_Circle(gp_Ax2(gp_Pnt(0.0, 0.0, -depth_mm), gp_Dir(0.0, 0.0, 1.0)), piece.distance_mm)
    x, y = float(np.cos(piece.normal)), float(np.sin(piece.normal))
    return Geom_Line(gp_Pnt(piece.distance_mm * x, piece.distance_mm * y, -depth_mm), gp_Dir(-y, x, 0.0))


def wire(edges: list[Any]) -> Any:
    """The wire through a chain of edges."""
    maker = BRepBuilderAPI_MakeWire()
    for edge in edges:
        maker.Add(edge)
    return maker.Wire()


def walls_below(name: str, edges: Chain, depth_mm: float, scale: float = 1.0) -> tuple[Named, Any]:
    """Walls called ``name`` below ``edges``, and the wire at their foot, ``scale`` times as far from the axis."""
    faces, foot = walls_and_foot(edges, depth_mm, scale)
    return [(name, face) for face in faces], foot


def walls_between(edges: Chain, foot: Any) -> list[Any]:
    """Walls from closed ``edges`` to a wire with as many edges: planes, cones, or ruled surfaces."""
    made = BRepFill_Generator()
    made.AddWire(wire(edges))
    made.AddWire(foot)
    made.Perform()
    faces = [_flattened(face) for face in parts_of(made.Shell(), "FACE")]
    return [
        next(face for face in faces if any(edge.IsSame(face_edge) for face_edge in parts_of(face, "EDGE")))
        for edge in edges
    ]


def _flattened(face: Any) -> Any:
    """The face as a plane if its edges are coplanar: ruled faces are splines."""
    made = BRepBuilderAPI_MakeFace(BRepTools.OuterWire_s(face), True)
    return made.Face() if made.IsDone() else face


def walls_and_foot(edges: Chain, depth_mm: float, scale: float) -> tuple[list[Any], Any]:
    """Walls down by ``depth_mm`` (up if negative), one for each edge, and the wire at their foot."""
    if scale != 1.0:
        about_apex = gp_Trsf()
        top = BRep_Tool.Pnt_s(parts_of(edges[0], "VERTEX")[0]).Z()
        about_apex.SetScale(gp_Pnt(0.0, 0.0, top + depth_mm / (scale - 1.0)), scale)
        foot = TopoDS.Wire_s(BRepBuilderAPI_Transform(wire(edges), about_apex, True).Shape())
        return walls_between(edges, foot), foot
    prism = BRepPrimAPI_MakePrism(wire(edges), gp_Vec(0.0, 0.0, -depth_mm))
    faces = [TopoDS.Face_s(prism.Generated(edge).First()) for edge in edges]
    return faces, TopoDS.Wire_s(prism.LastShape())


def moved(place: Iterable[float], turn_deg: float = 0.0) -> Any:
    """The location of a shape at ``place`` (mm), turned about its axis."""
    turned = gp_Trsf()
    moved = gp_Trsf()
    turned.SetRotation(gp_Ax1(gp_Pnt(0.0, 0.0, 0.0), gp_Dir(0.0, 0.0, 1.0)), radians(turn_deg))
    moved.SetTranslation(gp_Vec(*place, 0.0))
    return TopLoc_Location(moved.Multiplied(turned) if turn_deg else moved)


def face_at(face: Any, location: Any) -> Any:
    """A face at a location."""
    return TopoDS.Face_s(face.Moved(location))


def copies_at(shapes: list[Any], location: Any) -> list[Any]:
    """New shapes at a location that share what ``shapes`` share: a cone moved alone loses its name in STEP."""
    builder = BRep_Builder()
    compound = TopoDS_Compound()
    builder.MakeCompound(compound)
    for shape in shapes:
        builder.Add(compound, shape)
    made = BRepBuilderAPI_Transform(compound, location.Transformation(), True)
    return [made.ModifiedShape(shape).Oriented(shape.Orientation()) for shape in shapes]


def normal_at(face: Any, place: tuple[float, float] | None = None) -> tuple[Any, Any]:
    """Point (gp_Pnt) and normal (gp_Vec, of any length) of a face at its parameters, by default in the middle."""
    point = gp_Pnt()
    normal = gp_Vec()
    (u_low, u_high, v_low, v_high) = BRepTools.UVBounds_s(face)
    BRepGProp_Face(face).Normal(*(place or ((u_low + u_high) / 2.0, (v_low + v_high) / 2.0)), point, normal)
    return point, normal


def wire_at(boundary: Any, location: Any) -> Any:
    """A wire at a location."""
    return TopoDS.Wire_s(boundary.Moved(location))


def _corners(points: Float[np.ndarray, "n 3"], tolerance: float) -> list[Any]:
    """A vertex at each of the points (mm)."""
    corners = []
    for point in points.tolist():
        vertex = TopoDS_Vertex()
        BRep_Builder().MakeVertex(vertex, gp_Pnt(*point), tolerance)
        corners.append(vertex)
    return corners


def _spline_along(
    points: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "n d"]], ends: _Ends, nodes: int
) -> BSpline:
    """The spline with exactly these azimuths as ends, so that readers need not search for them."""
    share = (ends[1] - ends[0]) / FULL_TURN
    azimuths = np.linspace(*ends, 2 * DEGREE + int(_RIM_NODES_PER_NODE * nodes * share))
    return make_interp_spline(azimuths, points(azimuths), k=DEGREE)


def curve_of(spline: BSpline) -> Any:
    """``Geom_BSplineCurve`` in space, ``Geom2d_BSplineCurve`` in a plane."""
    of_space = spline.c.shape[1] == 3
    poles = (TColgp_Array1OfPnt if of_space else TColgp_Array1OfPnt2d)(1, len(spline.c))
    for k, point in enumerate(spline.c.round(_DECIMALS).tolist(), start=1):
        poles.SetValue(k, (gp_Pnt if of_space else gp_Pnt2d)(*point))
    return (Geom_BSplineCurve if of_space else Geom2d_BSplineCurve)(poles, *_knots(spline.t), DEGREE)


def _knots(knots: Float[np.ndarray, " k"]) -> tuple[Any, Any]:
    """Distinct knots and their multiplicities, as OCC arrays."""
    distinct, counts = np.unique(knots, return_counts=True)
    values = TColStd_Array1OfReal(1, len(distinct))
    multiplicities = TColStd_Array1OfInteger(1, len(distinct))
    for k, (knot, count) in enumerate(zip(distinct.tolist(), counts.tolist(), strict=True), start=1):
        values.SetValue(k, knot)
        multiplicities.SetValue(k, count)
    return values, multiplicities


@dataclass(frozen=True)
class Opening:
    """An opening that two boundaries share: the surfaces of its plane and of the cavity's face, and their edges."""

    plane: Any
    beside: Any
    edges: list[Any]

    @staticmethod
    def of(plan: Plan[Patch]) -> "Opening | None":
        """The opening of a plan; None for a closed one."""
        crease = plan.cavity.opening
        ring = plan.envelope.faces[0]
        if crease is None:
            return None
        beside = plan.cavity.faces[1]
        surfaces = [geom_surface(face.shape.bounded(face.domain.extent[1])) for face in (ring, beside)]
        edges = crease_edges(crease, (ring.shape, beside.shape), (surfaces[0], surfaces[1]))
        return Opening(surfaces[0], surfaces[1], edges)
