"""Sequential trace of the part, event by event, through its mesh or through the faces of its STEP file.

A ray meets the first triangle or face on its way, whatever it is. By Snell's law it is refracted there or reflected
totally, or a mirror reflects it. Light that a face reflects in part is not followed.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import product
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from trimesh.triangles import points_to_barycentric

from lensforge.optics.face_roles import DOUBLE
from lensforge.optics.media import Media, Mirror, RingScatter
from lensforge.proof.body_cast import behind_optics
from lensforge.proof.facet_casting import FacetHits, Grid, Leg, RayRows
from lensforge.proof.facet_tilt import Arrival, FaceNumbers, facet_slopes, tilted
from lensforge.proof.obstacles import wall_numbers
from lensforge.proof.optical_faces import NO_FACE, OpticalFaces
from lensforge.proof.part_mesh import PartMesh
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.refraction import AtFace, Fields, LitRays, RefractingFace, unpolarised
from lensforge.proof.ring_spread import Spreading
from lensforge.sources.ray_bundle import RayBundle

_CHUNK = 1024  # rays that a thread casts at a time: their candidates stay in its cache
# A ray that leaves a curved point may meet the facets just left: hits nearer than this share of an edge are those.
_SKIN_EDGES = 0.05
SKIN_MM = 1e-6  # where the side of a facet is looked at: small, so that light in corners is followed too
_SIDES = 4  # tries to get past facets whose side contradicts the medium that the ray is in


class CastFate(IntEnum):
    """Fate of a ray cast through the part."""

    LANDED = 0  # left the lens, and reached the receiver's surface
    NO_HIT = 1  # met no part of the body
    STARTS_INSIDE = 2  # its first hit leaves the material: it started in the body, or the mesh is inside out
    BASE = 3  # met a surface at or below z = 0 in the material, instead of leaving it
    BACK_INTO_CAVITY = 4  # left the material by a surface that faces the origin, where no reflection is followed
    TOTAL_REFLECTION = 5  # totally reflected at the last event, or where no reflection is followed
    MISSED_RECEIVER = 6  # left the lens, but never reaches the receiver's plane
    OPENING = 7  # met a surface at or below z = 0 on the way in: the wall of the base's opening, or its bottom
    STARTS_OUTSIDE = 8  # met the outside of the lens first: it started neither in the cavity nor below it
    EVENT_LIMIT = 9  # reflected by a mirror, or still not out of the lens, at its last event
    FLANGE = 10  # absorbed at the flange, by what holds it
    HOUSING = 11  # left the lens, and met a black body of the scene before the receiver
    SECOND_WALL = 12  # left the lens, went on from bodies of the scene by all its events, and met a further one


@dataclass(frozen=True)
class Passage:
    """Ends of ``n`` rays: exit point (mm) and direction, NaN if lost in the lens, flux (W) left in the ray, fate.

    ``absorbed``, ``in_glass``, ``in_bodies``: flux (W) lost in body and mirrors, in a cover glass, and in further
    bodies. ``fields``: of its polarisation. ``facets_um``: height of the curved surface over the flat facet at each
    event, 0 where there was none. ``met``: number of the face at each event, NO_FACE where there was none.
    ``draws``: two numbers in [0, 1) of each ray for every event at bodies of the scene, which may be diffuse.
    """

    points: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    absorbed: Float[np.ndarray, " n"]
    in_glass: Float[np.ndarray, " n"]
    fates: Int[np.ndarray, " n"]
    facets_um: Float[np.ndarray, "n events"]
    fields: Fields
    met: Int[np.ndarray, "n events"]
    in_bodies: Float[np.ndarray, " n"]
    draws: Float[np.ndarray, "n d"]

    @staticmethod
    def of(rays: RayBundle, events: int) -> "Passage":
        """Passage of ``rays`` as emitted, with room for ``events`` events."""
        return Passage(
            points=np.full((len(rays), 3), np.nan),
            directions=np.full((len(rays), 3), np.nan),
            flux=rays.flux.copy(),
            absorbed=np.zeros(len(rays)),
            in_glass=np.zeros(len(rays)),
            fates=np.full(len(rays), CastFate.NO_HIT, dtype=np.int64),
            facets_um=np.zeros((len(rays), events)),
            fields=unpolarised(rays.directions),
            met=np.full((len(rays), events), NO_FACE),
            in_bodies=np.zeros(len(rays)),
            draws=np.zeros((len(rays), 2)),
        )

    def landed(self, screen: Screen) -> "LandedRays":
        """Land the rays that left the lens."""
        landings = np.full((len(self.flux), 2), np.nan)
        fates = self.fates.copy()
        flux = self.flux.copy()
        left = np.nonzero(self.fates == CastFate.LANDED)[0]
        reached = screen.reached(self.points[left], self.directions[left], self.draws[left])
        landings[left] = reached.places
        flux[left] *= reached.onward
        lost = [reached.again, reached.onward == 0.0, np.isnan(reached.places[:, 0])]
        ends = [CastFate.SECOND_WALL, CastFate.HOUSING, CastFate.MISSED_RECEIVER]
        fates[left] = np.select(lost, ends, CastFate.LANDED)
        of_passage = {**vars(self), "fates": fates, "flux": flux}
        return LandedRays(**of_passage, landings=landings, in_housing=self.flux - flux)


def behind_lens(
    passage: Passage, rays: RayBundle, media: Media, optical: OpticalFaces, seed: int | None = None
) -> Passage:
    """Continue rays that left the lens, or one of a plate, through the further bodies and the cover glass.

    ``passage``: in the coordinates of the files; ``rays``: as they began; ``optical``: the faces of the part; ``seed``:
    of facets that are not those of the design.
    """
    points = optical.expansion.from_files(passage.points)
    passage = replace(passage, points=points, draws=wall_numbers(rays, media, seed))
    if media.cover_glass is None and not media.bodies:
        return passage
    waves = media.wavelengths(rays.wavelengths_nm, len(rays))
    met = [
        (rays, body.media(media), DOUBLE, media.scattering_before(number), seed)
        for number, body in enumerate(media.bodies)
    ]
    rough = [FaceNumbers.of(*arguments) for arguments in met]
    behind = behind_optics(passage.points, passage.directions, media, waves, passage.fields, optical.plate, rough)
    out_of_bodies = passage.flux * behind.through_bodies
    left = out_of_bodies * behind.through_glass
    return replace(
        passage,
        points=behind.points,
        directions=behind.directions,
        flux=left,
        in_bodies=passage.flux - out_of_bodies,
        in_glass=out_of_bodies - left,
    )


@dataclass(frozen=True)
class LandedRays(Passage):
    """A passage and where its rays land on the chart of a screen, NaN if lost; some may have missed the receiver.

    ``in_housing``: flux (W) that bodies of the scene take, which each meets.
    """

    landings: Float[np.ndarray, "n 2"]
    in_housing: Float[np.ndarray, " n"]

    @property
    def fate_names(self) -> Shaped[np.ndarray, " n"]:
        """Name of the fate of each ray."""
        return np.array([fate.name.lower() for fate in CastFate])[self.fates]


@dataclass(frozen=True)
class SurfaceHits(RayRows):
    """First hits of rays on a body: whether one was found, point (mm), unit normal of either sign.

    ``leaving``: the ray leaves the material there. ``away``: that side of the body faces away from the origin, as the
    outside of a lens does. ``faces``: number of the optical face, NO_FACE where none is. ``skins``: distance (mm)
    within which a continuing ray may meet the surface just left. ``heights``: of the point over a facet (mm).
    """

    found: Bool[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    leaving: Bool[np.ndarray, " n"]
    away: Bool[np.ndarray, " n"]
    faces: Int[np.ndarray, " n"]
    skins: Float[np.ndarray, " n"]
    heights: Float[np.ndarray, " n"]

    @property
    def base(self) -> Bool[np.ndarray, " n"]:
        """True for hits at or below z = 0."""
        return self.faces == NO_FACE


@runtime_checkable
class CastBody(Protocol):
    """A body for casting rays: a mesh, or the faces of a STEP file."""

    @property
    def optical(self) -> OpticalFaces:
        """Its optical faces."""
        ...

    def surface_hits(self, leg: Leg, inside: Bool[np.ndarray, " n"] | None = None) -> SurfaceHits:
        """First hit of each ray. ``inside``: True for rays in the material, where that is known."""
        ...


@dataclass(frozen=True)
class MeshBody:
    """The curved surface over the facets of a mesh."""

    part: PartMesh
    grid: Grid

    @property
    def optical(self) -> OpticalFaces:
        """Its optical faces."""
        return self.part.optical

    def surface_hits(self, leg: Leg, inside: Bool[np.ndarray, " n"] | None = None) -> SurfaceHits:
        """First hit of each ray; its side and its face are those of the flat facet.

        ``inside``: True for rays in the material; they pass facets of the other side, by which the facet just left is
        recognised. A grazing ray may miss its own.
        """
        if inside is not None:
            leg = leg._replace(beyond=np.minimum(leg.beyond, SKIN_MM))
        hits = self.grid.first_hits(leg)
        count = len(leg.origins)
        for _ in range(0 if inside is None else _SIDES):
            wrong = np.nonzero(hits.found & (self._leaving(leg, hits) != inside))[0]
            if len(wrong) == 0:
                break
            beyond = hits.distances[wrong] * (1.0 + 1e-9) + 1e-9
            second_hits = self.grid.first_hits(Leg(leg.origins[wrong], leg.directions[wrong], beyond))
            for name, values in vars(second_hits).items():
                getattr(hits, name)[wrong] = values
        no = np.zeros(count, dtype=bool)
        place = np.zeros((count, 3))
        zero = np.zeros(count)
        none = np.full(count, NO_FACE)
        on_surface = SurfaceHits(hits.found, place, place.copy(), no, no.copy(), none, zero, zero.copy())
        rows = np.nonzero(hits.found)[0]
        leg = leg.take(rows)
        hits = hits.take(rows)
        part = self.part
        flat = leg.origins + hits.distances[:, None] * leg.directions
        facing = part.mesh.face_normals[hits.triangles]
        on_surface.points[rows], on_surface.normals[rows] = meet(part, leg, hits)
        on_surface.leaving[rows] = self._leaving(leg, hits)
        on_surface.away[rows] = self.optical.away_at(flat, facing)
        on_surface.faces[rows] = part.faces[hits.triangles]
        on_surface.skins[rows] = _SKIN_EDGES * np.sqrt(2.0 * part.mesh.area_faces[hits.triangles])
        on_surface.heights[rows] = np.sum((on_surface.points[rows] - flat) * on_surface.normals[rows], axis=1)
        return on_surface

    def _leaving(self, leg: Leg, hits: FacetHits) -> Bool[np.ndarray, " n"]:
        along: Bool[np.ndarray, " n"] = (
            np.sum(leg.directions * self.part.mesh.face_normals[hits.triangles], axis=1) > 0.0
        )
        return along


def at_faces(optical: OpticalFaces, media: Media, light: LitRays, hits: SurfaceHits) -> AtFace:
    """Light at the places of a body that were hit.

    Beyond faces towards the origin lies the cavity; places off the optical faces are uncoated.
    """
    names = optical.names
    split = np.empty((2, *light.fields.shape), dtype=complex)
    models = media.scattering_of(names) or (None,) * len(names)
    numbers = light.numbers_at(hits.faces)
    rms = facet_slopes(media, names)[hits.faces]
    normals = tilted(Arrival(hits.points, hits.normals, light.directions), rms, numbers)
    at_face = AtFace(*np.empty((2, *hits.points.shape)), *np.empty((2, len(hits.points))), *split)
    for number, away, inside in product(range(NO_FACE, len(names)), (False, True), (False, True)):
        rows = np.nonzero((hits.faces == number) & (hits.away == away) & (light.inside == inside))[0]
        if len(rows):
            around = media.outside_index if away else media.cavity_index
            coating = None if number == NO_FACE else media.coating(names[number])
            of_body = light.indices[rows]
            beside_body = np.full(len(rows), around)
            before, behind = (of_body, beside_body) if inside else (beside_body, of_body)
            face = RefractingFace(before, behind, coating, light.wavelengths_nm[rows], not inside)
            some = AtFace.of(face, light.directions[rows], normals[rows], light.fields[rows])
            if number != NO_FACE and isinstance(model := models[number], RingScatter):
                met = Arrival(hits.points[rows], normals[rows], light.directions[rows])
                some = some.spread(Spreading.of(model, numbers[rows], met), isinstance(coating, Mirror))
            for name, values in vars(some).items():
                getattr(at_face, name)[rows] = values
    return at_face


def meet(part: PartMesh, leg: Leg, hits: FacetHits) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points (mm) and unit normals at which rays, all of which hit a facet, meet the curved surface over it."""
    facets = part.mesh.triangles[hits.triangles]
    points = leg.origins + hits.distances[:, None] * leg.directions
    barycentric = hits.barycentric
    # An oblique ray meets the curved surface not over its flat hit but near it: the second round corrects this.
    for _ in range(2):
        curved, normals = part.curved(hits.triangles, barycentric)
        cosine, height = (np.sum(vectors * normals, axis=1) for vectors in (leg.directions, curved - points))
        # To the plane there; no further than at a slope of 3 degrees.
        ahead = height / np.copysign(np.maximum(np.abs(cosine), 0.05), cosine)
        points = points + ahead[:, None] * leg.directions
        barycentric = points_to_barycentric(facets, points)
    return points, normals


