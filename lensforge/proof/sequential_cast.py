"""Sequential trace of the part, once in and once out, through its mesh or through the faces of its STEP file.

A ray refracts at the first triangle that it meets, whatever face this belongs to. Reflected light is not followed.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from trimesh.triangles import points_to_barycentric

from lensforge.optics.media import Media
from lensforge.proof.facet_casting import FacetHits, Grid, Leg, RayRows
from lensforge.proof.part_mesh import PartMesh
from lensforge.proof.receiver_screen import Screen
from lensforge.proof.refraction import AtFace, Fields, RefractingFace, through_glass, unpolarised
from lensforge.sources.ray_bundle import RayBundle

_CHUNK = 1024  # rays that a thread casts at a time: their candidates stay in its cache
# A ray that leaves a curved point may meet the facets just left: hits nearer than this share of an edge are those.
_SKIN_EDGES = 0.05
_SIDES = 4  # tries to get past facets whose side contradicts the medium that the ray is in


class CastFate(IntEnum):
    """Fate of a ray cast through the part."""

    LANDED = 0  # left the lens, and reached the receiver's surface
    NO_HIT = 1  # met no part of the body
    STARTS_INSIDE = 2  # its first hit leaves the material: it started in the body, or the mesh is inside out
    BASE = 3  # met a surface at or below z = 0 in the material, instead of leaving it
    BACK_INTO_CAVITY = 4  # left the material by a surface that faces the origin, as the inner one
    TOTAL_REFLECTION = 5  # totally reflected on the way out
    MISSED_RECEIVER = 6  # left the lens, but never reaches the receiver's plane
    OPENING = 7  # met a surface at or below z = 0 on the way in: the wall of the base's opening, or its bottom
    STARTS_OUTSIDE = 8  # met the outside of the lens first: it started neither in the cavity nor below it


@dataclass(frozen=True)
class Passage:
    """Ends of ``n`` rays: exit point (mm) and direction, NaN if lost in the lens, flux (W) left in the ray, fate.

    ``absorbed``, ``in_glass``: flux (W) that the body and a cover glass took of it. ``fields``: of its polarisation.
    ``facets_um``: height of the curved surface over the flat facet at the two hits, 0 where there was none.
    """

    points: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    absorbed: Float[np.ndarray, " n"]
    in_glass: Float[np.ndarray, " n"]
    fates: Int[np.ndarray, " n"]
    facets_um: Float[np.ndarray, "n 2"]
    fields: Fields

    @staticmethod
    def of(rays: RayBundle) -> "Passage":
        """Passage of ``rays`` that have met nothing yet."""
        return Passage(
            points=np.full((len(rays), 3), np.nan),
            directions=np.full((len(rays), 3), np.nan),
            flux=rays.flux.copy(),
            absorbed=np.zeros(len(rays)),
            in_glass=np.zeros(len(rays)),
            fates=np.full(len(rays), CastFate.NO_HIT, dtype=np.int64),
            facets_um=np.zeros((len(rays), 2)),
            fields=unpolarised(rays.directions),
        )


def behind_glass(passage: Passage, rays: RayBundle, media: Media) -> Passage:
    """Take the rays that left the lens through the faces of the cover glass, one after the other."""
    glass = media.cover_glass
    if glass is None:
        return passage
    waves = rays.wavelengths(media)
    points, directions, through = through_glass(passage.points, passage.directions, media, waves, passage.fields)
    left = passage.flux * through
    return replace(passage, points=points, directions=directions, flux=left, in_glass=passage.flux - left)


@dataclass(frozen=True)
class LandedRays:
    """Rays of a passage on a screen: places on its chart (NaN if lost), flux (W) left in the ray, fate.

    ``absorbed``, ``in_glass``: flux (W) that the body and a cover glass took of it.
    """

    landings: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]
    absorbed: Float[np.ndarray, " n"]
    in_glass: Float[np.ndarray, " n"]
    fates: Int[np.ndarray, " n"]

    @staticmethod
    def of(passage: Passage, screen: Screen) -> "LandedRays":
        """Land the rays that left the lens."""
        landings, fates = np.full((len(passage.flux), 2), np.nan), passage.fates.copy()
        left = np.nonzero(passage.fates == CastFate.LANDED)[0]
        landings[left] = screen.land(passage.points[left], passage.directions[left])
        fates[left[np.isnan(landings[left, 0])]] = CastFate.MISSED_RECEIVER
        return LandedRays(landings, passage.flux, passage.absorbed, passage.in_glass, fates)

    @property
    def fate_names(self) -> Shaped[np.ndarray, " n"]:
        """Name of the fate of each ray."""
        names: Shaped[np.ndarray, " n"] = np.array([fate.name.lower() for fate in CastFate])[self.fates]
        return names


@dataclass(frozen=True)
class SurfaceHits(RayRows):
    """First hits of rays on a body: whether there is one, point (mm), unit normal of either sign.

    ``leaving``: the ray leaves the material there. ``away``: that side of the body faces away from the origin, as the
    outside of a lens does. ``base``: it lies at or below z = 0, where no optical surface is. ``skins``: distance (mm)
    within which a ray that goes on from there may meet what it just left. ``heights``: of the point over a facet (mm).
    """

    found: Bool[np.ndarray, " n"]
    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    leaving: Bool[np.ndarray, " n"]
    away: Bool[np.ndarray, " n"]
    base: Bool[np.ndarray, " n"]
    skins: Float[np.ndarray, " n"]
    heights: Float[np.ndarray, " n"]


@runtime_checkable
class CastBody(Protocol):
    """A body at which rays can be cast: a mesh, or the faces of a STEP file."""

    def surface_hits(self, leg: Leg) -> SurfaceHits:
        """First hit of each ray."""
        ...


@dataclass(frozen=True)
class MeshBody:
    """The curved surface over the facets of a mesh."""

    part: PartMesh
    grid: Grid

    def surface_hits(self, leg: Leg, inside: Bool[np.ndarray, " n"] | None = None) -> SurfaceHits:
        """First hit of each ray; sides and base are those of the flat facet.

        ``inside``: True for rays in the material; they pass facets of the other side. A grazing ray may miss its own.
        """
        hits, count = self.grid.first_hits(leg), len(leg.origins)
        for _ in range(0 if inside is None else _SIDES):
            wrong = np.nonzero(hits.found & (self._leaving(leg, hits) != inside))[0]
            if len(wrong) == 0:
                break
            beyond = hits.distances[wrong] * (1.0 + 1e-9) + 1e-9
            again = self.grid.first_hits(Leg(leg.origins[wrong], leg.directions[wrong], beyond))
            for name, values in vars(again).items():
                getattr(hits, name)[wrong] = values
        no, place, zero = np.zeros(count, dtype=bool), np.zeros((count, 3)), np.zeros(count)
        found = SurfaceHits(hits.found, place, place.copy(), no, no.copy(), no.copy(), zero, zero.copy())
        rows = np.nonzero(hits.found)[0]
        leg, hits, part = leg.take(rows), hits.take(rows), self.part
        flat, facing = leg.origins + hits.distances[:, None] * leg.directions, part.mesh.face_normals[hits.triangles]
        found.points[rows], found.normals[rows] = meet(part, leg, hits)
        found.leaving[rows] = self._leaving(leg, hits)
        found.away[rows] = faces_away(flat, facing)
        # At or below z = 0 lies no optical surface.
        found.base[rows] = part.mesh.triangles_center[hits.triangles, 2] <= 0.0
        found.skins[rows] = _SKIN_EDGES * np.sqrt(2.0 * part.mesh.area_faces[hits.triangles])
        found.heights[rows] = np.sum((found.points[rows] - flat) * found.normals[rows], axis=1)
        return found

    def _leaving(self, leg: Leg, hits: FacetHits) -> Bool[np.ndarray, " n"]:
        along: Bool[np.ndarray, " n"] = (
            np.sum(leg.directions * self.part.mesh.face_normals[hits.triangles], axis=1) > 0.0
        )
        return along


def refracted(leg: Leg, hits: SurfaceHits, face: RefractingFace, fields: Fields | None = None) -> tuple[Leg, AtFace]:
    """Rays behind the surface that all of them hit, and their light there; ``fields`` None: unpolarised rays."""
    light = AtFace.of(face, leg.directions, hits.normals, unpolarised(leg.directions) if fields is None else fields)
    return Leg(hits.points, light.bent, hits.skins), light


def meet(part: PartMesh, leg: Leg, hits: FacetHits) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points (mm) and unit normals at which rays, all of which hit a facet, meet the curved surface over it."""
    facets = part.mesh.triangles[hits.triangles]
    points, barycentric = leg.origins + hits.distances[:, None] * leg.directions, hits.barycentric
    # An oblique ray meets the curved surface not over its flat hit but near it: the second round corrects this.
    for _ in range(2):
        curved, normals = part.curved(hits.triangles, barycentric)
        cosine, height = (np.sum(each * normals, axis=1) for each in (leg.directions, curved - points))
        # To the plane there; no further than at a slope of 3 degrees.
        ahead = height / np.copysign(np.maximum(np.abs(cosine), 0.05), cosine)
        points = points + ahead[:, None] * leg.directions
        barycentric = points_to_barycentric(facets, points)
    return points, normals


