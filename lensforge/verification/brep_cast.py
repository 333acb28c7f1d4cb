"""Rays through the STEP file: the CAD kernel intersects the exported body face by face, without triangles.

Errors from the flat facets of the mesh must vanish here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.errors import InputError
from lensforge.files import temporary_file
from lensforge.sources.bundle import RayBundle
from lensforge.untrusted.archives import require_small_step
from lensforge.untrusted.own_content import made_here
from lensforge.verification.acceptance import BREP_RAYS
from lensforge.verification.casting import Leg
from lensforge.verification.comparison import Expected, compare, drawn, gap_quantiles
from lensforge.verification.passage import (
    CastFate,
    LandedRays,
    Passage,
    RefractedRays,
    faces_away,
    indices_of,
    leave,
    outside_leg,
    refract,
)
from lensforge.verification.proof import BrepCast, Gaps

_SKIN_MM = 1e-4  # hits nearer than this are the point just left
_TOLERANCE_MM = 1e-7  # within which the CAD kernel takes two points as one
_FAR_MM = 1e6
_MOST_FACES = 10_000  # every ray is cast at each of them: a lens has 6, one on a clamp with screw holes some hundred


@dataclass(frozen=True)
class BrepHits:
    """First hits on a body: face (-1: none), point (mm), unit normal of either sign, True where the ray leaves it."""

    faces: Int[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    leaving: Bool[np.ndarray, " n"]

    def take(self, rows: Int[np.ndarray, " k"]) -> "BrepHits":
        """The hits of some of the rays."""
        return BrepHits(self.faces[rows], self.points[rows], self.normals[rows], self.leaving[rows])


class StepBody:
    """The only solid in the bytes of a STEP file, in mm. Raises :class:`InputError` where they hold anything else."""

    def __init__(self, step: bytes) -> None:
        from OCP.BRepAdaptor import BRepAdaptor_Surface
        from OCP.IntCurvesFace import IntCurvesFace_Intersector
        from OCP.TopoDS import TopoDS

        faces = [TopoDS.Face_s(face) for face in _faces_of_one_solid(step)]
        self._surfaces = [BRepAdaptor_Surface(face) for face in faces]
        self._intersectors = [IntCurvesFace_Intersector(face, _TOLERANCE_MM) for face in faces]

    def first_hits(self, leg: Leg) -> BrepHits:
        """First hit of each ray, about a millisecond each."""
        count = len(leg.origins)
        hits = BrepHits(np.full(count, -1), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, dtype=bool))
        for row in range(count):
            self._write_first_hit(row, leg, hits)
        return hits

    def _write_first_hit(self, row: int, leg: Leg, hits: BrepHits) -> None:
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


def _faces_of_one_solid(step: bytes) -> list[Any]:
    """The faces (TopoDS_Face) of the only solid, read by the CAD kernel, which accepts only a path."""
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPControl import STEPControl_Reader
    from OCP.TopAbs import TopAbs_ShapeEnum

    if not made_here(step):
        require_small_step(step, "STEP", "export it again")
    reader = STEPControl_Reader()
    try:
        with temporary_file(step, "part.step") as path:
            read = reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
            if not read or reader.TransferRoots() == 0:
                raise InputError("STEP: not readable; export it again")
        solids = _parts(reader.OneShape(), TopAbs_ShapeEnum.TopAbs_SOLID)
        faces = _parts(solids[0], TopAbs_ShapeEnum.TopAbs_FACE) if len(solids) == 1 else []
    except InputError:
        raise
    except Exception as error:  # the kernel raises whatever its parser does
        raise InputError(f"STEP: not readable ({' '.join(str(error).split())[:120]}); export it again") from error
    if len(solids) != 1:
        raise InputError(f"STEP: holds {len(solids)} solids, a lens is one; export it again")
    if len(faces) > _MOST_FACES:
        raise InputError(f"STEP: {len(faces)} faces, at most {_MOST_FACES} are cast; export it again")
    return faces


def _parts(shape: Any, kind: Any) -> list[Any]:
    """The different parts of ``shape`` that are of a kind, in their order."""
    from OCP.TopExp import TopExp
    from OCP.TopTools import TopTools_IndexedMapOfShape

    found = TopTools_IndexedMapOfShape()
    TopExp.MapShapes_s(shape, kind, found)
    return [found.FindKey(k + 1) for k in range(found.Extent())]


def cast_brep(
    body: StepBody,
    rays: RayBundle,
    refractive_index: float,
    expected: Sequence[Expected],
    mesh: Passage,
    count: int = BREP_RAYS,
) -> list[tuple[BrepCast, Gaps]]:
    """Cast ``count`` of ``rays``, drawn at random, through the STEP file; and quantiles of the landing gaps (mm).

    For each screen. ``expected`` and ``mesh`` hold all of the rays; the gaps are from the design.
    """
    start = perf_counter()
    rows = drawn(count, len(rays))
    some = rays.take(rows)
    passage = send_through_step(body, some, refractive_index)
    seconds, found = perf_counter() - start, []
    for each in expected:
        landed, by_mesh = LandedRays.of(passage, each.screen), LandedRays.of(mesh, each.screen)
        design, names = each.take(rows), by_mesh.fate_names[rows]
        reference = Expected(each.screen, each.irradiance, by_mesh.landings[rows], by_mesh.flux[rows], names)
        agreements = [compare(some, landed, other) for other in (design, reference)]
        cast = BrepCast(rays=len(rows), seconds=seconds, against_design=agreements[0], against_mesh=agreements[1])
        found.append((cast, gap_quantiles(landed, design)))
    return found


def send_through_step(body: StepBody, rays: RayBundle, refractive_index: float) -> Passage:
    """Trace every ray into the body and out of it, as through the mesh."""
    passage = Passage.of(rays)
    leg, indices = outside_leg(rays), indices_of(rays, refractive_index)
    entry = body.first_hits(leg)
    against = np.where(np.sum(entry.normals * leg.directions, axis=1) > 0.0, -1.0, 1.0)[:, None]
    passage.fates[:] = np.select(
        [entry.faces < 0, entry.leaving, entry.points[:, 2] <= 0.0, faces_away(entry.points, against * entry.normals)],
        [CastFate.NO_HIT, CastFate.STARTS_INSIDE, CastFate.OPENING, CastFate.STARTS_OUTSIDE],
        CastFate.LANDED,
    )
    rows = np.nonzero(passage.fates == CastFate.LANDED)[0]
    entry = entry.take(rows)
    entered = _cross(leg.take(rows), entry, 1.0 / indices[rows])
    passage.flux[rows] *= entered.transmittance

    exits = body.first_hits(entered.leg)
    passage.fates[rows] = _exit_fates(entry, exits)
    reached = np.nonzero(passage.fates[rows] == CastFate.LANDED)[0]
    left = _cross(entered.leg.take(reached), exits.take(reached), indices[rows[reached]])
    leave(passage, rows[reached], left)
    return passage


def _cross(leg: Leg, hits: BrepHits, index_ratio: Float[np.ndarray, " n"]) -> RefractedRays:
    directions, transmittance = refract(leg.directions, hits.normals, index_ratio)
    behind = Leg(hits.points, directions, np.full(len(directions), _SKIN_MM))
    return RefractedRays(behind, transmittance, np.zeros(len(directions)))


def _exit_fates(entry: BrepHits, exits: BrepHits) -> Int[np.ndarray, " n"]:
    return np.select(
        [exits.faces < 0, exits.points[:, 2] <= 0.0, exits.faces == entry.faces],
        [CastFate.NO_HIT, CastFate.BASE, CastFate.BACK_INTO_CAVITY],
        CastFate.LANDED,
    )
