"""Volume and area of solids of the CAD kernel.

The kernel's own integrals by a number of points err by 5e-3 on faces with a hole and many knots, its adaptive ones take
13 s each on a lens of four such faces. Here a lens takes a second.
"""

from collections.abc import Iterator
from math import ceil, hypot
from typing import Any

import numpy as np

# Of the Gauss-Kronrod volume, relative to each face: the whole errs by 5e-9 on a lens of two faces, by 1e-7 on one of
# four. With 1e-8 both are 1e-9, in six times the time.
_VOLUME_PRECISION = 1e-6
_AREA_PRECISION = 1e-8  # of faces that are no splines
_POINTS, _PANEL_CELLS = 16, 8  # of Gauss, and the cells between knots on which they lie: areas err by 1e-7
_LEAST_CELLS = 64  # across a surface: those of a few knots bend within a cell; areas of a ring or a hole err by 2e-6
_PROBES = 32  # along an edge, for its length in cells


def volume_mm3(shape: Any) -> float:
    """Volume of a TopoDS_Shape, negative where its faces face inwards."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    found = GProp_GProps()
    BRepGProp.VolumePropertiesGK_s(shape, found, _VOLUME_PRECISION, False, False)
    return float(found.Mass())


def area_mm2(shape: Any) -> float:
    """Area of all faces of a TopoDS_Shape."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepGProp import BRepGProp
    from OCP.GeomAbs import GeomAbs_SurfaceType
    from OCP.GProp import GProp_GProps
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopoDS import TopoDS

    total = 0.0
    for face in map(TopoDS.Face_s, _parts(shape, TopAbs_ShapeEnum.TopAbs_FACE)):
        if BRepAdaptor_Surface(face, False).GetType() == GeomAbs_SurfaceType.GeomAbs_BSplineSurface:
            total += _spline_area_mm2(face)
        else:
            found = GProp_GProps()
            BRepGProp.SurfaceProperties_s(face, found, _AREA_PRECISION)
            total += found.Mass()
    return float(total)


def _spline_area_mm2(face: Any) -> float:
    """Area of a face on a spline: the sum of the sectors in its plane of parameters from one point to all edges.

    What lies beyond a hole or a hollow edge is counted in one sector and taken away in another.
    """
    from OCP.BRepAdaptor import BRepAdaptor_Curve2d, BRepAdaptor_Surface
    from OCP.TopAbs import TopAbs_Orientation, TopAbs_ShapeEnum
    from OCP.TopoDS import TopoDS

    surface, total = BRepAdaptor_Surface(face, False), 0.0
    for edge in map(TopoDS.Edge_s, _parts(face, TopAbs_ShapeEnum.TopAbs_EDGE)):
        turned = edge.Orientation() == TopAbs_Orientation.TopAbs_REVERSED
        sector = _sector_mm2(surface, BRepAdaptor_Curve2d(edge, face))
        total += -sector if turned else sector
    return abs(total)


def _sector_mm2(surface: Any, edge: Any) -> float:
    """Area of a surface between the middle of its parameters and an edge, below 0 where that runs clockwise."""
    from OCP.gp import gp_Pnt, gp_Pnt2d, gp_Vec, gp_Vec2d

    middle = surface.FirstUParameter() + surface.LastUParameter(), surface.FirstVParameter() + surface.LastVParameter()
    u0, v0 = 0.5 * middle[0], 0.5 * middle[1]
    at, along, point, by_u, by_v, total = gp_Pnt2d(), gp_Vec2d(), gp_Pnt(), gp_Vec(), gp_Vec(), 0.0
    length, reach = _cells(surface, edge, (u0, v0))
    shares, weights = _gauss(reach)
    for place, weight in zip(*_gauss(length), strict=True):
        edge.D1(edge.FirstParameter() + place * (edge.LastParameter() - edge.FirstParameter()), at, along)
        u, v, inner = at.X() - u0, at.Y() - v0, 0.0
        for share, own in zip(shares, weights, strict=True):
            surface.D1(u0 + share * u, v0 + share * v, point, by_u, by_v)
            inner += own * share * by_u.CrossMagnitude(by_v)
        total += weight * (u * along.Y() - v * along.X()) * inner
    return float(total * (edge.LastParameter() - edge.FirstParameter()))


def _cells(surface: Any, edge: Any, middle: tuple[float, float]) -> tuple[float, float]:
    """Length of an edge, and its largest distance from the middle, in cells between the knots of a surface."""
    per_u = max(_LEAST_CELLS, surface.NbUKnots() - 1) / (surface.LastUParameter() - surface.FirstUParameter())
    per_v = max(_LEAST_CELLS, surface.NbVKnots() - 1) / (surface.LastVParameter() - surface.FirstVParameter())
    places = [edge.Value(t) for t in np.linspace(edge.FirstParameter(), edge.LastParameter(), _PROBES).tolist()]
    cells = np.array([[(p.X() - middle[0]) * per_u, (p.Y() - middle[1]) * per_v] for p in places])
    return float(np.hypot(*np.diff(cells, axis=0).T).sum()), float(max(hypot(*each) for each in cells))


def _gauss(cells: float) -> tuple[list[float], list[float]]:
    """Points and weights on 0 to 1, in equal panels of at most eight cells."""
    panels = max(1, ceil(cells / _PANEL_CELLS))
    points, weights = np.polynomial.legendre.leggauss(_POINTS)
    places = (np.arange(panels)[:, None] + 0.5 * (points + 1.0)) / panels
    return places.ravel().tolist(), np.tile(0.5 * weights / panels, panels).tolist()


def _parts(shape: Any, kind: Any) -> Iterator[Any]:
    from OCP.TopExp import TopExp_Explorer

    explorer = TopExp_Explorer(shape, kind)
    while explorer.More():
        yield explorer.Current()
        explorer.Next()