def absorb(
    passage: Passage, rows: Int[np.ndarray, " k"], lengths: Float[np.ndarray, " k"], per_mm: Float[np.ndarray, " k"]
) -> None:
    """Take absorption in the body over ``lengths`` (mm) from rays, by the law of Beer and Lambert."""
    arrived = passage.flux[rows] * np.exp(-per_mm * lengths)
    passage.absorbed[rows] += passage.flux[rows] - arrived
    passage.flux[rows] = arrived


def dim(passage: Passage, rows: Int[np.ndarray, " k"], at: AtFace, passes: Bool[np.ndarray, " k"]) -> None:
    """Reduce rays to what a face transmits, or reflects if they do not pass; a mirror absorbs the rest."""
    passage.absorbed[rows] += passage.flux[rows] * np.where(passes, 0.0, 1.0 - at.reflectance)
    passage.flux[rows] *= np.where(passes, at.transmittance, at.reflectance)
    passage.fields[rows] = np.where(passes[:, None, None], at.passed, at.returned)


def mirrors(optical: OpticalFaces, media: Media) -> list[int]:
    """Numbers of the faces that are mirrors."""
    return [number for number, name in enumerate(optical.names) if isinstance(media.coating(name), Mirror)]


def outside_leg(rays: RayBundle, optical: OpticalFaces) -> Leg:
    """First leg of every ray: from the source towards the part, in the coordinates of its files."""
    return Leg(optical.expansion.to_files(rays.origins), rays.directions, np.zeros(len(rays)))


