"""Light through the further bodies: what leaves the lens, or the body before, is the source of the next one.

Rays go into the frame of a body and through its two faces by the kernels' loop for chains of events, with the
polarisation in which they come. Light that a face reflects, that the body absorbs, that goes past it or ends in it is
lost there, and followed no further.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int, Int8

from lensforge.errors import InputError
from lensforge.kernels.adjoint import empty_adjoint, trace_adjoint
from lensforge.kernels.bicubic import FaceBounds, surface_bounds
from lensforge.kernels.chain_adjoint import empty_chain
from lensforge.kernels.fate import Fate
from lensforge.kernels.nearly_convex import chain_bounds
from lensforge.kernels.parallel import in_chunks, part_of
from lensforge.kernels.ray_packet import empty_packet
from lensforge.kernels.trace import trace
from lensforge.light.coated_glass import RayCoatings, face_transmittances
from lensforge.optics.dielectric import fields_behind, passing_amplitudes, unpolarised_fields
from lensforge.optics.media import DOUBLE, FurtherBody, Media
from lensforge.scene.as_made import Placed, through_frame
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, table_error, tabulate

TWO_FACES = Chain(DOUBLE, ("cavity", "body"), ("body", "outside"), 2)
_FEWEST_NODES, _MOST_NODES, _TABLE_ERROR_MM = 49, 769, 1e-6  # a nanometre

_Fields = Float[np.ndarray, "n 12"]
_Values = Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class TabledBody:
    """The tables of both faces of a body, their grid, and the bounds that the kernels take."""

    tables: Float[np.ndarray, "2 side side"]
    grid: TableGrid
    bounds: FaceBounds


@lru_cache(maxsize=32)
def tabled(body: FurtherBody) -> TabledBody:
    """Tables of a body within a nanometre of its faces, or as fine as tables are."""
    nodes, faces = _FEWEST_NODES, (body.inner, body.outer)
    while True:
        grid = TableGrid(nodes)
        tables = np.stack([tabulate(grid, face) for face in faces])
        errors = [table_error(grid, table, face) for table, face in zip(tables, faces, strict=True)]
        if max(errors) <= _TABLE_ERROR_MM or 2 * nodes > _MOST_NODES:
            break
        nodes *= 2
    each = FaceBounds.of([surface_bounds(table, grid.origin, grid.step) for table in tables])
    before = np.array([0, 1], dtype=np.int8)
    return TabledBody(tables, grid, chain_bounds(tables, each, before, grid.origin, grid.step))


@dataclass(frozen=True, eq=False)
class BodyPassage:
    """Rays through one body, and what their adjoint needs; ``rows``: numbers of the rays that come to it.

    ``own``: these rays in the frame of the body, ``begun`` their fields; ``lengths`` and ``met`` as the kernels fill
    them, ``fates`` of these rays alone.
    """

    body: FurtherBody
    media: Media
    fresnel: bool
    rows: Int[np.ndarray, " k"]
    own: RayBundle
    begun: _Fields
    coatings: RayCoatings
    lengths: Float[np.ndarray, "k 2"]
    met: Int8[np.ndarray, "k 2"]
    fates: Int8[np.ndarray, " k"]

    @property
    def _packed(self) -> tuple[bool, float, float, float, float]:
        grid, outside = tabled(self.body).grid, self.media.outside_index
        return self.fresnel, outside, outside, grid.origin, 1.0 / grid.step

    def back(
        self, by: Sensitivities, by_flux: _Values, by_fields: _Fields | None
    ) -> tuple[Sensitivities, _Values, _Fields]:
        """Sensitivities to the rays, their flux and their fields behind the body taken to those before it.

        That to the flux is then in that to the fields; None: behind the last body there is no other.
        """
        body, rows, place = tabled(self.body), self.rows, self.body
        by_points, by_directions = (place.own_directions(each[rows]) for each in by)
        behind = np.zeros((len(rows), 12)) if by_fields is None else by_fields[rows]
        ended, flux = _turned(behind, place.own_directions), by_flux[rows]
        found, none = np.zeros((len(rows), 18)), np.zeros(len(rows))
        indices, absorptions = _values(self.media, self.own)
        faces, packed = self.coatings.for_kernels(DOUBLE), TWO_FACES.packed(self.media)

        def work(_: int, part: slice) -> None:
            trace_adjoint(
                self.own.origins[part], self.own.directions[part], self.own.flux[part],
                part_of(indices, part), part_of(absorptions, part), body.tables, self._packed, faces,
                self.coatings.part(part), None, None, packed, self.begun[part], self.lengths[part], self.met[part],
                self.fates[part], by_points[part], by_directions[part], flux[part], None, none[part], ended[part],
                found[part], body.tables, empty_adjoint(), empty_chain(2), np.zeros(12),
            )  # fmt: skip

        in_chunks(work, len(rows))
        count = len(by_flux)
        points, directions, fields = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 12))
        points[rows], directions[rows] = (place.placed_directions(found[:, k : k + 3]) for k in (0, 3))
        fields[rows] = _turned(found[:, 6:], place.placed_directions)
        return Sensitivities(points, directions), np.zeros(count), fields


def _values(media: Media, rays: RayBundle) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " j"]]:
    """Index of a body for each ray, or one for all; its absorption (1/mm) likewise, nothing where it is clear."""
    return media.body.index(rays.wavelengths_nm), media.body.absorption(rays.wavelengths_nm)


def _turned(fields: _Fields, turn: Callable[[Float[np.ndarray, "m 3"]], Float[np.ndarray, "m 3"]]) -> _Fields:
    """Four vectors of each ray in another frame."""
    turned: _Fields = turn(fields.reshape(-1, 3)).reshape(-1, 12)
    return turned


def polarised(exits: ExitRays, ended: _Fields | None) -> ExitRays:
    """``exits`` of the lens with the fields with which they ended; themselves without."""
    if ended is None:
        return exits
    squared = np.sum(ended**2, axis=1)
    carried = np.where(exits.left_lens, 2.0 * exits.flux / np.where(squared > 0.0, squared, 1.0), 0.0)
    return replace(exits, fields=ended, carried=carried)


def fields_of_two_faces(
    rays: RayBundle, exits: ExitRays, first_mm: _Values, placed: Placed, indices: Float[np.ndarray, " k"], media: Media,
    coatings: RayCoatings,
) -> _Fields:  # fmt: skip
    """Fields of ``exits`` of the usual lens as it was made, whose kernel keeps none: from the directions of each ray.

    ``first_mm``: paths to the inner face; ``indices`` of the body. By Snell's law a normal is along the change of the
    direction, each taken times its index.
    """
    (first, between, last), into, back = placed
    points, along = through_frame(first, rays.origins, rays.directions, into)
    points = points + first_mm[:, None] * along
    for frame, factor in ((between, 1.0), (last, back)):
        points, along = through_frame(frame, points, along, factor)
    rows = np.flatnonzero(exits.left_lens)
    inside = exits.points[rows] - points[rows]
    inside /= np.linalg.norm(inside, axis=1, keepdims=True)
    own = indices[rows] if len(indices) > 1 else np.full(len(rows), indices[0])
    fields, before = unpolarised_fields(along[rows]), along[rows]
    steps = ((inside, media.cavity_index / own), (exits.directions[rows], own / media.outside_index))
    for name, (behind, ratio) in zip(DOUBLE, steps, strict=True):
        normals = (behind - ratio[:, None] * before) * np.sign(1.0 - ratio)[:, None]
        size = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(size > 0.0, normals / np.where(size > 0.0, size, 1.0), before)
        cosine = np.minimum((before * normals).sum(axis=1), 1.0)
        passed = face_transmittances(cosine, ratio, coatings.faces.get(name), coatings.rows, rows)
        fields = fields_behind(fields, before, behind, normals, passing_amplitudes(passed, ratio))
        before = behind
    found = np.zeros((len(rays), 12))
    found[rows, :3], found[rows, 6:9] = fields[:, 0], fields[:, 1]
    return found


def through_bodies(
    exits: ExitRays, media: Media, rays: RayBundle, fresnel: bool = True
) -> tuple[ExitRays, tuple[BodyPassage, ...]]:
    """The ``exits`` of the lens behind all bodies of ``media``, and the passage through each; ``rays``: as they began.

    Themselves where there is no body.
    """
    passages = []
    for body in media.bodies:
        exits, passage = _through(body, exits, media, rays, fresnel)
        passages.append(passage)
    return exits, tuple(passages)


def _through(
    body: FurtherBody, exits: ExitRays, around: Media, rays: RayBundle, fresnel: bool
) -> tuple[ExitRays, BodyPassage]:
    """Rays behind one body."""
    assert exits.fields is not None and exits.carried is not None, "light that comes to a body has its polarisation"
    rows, media, place = np.flatnonzero(exits.left_lens), body.media(around), tabled(body)
    count = len(rows)
    own = replace(
        rays.take(rows),
        origins=body.own_points(exits.points[rows]),
        directions=body.own_directions(exits.directions[rows]),
        flux=exits.carried[rows],
    )
    coatings = _coatings(body, own, media, fresnel)
    begun, ended = _turned(exits.fields[rows], body.own_directions), np.zeros((count, 12))
    lengths, met = np.empty((count, 2)), np.full((count, 2), -1, dtype=np.int8)
    fates = np.empty(count, dtype=np.int8)
    passage = BodyPassage(body, media, fresnel, rows, own, begun, coatings, lengths, met, fates)
    points, directions = np.zeros((count, 3)), np.zeros((count, 3))
    flux, sin2_exit, (indices, absorptions) = np.empty(count), np.empty(count), _values(media, own)
    absorbed = np.zeros(count if len(absorptions) else 0)
    faces, packed = coatings.for_kernels(DOUBLE), TWO_FACES.packed(media)

    def work(_: int, part: slice) -> None:
        trace(
            own.origins[part], own.directions[part], own.flux[part], part_of(indices, part), part_of(absorptions, part),
            place.tables, place.bounds, passage._packed, faces, coatings.part(part), None, None, packed,
            begun[part], lengths[part], met[part], points[part], directions[part], flux[part], absorbed[part], None,
            sin2_exit[part], fates[part], ended[part], empty_packet(),
        )  # fmt: skip

    in_chunks(work, count)
    out = fates == Fate.LEFT_LENS
    left, all_fates = rows[out], exits.fates.copy()
    all_fates[rows] = fates
    all_points, all_directions, fields = (
        np.zeros_like(each) for each in (exits.points, exits.directions, exits.fields)
    )
    all_points[left], all_directions[left] = body.placed_points(points[out]), body.placed_directions(directions[out])
    fields[left] = _turned(ended[out], body.placed_directions)
    all_flux = exits.flux.copy()
    all_flux[rows] = np.where(out, flux, 0.0)
    before = np.zeros((0, len(all_flux))) if exits.lost_in_bodies is None else exits.lost_in_bodies
    lost = np.concatenate([before, (exits.flux - all_flux)[None]])
    behind = replace(
        exits, points=all_points, directions=all_directions, flux=all_flux, fates=all_fates, lost_in_bodies=lost
    )
    return polarised(behind, fields), passage


def _coatings(body: FurtherBody, rays: RayBundle, media: Media, fresnel: bool) -> RayCoatings:
    """Coatings of its faces. Raises :class:`InputError` for light at whose wavelengths one is not known."""
    try:
        return RayCoatings.of(rays, media, fresnel)
    except InputError as error:
        raise InputError(str(error).replace("lens.", f"body {body.name!r}: ", 1)) from None
