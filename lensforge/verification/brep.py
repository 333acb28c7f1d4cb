"""A second referee: some of the rays through the STEP file itself, against the design and against the mesh.

No triangle takes part, so what the mesh owes to its facets has to vanish here.
"""

from time import perf_counter

import numpy as np
from jaxtyping import Float, Int

from lensforge.gates import Gate, at_most
from lensforge.sources.bundle import RayBundle
from lensforge.verification.casting import Leg
from lensforge.verification.comparison import Expected, compare, drawn, gap_quantiles
from lensforge.verification.passage import Crossing, Fate, Passage, indices_of, land, outside_leg, refract
from lensforge.verification.proof import BrepCast
from lensforge.verification.step_body import FaceHits, StepBody

RAYS = 1024
# Half of what the mesh may be off. The B-rep itself lands within 0.1 um at 150 mm of the exact surfaces; what is
# measured against the design is the design's own table: 4 um at draft accuracy, 2 um at standard.
DEVIATION_PER_DISTANCE = 5e-5
FLUX_SHARE = 1e-4
FATE_RAYS = 2  # of 1024: rays that graze an edge or the limit of total reflection may end either way
_SKIN_MM = 1e-4  # hits nearer than this are the point just left


def judge_brep(
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

    ``expected`` and ``mesh`` hold all of the rays; the gaps are against the design. Raises :class:`InputError` for
    bytes that hold no solid, or several.
    """
    start = perf_counter()
    rows = drawn(count, len(rays))
    some = rays.take(rows)
    passage = send_through_step(StepBody(step), some, refractive_index, distance_mm)
    design = expected.take(rows)
    by_mesh = Expected(expected.irradiance, mesh.landings[rows], mesh.flux[rows])
    against_design, against_mesh = (compare(some, passage, other, receiver_mm) for other in (design, by_mesh))
    gaps = gap_quantiles(passage, design, receiver_mm)
    seconds = perf_counter() - start
    cast = BrepCast(rays=len(rows), seconds=seconds, against_design=against_design, against_mesh=against_mesh)
    return cast, gaps


def brep_gates(cast: BrepCast, distance_mm: float) -> list[Gate]:
    """Gates that a STEP file must hold; ``distance_mm``: to the receiver."""
    design, remedy = cast.against_design, "export again; if it stays, lens.step is not the lens of lens.json"
    limits: list[tuple[str, float, float, str]] = [
        ("brep_deviation_rms", design.rms, DEVIATION_PER_DISTANCE * distance_mm, "mm"),
        ("brep_flux_deviation", design.flux, FLUX_SHARE, "of the flux"),
        ("brep_fate_disagreements", design.fates, FATE_RAYS * max(1.0, cast.rays / RAYS), "rays"),
    ]
    return [at_most(name, value, limit, unit, remedy) for name, value, limit, unit in limits]


def send_through_step(body: StepBody, rays: RayBundle, refractive_index: float, distance_mm: float) -> Passage:
    """Every ray into the body, out of it, and to the plane z = ``distance_mm``, as through the mesh."""
    passage = Passage(
        landings=np.full((len(rays), 2), np.nan),
        flux=rays.weights.copy(),
        fates=np.full(len(rays), Fate.NO_HIT, dtype=np.int64),
        facets_um=np.zeros((len(rays), 2)),
    )
    leg, indices = outside_leg(rays), indices_of(rays, refractive_index)
    entry = body.first_hits(leg)
    passage.fates[:] = np.select(
        [entry.faces < 0, entry.leaving, entry.points[:, 2] <= 0.0],
        [Fate.NO_HIT, Fate.STARTS_INSIDE, Fate.BASE],
        Fate.LANDED,
    )
    rows = np.nonzero(passage.fates == Fate.LANDED)[0]
    entry = entry.take(rows)
    entered = _cross(leg.take(rows), entry, 1.0 / indices[rows])
    passage.flux[rows] *= entered.transmittance

    exits = body.first_hits(entered.leg)
    passage.fates[rows] = _exit_fates(entry, exits)
    reached = np.nonzero(passage.fates[rows] == Fate.LANDED)[0]
    left = _cross(entered.leg.take(reached), exits.take(reached), indices[rows[reached]])
    land(passage, rows[reached], left, distance_mm)
    return passage


def _cross(leg: Leg, hits: FaceHits, index_ratio: Float[np.ndarray, " n"]) -> Crossing:
    directions, transmittance = refract(leg.directions, hits.normals, index_ratio)
    behind = Leg(hits.points, directions, np.full(len(directions), _SKIN_MM))
    return Crossing(behind, transmittance, np.zeros(len(directions)))


def _exit_fates(entry: FaceHits, exits: FaceHits) -> Int[np.ndarray, " n"]:
    return np.select(
        [exits.faces < 0, exits.points[:, 2] <= 0.0, exits.faces == entry.faces],
        [Fate.NO_HIT, Fate.BASE, Fate.BACK_INTO_CAVITY],
        Fate.LANDED,
    )