def send_through(
    part: PartMesh, grid: Grid, rays: RayBundle, media: Media, threads: int = 1, seed: int | None = None
) -> Passage:
    """Cast every ray into the mesh of a part and out of it; ``seed``: for facets other than the design's."""
    body = MeshBody(part, grid)

    def send(start: int) -> Passage:
        chunk_seed = None if seed is None else seed + start
        return send_through_body(body, rays.take(slice(start, start + _CHUNK)), media, chunk_seed)

    with ThreadPoolExecutor(threads) as pool:
        pieces = list(pool.map(send, range(0, len(rays), _CHUNK)))
    return Passage(*(np.concatenate([getattr(piece, name) for piece in pieces]) for name in Passage.__annotations__))


def send_through_body(body: CastBody, rays: RayBundle, media: Media, seed: int | None = None) -> Passage:
    """Cast every ray into ``body`` and out of it, with at most as many events as its light has."""
    optical = body.optical
    passage = Passage.of(rays, optical.events)
    light = LitRays.of(rays, media, optical.names, seed)
    rows = np.arange(len(rays))
    leg = outside_leg(rays, optical)
    for event in range(optical.events):
        # Sides count behind a reflection, which may graze; before, the skin of the facet just left is enough.
        known = event > (1 if optical.opening is None else 0)
        hits = body.surface_hits(leg, light.inside if known else None)
        fates = _fates(hits, light.inside, bool(optical.goes_on(event)), optical.flange)
        free = _leaves_freely(optical, leg, light, hits)
        passage.fates[rows] = np.where(free, CastFate.LANDED, fates)
        passage.points[rows[free]] = leg.origins[free]
        passage.directions[rows[free]] = leg.directions[free]
        passage.met[rows[free], event] = NO_FACE if optical.opening is None else optical.opening
        met = np.nonzero((fates == CastFate.LANDED) & ~free)[0]
        rows = rows[met]
        leg = leg.take(met)
        light = light.take(met)
        hits = hits.take(met)
        lengths = optical.expansion.scale * np.linalg.norm(hits.points - leg.origins, axis=1)
        absorb(passage, rows, lengths, np.where(light.inside, light.absorptions, 0.0))
        passage.facets_um[rows, event] = 1e3 * hits.heights
        passage.met[rows, event] = hits.faces
        at = at_faces(optical, media, light, hits)
        passes = at.transmittance > 0.0
        dim(passage, rows, at, passes)
        ways = np.where(passes[:, None], at.bent, at.mirrored)
        inside = light.inside != passes
        out = passes & light.inside & hits.away
        passage.points[rows[out]] = hits.points[out]
        passage.directions[rows[out]] = ways[out]
        enters = passes & ~light.inside & (event + 1 < optical.events)
        goes_on = ~out & (enters | optical.goes_on(event))
        whole = ~passes & ~np.isin(hits.faces, mirrors(optical, media))
        ends = np.where(whole, CastFate.TOTAL_REFLECTION, CastFate.EVENT_LIMIT)
        passage.fates[rows] = np.where(out | goes_on, CastFate.LANDED, ends)
        times = light.times_after(hits.faces)
        light = replace(light, directions=ways, fields=passage.fields[rows], inside=inside, times=times)
        going = np.nonzero(goes_on)[0]
        rows = rows[going]
        leg = Leg(hits.points, ways, hits.skins).take(going)
        light = light.take(going)
    return behind_lens(passage, rays, media, optical, seed)


