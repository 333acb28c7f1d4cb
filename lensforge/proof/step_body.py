"""The body in a STEP file, by the CAD kernel: its faces, its size, and the first hits of rays.

Faces need no names: if several lie on one side they are identified by OPTICAL_ and the name, or else by shape.

The kernel's own box of a trimmed face is that of the whole surface beyond the trim, and its distance to a plane takes
seconds for each side; so the box is that of all edges, and of the tops of the faces, searched from coarse to fine.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from OCP.Bnd import Bnd_Box
from OCP.BRep import BRep_Tool
from OCP.BRepAdaptor import BRepAdaptor_Surface
from OCP.BRepBndLib import BRepBndLib
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeFace
from OCP.BRepTopAdaptor import BRepTopAdaptor_FClass2d
from OCP.GeomAbs import GeomAbs_SurfaceType
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt, gp_Pnt2d, gp_Vec
from OCP.IFSelect import IFSelect_ReturnStatus
from OCP.IntCurvesFace import IntCurvesFace_Intersector
from OCP.IntCurveSurface import IntCurveSurface_TransitionOnCurve
from OCP.STEPControl import STEPControl_Reader
from OCP.TopAbs import TopAbs_ShapeEnum, TopAbs_State
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS
from OCP.TopTools import TopTools_IndexedMapOfShape
from scipy.ndimage import maximum_filter, minimum_filter

from lensforge.errors import InputError
from lensforge.proof.facet_casting import Leg
from lensforge.proof.file_form import DesignedFile, FileForm
from lensforge.proof.optical_faces import NO_FACE, USUAL_LENS, OpticalFaces, faces_away
from lensforge.proof.part_mesh import as_box
from lensforge.proof.sequential_cast import SurfaceHits
from lensforge.proof.step_form import ReadFace, step_form
from lensforge.results import BodySize
from lensforge.results.brep_size import volume_and_area
from lensforge.results.file_bounds import made_here, require_small_step
from lensforge.results.files import temporary_file
from lensforge.results.refined_maximum import NODES, refined_maximum

_TOP_TOLERANCE_MM = 1e-6  # what the box of a face exceeds that of the edges by rounding
# Points along u and v: as many as the knots of a spline, whose bumps are three knots wide. About so many of their tops
# the window is halved as often: a top is then missed by 1e-5 of its height above its neighbours.
_LEAST_COARSE = 48
_MOST_COARSE = 400
_TOPS = 64
_ROUNDS = 8


def bounds_mm(shape: Any, faces: Sequence[Any]) -> tuple[list[float], list[float]]:
    """Least and largest corner of the box around ``shape``, whose ``faces`` (TopoDS_Face) are given."""
    edges = TopTools_IndexedMapOfShape()
    box = Bnd_Box()
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
        for side in np.nonzero(np.r_[-beyond[:3], beyond[3:]] > _TOP_TOLERANCE_MM)[0]:
            sign = 1.0 if side >= 3 else -1.0
            sides[side] = sign * _reach(face, int(side) % 3, sign, sign * sides[side])
    return sides[:3].tolist(), sides[3:].tolist()


def _reach(face: Any, axis: int, sign: float, known: float) -> float:
    """Largest coordinate times ``sign`` along an axis over ``face`` within its trim, or ``known`` if that is more.

    Every sample above its neighbours is a start: the highest of a wavy face may lie beside another top.
    """
    surface = BRepAdaptor_Surface(face)
    trim = BRepTopAdaptor_FClass2d(face, 1e-9)
    low = np.array([surface.FirstUParameter(), surface.FirstVParameter()])
    sides = np.array([surface.LastUParameter(), surface.LastVParameter()]) - low

    def untrimmed(places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        points = (surface.Value(u, v) for u, v in (low + places * sides).tolist())
        return sign * np.array([(point.X(), point.Y(), point.Z())[axis] for point in points])

    def highest(places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
        """Height of the highest place of every window inside the trim, all others NaN: the trim takes the time."""
        values = untrimmed(places)
        heights = np.full(values.shape, np.nan)
        for window in np.arange(len(places)).reshape(-1, len(NODES)):
            for row in window[np.argsort(-values[window], kind="stable")]:
                u, v = low + places[row] * sides
                if trim.Perform(gp_Pnt2d(u, v)) != TopAbs_State.TopAbs_OUT:
                    heights[row] = values[row]
                    break
        return heights

    along = np.linspace(0.0, 1.0, _samples(surface))
    read = ReadFace(face)
    places = np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)
    values = sign * read.on_grid(*(low[:, None] + sides[:, None] * along))[:, axis]
    heights = values.reshape(len(along), -1)
    least, most = (of(heights, 3, mode="nearest") for of in (minimum_filter, maximum_filter))
    # A top of the trimmed face alone is on an edge; others rise less above their samples than these above neighbours.
    tops = places[np.flatnonzero((heights == most) & (2.0 * heights - least > known))]
    within = partial(np.clip, a_min=0.0, a_max=1.0)
    around = within(tops[:, None] + along[1] * NODES).reshape(-1, 2)
    values = highest(around)
    inside = np.isfinite(values)
    if not inside.any():
        return known
    starts = around[inside], values[inside], along[1]
    return max(known, refined_maximum(highest, *starts, starts=_TOPS, rounds=_ROUNDS, within=within)[1])


def _samples(surface: Any) -> int:
    """Parameters along u and v that miss no bump of ``surface``."""
    if surface.GetType() != GeomAbs_SurfaceType.GeomAbs_BSplineSurface:
        return _LEAST_COARSE
    return int(np.clip(max(surface.NbUKnots(), surface.NbVKnots()), _LEAST_COARSE, _MOST_COARSE))


_TOLERANCE_MM = 1e-7  # within which the CAD kernel takes two points as one
_FAR_MM = 1e6
_FLAT = 1e-12  # component of a direction, for boxes only
_SKIN_MM = 1e-4  # hits nearer than this are the point just left
# The kernel looks for hits between 50 samples along u and v at most. Where a face of several on one side is steep, they
# lie so far apart that a ray takes 40 ms; in pieces of so many knots, cast where it meets their boxes, 1 ms. On a usual
# lens, hit at the same places to 1e-15 mm, 15 or 60 knots take 1.2 times as long, and a face as a whole 1.3 times.
_KNOTS_OF_PIECE = 30
_MOST_FACES = 10_000  # every ray is cast at each of them: a lens has 6, one on a clamp with screw holes some hundred


@dataclass(frozen=True)
class _Pieces:
    """Pieces of faces for casting: by number, the face, its box (mm), and its intersector by the kernel.

    ``trims``: of faces cut into rectangles of u and v; None: the intersector knows the face's own.
    """

    faces: list[int]
    boxes: Float[np.ndarray, "p 2 3"]
    intersectors: list[Any]
    trims: list[Any]

    @staticmethod
    def of(faces: Sequence[Any]) -> "_Pieces":
        """All of ``faces`` (TopoDS_Face), splines cut into pieces of some knots, planes without their edges."""
        numbers = list[int]()
        boxes = list[Any]()
        cast = list[Any]()
        trims = list[Any]()
        for number, face in enumerate(faces):
            pieces = _cut(face)
            trims.append(None if pieces[0] is face else BRepTopAdaptor_FClass2d(face, _TOLERANCE_MM))
            numbers += [number] * len(pieces)
            boxes += map(_around, pieces)
            cast += [IntCurvesFace_Intersector(piece, _TOLERANCE_MM) for piece in pieces]
        return _Pieces(numbers, np.array(boxes), cast, trims)

    def met(self, origin: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]) -> Iterator[tuple[float, int]]:
        """Pieces whose boxes a ray meets, nearest first: distance, and number of the piece."""
        slopes = np.where(np.abs(direction) < _FLAT, _FLAT, direction)
        ends = (self.boxes - origin) / slopes
        enters = ends.min(axis=1).max(axis=1)
        leaves = ends.max(axis=1).min(axis=1)
        met = np.flatnonzero(leaves >= np.maximum(enters, 0.0))
        met = met[np.argsort(enters[met], kind="stable")]
        return zip(enters[met].tolist(), met.tolist(), strict=True)

    def trimmed(self, face: int, u: float, v: float) -> bool:
        """True if a place on a face lies outside its trim."""
        trim = self.trims[face]
        return trim is not None and trim.Perform(gp_Pnt2d(u, v)) == TopAbs_State.TopAbs_OUT


def _cut(face: Any) -> list[Any]:
    """The untrimmed surface of a spline in rectangles of some knots on the side of ``face``; a plane in one piece.

    Other faces stay whole. The kernel's intersector takes 1.4 ms for a place in a plane whose edge is a spline.
    """
    kind = BRepAdaptor_Surface(face)
    surface = BRep_Tool.Surface_s(face)
    pieces = []
    spline = kind.GetType() == GeomAbs_SurfaceType.GeomAbs_BSplineSurface
    if not spline and kind.GetType() != GeomAbs_SurfaceType.GeomAbs_Plane:
        return [face]
    bounds = ReadFace(face).bounds
    knots = (kind.NbUKnots(), kind.NbVKnots()) if spline else (1, 1)
    along_u, along_v = (
        np.linspace(low, high, 1 + -(-count // _KNOTS_OF_PIECE)).tolist()
        for low, high, count in zip(bounds[::2], bounds[1::2], knots, strict=True)
    )
    for (u, to_u), (v, to_v) in product(pairwise(along_u), pairwise(along_v)):
        piece = BRepBuilderAPI_MakeFace(surface, u, to_u, v, to_v, _TOLERANCE_MM).Face()
        piece.Orientation(face.Orientation())
        pieces.append(piece)
    return pieces


def _around(face: Any) -> Float[np.ndarray, "2 3"]:
    """Box (mm) around a face, that of a spline's control points."""
    box = Bnd_Box()
    BRepBndLib.Add_s(face, box, False)
    return np.reshape(box.Get(), (2, 3))


