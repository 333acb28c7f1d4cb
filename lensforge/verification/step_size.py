"""Volume, area and box of a solid of the CAD kernel.

The kernel's own box of a trimmed face is that of the whole surface beyond the trim, and its distance to a plane takes
seconds for each side; so the box is that of all edges, and of the tops of the faces, searched from coarse to fine.
"""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.ndimage import maximum_filter, minimum_filter

# Relative. The errors are 5e-9 of a lens's volume and 1e-9 of its area; without a setting 1e-4 and 1e-6 where another
# program has joined the rims to long edges, 1e-7 as exported.
_VOLUME_PRECISION, _AREA_PRECISION = 1e-6, 1e-4
_TOLERANCE_MM = 1e-6  # what the box of a face exceeds that of the edges by rounding
# Points along u and v: as many as the knots of a spline, whose bumps are three knots wide. About each top of theirs the
# window shrinks by a factor of 4 each time: a top is then missed by 1e-7 of its height above its neighbours.
_LEAST_COARSE, _MOST_COARSE, _FINE, _ROUNDS = 48, 400, 9, 6


def volume_mm3(shape: Any) -> float:
    """Volume of a solid, negative where its faces face inwards."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, found, _VOLUME_PRECISION)
    return float(found.Mass())


def area_mm2(shape: Any) -> float:
    """Area of all faces of a solid."""
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    found = GProp_GProps()
    BRepGProp.SurfaceProperties_s(shape, found, _AREA_PRECISION)
    return float(found.Mass())


def bounds_mm(shape: Any, faces: Sequence[Any]) -> tuple[list[float], list[float]]:
    """Least and largest corner of the box around ``shape``, whose ``faces`` (TopoDS_Face) are given."""
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp
    from OCP.TopTools import TopTools_IndexedMapOfShape

    edges, box = TopTools_IndexedMapOfShape(), Bnd_Box()
    TopExp.MapShapes_s(shape, TopAbs_ShapeEnum.TopAbs_EDGE, edges)
    for k in range(1, edges.Extent() + 1):
        BRepBndLib.AddOptimal_s(edges.FindKey(k), box, False, False)
    box.SetGap(0.0)
    sides = np.array(box.Get())  # x0, y0, z0, x1, y1, z1
    for face in faces:
        around = Bnd_Box()
        BRepBndLib.Add_s(
            face, around, False
        )  # that of a spline's control points, in a thousandth of the exact one's time
        around.SetGap(0.0)
        beyond = np.array(around.Get()) - sides
        for side in np.nonzero(np.r_[-beyond[:3], beyond[3:]] > _TOLERANCE_MM)[0]:
            reach = _reach(face, int(side) % 3, 1.0 if side >= 3 else -1.0)
            sides[side] = max(sides[side], reach) if side >= 3 else min(sides[side], -reach)
    return sides[:3].tolist(), sides[3:].tolist()


def _reach(face: Any, axis: int, sign: float) -> float:
    """Largest coordinate times ``sign`` along an axis, of the tops of ``face`` inside its trim; -inf: it has none.

    What is not on an edge is highest where the surface has a top. Each is followed: the highest sample of a wavy face
    may lie beside another top than the highest.
    """
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepTopAdaptor import BRepTopAdaptor_FClass2d
    from OCP.gp import gp_Pnt2d
    from OCP.TopAbs import TopAbs_State

    surface, trim = BRepAdaptor_Surface(face), BRepTopAdaptor_FClass2d(face, 1e-9)
    low = np.array([surface.FirstUParameter(), surface.FirstVParameter()])
    high = np.array([surface.LastUParameter(), surface.LastVParameter()])

    def heights(places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        points = (surface.Value(u, v) for u, v in places.tolist())
        return np.array([sign * (point.X(), point.Y(), point.Z())[axis] for point in points])

    def inside(place: Float[np.ndarray, " 2"]) -> bool:
        return bool(trim.Perform(gp_Pnt2d(*place.tolist())) != TopAbs_State.TopAbs_OUT)

    def around(place: Float[np.ndarray, " 2"], half: Float[np.ndarray, " 2"], count: int) -> Float[np.ndarray, "n 2"]:
        return _grid(np.maximum(place - half, low), np.minimum(place + half, high), count)

    count, best = _samples(surface), -np.inf
    for place, bound in _tops(heights, low, high, count):
        half = (high - low) / (count - 1)
        if bound <= best or not any(map(inside, around(place, half, 3))):
            continue
        for _ in range(_ROUNDS):
            window = around(place, half, _FINE)
            found = heights(window)
            place, half = window[np.argmax(found)], 0.25 * half
        if found.max() > best and inside(place):
            best = float(found.max())
    return best


def _samples(surface: Any) -> int:
    """Points along u and v among which no bump of ``surface`` is lost."""
    from OCP.GeomAbs import GeomAbs_SurfaceType

    if surface.GetType() != GeomAbs_SurfaceType.GeomAbs_BSplineSurface:
        return _LEAST_COARSE
    return int(np.clip(max(surface.NbUKnots(), surface.NbVKnots()), _LEAST_COARSE, _MOST_COARSE))


def _tops(
    heights: Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, " n"]],
    low: Float[np.ndarray, " 2"],
    high: Float[np.ndarray, " 2"],
    count: int,
) -> Iterator[tuple[Float[np.ndarray, " 2"], float]]:
    """Parameters (u, v) of the samples above all of their neighbours, the highest first, and what no top there exceeds.

    A paraboloid rises less from its highest sample to its top than from the lowest neighbour to that sample.
    """
    places = _grid(low, high, count)
    values = heights(places)
    square = values.reshape(count, count)
    highest, lowest = (filtered(square, 3, mode="nearest").ravel() for filtered in (maximum_filter, minimum_filter))
    tops = np.nonzero(values == highest)[0]
    for top in tops[np.argsort(-values[tops], kind="stable")]:
        yield places[top], float(2.0 * values[top] - lowest[top])


def _grid(low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"], count: int) -> Float[np.ndarray, "n 2"]:
    """Parameters (u, v) on a grid from ``low`` to ``high``."""
    u, v = (np.linspace(low[k], high[k], count) for k in (0, 1))
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