def _leaves_freely(optical: OpticalFaces, leg: Leg, light: LitRays, hits: SurfaceHits) -> Bool[np.ndarray, " n"]:
    """True for rays that rise in the cavity and meet the part no more: they leave by its opening."""
    rises: Bool[np.ndarray, " n"] = ~hits.found & ~light.inside & (leg.directions[:, 2] > 0.0)
    return rises if optical.opening is not None else np.zeros_like(rises)


def _fates(hits: SurfaceHits, inside: Bool[np.ndarray, " n"], back: bool, flange: int) -> Int[np.ndarray, " n"]:
    """Fates of rays that end here, LANDED for all others, including those ``back`` in the cavity."""
    entering = [~hits.found, hits.leaving, hits.base, hits.away]
    none = [CastFate.NO_HIT, CastFate.STARTS_INSIDE, CastFate.OPENING, CastFate.STARTS_OUTSIDE]
    leaving = [~hits.found, hits.base, hits.faces == flange, ~(hits.away | back)]
    lost = [CastFate.NO_HIT, CastFate.BASE, CastFate.FLANGE, CastFate.BACK_INTO_CAVITY]
    from_body = np.select(leaving, lost, CastFate.LANDED)
    from_cavity = np.select(entering, none, CastFate.LANDED)
    return np.where(inside, from_body, from_cavity)
