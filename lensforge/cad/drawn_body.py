"""The body of a linear lens: the section between its two profiles, extruded along y, as solid and as mesh.

A profile is a spline through its points over the angle from z, of as many nodes as its tolerance needs; the optical
faces of the solid are its surfaces of linear extrusion, exact along y. The body stands on two strips in z = 0. In the
mesh the profiles are polygons, and no vertex lies between the ends.
"""

from collections.abc import Mapping
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
    """Profiles by the names of their faces, the nodes of their splines, mesh and solid; ``chord_mm``: of its facets."""

    surfaces: Mapping[str, DrawnFace]
    nodes: Mapping[str, int]
    mesh: BodyMesh
    chord_mm: float
    solid: Solid

    def prove(self, step: bytes, stl: bytes, threemf: bytes) -> BodyProof:
        """Read the files of the body back, and compare its faces with the profiles."""
        solid = replace(parse_step(step), is_prism=True)
        form = {name: _read_error(face, solid.faces[optical_name(name)]) for name, face in self.surfaces.items()}
        return BodyProof(solid, check_closed(*parse_stl(stl)), check_closed(*parse_3mf(threemf)), form)


def drawn_body(
    inner: DrawnFace, outer: DrawnFace, length_mm: float, tolerance: FaceTolerance, nodes: int | None = None
) -> DrawnBody:
    """The body between two profiles; ``nodes``: of both splines, by default as many as their ``tolerance`` needs.

    Raises :class:`InputError` where the profiles meet.
    """
    angles = _angles(_SAMPLES)
    thinnest = float(
        (np.linalg.norm(outer.points(angles), axis=1) - np.linalg.norm(inner.points(angles), axis=1)).min()
    )
    if thinnest <= 0.0:
        raise InputError(
            f"wall = {thinnest:.4g} mm: the outer profile must lie outside the inner one; raise "
            "constraints.min_thickness_mm and design again"
        )
    surfaces = {"inner": inner, "outer": outer}
    splines = {name: _spline(face, tolerance, nodes) for name, face in surfaces.items()}
    counts = {name: len(spline.c) for name, spline in splines.items()}
    mesh, chord_mm = _mesh(surfaces, length_mm)
    return DrawnBody(surfaces, counts, mesh, chord_mm, _solid(splines, length_mm))


def _angles(count: int) -> Float[np.ndarray, " n"]:
    return np.linspace(-0.5 * np.pi, 0.5 * np.pi, count)


def _on_plane(points: _Points) -> _Points:
    """The points with both ends in z = 0, to the last bit."""
    points[[0, -1], 1] = 0.0
    return points


def _spline(face: DrawnFace, tolerance: FaceTolerance, nodes: int | None) -> BSpline:
    """The spline (x, z) over the angle with the fewest nodes within ``tolerance``, or with ``nodes``."""
    count = nodes or _LEAST_NODES
    while True:
        angles = _angles(count)
        spline = make_interp_spline(angles, _on_plane(face.points(angles)), k=_DEGREE)
        error = _error(face, spline(_angles(_SAMPLES)), spline(_angles(_SAMPLES), 1))
        within = error.form_max_nm <= _AIM * tolerance.form_nm and error.normal_max_mrad <= _AIM * tolerance.normal_mrad
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


def _solid(splines: Mapping[str, BSpline], length_mm: float) -> Solid:
    """The prism of the section; its faces by name."""
    front = -0.5 * length_mm
    ends = {
        name: [BRepBuilderAPI_MakeVertex(gp_Pnt(x, front, 0.0)).Vertex() for x in spline.c[[0, -1], 0].tolist()]
        for name, spline in splines.items()
    }
    edges = {
        optical_name(name): BRepBuilderAPI_MakeEdge(
            curve_of(BSpline(spline.t, np.insert(spline.c, 1, front, axis=1), _DEGREE)), *ends[name]
        ).Edge()
        for name, spline in splines.items()
    }
    feet = [BRepBuilderAPI_MakeEdge(*pair).Edge() for pair in zip(ends["inner"], ends["outer"], strict=True)]
    around = wire([edges[optical_name("outer")], feet[1], edges[optical_name("inner")], feet[0]])
    prism = BRepPrimAPI_MakePrism(BRepBuilderAPI_MakeFace(around, True).Face(), gp_Vec(0.0, length_mm, 0.0))
    named = [(name, prism.Generated(edge).First()) for name, edge in edges.items()]
    named += [(RIM, prism.Generated(edge).First()) for edge in feet]
    named += [(END_FACE, prism.FirstShape()), (END_FACE, prism.LastShape())]
    faces = uniquely_named([(name, TopoDS.Face_s(face)) for name, face in named])
    return Solid(TopoDS.Solid_s(prism.Shape()), faces, is_prism=True)


def _mesh(surfaces: Mapping[str, DrawnFace], length_mm: float) -> tuple[BodyMesh, float]:
    """The mesh, and the largest distance (mm) of its facets from the profiles."""
    import manifold3d

    outer = _polygon(surfaces["outer"])
    inner = _polygon(surfaces["inner"])[::-1]
    section = np.concatenate([outer, inner])
    count = len(section)
    names = [*[optical_name("outer")] * (len(outer) - 1), RIM, *[optical_name("inner")] * (len(inner) - 1), RIM]
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
    chord = max(_chord_mm(surfaces["outer"], outer), _chord_mm(surfaces["inner"], inner))
    return (mesh if mesh.volume() > 0.0 else BodyMesh(*_turned(mesh))), chord


def _turned(mesh: BodyMesh) -> tuple[Any, ...]:
    return mesh.vertices, mesh.triangles[:, ::-1], mesh.face, mesh.names, mesh.rings


def _polygon(face: DrawnFace) -> _Points:
    """Points of a profile whose sides stay within ``_CHORD_MM``, and normals that are interpolated between them within
    ``_NORMAL_RAD``: both errors go as the squared length.
    """
    angles = _angles(_SAMPLES)
    points = face.points(angles)
    tangents = np.gradient(points, angles, axis=0)
    speed = np.linalg.norm(tangents, axis=1)
    turned = np.gradient(np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0])), angles)
    by_chord = np.abs(turned) * speed / _CHORD_MM
    by_normal = np.abs(np.gradient(turned, angles)) / _NORMAL_RAD
    density = np.sqrt(np.maximum(by_chord, by_normal) / (8.0 * _AIM * _AIM)) + _LEAST_NODES
    steps = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(angles))])
    wanted = np.linspace(0.0, steps[-1], int(np.ceil(steps[-1])) + 1)
    return _on_plane(face.points(np.interp(wanted, steps, angles)))


def _chord_mm(face: DrawnFace, polygon: _Points) -> float:
    """Largest distance (mm) of the middles of a polygon's sides from its profile."""
    middles = np.array([0.5 * (start + end) for start, end in pairwise(polygon)])
    flat = np.insert(middles, 1, 0.0, axis=1)
    radius = np.linalg.norm(flat, axis=1)
    ways = flat / radius[:, None]
    off = np.abs(radius - face.radius(ways)) * np.sum(face.normal(ways) * ways, axis=1)
    return float(off.max())
