"""The form of a body in a STEP file: points of its faces, edges and corners, as the CAD kernel has read them.

A spline is looked at four times between neighbouring knots, twice each way, so that no control point is moved unseen;
other faces along their parameters. Every edge is looked at as the curve that the file states, and as that of each face
beside it. Points beyond the trim of a face do not count.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Curve, BRepAdaptor_Curve2d, BRepAdaptor_Surface
from OCP.BRepTopAdaptor import BRepTopAdaptor_FClass2d
from OCP.gp import gp_Pnt2d
from OCP.TopAbs import TopAbs_ShapeEnum, TopAbs_State
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_IndexedMapOfShape
from scipy.interpolate import BSpline

from lensforge.proof.designed_body import ABOVE_MM, Designed, DesignedFace, PlacedFace
from lensforge.proof.file_form import DesignedFile, Farthest, FileForm
from lensforge.results.brep_size import explored, spline_poles

_OF_SPAN = np.array([0.25, 0.75])  # no node of an interpolation lies there, and a wave of two knots does not vanish
_PROBES = 6  # along each parameter: which face of the design it is
# Along both parameters of a face that is no spline: planes and cylinders are what they are by a few of their points.
_SAMPLES = {"Plane": (3, 3), "Cylinder": (15, 3), "SurfaceOfExtrusion": (48, 3)}
_OF_OTHERS = (96, 96)
_LEAST_SPANS = 48
_LEAST_OF_EDGE = 16
_TRIM_MM = 1e-7
_SAME_MM = 1e-9  # poles of a face at another place
_MM_PER_UM = 1e-3
_BEYOND_MM = 1e-3  # beyond its edges a face that is exported without them is not fitted to any error

_Points = Float[np.ndarray, "n 3"]
_Places = Float[np.ndarray, "n 2"]


def step_form(file: DesignedFile, faces: Sequence[Any]) -> FileForm:
    """Form of the ``faces`` (TopoDS_Face) read from ``file``."""
    seen = _Seen(file)
    for face in faces:
        seen.see(ReadFace(face))
    return seen.farthest.form(file.name, file.body, file.limit_um, _open_edges(faces) if file.trimmed else 0)


@dataclass(eq=False)
class ReadFace:
    """One face of a file."""

    face: Any

    @cached_property
    def surface(self) -> Any:
        """The kernel's surface of the face, in place, within the bounds of its edges."""
        return BRepAdaptor_Surface(self.face, True)

    @cached_property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least and largest parameter, of u and of v."""
        surface = self.surface
        return surface.FirstUParameter(), surface.LastUParameter(), surface.FirstVParameter(), surface.LastVParameter()

    @cached_property
    def kind(self) -> str:
        """Kind of the surface in the kernel's words."""
        return str(self.surface.GetType()).rpartition("_")[2]

    def at(self, places: _Places) -> _Points:
        """Points (mm) at parameters."""
        return np.array([self.surface.Value(u, v).Coord() for u, v in places.tolist()]).reshape(-1, 3)

    def inside(self, places: _Places) -> Bool[np.ndarray, " n"]:
        """True for parameters within the trim."""
        is_inside = (self._trim.Perform(gp_Pnt2d(u, v)) == TopAbs_State.TopAbs_IN for u, v in places.tolist())
        return np.fromiter(is_inside, dtype=bool, count=len(places))

    @cached_property
    def _trim(self) -> Any:
        return BRepTopAdaptor_FClass2d(self.face, _TRIM_MM)

    @cached_property
    def spline(self) -> "_Spline | None":
        """Its spline, with the same parameters; None for any other surface, and for closed or rational splines."""
        if self.kind != "BSplineSurface":
            return None
        kernel = self.surface.BSpline()
        if kernel.IsUPeriodic() or kernel.IsVPeriodic() or kernel.IsURational() or kernel.IsVRational():
            return None
        along_u, along_v = (np.array(list(knots)) for knots in (kernel.UKnotSequence(), kernel.VKnotSequence()))
        return _Spline(spline_poles(kernel), along_u, along_v, kernel.UDegree(), kernel.VDegree())

    def on_grid(self, u: Float[np.ndarray, " p"], v: Float[np.ndarray, " q"]) -> _Points:
        """Points (mm) at all pairs of parameters, v changing faster."""
        return self.at(_crossed(u, v)) if self.spline is None else self.spline.on_grid(u, v).reshape(-1, 3)

    def grid(self) -> tuple[_Places, _Points]:
        """Parameters between all knots, and the points there."""
        u0, u1, v0, v1 = self.bounds
        if self.spline is not None:
            u, v = _between(self.spline.knots_u, u0, u1), _between(self.spline.knots_v, v0, v1)
        else:
            least_u, least_v = _SAMPLES.get(self.kind, _OF_OTHERS)
            knots_u, knots_v = self._knots
            u, v = np.linspace(u0, u1, max(least_u, 2 * knots_u)), np.linspace(v0, v1, max(least_v, 2 * knots_v))
        return _crossed(u, v), self.on_grid(u, v)

    @cached_property
    def _knots(self) -> tuple[int, int]:
        """Knots of a spline along u and v, or of the curve that is extruded."""
        if self.kind == "BSplineSurface":
            return self.surface.NbUKnots(), self.surface.NbVKnots()
        if self.kind == "SurfaceOfExtrusion":
            return _knots_of(self.surface.BasisCurve()), 0
        return 0, 0

    @property
    def is_plain(self) -> bool:
        """True if a few points determine all of its surface."""
        return self.kind in _SAMPLES

    def probes(self) -> _Points:
        """Some of its points, within the trim if the surface beyond may be anything; for a narrow face on its edges."""
        u0, u1, v0, v1 = self.bounds
        share = (np.arange(_PROBES) + 0.5) / _PROBES
        places = _crossed(u0 + share * (u1 - u0), v0 + share * (v1 - v0))
        if not self.is_plain:
            places = places[self.inside(places)]
        return self.at(places) if len(places) else self.edge_points(on_surface=True)

    def edge_points(self, on_surface: bool) -> _Points:
        """Points of its edges, by their own curves and ``on_surface``, and their ends."""
        points = [np.empty((0, 3))]
        for edge in map(TopoDS.Edge_s, explored(self.face, TopAbs_ShapeEnum.TopAbs_EDGE)):
            count = _LEAST_OF_EDGE
            if not BRep_Tool.Degenerated_s(edge):
                curve = BRepAdaptor_Curve(edge)
                count = max(count, 2 * _knots_of(curve))
                points.append(np.array([curve.Value(parameter).Coord() for parameter in _even(curve, count)]))
            if on_surface and not self.is_plain:
                trim = BRepAdaptor_Curve2d(edge, self.face)
                points.append(
                    self.at(np.array([trim.Value(parameter).Coord() for parameter in _even(trim, 2 * count)]))
                )
        for vertex in map(TopoDS.Vertex_s, explored(self.face, TopAbs_ShapeEnum.TopAbs_VERTEX)):
            points.append(np.array([BRep_Tool.Pnt_s(vertex).Coord()]))
        return np.concatenate(points)


