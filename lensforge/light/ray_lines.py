"""Rays from a source through a lens as lines for a drawing: the places where they meet faces, and how they end."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

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

ENDS = ("leaves", "opening", "base", "flange", "total reflection", "cavity again", "lost in the lens")
"""How a ray ends, in words."""
_LEAVES = ENDS.index("leaves")
_BACK = ENDS.index("cavity again")
_END_BY_FATE = np.full(len(Fate), ENDS.index("lost in the lens"))
_END_BY_FATE[Fate.LEFT_LENS] = _LEAVES
_END_BY_FATE[[Fate.BACKWARD, Fate.OUTSIDE_CAVITY]] = ENDS.index("opening")
_END_BY_FATE[Fate.BASE] = ENDS.index("base")
_END_BY_FATE[Fate.FLANGE] = ENDS.index("flange")
_END_BY_FATE[Fate.TOTAL_REFLECTION] = ENDS.index("total reflection")

Points = Float[np.ndarray, "n 3"]


def fan_tables(lens: Lens) -> TracedLens:
    """``lens`` as :func:`trace_fan` follows rays through it."""
    return TracedLens.of(lens, _NODES_PER_SIGMA)


def trace_fan(
    lens: Lens, start_mm: Points, directions: Points, reach_mm: float, traced: TracedLens | None = None
) -> Float[np.ndarray, "n p 3"]:
    """Places of :func:`ray_lines` for rays by their starts and directions."""
    return ray_lines(lens, RayBundle(start_mm, directions, np.ones(len(start_mm))), reach_mm, traced).places_mm


@dataclass(frozen=True)
class RayLines:
    """Places (mm) of ``n`` rays from start to end, NaN behind it, and the end of each, of :data:`ENDS`."""

    places_mm: Float[np.ndarray, "n p 3"]
    ends: Int[np.ndarray, " n"]

    def by_end(self) -> dict[str, list[Points]]:
        """Lines of the rays with each end that occurs."""
        lines = [places[~np.isnan(places[:, 0])] for places in self.places_mm]
        return {name: [lines[k] for k in np.flatnonzero(self.ends == end)] for end, name in self._names()}

    def _names(self) -> Iterator[tuple[int, str]]:
        return ((int(end), ENDS[end]) for end in np.unique(self.ends))


def ray_lines(lens: Lens, rays: RayBundle, reach_mm: float, traced: TracedLens | None = None) -> RayLines:
    """Start, the hits on all faces that rays meet, further bodies' too, and a point at ``reach_mm`` from the origin.

    ``traced``: by :func:`fan_tables`, where they are made already. Faces that scatter are drawn as if polished.
    A ray ends where it meets z = 0, re-enters the cavity, or is totally reflected: it has no last point. One that
    starts below z = 0 must pass that plane inside the cavity; directions are upwards.
    """
    traced = traced or fan_tables(lens)
    scene = replace(traced.scene, media=traced.scene.media.polished)
    bundle = TracedBundle.of(traced.tables, scene, rays)
    in_order = np.where(bundle.lengths > 0.0, 4 * np.arange(bundle.lengths.shape[1]), -1)  # a double lens: both faces
    points = rays.origins.copy()
    along = rays.directions.copy()
    places = [rays.origins]
    for lengths, met in zip(bundle.lengths.T, (in_order if bundle.met is None else bundle.met).T, strict=True):
        rows = met >= 0
        points[rows] += lengths[rows, None] * along[rows]
        for number, name in enumerate(lens.surfaces):
            here = rows & (met // 4 == number)
            along[here] = _behind(lens, name, points[here], along[here], met[here])
        places.append(np.where(rows[:, None], points, np.nan))
    ends = _END_BY_FATE[bundle.exits.fates]
    if bundle.met is None:
        back = (ends == _LEAVES) & _returns(lens.inner, places[1], places[2])
        ends[back] = _BACK
        places[2][back] = np.nan
    if bundle.optics:
        places += _in_optics(bundle)
        points = bundle.exits.points
        along = bundle.exits.directions
    last = np.where((ends == _LEAVES)[:, None], _at_distance(points, along, reach_mm), np.nan)
    return RayLines(np.stack([*_without_gaps(places), last], axis=1), ends)


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
