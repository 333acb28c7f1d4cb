"""Volume, area and box of a solid of the CAD kernel.

The kernel's own box of a trimmed face is that of the whole surface beyond the trim, and its distance to a plane takes
seconds for each side; so the box is that of all edges, and of points on the faces, searched from coarse to fine.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

# Relative. The errors are 5e-9 of a lens's volume and 1e-9 of its area; without a setting 1e-4 and 1e-6 where another
# program has joined the rims to long edges, 1e-7 as exported.
_VOLUME_PRECISION, _AREA_PRECISION = 1e-6, 1e-4
_TOLERANCE_MM = 1e-6  # what the box of a face exceeds that of the edges by rounding
_COARSE, _FINE, _ROUNDS = 48, 9, 9  # points along u and v; the window shrinks by a factor of 4 each time: to 1e-6 of it


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
    """Largest coordinate times ``sign`` along an axis, of points inside the trim of ``face``; -inf: none was found."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepTopAdaptor import BRepTopAdaptor_FClass2d
    from OCP.gp import gp_Pnt2d
    from OCP.TopAbs import TopAbs_State

    surface, trim = BRepAdaptor_Surface(face), BRepTopAdaptor_FClass2d(face, 1e-9)
    low = np.array([surface.FirstUParameter(), surface.FirstVParameter()])
    high = np.array([surface.LastUParameter(), surface.LastVParameter()])
    best, place, span, count = -np.inf, 0.5 * (low + high), high - low, _COARSE
    for _ in range(_ROUNDS):
        for u, v in _grid(np.maximum(place - 0.5 * span, low), np.minimum(place + 0.5 * span, high), count):
            point = surface.Value(u, v)
            reach = sign * (point.X(), point.Y(), point.Z())[axis]
            if reach > best and trim.Perform(gp_Pnt2d(u, v)) != TopAbs_State.TopAbs_OUT:
                best, place = reach, np.array([u, v])
        span, count = (4.0 / _COARSE * span if count == _COARSE else 0.25 * span), _FINE
    return float(best)


def _grid(low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"], count: int) -> list[tuple[float, float]]:
    """Parameters (u, v) on a grid from ``low`` to ``high``."""
    u, v = (np.linspace(low[k], high[k], count) for k in (0, 1))
    return [(float(a), float(b)) for a in u for b in v]