class StepBody:
    """The only solid in the bytes of a STEP file, in mm, with its ``optical`` faces.

    Raises :class:`InputError` if they hold anything else.
    """

    def __init__(self, step: bytes, optical: OpticalFaces = USUAL_LENS) -> None:
        self.optical = optical
        numbers = {f"OPTICAL_{name.upper()}": number for number, name in enumerate(optical.names)}
        self._solid, faces, names = _only_solid(step, "STEP", named=optical.inverse_radii is not None)
        self._numbers = np.array([numbers.get(name, NO_FACE) for name in names])
        self._faces = [TopoDS.Face_s(face) for face in faces]
        self._surfaces = [BRepAdaptor_Surface(face) for face in self._faces]
        self._pieces = _Pieces.of(self._faces)

    def size(self) -> BodySize:
        """Volume, area and box of the solid, by integrals over its faces and by points on them; takes a second."""
        corners = bounds_mm(self._solid, self._faces)
        volume, area = volume_and_area(self._solid, by_sectors=self.optical.end_mm is not None)
        return BodySize(volume_mm3=volume, area_mm2=area, bounds_mm=as_box(np.array(corners)))

    def form(self, file: DesignedFile) -> FileForm:
        """Form of the body, read from ``file``."""
        return step_form(file, self._faces)

    def surface_hits(self, leg: Leg, inside: Bool[np.ndarray, " n"] | None = None) -> SurfaceHits:
        """First hit of each ray, about a millisecond each; ``inside`` is not needed."""
        count = len(leg.origins)
        faces = np.zeros(count, dtype=np.int64)
        found, leaving = np.zeros((2, count), dtype=bool)
        points, normals = np.zeros((2, count, 3))
        for row in range(count):
            if (hit := self._first_hit(leg, row)) is not None:
                faces[row] = hit[0]
                found[row] = True
                leaving[row] = hit[1]
                points[row], normals[row] = self._point_and_normal(hit[0], *hit[2:])
        outwards = np.where((np.sum(normals * leg.directions, axis=1) > 0.0) == leaving, 1.0, -1.0)[:, None]
        away = faces_away(points, outwards * normals)
        numbers = self._sorted(faces, points, outwards * normals)
        return SurfaceHits(found, points, normals, leaving, away, numbers, np.full(count, _SKIN_MM), np.zeros(count))

    def _sorted(
        self, faces: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
    ) -> Int[np.ndarray, " n"]:
        """Number of the optical face on which each hit lies: by the name of the file's face, else by its place."""
        numbers = self.optical.sorted(points, normals)[0]
        named = self._numbers[faces]
        return np.where((named != NO_FACE) & (numbers != NO_FACE), named, numbers)

    def _first_hit(self, leg: Leg, row: int) -> tuple[int, bool, float, float] | None:
        """First face of the file hit by a ray, True if the ray leaves the body there, and its parameters."""
        line = gp_Lin(gp_Pnt(*leg.origins[row].tolist()), gp_Dir(*leg.directions[row].tolist()))
        nearest = np.inf
        hit: tuple[int, bool, float, float] | None = None
        for enters, piece in self._pieces.met(leg.origins[row], leg.directions[row]):
            if enters > nearest:
                break
            face = self._pieces.faces[piece]
            crossings = self._pieces.intersectors[piece]
            crossings.Perform(line, float(leg.beyond[row]), _FAR_MM)
            for k in range(1, crossings.NbPnt() + 1):
                place = crossings.UParameter(k), crossings.VParameter(k)
                if crossings.WParameter(k) < nearest and not self._pieces.trimmed(face, *place):
                    nearest = crossings.WParameter(k)
                    out = crossings.Transition(k) == IntCurveSurface_TransitionOnCurve.IntCurveSurface_Out
                    hit = face, out, *place
        return hit

    def _point_and_normal(self, face: int, u: float, v: float) -> tuple[np.ndarray, np.ndarray]:
        point = gp_Pnt()
        along_u = gp_Vec()
        along_v = gp_Vec()
        self._surfaces[face].D1(u, v, point, along_u, along_v)
        normal = along_u.Crossed(along_v)
        unit = np.array([normal.X(), normal.Y(), normal.Z()]) / normal.Magnitude()
        return np.array([point.X(), point.Y(), point.Z()]), unit


