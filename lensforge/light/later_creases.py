"""Light that crosses creases behind the first face that it meets, as any face moves: a part of a derivative.

``light.crease`` has the creases of the cavity, which rays meet first; here the rays that pass a crease are found by
tracing. Each of many fans has its rays in a plane through the axis, by the angle t from it. Where two neighbours of a
fan meet other faces, their interval is narrowed down to the ray in between that meets a crease. It meets both faces
after the same path, ``G = t_b - t_a = 0``. Where faces move, this ray turns by ``dt = -dG / (dG/dt)``, and the flux
that goes over is the fan's (W/rad) times dt. G depends on both faces at the crease and, by the line of the ray, on all
that it met before: the adjoint of the tracer has that, of a path that ends before the crease.

Left out, as there: the edge of total reflection, the rim, and rays that only just touch a face.
"""

from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from lensforge.kernels.bicubic import FaceBounds
from lensforge.kernels.fate import Fate
from lensforge.kernels.traced_body import BODY, FROM_BEHIND, REFLECTED, ByRaysOut
from lensforge.light.crease import BESIDE, OnFaces, RayAdjoint, Trace, in_lens, without_roughness
from lensforge.light.passage import BodyPassage
from lensforge.light.table_trace import Scene, Tables, TracedBundle, face_bounds
from lensforge.optics.pose import FACES_IN_PLACE
from lensforge.seeds import sobol
from lensforge.sources.ray_bundle import RayBundle, Source, towards

_PARTS = 8  # of an interval
_TIMES = 6  # that an interval is divided: from a few degrees to 1e-7 rad
_ROUNDS = 4  # in which intervals are looked through that hold several changes
_TOGETHER = 1e-3  # of their path: so close to each other they meet the faces of a crease

_Values = Float[np.ndarray, " k"]
_Vectors = Float[np.ndarray, "k 3"]
_Numbers = Int[np.ndarray, " k"]


def later_crease_gradients(
    tables: Tables,
    scene: Scene,
    source: Source,
    worth: RayAdjoint,
    fans: int = 2**8,
    rays: int = 48,
    seed: int = 0,
    bounds: FaceBounds | None = None,
) -> Tables:
    """Gradients of a merit by all ``tables`` for light that crosses creases at its second event and later.

    ``fans``: their number, of ``rays`` each, from start points of ``source`` that are drawn by ``seed``; ``worth`` and
    ``bounds`` as in :func:`~lensforge.light.crease.crease_gradients`, with the same errors.
    """
    scene = without_roughness(scene)
    total: Tables = np.zeros(tables.shape)
    if scene.chain is None:
        return total
    bounds = face_bounds(tables, scene) if bounds is None else bounds  # for some twenty bundles
    trace = partial(TracedBundle.of, tables, scene, bounds=bounds)
    drawn = Fans.of(source, float(tables[0].max()), fans, rays, seed)
    changes = _changes(drawn, trace)
    changes = changes.take(changes.later)
    beside = [drawn.rays(changes.fan, changes.middle + sign * BESIDE) for sign in (-1.0, 1.0)]
    creases = _at_creases(changes, *map(trace, beside))
    if not creases.any():
        return total
    changes, low, high = changes.take(creases), *(trace(bundle.take(creases)) for bundle in beside)
    flux = drawn.flux(changes.fan, changes.middle) * (worth(low) - worth(high))
    return _gradients(changes, low, high, flux)


