"""Rays cast through the further bodies, by the radius of their faces alone: without the design's tables and its code.

A face is met where the distance from the origin of its body first exceeds its radius. Light that it reflects, and rays
that pass the rim or are totally reflected, are lost there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.face_roles import DOUBLE
from lensforge.optics.media import Media, RingScatter, SecondaryOptic, Surface, Wavelengths
from lensforge.proof.facet_tilt import Arrival, FaceNumbers, facet_slopes, tilted
from lensforge.proof.optical_faces import PlateOfLenses
from lensforge.proof.refraction import AtFace, Fields, RefractingFace, through_glass, unpolarised
from lensforge.proof.ring_spread import Spreading

_SCANNED = 24  # places along a ray among which its first crossing lies
_STEPS = 60  # halvings from there
_DIRECTIONS = 2000  # by which the size of a face is known
_ROOM = 1.05

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]


@dataclass
class _Beam:
    """Light on its way: all rays, and the remaining share of each ray's flux, NaN if lost."""

    points: _Vectors
    directions: _Vectors
    fields: Fields
    share: _Values
    rough: list[FaceNumbers]

    def end(self, rows: Int[np.ndarray, " k"]) -> None:
        """Mark some of the rays as lost."""
        self.points[rows] = np.nan
        self.directions[rows] = np.nan
        self.share[rows] = 0.0


class BehindOptics(NamedTuple):
    """Rays behind all optics: points (mm), directions, and transmittances of the bodies and the cover glass."""

    points: _Vectors
    directions: _Vectors
    through_bodies: _Values
    through_glass: _Values


def behind_optics(
    points: _Vectors,
    directions: _Vectors,
    media: Media,
    wavelengths_nm: _Values,
    fields: Fields | None = None,
    plate: PlateOfLenses | None = None,
    rough: Sequence[FaceNumbers] = (),
) -> BehindOptics:
    """Rays behind the bodies and then the cover glass of ``media``; NaN for those that end in a body.

    ``fields`` None: unpolarised light. ``plate``: lenses that each have bodies of their own. ``rough``: numbers for
    rough faces of each body; by default all are polished.
    """
    known = unpolarised(directions) if fields is None else fields
    beam = _Beam(points.copy(), directions.copy(), known.copy(), np.ones(len(points)), list(rough))
    if media.bodies:
        _through_bodies(beam, media, wavelengths_nm, plate)
    ends, ways, glass = through_glass(beam.points, beam.directions, media, wavelengths_nm, beam.fields)
    return BehindOptics(ends, ways, beam.share, glass)


def _through_bodies(beam: _Beam, media: Media, waves: _Values, plate: PlateOfLenses | None) -> None:
    if plate is None:
        for number, body in enumerate(media.bodies):
            none = FaceNumbers(np.zeros((len(waves), 0)), np.zeros(len(waves), dtype=np.uint64))
            _through(body, media, beam, waves, beam.rough[number] if beam.rough else none)
        return
    rows = np.flatnonzero(np.isfinite(beam.points[:, 0]))
    points, numbers = plate.at_local(beam.points[rows])
    turns = plate.turns_to(numbers)
    ways = np.einsum("nij,nj->ni", turns, beam.directions[rows])
    fields = np.einsum("nij,nkj->nki", turns, beam.fields[rows])
    rough = [numbers_of_body.take(rows) for numbers_of_body in beam.rough]
    alone = _Beam(points, ways, fields, beam.share[rows], rough)
    _through_bodies(alone, media, waves[rows], None)
    beam.points[rows] = plate.to_lit_points(alone.points, numbers)
    beam.directions[rows] = np.einsum("nji,nj->ni", turns, alone.directions)
    beam.fields[rows] = np.einsum("nji,nkj->nki", turns, alone.fields)
    beam.share[rows] = alone.share


