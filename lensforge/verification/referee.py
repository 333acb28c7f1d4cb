"""trimesh's own plain path as the referee of the grid: slow, written by others, on a small sample of the rays."""

from time import perf_counter

import numpy as np

from lensforge.sources.bundle import RayBundle
from lensforge.verification.casting import Grid, Leg, plain_distances
from lensforge.verification.part import Part
from lensforge.verification.passage import cross, indices_of, outside_leg
from lensforge.verification.proof import PlainCast

AGREE_MM = 1e-6  # the two compute the same plane intersection; only the last digits may differ


def judge(part: Part, grid: Grid, rays: RayBundle, refractive_index: float, count: int) -> PlainCast:
    """Cast ``count`` rays, evenly picked, both ways: from the source, and on from where they entered."""
    rows = np.unique(np.linspace(0, len(rays) - 1, min(count, len(rays))).astype(np.int64))
    outside, indices = outside_leg(rays).take(rows), indices_of(rays, refractive_index)[rows]
    part.mesh.triangles_tree  # noqa: B018  built here, so that it does not count as casting
    entry = grid.first_hits(outside)
    entered = np.nonzero(entry.found)[0]
    inside = cross(part, outside.take(entered), entry.take(entered), 1.0 / indices[entered]).leg
    start = perf_counter()
    wrong = _disagreements(part, grid, outside) + _disagreements(part, grid, inside)
    seconds = perf_counter() - start
    casts = len(rows) + len(entered)
    return PlainCast(rays=len(rows), casts=casts, disagreements=wrong, rate=casts / max(seconds, 1e-9))


def _disagreements(part: Part, grid: Grid, leg: Leg) -> int:
    if len(leg.origins) == 0:
        return 0
    plain, quick = plain_distances(part.mesh, leg), grid.first_hits(leg).distances
    both = np.isfinite(plain) & np.isfinite(quick)
    apart = np.abs(np.where(both, plain, 0.0) - np.where(both, quick, 0.0)) > AGREE_MM
    return int(np.sum(apart | (np.isfinite(plain) != np.isfinite(quick))))
