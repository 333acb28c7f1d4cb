"""The body of a STEP file under rays: read back and intersected face by face by the CAD kernel, without triangles."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.errors import InputError
from lensforge.verification.casting import Leg

_TOLERANCE_MM = 1e-7  # the kernel's own confusion of points
_FAR_MM = 1e6


@dataclass(frozen=True)
class FaceHits:
    """First hits on a body: face (-1: none), point (mm), unit normal to either side, and whether the ray leaves it."""

    faces: Int[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    leaving: Bool[np.ndarray, " n"]

    def take(self, rows: Int[np.ndarray, " k"]) -> "FaceHits":
        """The hits of some of the rays."""
        return FaceHits(self.faces[rows], self.points[rows], self.normals[rows], self.leaving[rows])


class StepBody:
    """The one solid in the bytes of a STEP file, in mm. Raises :class:`InputError` where they hold anything else."""

    def __init__(self, step: bytes) -> None:
        from OCP.BRepAdaptor import BRepAdaptor_Surface
        from OCP.IntCurvesFace import IntCurvesFace_Intersector

        solids = _solids(step)
        if len(solids) != 1:
            raise InputError(f"STEP: holds {len(solids)} solids, a lens is one; export it again")
        faces = [face.wrapped for face in solids[0].Faces()]
        self._surfaces = [BRepAdaptor_Surface(face) for face in faces]
        self._intersectors = [IntCurvesFace_Intersector(face, _TOLERANCE_MM) for face in faces]

    def first_hits(self, leg: Leg) -> FaceHits:
        """First hit of each ray, about a millisecond each."""
        count = len(leg.origins)
        hits = FaceHits(np.full(count, -1), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, dtype=bool))
        for row in range(count):
            self._write_first_hit(row, leg, hits)
        return hits

    def _write_first_hit(self, row: int, leg: Leg, hits: FaceHits) -> None:
        from OCP.gp import gp_Dir, gp_Lin, gp_Pnt
        from OCP.IntCurveSurface import IntCurveSurface_TransitionOnCurve

        line = gp_Lin(gp_Pnt(*leg.origins[row].tolist()), gp_Dir(*leg.directions[row].tolist()))
        nearest, place = np.inf, (0.0, 0.0)
        for face, found in enumerate(self._intersectors):
            found.Perform(line, float(leg.beyond[row]), _FAR_MM)
            for k in range(1, found.NbPnt() + 1):
                if found.WParameter(k) < nearest:
                    nearest, place = found.WParameter(k), (found.UParameter(k), found.VParameter(k))
                    hits.faces[row] = face
                    out = IntCurveSurface_TransitionOnCurve.IntCurveSurface_Out
                    hits.leaving[row] = found.Transition(k) == out
        if np.isfinite(nearest):
            hits.points[row], hits.normals[row] = self._point_and_normal(int(hits.faces[row]), *place)

    def _point_and_normal(self, face: int, u: float, v: float) -> tuple[np.ndarray, np.ndarray]:
        from OCP.gp import gp_Pnt, gp_Vec

        point, along_u, along_v = gp_Pnt(), gp_Vec(), gp_Vec()
        self._surfaces[face].D1(u, v, point, along_u, along_v)
        normal = along_u.Crossed(along_v)
        unit = np.array([normal.X(), normal.Y(), normal.Z()]) / normal.Magnitude()
        return np.array([point.X(), point.Y(), point.Z()]), unit


def _solids(step: bytes) -> list[Any]:
    """All solids, read by the CAD kernel, which takes nothing but a path."""
    import cadquery as cq

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.step"
        path.write_bytes(step)
        try:
            solids: list[Any] = cq.importers.importStep(str(path)).solids().vals()
        except Exception as error:  # the kernel raises whatever its parser does
            raise InputError(f"STEP: not readable ({error}); export it again") from error
    return solids
