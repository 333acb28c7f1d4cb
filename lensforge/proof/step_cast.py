"""Rays through the STEP file: the CAD kernel intersects the exported body face by face, without triangles.

Errors from the flat facets of the mesh must vanish here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from jaxtyping import Int

from lensforge.optics.media import Media
from lensforge.proof.acceptance import BREP_RAYS
from lensforge.proof.facet_casting import Leg
from lensforge.proof.part_comparison import Expected, compare, drawn, gap_quantiles
from lensforge.proof.pose_diagnosis import Cast, Ends
from lensforge.proof.proof_result import BrepCast, Gaps
from lensforge.proof.refraction import AtFace, Fields, RefractingFace, unpolarised
from lensforge.proof.sequential_cast import (
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
from lensforge.proof.step_body import BrepHits, StepBody
from lensforge.results import BodySize
from lensforge.results.second_process import IN_TURN, SecondProcess
from lensforge.sources.ray_bundle import RayBundle

_SKIN_MM = 1e-4  # hits nearer than this are the point just left


@dataclass(frozen=True)
class StepCast:
    """Some rays' ``passage`` through a STEP file, the ``seconds`` that it took, and the ``size`` of the body if asked.

    ``rows``: numbers of the rays.
    """

    rows: Int[np.ndarray, " k"]
    passage: Passage
    seconds: float
    size: BodySize | None


def cast_step(
    step: bytes | StepBody,
    rays: RayBundle,
    media: Media,
    count: int = BREP_RAYS,
    *,
    sized: bool = False,
    second: SecondProcess = IN_TURN,
) -> Callable[[], StepCast]:
    """Begin to cast ``count`` of ``rays``, drawn at random, through a STEP file; ``sized``: measure its body, too.

    In ``second``, where there is one; the function that is returned waits for it.
    """
    rows = drawn(count, len(rays))
    cast = second.call(_cast_and_measure, step, rays.take(rows), media, sized)
    return lambda: StepCast(rows, *cast.result())


def _cast_and_measure(
    step: bytes | StepBody, rays: RayBundle, media: Media, sized: bool
) -> tuple[Passage, float, BodySize | None]:
    body = StepBody(step) if isinstance(step, bytes) else step
    start = perf_counter()
    passage = send_through_step(body, rays, media)
    return passage, perf_counter() - start, body.size() if sized else None


def judge_brep(
    cast: StepCast, rays: RayBundle, expected: Sequence[Expected], mesh: Passage
) -> list[tuple[BrepCast, Gaps]]:
    """Landings of a cast through the STEP file on each screen, beside the design's and the mesh's; gaps (mm).

    ``rays``, ``expected`` and ``mesh`` hold all of the rays; the quantiles of the gaps are from the design.
    """
    rows, found = cast.rows, []
    some = rays.take(rows)
    for each in expected:
        landed, by_mesh = LandedRays.of(cast.passage, each.screen), LandedRays.of(mesh, each.screen)
        design, names = each.take(rows), by_mesh.fate_names[rows]
        reference = Expected(each.screen, each.irradiance, by_mesh.landings[rows], by_mesh.flux[rows], names)
        agreements = [compare(some, landed, other) for other in (design, reference)]
        agreed = BrepCast(
            rays=len(rows), seconds=cast.seconds, against_design=agreements[0], against_mesh=agreements[1]
        )
        found.append((agreed, gap_quantiles(landed, design)))
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
    ahead, out_of = entered.leg.take(reached), out_of.take(rows[reached])
    left = _cross(ahead, exits.take(reached), out_of, entered.fields[reached])
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


def _cross(leg: Leg, hits: BrepHits, face: RefractingFace, fields: Fields | None = None) -> RefractedRays:
    light = AtFace.of(face, leg.directions, hits.normals, unpolarised(leg.directions) if fields is None else fields)
    behind = Leg(hits.points, light.bent, np.full(len(light.bent), _SKIN_MM))
    return RefractedRays(behind, light.transmittance, light.passed, np.zeros(len(light.bent)))


def _exit_fates(body: StepBody, entry: BrepHits, exits: BrepHits) -> Int[np.ndarray, " n"]:
    same = body.smooth_faces[exits.faces] == body.smooth_faces[entry.faces]
    return np.select(
        [exits.faces < 0, exits.points[:, 2] <= 0.0, same],
        [CastFate.NO_HIT, CastFate.BASE, CastFate.BACK_INTO_CAVITY],
        CastFate.LANDED,
    )