@dataclass(frozen=True)
class Fans:
    """Rays of one start point each, aimed at points ``radius_mm`` from the origin at some ``azimuths`` about the axis.

    ``starts``: a ray of each fan; ``angles``: from the axis (rad) of those of which the flux is known, the same in all
    fans, with ``known``: that flux (W/rad).
    """

    radius_mm: float
    azimuths: Float[np.ndarray, " n"]
    starts: RayBundle
    angles: Float[np.ndarray, " s"]
    known: Float[np.ndarray, "s n"]

    @staticmethod
    def of(source: Source, radius_mm: float, count: int, rays: int, seed: int) -> "Fans":
        """Draw fans by ``seed``. Raises :class:`InputError` for a source whose light there is not known."""
        azimuths = 2.0 * np.pi * sobol(count, 5, seed)[:, 4]
        angles = 0.5 * np.pi * (np.arange(rays) + np.random.default_rng(seed).random()) / rays
        known = []
        for angle in angles:
            along = _directions(np.full(count, angle), azimuths)
            aimed = towards(source, radius_mm * along, seed)
            away = np.linalg.norm(radius_mm * along - aimed.origins, axis=1) / radius_mm
            by_angle = (aimed.directions * along).sum(axis=1) / away**2 * np.sin(angle)  # sr/rad^2
            known.append(2.0 * np.pi * aimed.flux * by_angle)
        return Fans(radius_mm, azimuths, aimed, angles, np.stack(known))

    def rays(self, fan: _Numbers, angle: _Values) -> RayBundle:
        """Rays of some fans at angles (rad) from the axis, of 1 W each."""
        starts = self.starts.take(fan)
        away = self.radius_mm * _directions(angle, self.azimuths[fan]) - starts.origins
        return replace(starts, directions=away / np.linalg.norm(away, axis=1, keepdims=True), flux=np.ones(len(fan)))

    def flux(self, fan: _Numbers, angle: _Values) -> _Values:
        """Flux (W/rad) of some fans at angles between those at which it is known."""
        place = np.interp(angle, self.angles, np.arange(len(self.angles)))
        low = np.minimum(place.astype(int), len(self.angles) - 2)
        return self.known[low, fan] + (place - low) * (self.known[low + 1, fan] - self.known[low, fan])


def _directions(angle: _Values, azimuth: _Values) -> _Vectors:
    sine = np.sin(angle)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(angle)], axis=1)


@dataclass(frozen=True)
class _Changes:
    """Intervals of angle (rad) in fans whose ends meet different faces, and the faces met."""

    fan: _Numbers
    low: _Values
    high: _Values
    met_low: Int8[np.ndarray, "k e"]
    met_high: Int8[np.ndarray, "k e"]

    @property
    def middle(self) -> _Values:
        """Middle angle of each interval."""
        return 0.5 * (self.low + self.high)

    @property
    def event(self) -> _Numbers:
        """The first event that differs."""
        return np.argmax(self.met_low != self.met_high, axis=1)

    @property
    def codes(self) -> tuple[_Numbers, _Numbers]:
        """Codes of the faces met at that event on both sides, as in ``kernels.traced_body``."""
        rows = np.arange(len(self.fan)), self.event
        return self.met_low[rows].astype(int), self.met_high[rows].astype(int)

    @property
    def later(self) -> Bool[np.ndarray, " k"]:
        """True where the faces differ at the second event or later."""
        low_face, high_face = self.codes
        return (self.event > 0) & (low_face >= 0) & (high_face >= 0) & (low_face >> 2 != high_face >> 2)

    def take(self, rows: np.ndarray) -> "_Changes":
        """Select intervals by row."""
        return _Changes(*(getattr(self, field.name)[rows] for field in fields(self)))

    def narrowed(self, fans: Fans, trace: Trace) -> "_Changes":
        """Narrow each interval down to the first change in it."""
        closer = self
        rows = np.arange(len(self.fan))
        for _ in range(_TIMES):
            angles = closer.low + (closer.high - closer.low) * np.arange(_PARTS + 1)[:, None] / _PARTS
            inner = fans.rays(np.tile(closer.fan, _PARTS - 1), angles[1:-1].ravel())
            met = trace(inner).met
            assert met is not None
            met = np.concatenate([closer.met_low, met, closer.met_high]).reshape(_PARTS + 1, len(rows), -1)
            first = np.argmax((met[1:] != met[:-1]).any(axis=2), axis=0)
            ends = angles[first, rows], angles[first + 1, rows], met[first, rows], met[first + 1, rows]
            closer = _Changes(self.fan, *ends)
        return closer


