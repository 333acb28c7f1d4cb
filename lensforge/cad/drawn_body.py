"""The body of a linear lens: the section between its profiles, extruded along y, as solid and as mesh.

An arc of a profile is a spline through its points over the angle from z, of as many nodes as its tolerance needs; the
optical faces of the solid are its surfaces of linear extrusion, exact along y. The body stands on two strips in z = 0.
In the mesh the profiles are polygons, and no vertex lies between the ends.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge, BRepBuilderAPI_MakeFace, BRepBuilderAPI_MakeVertex
from OCP.BRepPrimAPI import BRepPrimAPI_MakePrism
from OCP.BRepTools import BRepTools
from OCP.gp import gp_Pnt, gp_Vec
from OCP.TopoDS import TopoDS
from scipy.interpolate import BSpline, make_interp_spline

from lensforge.cad.body_export import BodyProof
from lensforge.cad.boundary import optical_name
from lensforge.cad.edges import curve_of, wire
from lensforge.cad.face_tolerance import MAX_NODES, FaceTolerance
from lensforge.cad.form_error import FormError, face_points, form_error
from lensforge.cad.mesh import BodyMesh, check_closed
from lensforge.cad.mesh_files import parse_3mf, parse_stl
from lensforge.cad.plan import RIM
from lensforge.cad.solid import Solid, uniquely_named
from lensforge.cad.step import parse_step
from lensforge.errors import InputError
from lensforge.scene.section_arcs import FaceArc, points_along
from lensforge.surfaces.drawn_profile import DrawnFace

END_FACE = "END"
_DEGREE = 7
_LEAST_NODES = 24
_MORE = 1.3  # nodes of a finer spline over those of one that misses its tolerance
_SAMPLES = 4001  # angles at which a profile is looked at
_AIM = 0.9  # of the tolerances
# of the strips of the mesh, which cost little: rays are judged by normals that are interpolated across them
_CHORD_MM = 1e-4
_NORMAL_RAD = 3e-5
_ALONG = 3  # places along y at which a face is compared

_Points = Float[np.ndarray, "n 2"]


@dataclass(frozen=True, eq=False)
class DrawnBody:
    """Arcs of the section by the names of their faces in the solid, and the nodes of the splines of each face of the
    lens; mesh and solid; ``chord_mm``: of the facets.
    """

    arcs: Mapping[str, FaceArc]
    nodes: Mapping[str, int]
    mesh: BodyMesh
    chord_mm: float
    solid: Solid

    def prove(self, step: bytes, stl: bytes, threemf: bytes) -> BodyProof:
        """Read the files of the body back, and compare its faces with the profiles."""
        solid = replace(parse_step(step), is_prism=True)
        form = {name: _read_error(arc.face, solid.faces[name]) for name, arc in self.arcs.items()}
        return BodyProof(solid, check_closed(*parse_stl(stl)), check_closed(*parse_3mf(threemf)), form)


def drawn_body(
    cavity: Sequence[FaceArc],
    envelope: Sequence[FaceArc],
    length_mm: float,
    tolerance: FaceTolerance,
    nodes: int | None = None,
) -> DrawnBody:
    """The body between two sides of a section, each from -x to +x; ``nodes``: of all splines, by default as many as
    their ``tolerance`` needs.

    Raises :class:`InputError` where the sides meet.
    """
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _SAMPLES)
    outer, inner = (np.linalg.norm(points_along(arcs, angles), axis=1) for arcs in (envelope, cavity))
    thinnest = float((outer - inner).min())
    if thinnest <= 0.0:
        raise InputError(
            f"wall = {thinnest:.4g} mm: the {' and '.join(_names(envelope))} profile must lie outside the "
            f"{' and '.join(_names(cavity))} one; raise constraints.min_thickness_mm and design again"
        )
    sides = [_Side.of(arcs) for arcs in (envelope, cavity)]
    splines = [side.splines(tolerance, nodes) for side in sides]
    counts: dict[str, int] = {}
    for arc, spline in zip((*envelope, *cavity), (*splines[0], *splines[1]), strict=True):
        counts[arc.name] = max(counts.get(arc.name, 0), len(spline.c))
    mesh, chord_mm = _mesh(sides, length_mm)
    labels = uniquely_named([(optical_name(arc.name), arc) for arc in (*envelope, *cavity)])
    return DrawnBody(labels, counts, mesh, chord_mm, _solid(sides, splines, length_mm))


def _names(arcs: Sequence[FaceArc]) -> list[str]:
    return list(dict.fromkeys(arc.name for arc in arcs))


@dataclass(frozen=True)
class _Side:
    """One side of the section: its arcs, and their corners (x, z) from foot to foot, which lie in z = 0."""

    arcs: tuple[FaceArc, ...]
    corners: _Points

    @staticmethod
    def of(arcs: Sequence[FaceArc]) -> "_Side":
        """The side of these arcs."""
        corners = np.concatenate([arc.face.points(np.array([arc.low_rad])) for arc in arcs])
        last = arcs[-1]
        corners = np.concatenate([corners, last.face.points(np.array([last.high_rad]))])
        corners[[0, -1], 1] = 0.0
        return _Side(tuple(arcs), corners)

    def points(self, number: int, angles: Float[np.ndarray, " n"]) -> _Points:
        """Points of an arc at angles from end to end, with its corners to the last bit."""
        points = self.arcs[number].face.points(angles)
        points[[0, -1]] = self.corners[[number, number + 1]]
        return points

    def splines(self, tolerance: FaceTolerance, nodes: int | None) -> list[BSpline]:
        """The splines (x, z) of the arcs, each over the angle."""
        return [self._spline(number, tolerance, nodes) for number in range(len(self.arcs))]

    def _spline(self, number: int, tolerance: FaceTolerance, nodes: int | None) -> BSpline:
        """The spline with the fewest nodes within ``tolerance``, or with ``nodes``."""
        arc = self.arcs[number]
        samples = arc.angles(_SAMPLES)
        count = nodes or _LEAST_NODES
        while True:
            angles = arc.angles(count)
            spline = make_interp_spline(angles, self.points(number, angles), k=_DEGREE)
            error = _error(arc.face, spline(samples), spline(samples, 1))
            within = (
                error.form_max_nm <= _AIM * tolerance.form_nm and error.normal_max_mrad <= _AIM * tolerance.normal_mrad
            )
            if within or nodes is not None or count == MAX_NODES:
                return spline
            count = min(MAX_NODES, int(np.ceil(_MORE * count)))


def _error(face: DrawnFace, points: _Points, tangents: _Points) -> FormError:
    flat = np.zeros((len(points), 3))
    normals = np.zeros((len(points), 3))
    flat[:, [0, 2]] = points
    normals[:, 0], normals[:, 2] = -tangents[:, 1], tangents[:, 0]
    return form_error(face, flat, normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _read_error(profile: DrawnFace, face: Any) -> FormError:
    """Form error of a face (TopoDS_Face) as read back, at three places along y."""
    low, high, start, end = BRepTools.UVBounds_s(face)
    across, along = np.meshgrid(np.linspace(low, high, _SAMPLES // _ALONG), np.linspace(start, end, _ALONG))
    points, normals = face_points(face, np.column_stack([across.ravel(), along.ravel()]))
    points[:, 1] = 0.0
    return form_error(profile, points, normals)


def _solid(sides: Sequence[_Side], splines: Sequence[Sequence[BSpline]], length_mm: float) -> Solid:
    """The prism of the section; its faces by name."""
    front = -0.5 * length_mm
    vertices = [
        [BRepBuilderAPI_MakeVertex(gp_Pnt(x, front, z)).Vertex() for x, z in side.corners.tolist()] for side in sides
    ]
    edges = [
        [
            BRepBuilderAPI_MakeEdge(
                curve_of(BSpline(spline.t, np.insert(spline.c, 1, front, axis=1), _DEGREE)), *ends
            ).Edge()
            for spline, ends in zip(of_side, pairwise(corners), strict=True)
        ]
        for of_side, corners in zip(splines, vertices, strict=True)
    ]
    left, right = (BRepBuilderAPI_MakeEdge(*(corners[end] for corners in vertices)).Edge() for end in (0, -1))
    around = wire([*edges[0], right, *edges[1][::-1], left])
    prism = BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(around, True).Face(), gp_Vec(0.0, length_mm, 0.0))
    named = [
        (optical_name(arc.name), prism.Generated(edge).First())
        for side, of_side in zip(sides, edges, strict=True)
        for arc, edge in zip(side.arcs, of_side, strict=True)
    ]
    named += [(RIM, prism.Generated(edge).First()) for edge in (left, right)]
    named += [(END_FACE, prism.FirstShape()), (END_FACE, prism.LastShape())]
    faces = uniquely_named([(name, TopoDS.Face_s(face)) for name, face in named])
    return Solid(TopoDS.Solid_s(prism.Shape()), faces, is_prism=True)


def _mesh(sides: Sequence[_Side], length_mm: float) -> tuple[BodyMesh, float]:
    """The mesh, and the largest distance (mm) of its facets from the profiles."""
    import manifold3d

    outer, inner = ([_polygon(side, number) for number in range(len(side.arcs))] for side in sides)
    outwards, inwards = (_joined(polygons) for polygons in (outer, inner))
    section = np.concatenate([outwards, inwards[::-1]])
    count = len(section)
    names = [*_strips(sides[0], outer), RIM, *_strips(sides[1], inner)[::-1], RIM]
    here = np.arange(count)
    following = np.roll(here, -1)
    walls = [
        np.stack(corners, 1)
        for corners in ((here, following, here + count), (following, following + count, here + count))
    ]
    end = np.asarray(manifold3d.triangulate([np.ascontiguousarray(section[::-1])]))
    front = count - 1 - end
    triangles = np.concatenate([*walls, front, front[:, ::-1] + count])
    labels = np.array([*names, *names, *[END_FACE] * (2 * len(front))])
    places = [np.insert(section, 1, side * length_mm, axis=1) for side in (-0.5, 0.5)]
    known, faces = np.unique(labels, return_inverse=True)
    mesh = BodyMesh(np.concatenate(places), triangles, faces, tuple(map(str, known)), count)
    chord = max(
        _chord_mm(arc.face, polygon)
        for side, polygons in zip(sides, (outer, inner), strict=True)
        for arc, polygon in zip(side.arcs, polygons, strict=True)
    )
    return (mesh if mesh.volume() > 0.0 else BodyMesh(*_turned(mesh))), chord


def _turned(mesh: BodyMesh) -> tuple[Any, ...]:
    return mesh.vertices, mesh.triangles[:, ::-1], mesh.face, mesh.names, mesh.rings


def _joined(polygons: Sequence[Float[np.ndarray, "_ 2"]]) -> _Points:
    """The points of arcs one after another, each corner once."""
    return np.concatenate([polygons[0], *(polygon[1:] for polygon in polygons[1:])])


def _strips(side: _Side, polygons: Sequence[Float[np.ndarray, "_ 2"]]) -> list[str]:
    """Name of the face of each side of a polygon."""
    pieces = zip(side.arcs, polygons, strict=True)
    return [optical_name(arc.name) for arc, polygon in pieces for _ in polygon[1:]]


def _polygon(side: _Side, number: int) -> _Points:
    """Points of an arc whose sides stay within ``_CHORD_MM``, and normals that are interpolated between them within
    ``_NORMAL_RAD``: both errors go as the squared length.
    """
    arc = side.arcs[number]
    angles = arc.angles(_SAMPLES)
    points = arc.face.points(angles)
    tangents = np.gradient(points, angles, axis=0)
    speed = np.linalg.norm(tangents, axis=1)
    turned = np.gradient(np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0])), angles)
    by_chord = np.abs(turned) * speed / _CHORD_MM
    by_normal = np.abs(np.gradient(turned, angles)) / _NORMAL_RAD
    density = np.sqrt(np.maximum(by_chord, by_normal) / (8.0 * _AIM * _AIM)) + _LEAST_NODES
    steps = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(angles))])
    wanted = np.linspace(0.0, steps[-1], int(np.ceil(steps[-1])) + 1)
    return side.points(number, np.interp(wanted, steps, angles))


def _chord_mm(face: DrawnFace, polygon: _Points) -> float:
    """Largest distance (mm) of the middles of a polygon's sides from its profile."""
    middles = np.array([0.5 * (start + end) for start, end in pairwise(polygon)])
    flat = np.insert(middles, 1, 0.0, axis=1)
    radius = np.linalg.norm(flat, axis=1)
    ways = flat / radius[:, None]
    off = np.abs(radius - face.radius(ways)) * np.sum(face.normal(ways) * ways, axis=1)
    return float(off.max())
