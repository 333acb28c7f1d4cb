"""The body as a B-rep solid: two optical faces of one patch each, closed by the faces of the base.

Neighbouring faces are built on the same edges, so the shell is closed by construction: no sewing within a
tolerance, and no boolean operation that could lose the name of a face.
"""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lensforge.geometry.arcs import Arc
from lensforge.geometry.base import FLAT, body_faces
from lensforge.geometry.base_profile import (
    BORE,
    BORE_TOP,
    BOTTOM,
    FLANGE_SIDE,
    FLANGE_TOP,
    INNER,
    OUTER,
    POCKET_SIDE,
    POCKET_TOP,
    RELIEF,
    RIM,
    SIDE,
    TOP,
)
from lensforge.geometry.edges import geom_surface, rim_edges, wire
from lensforge.geometry.outline import FULL_TURN
from lensforge.geometry.patch import Patch
from lensforge.geometry.plan import Plan

# Outward direction of each face: along +z or -z, away from the axis or towards it.
_UP, _DOWN, _AWAY, _TOWARDS = "+z", "-z", "+r", "-r"
_OUTWARD = {
    **{OUTER: _UP, INNER: _DOWN, RIM: _DOWN, TOP: _UP, SIDE: _AWAY, BOTTOM: _DOWN, BORE: _TOWARDS},
    **{RELIEF: _AWAY, FLAT: _AWAY, FLANGE_TOP: _UP, FLANGE_SIDE: _AWAY, POCKET_SIDE: _TOWARDS, POCKET_TOP: _DOWN},
    **{BORE_TOP: _DOWN},
}

# Relative; the volume errs by as much, in 2 s instead of the 5 s of 1e-10.
_VOLUME_PRECISION = 1e-8


@dataclass(frozen=True)
class Solid:
    """A ``cadquery.Solid`` (mm) and its faces (``cadquery.Face``) by name."""

    shape: Any
    faces: dict[str, Any]

    @property
    def valid(self) -> bool:
        """True where the CAD kernel finds one closed, outward-facing solid with consistent wires, edges, tolerances."""
        return bool(self.shape.isValid()) and len(self.shape.Shells()) == 1 and self.default_volume_mm3 > 0.0

    @property
    def faults(self) -> list[str]:
        """Names of the faces that the CAD kernel finds invalid, each tested on its own."""
        return [name for name, face in self.faces.items() if not face.isValid()]

    @cached_property
    def volume_mm3(self) -> float:
        """Volume, by adaptive integration over the faces."""
        return self._volume_mm3(_VOLUME_PRECISION)

    @cached_property
    def default_volume_mm3(self) -> float:
        """Volume by the integration that other programs take: the same points on the same faces, a tenth of the time.

        It errs by 1e-7 at most where rims are short edges, by 1e-4 on the planes of other solids with long ones.
        """
        return self._volume_mm3()

    def _volume_mm3(self, *precision: float) -> float:
        from OCP.BRepGProp import BRepGProp
        from OCP.GProp import GProp_GProps

        properties = GProp_GProps()
        BRepGProp.VolumeProperties_s(self.shape.wrapped, properties, *precision)
        return float(properties.Mass())

    @property
    def genus(self) -> int:
        """Handles of the boundary, by Euler and Poincaré: ``V - E + F - (L - F) = 2 (S - G)``, L: loops, S: shells."""
        from OCP.BRep import BRep_Tool

        faces, shape = self.shape.Faces(), self.shape
        edges = sum(not BRep_Tool.Degenerated_s(edge.wrapped) for edge in shape.Edges())
        loops = sum(len(face.Wires()) for face in faces)
        return len(shape.Shells()) - (len(shape.Vertices()) - edges + 2 * len(faces) - loops) // 2


def build_solid(plan: Plan[Patch]) -> Solid:
    """Build the closed solid of a plan."""
    inner_surface, outer_surface = geom_surface(plan.inner.trimmed), geom_surface(plan.outer.trimmed)
    outer_rim = rim_edges(plan.outer, outer_surface, plan.arcs, split=len(plan.arcs) == 1)
    whole = (Arc(0.0, FULL_TURN, "bare"),)
    (inner_rim,) = rim_edges(plan.inner, inner_surface, whole, split=True)
    outer_boundary = [edge for chain in outer_rim for edge in chain]
    faces = [(OUTER, _trimmed(outer_surface, outer_boundary)), (INNER, _trimmed(inner_surface, inner_rim))]
    faces += body_faces(plan, inner_rim, outer_rim)
    return _assembled([(name, _facing(face, _OUTWARD[name])) for name, face in faces])


def untrimmed_faces(patches: dict[str, Patch]) -> dict[str, Any]:
    """A ``cadquery.Face`` over the whole of each patch, its normal out of the material of a lens."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    faces = {name: BRepBuilderAPI_MakeFace(geom_surface(patch), 1e-7).Face() for name, patch in patches.items()}
    return {name: _facing(face, _OUTWARD[name]) for name, face in faces.items()}


def _trimmed(surface: Any, rim: list[Any]) -> Any:
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace

    return BRepBuilderAPI_MakeFace(surface, wire(rim), True).Face()


def _facing(face: Any, outward: str) -> Any:
    """``face`` with the orientation that makes its normal point outwards."""
    import cadquery as cq

    shape = cq.Face(face)
    normal, point = shape.normalAt(*_middle(face))
    radial = normal.x * point.x + normal.y * point.y
    along = {_UP: normal.z, _DOWN: -normal.z, _AWAY: radial, _TOWARDS: -radial}[outward]
    return shape if along > 0.0 else cq.Face(face.Reversed())


def _middle(face: Any) -> tuple[float, float]:
    from OCP.BRepTools import BRepTools

    u_low, u_high, v_low, v_high = BRepTools.UVBounds_s(face)
    return (u_low + u_high) / 2.0, (v_low + v_high) / 2.0


def _assembled(faces: list[tuple[str, Any]]) -> Solid:
    import cadquery as cq
    from OCP.BRep import BRep_Builder
    from OCP.TopoDS import TopoDS_Shell, TopoDS_Solid

    builder, shell, solid = BRep_Builder(), TopoDS_Shell(), TopoDS_Solid()
    builder.MakeShell(shell)
    for _, face in faces:
        builder.Add(shell, face.wrapped)
    shell.Closed(True)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return Solid(cq.Solid(solid), uniquely_named(faces))


def uniquely_named(faces: list[tuple[str, Any]]) -> dict[str, Any]:
    """Names made unique: a number is added where several faces share one."""
    total, seen = Counter(name for name, _ in faces), Counter[str]()
    named = {}
    for name, face in faces:
        seen[name] += 1
        named[name if total[name] == 1 else f"{name}_{seen[name]}"] = face
    return named