def _even(curve: Any, count: int) -> list[float]:
    """Parameters of the kernel's curve from end to end."""
    return np.linspace(curve.FirstParameter(), curve.LastParameter(), count).tolist()


@dataclass(frozen=True, eq=False)
class _Spline:
    """A tensor-product spline by its poles (mm), the knots along both parameters, and the degrees."""

    poles: Float[np.ndarray, "n m 3"]
    knots_u: Float[np.ndarray, " k"]
    knots_v: Float[np.ndarray, " l"]
    degree_u: int
    degree_v: int

    def on_grid(self, u: Float[np.ndarray, " p"], v: Float[np.ndarray, " q"]) -> Float[np.ndarray, "p q 3"]:
        """Points (mm) at all pairs of parameters."""
        by_u = BSpline.design_matrix(u, self.knots_u, self.degree_u)
        by_v = BSpline.design_matrix(v, self.knots_v, self.degree_v)
        along_u = by_u @ self.poles.reshape(len(self.poles), -1)
        across = along_u.reshape(len(u), -1, 3).transpose(1, 0, 2).reshape(self.poles.shape[1], -1)
        return (by_v @ across).reshape(len(v), len(u), 3).transpose(1, 0, 2)

    def is_same(self, other: "_Spline") -> bool:
        """True if both are one surface: splines with equal knots are no farther apart than their poles."""
        alike = np.array_equal(self.knots_u, other.knots_u) and np.array_equal(self.knots_v, other.knots_v)
        alike &= self.poles.shape == other.poles.shape
        return alike and bool(np.abs(self.poles - other.poles).max() <= _SAME_MM)