def _changes(fans: Fans, trace: Trace) -> _Changes:
    """All angles in fans at which rays change their way, narrowed down; also several in one interval."""
    count = len(fans.azimuths)
    steps = len(fans.angles)
    rays = fans.rays(np.tile(np.arange(count), steps), np.repeat(fans.angles, count))
    met = trace(rays).met
    assert met is not None
    met = met.reshape(steps, count, -1)
    step, fan = np.nonzero((met[1:] != met[:-1]).any(axis=2))
    wide = _Changes(fan, fans.angles[step], fans.angles[step + 1], met[step, fan], met[step + 1, fan])
    narrowed: list[_Changes] = []
    while len(wide.fan) and len(narrowed) < _ROUNDS:
        narrowed.append(wide.narrowed(fans, trace))
        remaining = _Changes(wide.fan, narrowed[-1].high, wide.high, narrowed[-1].met_high, wide.met_high)
        wide = remaining.take((remaining.met_low != remaining.met_high).any(axis=1))
    every = [*narrowed, wide]
    return _Changes(
        *(np.concatenate([getattr(intervals, part.name) for intervals in every]) for part in fields(_Changes))
    )


def _at_creases(changes: _Changes, low: TracedBundle, high: TracedBundle) -> Bool[np.ndarray, " k"]:
    """True where the rays beside a change agree up to it, and then meet two faces at one point."""
    assert low.met is not None and high.met is not None
    rows = np.arange(len(changes.fan))
    event = changes.event
    same: Bool[np.ndarray, " k"] = (low.met[rows, event] == changes.codes[0]) & (
        high.met[rows, event] == changes.codes[1]
    )
    before = np.arange(low.met.shape[1]) < event[:, None]
    same &= ((low.met == changes.met_low) & (high.met == changes.met_low) | ~before).all(axis=1)
    same &= ~(before & _scatters(low.scene)[low.met >> 2]).any(axis=1)
    chosen = np.flatnonzero(same)
    places = [lines.hits for lines in (_Lines.of(low, event, chosen), _Lines.of(high, event, chosen))]
    path = low.lengths[chosen, event[chosen]]
    grazed = np.any([_reflects_nothing(low.scene)[code[chosen] >> 2] for code in changes.codes], axis=0)
    path[grazed] = np.where(before, low.lengths, 0.0).sum(axis=1)[chosen[grazed]]  # of a flange the last part is short
    same[chosen] = np.linalg.norm(places[1] - places[0], axis=1) < _TOGETHER * path
    return same


def _scatters(scene: Scene) -> Bool[np.ndarray, " f"]:
    """True for faces behind which rays go on by facets of their own, and are not followed."""
    assert scene.chain is not None
    rough = {scatter.face for scatter in scene.media.scatter}
    return np.array([name in rough for name in scene.chain.names])


def _reflects_nothing(scene: Scene) -> Bool[np.ndarray, " f"]:
    """True for absorbing faces: a flange, which rays along the axis meet at grazing angles."""
    assert scene.chain is not None
    return scene.chain.packed(scene.media).mirrors == 0.0


@dataclass(frozen=True)
class _Lines:
    """Rays before one of their events: starts, directions, and paths (mm) to the face."""

    points: _Vectors
    directions: _Vectors
    paths: _Values

    @property
    def hits(self) -> _Vectors:
        """Points (mm) at which they meet the face."""
        return self.points + self.paths[:, None] * self.directions

    @staticmethod
    def of(traced: TracedBundle, event: _Numbers, rows: Int[np.ndarray, " r"]) -> "_Lines":
        """Follow some rays of a bundle, each to its event."""
        assert traced.met is not None and traced.scene.chain is not None
        event = event[rows]
        met = traced.met[rows].astype(int)
        paths = traced.lengths[rows]
        lens_rays = in_lens(traced.scene, traced.rays)
        points = lens_rays.origins[rows]
        directions = lens_rays.directions[rows]
        for number in range(event.max(initial=0)):
            on = np.flatnonzero(number < event)
            points[on] += paths[on, number, None] * directions[on]
            directions[on] = _behind(traced, rows[on], met[on, number], points[on], directions[on])
        return _Lines(points, directions, paths[np.arange(len(rows)), event])


