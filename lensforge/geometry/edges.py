"""The curves of the body in z = 0 as B-rep edges, shared between the faces that meet in them.

A rim edge carries two descriptions with the same parameter, the azimuth: a quintic curve in space, and the
exact unit circle in the parameter plane of its optical face.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline

from lensforge.geometry.patch import DEGREE, Patch
from lensforge.geometry.plan import FULL_TURN, Arc, rim_directions

# The rim curve lies in z = 0, the face's own boundary within the patch's form error of it.
_MIN_TOLERANCE_MM, _GAP_MARGIN = 1e-6, 2.0
_RIM_NODES_PER_NODE = 4  # along the whole rim, for each node across the patch: 1.3 times as dense


def geom_surface(patch: Patch) -> Any:
    """``Geom_BSplineSurface`` of a patch: the same control points, knots and parameters."""
    from OCP.Geom import Geom_BSplineSurface
    from OCP.gp import gp_Pnt
    from OCP.TColgp import TColgp_Array2OfPnt

    poles = TColgp_Array2OfPnt(1, len(patch.control), 1, len(patch.control))
    for (row, column), _ in np.ndenumerate(patch.control[..., 0]):
        poles.SetValue(row + 1, column + 1, gp_Pnt(*patch.control[row, column].tolist()))
    knots, multiplicities = _knots(patch.knots)
    return Geom_BSplineSurface(poles, knots, knots, multiplicities, multiplicities, DEGREE, DEGREE)


def rim_edges(patch: Patch, face_surface: Any, arcs: tuple[Arc, ...]) -> list[Any]:
    """One edge for each arc of the patch's rim, in a closed chain; on ``face_surface`` each is a piece of circle."""
    from OCP.BRep import BRep_Builder
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.Geom2d import Geom2d_Circle
    from OCP.gp import gp_Ax2d, gp_Dir2d, gp_Pnt2d
    from OCP.TopLoc import TopLoc_Location

    unit_circle = Geom2d_Circle(gp_Ax2d(gp_Pnt2d(0.0, 0.0), gp_Dir2d(1.0, 0.0)), 1.0)
    tolerance = _rim_tolerance(patch)
    corners = _corners(patch, arcs, tolerance)
    edges = []
    for k, arc in enumerate(arcs):
        curve = _rim_curve(patch, arc)
        maker = BRepBuilderAPI_MakeEdge(curve, corners[k], corners[(k + 1) % len(arcs)], arc.start, arc.end)
        edge = maker.Edge()
        BRep_Builder().UpdateEdge(edge, unit_circle, face_surface, TopLoc_Location(), tolerance)
        edges.append(edge)
    return edges


def circle_edges(radius: float, rims: list[Any], arcs: tuple[Arc, ...]) -> list[Any]:
    """The circle of ``radius`` in z = 0, one edge for each arc; it shares the vertices of ``rims`` if they cross."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.Geom import Geom_Circle
    from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt
    from OCP.TopExp import TopExp

    circle = Geom_Circle(gp_Ax2(gp_Pnt(0.0, 0.0, 0.0), gp_Dir(0.0, 0.0, 1.0)), radius)
    if len(arcs) == 1:
        return [BRepBuilderAPI_MakeEdge(circle).Edge()]
    return [
        BRepBuilderAPI_MakeEdge(circle, TopExp.FirstVertex_s(rim), TopExp.LastVertex_s(rim), arc.start, arc.end).Edge()
        for rim, arc in zip(rims, arcs, strict=True)
    ]


def wire(edges: list[Any]) -> Any:
    """The wire through a chain of edges."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeWire

    maker = BRepBuilderAPI_MakeWire()
    for edge in edges:
        maker.Add(edge)
    return maker.Wire()


def _corners(patch: Patch, arcs: tuple[Arc, ...], tolerance: float) -> list[Any]:
    """A vertex at the start of each arc."""
    from OCP.BRep import BRep_Builder
    from OCP.gp import gp_Pnt
    from OCP.TopoDS import TopoDS_Vertex

    corners = []
    for point in _rim_points(patch, np.array([arc.start for arc in arcs])).tolist():
        vertex = TopoDS_Vertex()
        BRep_Builder().MakeVertex(vertex, gp_Pnt(*point), tolerance)
        corners.append(vertex)
    return corners


def _rim_tolerance(patch: Patch) -> float:
    azimuths = np.linspace(0.0, FULL_TURN, 4 * _RIM_NODES_PER_NODE * patch.nodes)
    gap = float(np.abs(patch.points(rim_directions(azimuths)[:, :2])[:, 2]).max())
    return max(_MIN_TOLERANCE_MM, _GAP_MARGIN * gap)


def _rim_curve(patch: Patch, arc: Arc) -> Any:
    """``Geom_BSplineCurve`` over exactly the azimuths of the arc, so that readers find its ends without searching."""
    from OCP.Geom import Geom_BSplineCurve
    from OCP.gp import gp_Pnt
    from OCP.TColgp import TColgp_Array1OfPnt

    share = (arc.end - arc.start) / FULL_TURN
    azimuths = np.linspace(arc.start, arc.end, 16 + int(_RIM_NODES_PER_NODE * patch.nodes * share))
    spline = make_interp_spline(azimuths, _rim_points(patch, azimuths), k=DEGREE)
    poles = TColgp_Array1OfPnt(1, len(spline.c))
    for k, point in enumerate(spline.c.tolist(), start=1):
        poles.SetValue(k, gp_Pnt(*point))
    return Geom_BSplineCurve(poles, *_knots(spline.t), DEGREE)


def _rim_points(patch: Patch, azimuths: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """The patch's rim with z set to 0, from which it differs by less than its form error."""
    points = patch.points(rim_directions(azimuths)[:, :2])
    points[:, 2] = 0.0
    return points


def _knots(knots: Float[np.ndarray, " k"]) -> tuple[Any, Any]:
    """Distinct knots and their multiplicities, the way OCC wants them."""
    from OCP.TColStd import TColStd_Array1OfInteger, TColStd_Array1OfReal

    distinct, counts = np.unique(knots, return_counts=True)
    values, multiplicities = TColStd_Array1OfReal(1, len(distinct)), TColStd_Array1OfInteger(1, len(distinct))
    for k, (knot, count) in enumerate(zip(distinct.tolist(), counts.tolist(), strict=True), start=1):
        values.SetValue(k, knot)
        multiplicities.SetValue(k, count)
    return values, multiplicities