def absorb(
    passage: Passage, rows: Int[np.ndarray, " k"], lengths: Float[np.ndarray, " k"], per_mm: Float[np.ndarray, " k"]
) -> None:
    """Take from rays what the body absorbs of them over ``lengths`` (mm), by the law of Beer and Lambert."""
    arrived = passage.flux[rows] * np.exp(-per_mm * lengths)
    passage.absorbed[rows] = passage.flux[rows] - arrived
    passage.flux[rows] = arrived


def outside_leg(rays: RayBundle) -> Leg:
    """First leg of every ray: from the source towards the part."""
    return Leg(rays.origins, rays.directions, np.zeros(len(rays)))


def send_through(part: PartMesh, grid: Grid, rays: RayBundle, media: Media, threads: int = 1) -> Passage:
    """Cast every ray into the mesh of a part and out of it."""
    body = MeshBody(part, grid)

    def send(start: int) -> Passage:
        return send_through_body(body, rays.take(slice(start, start + _CHUNK)), media)

    with ThreadPoolExecutor(threads) as pool:
        pieces = list(pool.map(send, range(0, len(rays), _CHUNK)))
    return Passage(*(np.concatenate([getattr(piece, name) for piece in pieces]) for name in Passage.__annotations__))


def send_through_body(body: CastBody, rays: RayBundle, media: Media) -> Passage:
    """Cast every ray into ``body`` and out of it."""
    passage = Passage.of(rays)
    leg, into, out_of = outside_leg(rays), RefractingFace.inner(rays, media), RefractingFace.outer(rays, media)
    entry = body.surface_hits(leg)
    passage.fates[:] = np.select(
        [~entry.found, entry.leaving, entry.base, entry.away],
        [CastFate.NO_HIT, CastFate.STARTS_INSIDE, CastFate.OPENING, CastFate.STARTS_OUTSIDE],
        CastFate.LANDED,
    )
    rows = np.nonzero(passage.fates == CastFate.LANDED)[0]
    entry = entry.take(rows)
    inside, entered = refracted(leg.take(rows), entry, into.take(rows))
    passage.flux[rows] *= entered.transmittance
    passage.facets_um[rows, 0] = 1e3 * entry.heights

    exits = body.surface_hits(inside)
    passage.fates[rows] = np.select(
        [~exits.found, exits.base, ~exits.away],
        [CastFate.NO_HIT, CastFate.BASE, CastFate.BACK_INTO_CAVITY],
        CastFate.LANDED,
    )
    reached = np.nonzero(passage.fates[rows] == CastFate.LANDED)[0]
    rows, inside, exits = rows[reached], inside.take(reached), exits.take(reached)
    behind, left = refracted(inside, exits, out_of.take(rows), entered.passed[reached])
    lengths = np.linalg.norm(exits.points - inside.origins, axis=1)
    absorb(passage, rows, lengths, rays.absorptions(media)[rows])
    passage.facets_um[rows, 1] = 1e3 * exits.heights
    passes = left.transmittance > 0.0
    passage.fates[rows] = np.where(passes, CastFate.LANDED, CastFate.TOTAL_REFLECTION)
    passage.flux[rows] *= np.where(passes, left.transmittance, 1.0)
    passage.points[rows[passes]] = behind.origins[passes]
    passage.directions[rows[passes]] = behind.directions[passes]
    passage.fields[rows[passes]] = left.passed[passes]
    return behind_glass(passage, rays, media)


def faces_away(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """True where a surface with ``normals`` out of the material faces away from the origin, as the lens's outside does.

    Both surfaces are star-shaped about the origin, and the material lies between them.
    """
    away: Bool[np.ndarray, " n"] = np.sum(points * normals, axis=1) > 0.0
    return away
