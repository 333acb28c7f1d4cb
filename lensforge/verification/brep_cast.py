"""Rays through the STEP file: the CAD kernel intersects the exported body face by face, without triangles.

Errors from the flat facets of the mesh must vanish here.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.criteria import Criterion, at_most
from lensforge.errors import InputError
from lensforge.sources.bundle import RayBundle
from lensforge.verification.advice import Evidence
from lensforge.verification.casting import Leg
from lensforge.verification.comparison import Expected, compare, drawn, gap_quantiles
from lensforge.verification.passage import (
    CastFate,
    Passage,
    RefractedRays,
    faces_away,
    indices_of,
    land,
    outside_leg,
    refract,
)
from lensforge.verification.proof import BrepCast

RAYS = 1024
# Half of the mesh's limit. The B-rep itself lands rays within 0.1 um at 150 mm of the exact surfaces; the
# deviation from the design is that of the design's own table: 4 um at draft accuracy, 2 um at standard.
DEVIATION_PER_DISTANCE = 5e-5
FLUX_SHARE = 1e-4
FATE_RAYS = 2  # of 1024: rays that graze an edge or the limit of total reflection may end either way
_SKIN_MM = 1e-4  # hits nearer than this are the point just left
_TOLERANCE_MM = 1e-7  # within which the CAD kernel takes two points as one
_FAR_MM = 1e6


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

        solids = _solids(step)
        if len(solids) != 1:
            raise InputError(f"STEP: holds {len(solids)} solids, a lens is one; export it again")
        faces = [face.wrapped for face in solids[0].Faces()]
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


def _solids(step: bytes) -> list[Any]:
    """All solids, read by the CAD kernel, which accepts only a path."""
    import cadquery as cq

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.step"
        path.write_bytes(step)
        try:
            solids: list[Any] = cq.importers.importStep(str(path)).solids().vals()
        except Exception as error:  # the kernel raises whatever its parser does
            raise InputError(f"STEP: not readable ({error}); export it again") from error
    return solids


def cast_brep(
    step: bytes,
    rays: RayBundle,
    refractive_index: float,
    distance_mm: float,
    receiver_mm: float,
    expected: Expected,
    mesh: Passage,
    count: int = RAYS,
) -> tuple[BrepCast, Float[np.ndarray, " q"]]:
    """Cast ``count`` of ``rays``, drawn at random, through the STEP file; and quantiles of the landing gaps (mm).

    ``expected`` and ``mesh`` hold all of the rays; the gaps are from the design. Raises :class:`InputError` for
    bytes that hold no solid or several.
    """
    start = perf_counter()
    rows = drawn(count, len(rays))
    some = rays.take(rows)
    passage = send_through_step(StepBody(step), some, refractive_index, distance_mm)
    design = expected.take(rows)
    by_mesh = Expected(expected.irradiance, mesh.landings[rows], mesh.flux[rows], mesh.fate_names[rows])
    against_design, against_mesh = (compare(some, passage, other, receiver_mm) for other in (design, by_mesh))
    gaps = gap_quantiles(passage, design, receiver_mm)
    seconds = perf_counter() - start
    cast = BrepCast(rays=len(rows), seconds=seconds, against_design=against_design, against_mesh=against_mesh)
    return cast, gaps


def brep_criteria(cast: BrepCast, distance_mm: float) -> list[Criterion]:
    """Acceptance criteria of a STEP file; ``distance_mm``: to the receiver."""
    design, seen = cast.against_design, brep_evidence(cast, distance_mm)
    allowed = FATE_RAYS * max(1.0, cast.rays / RAYS)
    return [
        at_most("brep_deviation_rms", design.rms, seen.deviation_mm, "mm", seen.of_deviation()),
        at_most("brep_flux_deviation", design.flux, FLUX_SHARE, "of the flux", seen.of_flux()),
        at_most("brep_fate_disagreements", design.fates, allowed, "rays", seen.of_fates()),
    ]


def brep_evidence(cast: BrepCast, distance_mm: float) -> Evidence:
    """Agreement of the STEP file with the design, and its limits; ``distance_mm``: to the receiver."""
    form = "export again; if it stays, lens.step is not the lens of lens.json"
    fates = FATE_RAYS / RAYS
    return Evidence(cast.against_design, DEVIATION_PER_DISTANCE * distance_mm, FLUX_SHARE, fates, form)


def send_through_step(body: StepBody, rays: RayBundle, refractive_index: float, distance_mm: float) -> Passage:
    """Trace every ray into the body, out of it, and to the plane z = ``distance_mm``, as through the mesh."""
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
    land(passage, rows[reached], left, distance_mm)
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
