"""Rays from a source through a lens for a drawing: every face that they meet, and where they leave the drawing."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from lensforge.kernels.fate import Fate
from lensforge.kernels.traced_body import FROM_BEHIND, REFLECTED
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import TracedBundle
from lensforge.optics.dielectric import refract
from lensforge.optics.face_roles import BODY
from lensforge.optics.media import Media
from lensforge.scene.lens import Lens
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.surface import Surface

_NODES_PER_SIGMA = 4.0  # of the tables: hits lie within some micrometres of the faces
_STEPS = 192  # along a ray between two faces: far finer than a lens's features
_CAVITY_MM = 1e-9  # a point is in the cavity from this depth on

Points = Float[np.ndarray, "n 3"]


def fan_tables(lens: Lens) -> TracedLens:
    """``lens`` as :func:`trace_fan` follows rays through it."""
    return TracedLens.of(lens, _NODES_PER_SIGMA)


def trace_fan(
    lens: Lens, start_mm: Points, directions: Points, reach_mm: float, traced: TracedLens | None = None
) -> Float[np.ndarray, "n p 3"]:
    """Start, the hits on all faces that rays meet, further bodies' too, and a point at ``reach_mm`` from the origin.

    ``traced``: by :func:`fan_tables`, where they are made already. NaN after their end. Faces that scatter are drawn as
    if polished.
    A ray ends where it meets z = 0, re-enters the cavity, or is totally reflected: it has no last point. One that
    starts below z = 0 must pass that plane inside the cavity; directions are upwards.
    """
    traced = traced or fan_tables(lens)
    scene = replace(traced.scene, media=traced.scene.media.polished)
    bundle = TracedBundle.of(traced.tables, scene, RayBundle(start_mm, directions, np.ones(len(start_mm))))
    in_order = np.where(bundle.lengths > 0.0, 4 * np.arange(bundle.lengths.shape[1]), -1)  # a double lens: both faces
    points = start_mm.copy()
    along = directions.copy()
    places = [start_mm]
    for lengths, met in zip(bundle.lengths.T, (in_order if bundle.met is None else bundle.met).T, strict=True):
        rows = met >= 0
        points[rows] += lengths[rows, None] * along[rows]
        for number, name in enumerate(lens.surfaces):
            here = rows & (met // 4 == number)
            along[here] = _behind(lens, name, points[here], along[here], met[here])
        places.append(np.where(rows[:, None], points, np.nan))
    left = bundle.exits.left_lens
    if bundle.met is None:
        back = _returns(lens.inner, places[1], places[2])
        left = left & ~back
        places[2][back] = np.nan
    if bundle.optics:
        places += _in_optics(bundle)
        points = bundle.exits.points
        along = bundle.exits.directions
    ends = np.where(left[:, None], _at_distance(points, along, reach_mm), np.nan)
    return np.stack([*_without_gaps(places), ends], axis=1)


def _in_optics(bundle: TracedBundle) -> list[Points]:
    """Hits on both faces of each optic behind the lens; NaN where a ray does not come to them."""
    places = []
    for passage in bundle.optics:
        hits = passage.rays.origins + passage.ways.lengths[:, :1] * passage.rays.directions
        came = passage.met[:, :1] >= 0
        left = passage.exits.fates[:, None] == Fate.LEFT_LENS
        places += [np.where(came, hits, np.nan), np.where(left, passage.exits.points, np.nan)]
    return places


def _behind(lens: Lens, name: str, points: Points, along: Points, met: np.ndarray) -> Points:
    from_behind = (met % 2 == FROM_BEHIND)[:, None]
    normals = lens.surfaces[name].normal(points / np.linalg.norm(points, axis=1, keepdims=True))
    normals = np.where(from_behind, -normals, normals)
    face = lens.body.face(name)
    index_before, index_behind = (_index(lens.media, medium) for medium in (face.before, face.behind))
    ratio = np.where(from_behind[:, 0], index_behind / index_before, index_before / index_behind)
    cosine = (along * normals).sum(axis=1, keepdims=True)
    reflected = (met % 4 >= REFLECTED)[:, None]
    with np.errstate(invalid="ignore"):  # totally reflected: NaN
        refracted = refract(along, normals, np.where(reflected[:, 0], 1.0, ratio))
    return np.asarray(np.where(reflected, along - 2.0 * cosine * normals, refracted))


def _index(media: Media, medium: str) -> float:
    return media.body.refractive_index if medium == BODY else media.around(medium)


def _without_gaps(places: list[Points]) -> list[Points]:
    """Places of rays that leave early repeated where they leave: a line goes on from there."""
    for before, after in pairwise(places):
        after[np.isnan(after)] = before[np.isnan(after)]
    return places


def _returns(cavity: Surface, start: Points, end: Points) -> Bool[np.ndarray, " n"]:
    """True where the segment from ``start`` on the cavity to ``end`` enters the cavity again."""
    share = np.linspace(0.0, 1.0, _STEPS)[1:, None]
    points = (start[:, None] + share * (end - start)[:, None]).reshape(-1, 3)
    depth = cavity.radius(points / np.linalg.norm(points, axis=1, keepdims=True)) - np.linalg.norm(points, axis=1)
    return np.asarray((depth > _CAVITY_MM).reshape(len(start), -1).any(axis=1))


def _at_distance(points: Points, directions: Points, reach_mm: float) -> Points:
    """Points where rays leave the sphere of ``reach_mm`` around the origin."""
    along = np.sum(points * directions, axis=1)
    length = np.sqrt(along**2 + reach_mm**2 - np.sum(points**2, axis=1)) - along
    return points + length[:, None] * directions