def form_in_step(file: DesignedFile) -> FileForm:
    """Form of the body, or of the loose faces, in a STEP file."""
    if file.trimmed:
        faces = _only_solid(file.content, file.name, named=False)[1]
    else:
        faces = _parts(_read(file.content, file.name).OneShape(), TopAbs_ShapeEnum.TopAbs_FACE)
    return step_form(file, list(map(TopoDS.Face_s, faces)))


def _only_solid(step: bytes, origin: str, *, named: bool) -> tuple[Any, list[Any], list[str]]:
    """The only solid (TopoDS_Shape), its faces and their names; without ``named`` all names are ""."""
    reader = _read(step, origin)
    shape = reader.OneShape()
    solids = _parts(shape, TopAbs_ShapeEnum.TopAbs_SOLID)
    if len(solids) != 1:
        raise InputError(f"{origin}: holds {len(solids)} solids, a lens is one; export it again")
    faces, every = (_parts(parent, TopAbs_ShapeEnum.TopAbs_FACE) for parent in (solids[0], shape))
    if len(faces) > _MOST_FACES:
        raise InputError(f"{origin}: {len(faces)} faces, at most {_MOST_FACES} are cast; export it again")
    if len(every) > len(faces):
        raise InputError(f"{origin}: holds {len(every) - len(faces)} faces beside its solid; export it again")
    return solids[0], faces, [_name_of(reader, face) if named else "" for face in faces]


def _read(step: bytes, origin: str) -> Any:
    """The CAD kernel's reader, which takes only a path, with the file's contents transferred."""
    if not made_here(step):
        require_small_step(step, origin, "export it again")
    reader = STEPControl_Reader()
    try:
        with temporary_file(step, "part.step") as path:
            read = reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
            transferred = read and reader.TransferRoots() > 0
    except Exception as error:  # the kernel raises whatever its parser does
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{origin}: not readable ({reason}); export it again") from error
    if not transferred:
        raise InputError(f"{origin}: not readable; export it again")
    return reader


def _name_of(reader: Any, face: Any) -> str:
    entity = reader.WS().TransferReader().EntityFromShapeResult(face, 1)
    try:
        return str(entity.Name().ToCString())
    except (AttributeError, UnicodeDecodeError):  # no entity of the file, none with a name, or not in ASCII
        return ""


def _parts(shape: Any, kind: Any) -> list[Any]:
    """The distinct parts of ``shape`` of a kind, in their order."""
    parts = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, parts)
    return [parts.FindKey(k + 1) for k in range(parts.Extent())]
