"""Rays from the origin on CAD faces: the kernel finds the crossings, Newton steps on its surfaces make them exact."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float, Int

_TOLERANCE_MM = (
    1e-4  # of a face's edge, to which a ray still meets it: rims lie in z = 0 to the tolerance of their file
)
_FAR_MM = 1e6
_SAME_MM = 1e-3  # two crossings nearer than this are one, on an edge that two faces share
_NEWTON_STEPS = 3
_SINGULAR = 1e-12  # of the product of the three lengths: the surface has a pole here


class FaceCast:
    """Rays from the origin, in the coordinates of the lens, on ``faces`` (TopoDS_Face) moved by ``shift_mm``."""

    def __init__(self, faces: list[Any], shift_mm: Float[np.ndarray, "3"]) -> None:
        from OCP.BRep import BRep_Tool
        from OCP.gp import gp_Pnt
        from OCP.IntCurvesFace import IntCurvesFace_Intersector

        self._start = -np.asarray(shift_mm, dtype=np.float64)
        self._start_point = gp_Pnt(*self._start.tolist())
        self._casts = [IntCurvesFace_Intersector(face, _TOLERANCE_MM) for face in faces]
        self._surfaces = [BRep_Tool.Surface_s(face) for face in faces]

    def all_mm(self, directions: Float[np.ndarray, "n 3"]) -> list[list[float]]:
        """Distances (mm) at which each ray meets a face, rising."""
        found = []
        for crossings in self._crossings(directions):
            distances: list[float] = []
            for distance in sorted(distance for distance, *_ in crossings):
                if not distances or distance - distances[-1] > _SAME_MM:
                    distances.append(distance)
            found.append(distances)
        return found

    def nearest_mm(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Distance (mm) of the first crossing of each ray, infinite where there is none."""
        return np.array([min(distances, default=np.inf) for distances in self.all_mm(directions)])

    def points(self, directions: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Distance (mm) of the first crossing of each ray to rounding, and the unit normal there, outwards.

        NaN where a ray meets no face.
        """
        first = [min(crossings, default=None) for crossings in self._crossings(directions)]
        met = np.array([each is not None for each in first], dtype=bool)
        radius, normals = np.full(len(directions), np.nan), np.full((len(directions), 3), np.nan)
        if met.any():
            crossings = np.array([each for each in first if each is not None])
            radius[met], normals[met] = self._exact(directions[met], crossings)
        return radius, normals

    def _exact(
        self, directions: Float[np.ndarray, "n 3"], crossings: Float[np.ndarray, "n 4"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Crossings by Newton steps in both parameters: to where the ray meets the tangent plane."""
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        distance, parameters, faces = crossings[:, 0].copy(), crossings[:, 1:3].copy(), crossings[:, 3].astype(int)
        normals = unit.copy()
        for _ in range(_NEWTON_STEPS):
            place, along_u, along_v = self._tangents(parameters, faces)
            across = np.cross(along_u, along_v)
            size = np.linalg.norm(across, axis=1)
            regular = size > _SINGULAR * np.linalg.norm(along_u, axis=1) * np.linalg.norm(along_v, axis=1)
            normals[regular] = across[regular] / size[regular, None]
            reached = np.sum(normals * place, axis=1) / np.sum(normals * unit, axis=1)
            distance = np.where(regular, reached, distance)
            rest = distance[:, None] * unit - place
            by_u = np.sum(np.cross(rest, along_v) * across, axis=1)
            by_v = np.sum(np.cross(along_u, rest) * across, axis=1)
            squared = np.where(regular, size, 1.0) ** 2
            parameters += np.where(regular[:, None], np.column_stack([by_u, by_v]) / squared[:, None], 0.0)
        return distance, normals * np.sign(np.sum(normals * unit, axis=1))[:, None]

    def _tangents(
        self, parameters: Float[np.ndarray, "n 2"], faces: Int[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Point from where the rays start, and its derivatives by both parameters."""
        from OCP.gp import gp_Pnt, gp_Vec

        point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
        rows = []
        for (u, v), face in zip(parameters.tolist(), faces.tolist(), strict=True):
            self._surfaces[face].D1(u, v, point, along_u, along_v)
            rows.append((point.Coord(), along_u.Coord(), along_v.Coord()))
        found = np.array(rows).reshape(-1, 3, 3)
        found[:, 0] -= self._start
        return found[:, 0], found[:, 1], found[:, 2]

    def _crossings(self, directions: Float[np.ndarray, "n 3"]) -> Iterator[list[tuple[float, float, float, int]]]:
        """Distance (mm), parameters and number of the face of each crossing, ray by ray."""
        from OCP.gp import gp_Dir, gp_Lin

        casts, start = list(enumerate(self._casts)), self._start_point
        for direction in directions.tolist():
            line, found = gp_Lin(start, gp_Dir(*direction)), []
            for index, cast in casts:
                cast.Perform(line, 0.0, _FAR_MM)
                if cast.IsDone():
                    for k in range(1, cast.NbPnt() + 1):
                        found.append((cast.WParameter(k), cast.UParameter(k), cast.VParameter(k), index))
            yield found
