"""Rays through the STEP file: the CAD kernel intersects the exported body face by face, without triangles.

Errors from the flat facets of the mesh must vanish here.
"""

from collections.abc import Sequence
from time import perf_counter

import numpy as np
from jaxtyping import Int

from lensforge.optics.media import Media
from lensforge.sources.bundle import RayBundle
from lensforge.verification.acceptance import BREP_RAYS
from lensforge.verification.casting import Leg
from lensforge.verification.coated_face import RefractingFace
from lensforge.verification.comparison import Expected, compare, drawn, gap_quantiles
from lensforge.verification.misplaced import Cast, Ends
from lensforge.verification.passage import (
    CastFate,
    LandedRays,
    Passage,
    RefractedRays,
    absorb,
    behind_glass,
    faces_away,
    leave,
    outside_leg,
)
from lensforge.verification.proof import BrepCast, Gaps
from lensforge.verification.refraction import refract_at
from lensforge.verification.step_body import BrepHits, StepBody

_SKIN_MM = 1e-4  # hits nearer than this are the point just left


def cast_brep(
    body: StepBody,
    rays: RayBundle,
    media: Media,
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
    passage = send_through_step(body, some, media)
    seconds, found = perf_counter() - start, []
    for each in expected:
        landed, by_mesh = LandedRays.of(passage, each.screen), LandedRays.of(mesh, each.screen)
        design, names = each.take(rows), by_mesh.fate_names[rows]
        reference = Expected(each.screen, each.irradiance, by_mesh.landings[rows], by_mesh.flux[rows], names)
        agreements = [compare(some, landed, other) for other in (design, reference)]
        cast = BrepCast(rays=len(rows), seconds=seconds, against_design=agreements[0], against_mesh=agreements[1])
        found.append((cast, gap_quantiles(landed, design)))
    return found


def send_through_step(body: StepBody, rays: RayBundle, media: Media) -> Passage:
    """Trace every ray into the body and out of it, as through the mesh."""
    passage = Passage.of(rays)
    leg, into, out_of = outside_leg(rays), RefractingFace.inner(rays, media), RefractingFace.outer(rays, media)
    entry = body.first_hits(leg)
    against = np.where(np.sum(entry.normals * leg.directions, axis=1) > 0.0, -1.0, 1.0)[:, None]
    passage.fates[:] = np.select(
        [entry.faces < 0, entry.leaving, entry.points[:, 2] <= 0.0, faces_away(entry.points, against * entry.normals)],
        [CastFate.NO_HIT, CastFate.STARTS_INSIDE, CastFate.OPENING, CastFate.STARTS_OUTSIDE],
        CastFate.LANDED,
    )
    rows = np.nonzero(passage.fates == CastFate.LANDED)[0]
    entry = entry.take(rows)
    entered = _cross(leg.take(rows), entry, into.take(rows))
    passage.flux[rows] *= entered.transmittance

    exits = body.first_hits(entered.leg)
    passage.fates[rows] = _exit_fates(body, entry, exits)
    reached = np.nonzero(passage.fates[rows] == CastFate.LANDED)[0]
    lengths = np.linalg.norm(exits.points[reached] - entered.leg.origins[reached], axis=1)
    absorb(passage, rows[reached], lengths, rays.absorptions(media)[rows[reached]])
    left = _cross(entered.leg.take(reached), exits.take(reached), out_of.take(rows[reached]))
    leave(passage, rows[reached], left)
    return behind_glass(passage, rays, media)


def through_step(body: StepBody) -> Cast:
    """Rays through a STEP file, refracted at the first two faces that they meet, whatever these are."""

    def cast(leg: Leg, into: RefractingFace, out_of: RefractingFace) -> Ends:
        points, directions = np.full((2, len(leg.origins), 3), np.nan)
        entry = body.first_hits(leg)
        rows = np.nonzero(entry.faces >= 0)[0]
        entered = _cross(leg.take(rows), entry.take(rows), into.take(rows))
        exits = body.first_hits(entered.leg)
        met = np.nonzero(exits.faces >= 0)[0]
        left = _cross(entered.leg.take(met), exits.take(met), out_of.take(rows[met]))
        passes = left.transmittance > 0.0
        points[rows[met[passes]]] = left.leg.origins[passes]
        directions[rows[met[passes]]] = left.leg.directions[passes]
        return points, directions

    return cast


def _cross(leg: Leg, hits: BrepHits, face: RefractingFace) -> RefractedRays:
    directions, transmittance = refract_at(face, leg.directions, hits.normals)
    behind = Leg(hits.points, directions, np.full(len(directions), _SKIN_MM))
    return RefractedRays(behind, transmittance, np.zeros(len(directions)))


def _exit_fates(body: StepBody, entry: BrepHits, exits: BrepHits) -> Int[np.ndarray, " n"]:
    same = body.smooth_faces[exits.faces] == body.smooth_faces[entry.faces]
    return np.select(
        [exits.faces < 0, exits.points[:, 2] <= 0.0, same],
        [CastFate.NO_HIT, CastFate.BASE, CastFate.BACK_INTO_CAVITY],
        CastFate.LANDED,
    )