def _through(body: SecondaryOptic, media: Media, beam: _Beam, waves: _Values, rough: FaceNumbers) -> None:
    rows = np.flatnonzero(np.isfinite(beam.points[:, 0]))
    points = body.pose.to_local_points(beam.points[rows])
    along = body.pose.to_local_directions(beam.directions[rows])
    enters, points = _from_the_rim(points, along)
    beam.end(rows[~enters])
    rows = rows[enters]
    points = points[enters]
    along = along[enters]
    inside = media.outside_index
    media_of_body = body.media(media)
    for face, shape in (("inner", body.inner), ("outer", body.outer)):
        paths, met = _first_crossing(shape, points, along)
        beam.end(rows[~met])
        rows = rows[met]
        along = along[met]
        starts = points[met]
        paths = paths[met]
        points = starts + paths[:, None] * along
        wavelengths = Wavelengths(waves[rows])
        leaving = face == "outer"
        indices = body.medium.indices(wavelengths, len(rows))
        if leaving:
            beam.share[rows] *= np.exp(-body.medium.absorptions(wavelengths, len(rows)) * paths)
        around = np.full(len(rows), inside)
        before, behind = (indices, around) if leaving else (around, indices)
        refracting = RefractingFace(before, behind, media_of_body.coating(face), wavelengths.nm, not leaving)
        normals = shape.normal(points / np.linalg.norm(points, axis=1, keepdims=True))
        number = DOUBLE.index(face)
        (model,) = media_of_body.scattering_of([face]) or (None,)
        numbers = rough.take(rows).at(np.full(len(rows), number), np.zeros(len(rows), dtype=np.int64))
        rms = np.full(len(rows), facet_slopes(media_of_body, DOUBLE)[number])
        normals = tilted(Arrival(points, normals, along), rms, numbers)
        at = AtFace.of(refracting, along, normals, body.pose.to_local_directions(beam.fields[rows]))
        if isinstance(model, RingScatter):
            at = at.spread(Spreading.of(model, numbers, Arrival(points, normals, along)), False)
        beam.share[rows] *= at.transmittance
        beam.fields[rows] = body.pose.directions(at.passed)
        passes = at.transmittance > 0.0
        beam.end(rows[~passes])
        rows = rows[passes]
        points = points[passes]
        along = at.bent[passes]
    beam.points[rows] = body.pose.points(points)
    beam.directions[rows] = body.pose.directions(along)


def _from_the_rim(points: _Vectors, along: _Vectors) -> tuple[Bool[np.ndarray, " n"], _Vectors]:
    """True for rays that reach the body's end plane, or start above it; their points there."""
    below = points[:, 2] < 0.0
    rises = along[:, 2] > 0.0
    path = np.where(below & rises, -points[:, 2] / np.where(rises, along[:, 2], 1.0), 0.0)
    started = points + path[:, None] * along
    return ~below | rises, started


def _first_crossing(shape: Surface, points: _Vectors, along: _Vectors) -> tuple[_Values, Bool[np.ndarray, " n"]]:
    """Path (mm) to where rays first leave the face from within, and whether at or above z = 0."""
    depth = _depths(shape, points)
    far = _ROOM * _size(shape)
    middle = np.sum(points * along, axis=1)
    ends = np.sqrt(np.maximum(middle**2 + far**2 - np.sum(points**2, axis=1), 0.0)) - middle
    down = along[:, 2] < 0.0
    ends = np.minimum(ends, np.where(down, -points[:, 2] / np.where(down, along[:, 2], 1.0), np.inf))
    low = np.zeros(len(points))
    high = np.zeros(len(points))
    crossed = np.zeros(len(points), dtype=bool)
    for step in range(1, _SCANNED + 1):
        path = ends * (step / _SCANNED)
        new = ~crossed & (_depths(shape, points + path[:, None] * along) < 0.0)
        high = np.where(new, path, high)
        crossed |= new
        low = np.where(crossed, low, path)
    for _ in range(_STEPS):
        half = 0.5 * (low + high)
        out = _depths(shape, points + half[:, None] * along) < 0.0
        low = np.where(out, low, half)
        high = np.where(out, half, high)
    return 0.5 * (low + high), crossed & (depth > 0.0)


def _size(shape: Surface) -> float:
    """Largest radius (mm) of a face over the hemisphere."""
    turns = np.arange(_DIRECTIONS) * np.pi * (3.0 - np.sqrt(5.0))
    heights = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    across = np.sqrt(1.0 - heights**2)
    return float(shape.radius(np.column_stack([across * np.cos(turns), across * np.sin(turns), heights])).max())


def _depths(shape: Surface, points: _Vectors) -> _Values:
    """Radius (mm) of the face in the direction of each point, less the point's distance from the origin."""
    distances = np.linalg.norm(points, axis=1)
    ways = np.where(distances[:, None] > 0.0, points, [0.0, 0.0, 1.0])
    return shape.radius(ways / np.linalg.norm(ways, axis=1, keepdims=True)) - distances