@dataclass(eq=False)
class _Seen:
    """Points of a file seen so far; ``known``: splines of a plate's lenses, in local coordinates, by the face."""

    file: DesignedFile
    farthest: Farthest = field(default_factory=Farthest)
    known: dict[DesignedFace, _Spline] = field(default_factory=dict)

    def see(self, read: ReadFace) -> None:
        """Compare all of a file's face with the design's face nearest to most of it."""
        probes = read.probes()
        below = self.file.body.below
        if below is None and float(probes[:, 2].max()) <= ABOVE_MM:
            return
        designed = [*self.file.body.above, *(below or ())]
        distances = [face.off_mm(probes) for face in designed]
        chosen = int(np.argmin([off.mean() for off, _ in distances]))
        face = designed[chosen]
        owner = int(np.median(distances[chosen][1]))
        self.farthest.meet(face, np.array([owner]))
        if self.file.trimmed:
            is_copy = self._is_copy(read, face, owner)
            self.farthest.look(face, read.edge_points(on_surface=not is_copy))
            if not is_copy:
                self.farthest.look(face, self._within(read, face))
        elif isinstance(face, DesignedFace):
            self._see_untrimmed(read, face)

    def _within(self, read: ReadFace, face: Designed) -> _Points:
        """Points between the knots, without those beyond the trim that lie off the face."""
        places, points = read.grid()
        if isinstance(face, DesignedFace | PlacedFace):
            known = _known(face, points)
            places = places[known]
            points = points[known]
        away = np.flatnonzero(face.off_mm(points)[0] > self.file.limit_um * _MM_PER_UM)
        on_part = np.ones(len(points), dtype=bool)
        on_part[away] = read.inside(places[away])
        return points[on_part]

    def _see_untrimmed(self, read: ReadFace, face: DesignedFace) -> None:
        """Compare a face that extends beyond its edges, where the design's extends less exactly."""
        _, points = read.grid()
        points = points[face.within(face.known, points)]
        off, numbers = face.off_mm(points)
        beyond = np.where(face.within(face.extent, points), 0.0, _BEYOND_MM)
        self.farthest.see(face, np.maximum(off - beyond, 0.0), points, numbers)

    def _is_copy(self, read: ReadFace, face: Designed, lens: int) -> bool:
        """True if another lens of the same kind has the same spline at its place."""
        if not isinstance(face, PlacedFace) or read.spline is None:
            return False
        poles = face.to_local(read.spline.poles.reshape(-1, 3), lens).reshape(read.spline.poles.shape)
        spline = replace(read.spline, poles=poles)
        of_kind = face.of_lens(lens)
        return self.known.setdefault(of_kind, spline) is not spline and self.known[of_kind].is_same(spline)


def _known(face: Any, points: _Points) -> Bool[np.ndarray, " n"]:
    """True for points in a direction in which a face, or that of the nearest lens, is known."""
    if isinstance(face, PlacedFace):
        return face.known(points)
    return np.asarray(face.within(face.known, points))


def _between(knots: Float[np.ndarray, " k"], low: float, high: float) -> Float[np.ndarray, " p"]:
    """Two places between all neighbouring knots from ``low`` to ``high``, at least as many as for a few spans."""
    ends = np.unique(np.clip(knots, low, high))
    if len(ends) <= _LEAST_SPANS:
        ends = np.linspace(low, high, _LEAST_SPANS + 1)
    return np.asarray((ends[:-1, None] + _OF_SPAN * np.diff(ends)[:, None]).ravel())


def _crossed(u: Float[np.ndarray, " p"], v: Float[np.ndarray, " q"]) -> _Places:
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)


def _knots_of(curve: Any) -> int:
    return int(curve.NbKnots()) if str(curve.GetType()).endswith("BSplineCurve") else 0


def _open_edges(faces: Sequence[Any]) -> int:
    """Edges that join neither two faces nor the two ends of one."""
    edges = TopTools_IndexedMapOfShape()
    uses = list[int]()
    for face in faces:
        for edge in map(TopoDS.Edge_s, explored(face, TopAbs_ShapeEnum.TopAbs_EDGE)):
            if not BRep_Tool.Degenerated_s(edge):
                uses.append(edges.Add(edge))
    return int(np.sum(np.bincount(uses, minlength=2)[1:] != 2))
