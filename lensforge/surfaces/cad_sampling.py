"""Sampling of a CAD face: the named faces of a file, rays from the origin on them, and the spline through the hits.

All of it is work of a child process. The CAD kernel finds the crossings, Newton steps on its surfaces make them
exact.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from OCP.BRep import BRep_Tool
from OCP.BRepTopAdaptor import BRepTopAdaptor_FClass2d
from OCP.gp import gp_Dir, gp_Lin, gp_Pnt, gp_Pnt2d, gp_Vec
from OCP.IGESCAFControl import IGESCAFControl_Reader
from OCP.IntCurvesFace import IntCurvesFace_Intersector
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TColStd import TColStd_SequenceOfAsciiString
from OCP.TopAbs import TopAbs_State
from scipy.interpolate import make_interp_spline
from scipy.spatial import cKDTree

from lensforge.errors import InputError
from lensforge.results.files import write_json
from lensforge.results.sandbox import serve
from lensforge.surfaces.chart_spline import HALF_WIDTH, ChartSpline, bent_radius
from lensforge.surfaces.imported_face import FOUND, JOB, SPLINE, place_of
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.step_file import parts_of, shapes_in
from lensforge.surfaces.surface import to_sphere

_REMEDY = "export it again from CAD"
_MOST_FACES = 10_000
_UNITS = {"millimetre": "mm", "mm": "mm", "inch": "inches", "in": "inches", "inches": "inches", "metre": "metres"}


@dataclass(frozen=True)
class NamedFace:
    """A face (TopoDS_Face), its name ("" if unnamed) and its number in the file, counted from 1."""

    face: Any
    name: str
    number: int

    @property
    def title(self) -> str:
        """Its name, or its number."""
        return f"face {self.name}" if self.name else f"face {self.number}"


def _faces_in(path: Path, iges: bool, origin: str) -> tuple[list[NamedFace], str]:
    """Faces of the file at ``path``, and the unit in which it is written."""
    reader = IGESCAFControl_Reader() if iges else STEPCAFControl_Reader()
    refusal = f"{origin}: not readable as {'IGES' if iges else 'STEP'}; {_REMEDY}"
    faces: list[NamedFace] = []
    for name, shape, named in shapes_in(reader, path, refusal):
        every = [] if shape.IsNull() else parts_of(shape, "FACE")
        alone = name if len(every) == 1 else ""  # a face that is a product of its own
        for face in every:
            face_name = next((known for known, named_face in named.items() if named_face.IsSame(face)), alone)
            faces.append(NamedFace(face, face_name, len(faces) + 1))
    if not 1 <= len(faces) <= _MOST_FACES:
        raise InputError(f"{origin}: {len(faces)} faces, 1 to {_MOST_FACES} are read; {_REMEDY}")
    if iges:
        stated = reader.IGESModel().GlobalSection().UnitName()
        unit = "mm" if stated is None else stated.ToCString()
    else:
        lengths, angles, solid_angles = (TColStd_SequenceOfAsciiString() for _ in range(3))
        reader.ChangeReader().FileUnits(lengths, angles, solid_angles)
        unit = lengths.Value(1).ToCString() if lengths.Length() else "mm"
    unit = unit.strip().lower()
    return faces, _UNITS.get(unit, unit)


# Of a face's edge, to which a ray still meets it: rims lie in z = 0 to the tolerance of their file.
_TOLERANCE_MM = 1e-4
_FAR_MM = 1e6
_SAME_MM = 1e-3  # two crossings nearer than this are one, on an edge that two faces share
_NEWTON_STEPS = 3
_STEPS_BESIDE = 4  # Newton steps from the crossing of a neighbouring ray
_RESTS_MM = 1e-6  # a last step below this has converged
_BESIDE = 0.2  # relative change of the radius by which it is still the same crossing
_SINGULAR = 1e-12  # of the product of the three lengths: the surface has a pole here


class FaceCast:
    """Rays from the origin, in the coordinates of the lens, on ``faces`` (TopoDS_Face) moved by ``shift_mm``."""

    def __init__(self, faces: list[Any], shift_mm: Float[np.ndarray, "3"]) -> None:
        self._start = -np.asarray(shift_mm, dtype=np.float64)
        self._start_point = gp_Pnt(*self._start.tolist())
        self._casts = [IntCurvesFace_Intersector(face, _TOLERANCE_MM) for face in faces]
        self._surfaces = [BRep_Tool.Surface_s(face) for face in faces]
        self._edges = [BRepTopAdaptor_FClass2d(face, _TOLERANCE_MM) for face in faces]
        self._begun = np.empty((0, 3)), np.empty((0, 4))

    def all_mm(self, directions: Float[np.ndarray, "n 3"]) -> list[list[float]]:
        """Distances (mm) at which each ray meets a face, rising."""
        return [_apart(crossings) for crossings in self._crossings(directions)]

    def begin_at(self, directions: Float[np.ndarray, "n 3"]) -> list[list[float]]:
        """Distances as :meth:`all_mm` gives them; Newton steps from their first crossings serve neighbouring rays."""
        every = list(self._crossings(directions))
        met = [k for k, crossings in enumerate(every) if crossings]
        self._begun = _unit(directions[met]), np.array([min(every[k]) for k in met]).reshape(-1, 4)
        return [_apart(crossings) for crossings in every]

    def points(self, directions: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Distance (mm) of each ray's first crossing, exact to rounding, and the unit outward normal there.

        NaN for a ray that meets no face.
        """
        radius, normals = self._beside(directions)
        lost = np.flatnonzero(np.isnan(radius))
        first = [min(crossings, default=None) for crossings in self._crossings(directions[lost])]
        met = np.array([crossing is not None for crossing in first], dtype=bool)
        if met.any():
            crossings = np.array([crossing for crossing in first if crossing is not None])
            radius[lost[met]], normals[lost[met]], *_ = self._exact(directions[lost[met]], crossings, _NEWTON_STEPS)
        return radius, normals

    def _beside(self, directions: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Distances and normals by Newton steps from the nearest known ray's crossing; ten times the kernel's speed.

        NaN if the steps do not converge near it, within its face.
        """
        rays, crossings = self._begun
        if not len(rays):
            return np.full(len(directions), np.nan), np.full((len(directions), 3), np.nan)
        start = crossings[cKDTree(rays).query(_unit(directions))[1]]
        radius, normals, parameters, last_mm = self._exact(directions, start, _STEPS_BESIDE)
        rests = (last_mm < _RESTS_MM) & (np.abs(radius / start[:, 0] - 1.0) < _BESIDE)
        rests[rests] = self._within(parameters[rests], start[rests, 3].astype(int))
        return np.where(rests, radius, np.nan), np.where(rests[:, None], normals, np.nan)

    def _within(self, parameters: Float[np.ndarray, "n 2"], faces: Int[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        inside = TopAbs_State.TopAbs_IN
        rows = zip(parameters.tolist(), faces.tolist(), strict=True)
        return np.array([self._edges[face].Perform(gp_Pnt2d(u, v)) == inside for (u, v), face in rows], dtype=bool)

    def _exact(
        self, directions: Float[np.ndarray, "n 3"], crossings: Float[np.ndarray, "n 4"], steps: int
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """Crossings by Newton steps in both parameters: to where the ray meets the tangent plane.

        Distances, outward normals, parameters, and the length (mm) of the last step.
        """
        unit = _unit(directions)
        distance = crossings[:, 0].copy()
        parameters = crossings[:, 1:3].copy()
        faces = crossings[:, 3].astype(int)
        normals = unit.copy()
        for _ in range(steps):
            place, along_u, along_v = self._tangents(parameters, faces)
            across = np.cross(along_u, along_v)
            size = np.linalg.norm(across, axis=1)
            regular = size > _SINGULAR * np.linalg.norm(along_u, axis=1) * np.linalg.norm(along_v, axis=1)
            normals[regular] = across[regular] / size[regular, None]
            reached = np.sum(normals * place, axis=1) / np.sum(normals * unit, axis=1)
            distance = np.where(regular, reached, distance)
            residual = distance[:, None] * unit - place
            by_u = np.sum(np.cross(residual, along_v) * across, axis=1)
            by_v = np.sum(np.cross(along_u, residual) * across, axis=1)
            squared = np.where(regular, size, 1.0) ** 2
            parameters += np.where(regular[:, None], np.column_stack([by_u, by_v]) / squared[:, None], 0.0)
        outwards = normals * np.sign(np.sum(normals * unit, axis=1))[:, None]
        return distance, outwards, parameters, np.linalg.norm(residual, axis=1)

    def _tangents(
        self, parameters: Float[np.ndarray, "n 2"], faces: Int[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points of the faces, relative to the rays' start, and their derivatives by both parameters."""
        point = gp_Pnt()
        along_u = gp_Vec()
        along_v = gp_Vec()
        rows = []
        for (u, v), face in zip(parameters.tolist(), faces.tolist(), strict=True):
            self._surfaces[face].D1(u, v, point, along_u, along_v)
            rows.append((point.Coord(), along_u.Coord(), along_v.Coord()))
        vectors = np.array(rows).reshape(-1, 3, 3)
        vectors[:, 0] -= self._start
        return vectors[:, 0], vectors[:, 1], vectors[:, 2]

    def _crossings(self, directions: Float[np.ndarray, "n 3"]) -> Iterator[list[tuple[float, float, float, int]]]:
        """Distance (mm), parameters and number of the face of each crossing, ray by ray."""
        casts = list(enumerate(self._casts))
        start = self._start_point
        for direction in directions.tolist():
            line = gp_Lin(start, gp_Dir(*direction))
            crossings = []
            for index, cast in casts:
                cast.Perform(line, 0.0, _FAR_MM)
                if cast.IsDone():
                    for k in range(1, cast.NbPnt() + 1):
                        crossings.append((cast.WParameter(k), cast.UParameter(k), cast.VParameter(k), index))
            yield crossings


def _unit(directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _apart(crossings: list[tuple[float, float, float, int]]) -> list[float]:
    distances: list[float] = []
    for distance in sorted(distance for distance, *_ in crossings):
        if not distances or distance - distances[-1] > _SAME_MM:
            distances.append(distance)
    return distances


FIRST = "first"
_TESTED = 1500  # directions at which the face is tried
_RIM = 360  # the error of the spline measured
_NODES = 72  # even: no node lies on the axis
_MOST_NODES = 240  # where a surface of revolution has its pole
# What a spline aims at; an error falls with the sixth power of its nodes, that of the normal with the fifth.
_AIM_NM = 0.3
_AIM_URAD = 0.5
_MOST_NM = 1000.0  # a seam
_MOST_URAD = 1000.0  # a kink or a wave that no lens is given on purpose
# Beyond the rim the radius goes on by the polynomial of degree 4 through that many places inside, a step apart.
_PLACES = 5
_STEP_RAD = 0.002
_AZIMUTHS = 720


@dataclass(frozen=True)
class SampledFace:
    """Chart axis and radii (mm) on its grid; the largest errors of the spline through them."""

    axis: Float[np.ndarray, " n"]
    radius: Float[np.ndarray, "n n"]
    form_error_nm: float
    normal_error_urad: float


def _sample_face(folder: Path) -> None:
    job = json.loads((folder / JOB).read_text(encoding="utf-8"))
    faces, unit = _faces_in(folder / job["file"], job["iges"], job["origin"])
    shift = np.array(job["shift_mm"])
    chosen = _selected(faces, job["faces"], job["origin"], shift)
    cast = FaceCast([chosen_face.face for chosen_face in chosen], shift)
    sampled = sampled_face(cast, f"{job['origin']}: {' and '.join(chosen_face.title for chosen_face in chosen)}")
    np.savez(folder / SPLINE, axis=sampled.axis, radius=sampled.radius)
    described = {"unit": unit, "names": [chosen_face.title for chosen_face in chosen]}
    errors = {"form_error_nm": sampled.form_error_nm, "normal_error_urad": sampled.normal_error_urad}
    write_json(folder / FOUND, {**described, **errors})


def _selected(
    faces: list[NamedFace], wanted: list[str | int], origin: str, shift_mm: Float[np.ndarray, "3"]
) -> list[NamedFace]:
    names = [face.name for face in faces if face.name]
    chosen = []
    for name in wanted:
        if name == FIRST:
            chosen.append(_first_on_axis(faces, origin, shift_mm))
        elif isinstance(name, int):
            if not 1 <= name <= len(faces):
                raise InputError(f"{origin}: face = {name}: it has faces 1 to {len(faces)}")
            chosen.append(faces[name - 1])
        else:
            same = [face for face in faces if face.name == name]
            if len(same) != 1:
                near = get_close_matches(name, names, 3, 0.3) or names[:5]
                known = f"names of faces: {', '.join(near)}" if near else "its faces have no names; give a number"
                count = f"{len(same)} faces have this name" if same else "no such face"
                raise InputError(f"{origin}: face = {name!r}: {count}; {known}, or 'first'")
            chosen.append(same[0])
    return chosen


def _first_on_axis(faces: list[NamedFace], origin: str, shift_mm: Float[np.ndarray, "3"]) -> NamedFace:
    """The first face that the axis meets above the origin; probed slightly off-axis, where no face has its pole."""
    beside = np.array([[1e-6, 1e-6, 1.0]])
    met = [(min(FaceCast([face.face], shift_mm).all_mm(beside)[0], default=np.inf), face) for face in faces]
    distance, first = min(met, key=lambda crossing: crossing[0])
    if not np.isfinite(distance):
        raise InputError(f"{origin}: the axis meets no face above z = 0; move the file by shift_mm, or name the face")
    return first


def sampled_face(cast: FaceCast, title: str) -> SampledFace:
    """The spline through the faces of ``cast``, with as many nodes as its measured error needs.

    Raises :class:`InputError` if a ray from the origin does not meet the faces exactly once, and if they are not
    smooth.
    """
    tested = np.concatenate([fibonacci_hemisphere(_TESTED), _around(0.5 * np.pi, _RIM)])
    radius, normals = _met_once(cast, tested, title)
    nodes = _NODES
    while True:
        axis, values = _on_grid(cast, nodes, title)
        spline = ChartSpline.through(axis, values)
        cosine = np.sum(normals * tested, axis=1)
        form_nm = np.abs(spline.radius(tested) - radius) * cosine * 1e6
        turned_urad = np.linalg.norm(np.cross(spline.normal(tested), normals), axis=1) * 1e6
        more = max((form_nm.max() / _AIM_NM) ** (1.0 / 6.0), (turned_urad.max() / _AIM_URAD) ** (1.0 / 5.0))
        if more <= 1.0 or nodes == _MOST_NODES:
            break
        nodes = min(_MOST_NODES, 2 * int(np.ceil(0.5 * nodes * max(more, 1.1))))
    if form_nm.max() > _MOST_NM or turned_urad.max() > _MOST_URAD:
        worst = int((form_nm / _MOST_NM + turned_urad / _MOST_URAD).argmax())
        raise InputError(
            f"{title}: not smooth {place_of(tested[worst])}: a spline of {nodes} nodes misses it by "
            f"{form_nm[worst]:.3g} nm and {turned_urad[worst]:.3g} urad, at most {_MOST_NM:g} and {_MOST_URAD:g}; "
            "close the seam or the kink in CAD"
        )
    return SampledFace(axis, values, float(form_nm.max()), float(turned_urad.max()))


def _met_once(
    cast: FaceCast, directions: Float[np.ndarray, "n 3"], title: str
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Radius (mm) and outward normals in ``directions``, each of which must meet the faces exactly once."""
    met = cast.begin_at(directions)
    for direction, distances in zip(directions, met, strict=True):
        if len(distances) != 1:
            fault = f"meets it {len(distances)} times" if distances else "does not meet it: a hole, or its edge"
            raise InputError(
                f"{title}: a ray from the origin, {place_of(direction)}, {fault}; "
                "a face must be star-shaped, and reach "
                "down to z = 0: take all its parts (face = [...]), or extend it in CAD"
            )
    return cast.points(directions)


def _on_grid(cast: FaceCast, nodes: int, title: str) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n n"]]:
    """Chart axis, even in angle, and the radii (mm) on its grid."""
    half = np.arctan(HALF_WIDTH)
    axis = np.tan(np.linspace(-half, half, nodes))
    chart = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.hypot(chart[:, 0], chart[:, 1])
    inside = distance <= 1.0
    values = np.empty(len(chart))
    values[inside] = cast.points(to_sphere(chart[inside]))[0]
    beyond = 2.0 * np.arctan(bent_radius(distance[~inside])) - 0.5 * np.pi
    azimuth = np.arctan2(chart[~inside, 1], chart[~inside, 0])
    values[~inside] = _extrapolated_radius(cast, azimuth, beyond)
    if not np.isfinite(values).all():
        raise InputError(
            f"{title}: the CAD kernel finds no point {place_of(to_sphere(chart[~np.isfinite(values)])[0])}"
        )
    return axis, values.reshape(nodes, nodes)


def _extrapolated_radius(
    cast: FaceCast, azimuth: Float[np.ndarray, " n"], beyond_rad: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Radius (mm) beyond the rim, extrapolated on each meridian by a polynomial through points inside the rim."""
    turn = 2.0 * np.pi * np.arange(_AZIMUTHS + 1) / _AZIMUTHS
    total = np.zeros(len(azimuth))
    for weight, inside in _extrapolation(beyond_rad):
        around = cast.points(_around(0.5 * np.pi - inside, _AZIMUTHS))[0]
        along = make_interp_spline(turn, np.append(around, around[0]), k=5, bc_type="periodic")
        total += weight * along(azimuth % (2.0 * np.pi))
    return total


def _extrapolation(beyond_rad: Float[np.ndarray, " n"]) -> Iterator[tuple[Float[np.ndarray, " n"], float]]:
    """Lagrange's weights of the points inside the rim, and their distances (rad) from it."""
    for k in range(_PLACES):
        weight = np.ones_like(beyond_rad)
        for j in range(_PLACES):
            if j != k:
                weight = weight * (beyond_rad / _STEP_RAD + j) / (j - k)
        yield weight, k * _STEP_RAD


def _around(polar: float, count: int) -> Float[np.ndarray, "n 3"]:
    azimuth = 2.0 * np.pi * np.arange(count) / count
    height = np.full(count, max(np.cos(polar), 0.0))
    return np.column_stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), height])


if __name__ == "__main__":
    serve(_sample_face)