def _behind(traced: TracedBundle, rows: _Numbers, code: _Numbers, points: _Vectors, along: _Vectors) -> _Vectors:
    """Directions of rays refracted or reflected by the faces that they meet at ``points``."""
    scene = traced.scene
    body = traced.lens.rays.indices
    assert scene.chain is not None
    face = code >> 2
    back = (code & FROM_BEHIND) > 0
    sides = scene.chain.packed(scene.media)
    indices = np.tile([scene.media.cavity_index, 1.0, scene.media.outside_index], (len(rows), 1))
    indices[:, BODY] = body[rows] if len(body) > 1 else body
    index_before, index_behind = (indices[np.arange(len(rows)), side[face]] for side in (sides.before, sides.behind))
    ratio = np.where(back, index_behind / index_before, index_before / index_behind)[:, None]
    normals = OnFaces.at(traced.tables, scene, face, points).normals
    normals *= (np.where(back, -1.0, 1.0) / np.linalg.norm(normals, axis=1))[:, None]
    cosine = (along * normals).sum(axis=1, keepdims=True)
    root = np.sqrt(np.maximum(1.0 - ratio**2 * (1.0 - cosine**2), 0.0))
    reflected = (code & REFLECTED)[:, None] > 0
    refracted = ratio * along + (root - ratio * cosine) * normals
    return np.where(reflected, along - 2.0 * cosine * normals, refracted)


def _gradients(changes: _Changes, low: TracedBundle, high: TracedBundle, flux: _Values) -> Tables:
    """Gradients by all tables: ``flux`` (of the merit, per rad) crosses over as the angle of a change grows."""
    scene = low.scene
    rows = np.arange(len(flux))
    event = changes.event
    line = _Lines.of(low, event, rows)
    beside = _Lines.of(high, event, rows)
    faces = [OnFaces.at(low.tables, scene, code >> 2, line.hits) for code in changes.codes]
    steep = [(face.normals * line.directions).sum(axis=1) for face in faces]
    across = faces[0].normals / steep[0][:, None] - faces[1].normals / steep[1][:, None]
    hits = beside.points + line.paths[:, None] * beside.directions
    by_gap = -flux * 2.0 * BESIDE / (across * (hits - line.hits)).sum(axis=1)
    total: Tables = np.zeros(low.tables.shape)
    faces[0].add(-by_gap / steep[0], total)
    faces[1].add(by_gap / steep[1], total)
    by_point = by_gap[:, None] * across
    none = np.zeros(len(flux))
    by = ByRaysOut(by_point, line.paths[:, None] * by_point, none, none)
    total += _before(low, event).gradients(by)
    return total


def _before(traced: TracedBundle, event: _Numbers) -> BodyPassage:
    """The rays, in the frame of the faces, as if each left before its event, where its adjoint then ends."""
    lens = traced.lens
    lens_rays = in_lens(traced.scene, traced.rays)
    assert lens.ways.met is not None
    is_before = np.arange(lens.ways.met.shape[1]) < event[:, None]
    return replace(
        lens,
        body=lens.body._replace(placement=FACES_IN_PLACE.packed()),
        rays=lens.rays._replace(origins=lens_rays.origins, directions=lens_rays.directions),
        ways=lens.ways._replace(met=np.where(is_before, lens.ways.met, -1).astype(np.int8)),
        exits=lens.exits._replace(fates=np.full(len(event), Fate.LEFT_LENS, dtype=np.int8)),
    )
