"""Rays from a source through a lens for a drawing: every face that they meet, and where they leave the drawing."""

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from lensforge.kernels.chain import FROM_BEHIND, REFLECTED
from lensforge.light.exact_trace import DenseScan, exact_surfaces
from lensforge.light.sequential_trace import TracedSurface
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import TracedBundle
from lensforge.optics.dielectric import refract, transmitted_cosine_squared
from lensforge.optics.media import BODY, SIDES, Media
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import RayBundle

_NODES_PER_SIGMA = 8.0  # of the tables that tell which faces rays meet
_STEPS = 192  # of the search for a first crossing: far finer than a lens's features
_CAVITY_MM = 1e-9  # a point is in the cavity from this depth on

Points = Float[np.ndarray, "n 3"]


def trace_fan(lens: Lens, start_mm: Points, directions: Points, reach_mm: float) -> Float[np.ndarray, "n p 3"]:
    """Start, the hits on all faces that rays meet, and a point at ``reach_mm`` from the origin; NaN after their end.

    A ray ends where it meets z = 0, re-enters the cavity, or is totally reflected. One that starts below z = 0 must
    pass that plane inside the cavity; directions are upwards.
    """
    if lens.spec.lens.kind != "double":
        return _through_chain(lens, start_mm, directions, reach_mm)
    scan, media = DenseScan(_STEPS, reach_mm=2.0 * reach_mm), lens.media
    inner, outer = exact_surfaces(lens, (scan, scan))
    entry = start_mm + np.maximum(-start_mm[:, 2:] / directions[:, 2:], 0.0) * directions
    entry[inner.gap(entry) <= 0.0] = np.nan
    at_inner, inside = _crossed(inner, entry, directions, media.cavity_index / media.body.refractive_index)
    at_outer, behind = _crossed(outer, at_inner, inside, media.body.refractive_index / media.outside_index)
    at_outer[_returns(inner, at_inner, at_outer)] = np.nan
    return np.stack([start_mm, at_inner, at_outer, _at_distance(at_outer, behind, reach_mm)], axis=1)


def _through_chain(lens: Lens, start_mm: Points, directions: Points, reach_mm: float) -> Float[np.ndarray, "n p 3"]:
    """Paths by the tables of the faces: a ray that ends within the lens has no last point."""
    traced, own = TracedLens.of(lens, _NODES_PER_SIGMA), RayBundle(start_mm, directions, np.ones(len(start_mm)))
    bundle = TracedBundle.of(traced.tables, traced.scene, own)
    assert bundle.met is not None
    points, along, places = start_mm.copy(), directions.copy(), [start_mm]
    for lengths, met in zip(bundle.lengths.T, bundle.met.T, strict=True):
        rows = met >= 0
        points[rows] += lengths[rows, None] * along[rows]
        for number, name in enumerate(lens.surfaces):
            here = rows & (met // 4 == number)
            along[here] = _behind(lens, name, points[here], along[here], met[here])
        places.append(np.where(rows[:, None], points, np.nan))
    ends = np.where(bundle.exits.left_lens[:, None], _at_distance(points, along, reach_mm), np.nan)
    return np.stack([*_without_gaps(places), ends], axis=1)


def _behind(lens: Lens, name: str, points: Points, along: Points, met: np.ndarray) -> Points:
    """Directions behind a face that rays meet at ``points``."""
    from_behind = (met % 2 == FROM_BEHIND)[:, None]
    normals = lens.surfaces[name].normal(points / np.linalg.norm(points, axis=1, keepdims=True))
    normals = np.where(from_behind, -normals, normals)
    one, other = (_index(lens.media, medium) for medium in SIDES[name])
    ratio = np.where(from_behind[:, 0], other / one, one / other)
    cosine = (along * normals).sum(axis=1, keepdims=True)
    reflected = (met % 4 >= REFLECTED)[:, None]
    found: Points = np.where(
        reflected, along - 2.0 * cosine * normals, refract(along, normals, np.where(reflected[:, 0], 1.0, ratio))
    )
    return found


def _index(media: Media, medium: str) -> float:
    return media.body.refractive_index if medium == BODY else media.around(medium)


def _without_gaps(places: list[Points]) -> list[Points]:
    """Places of rays that leave early repeated where they leave: a line goes on from there."""
    for before, after in pairwise(places):
        after[np.isnan(after)] = before[np.isnan(after)]
    return places


def _crossed(surface: TracedSurface, origins: Points, directions: Points, ratio: float) -> tuple[Points, Points]:
    """First crossings at z >= 0 and directions behind them, else NaN; ``ratio``: index before over index behind."""
    points, behind = np.full_like(origins, np.nan), np.full_like(origins, np.nan)
    alive = np.flatnonzero(~np.isnan(origins + directions).any(axis=1))
    crossing = surface.first_crossing(origins[alive], directions[alive])
    hits = origins[alive] + crossing.lengths[:, None] * directions[alive]
    met = crossing.found & (hits[:, 2] >= 0.0)
    alive, hits = alive[met], hits[met]
    points[alive] = hits
    normals = surface.normal(hits)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    passes = transmitted_cosine_squared((directions[alive] * normals).sum(axis=1), ratio) > 0.0
    behind[alive[passes]] = refract(directions[alive[passes]], normals[passes], ratio)
    return points, behind


def _returns(cavity: TracedSurface, start: Points, end: Points) -> Bool[np.ndarray, " n"]:
    """True where the segment from ``start`` on the cavity to ``end`` enters the cavity again."""
    share = np.linspace(0.0, 1.0, _STEPS)[1:, None]
    points = (start[:, None] + share * (end - start)[:, None]).reshape(-1, 3)
    inside = (cavity.gap(points) > _CAVITY_MM).reshape(len(start), -1)
    return np.asarray(inside.any(axis=1))


def _at_distance(points: Points, directions: Points, reach_mm: float) -> Points:
    """Points where rays leave the sphere of ``reach_mm`` around the origin."""
    along = np.sum(points * directions, axis=1)
    length = np.sqrt(along**2 + reach_mm**2 - np.sum(points**2, axis=1)) - along
    ends: Points = points + length[:, None] * directions
    return ends
