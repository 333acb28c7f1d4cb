"""Non-sequential trace of the part: rays split at every surface and are absorbed in the bulk until all light has left.

Every ray splits into a transmitted and a reflected one; nothing is drawn at random, so the flux budget closes to
rounding. The polarisation of each ray goes with it.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from itertools import product
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.media import Media
from lensforge.proof.facet_casting import FacetHits, Grid, Leg
from lensforge.proof.part_mesh import PartMesh
from lensforge.proof.refraction import AtFace, Fields, RefractingFace, unpolarised
from lensforge.proof.sequential_cast import at_base, faces_away, meet
from lensforge.sources.ray_bundle import RayBundle

# A polished base is as clear as the lens; a black one absorbs all light that meets it, as a holder may.
Base = Literal["polished", "black"]

_CHUNK = 16384  # rays cast at a time: bounds the memory, and stays in the cache
_SKIN_MM = 1e-6  # small, so that light in corners is followed too; the facet just left is recognised by its side
_SIDES = 4  # tries to get past facets whose side contradicts the medium that the ray is in


class Cause(IntEnum):
    """First event that took light off the sequential path, in through one face and out through the other."""

    SEQUENTIAL = 0  # none: light on the sequential path
    INNER_REFLECTION = 1  # reflected where it should have entered
    OUTER_REFLECTION = 2  # reflected in part where it should have left
    TOTAL_REFLECTION = 3  # totally reflected where it should have left
    BASE = 4  # met a surface at or below z = 0, came back into the cavity, or came from outside of the lens
    MET_AGAIN = 5  # left the lens and met it again


@dataclass(frozen=True)
class ActiveRays:
    """Rays being traced: leg, flux (W), True in the material, cause, and the face by which they entered (-1: none).

    ``indices``, ``absorptions``: refractive index and absorption (1/mm) of the lens for each, at ``wavelengths_nm``.
    ``crossings``: surfaces passed on the sequential path.
    """

    leg: Leg
    flux: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]
    crossings: Int[np.ndarray, " n"]
    entered_by: Int[np.ndarray, " n"]
    indices: Float[np.ndarray, " n"]
    absorptions: Float[np.ndarray, " n"]
    wavelengths_nm: Float[np.ndarray, " n"]
    fields: Fields

    def take(self, rows: Int[np.ndarray, " k"]) -> "ActiveRays":
        """Some of the rays."""
        own = dict(vars(self))
        return ActiveRays(own.pop("leg").take(rows), *(each[rows] for each in own.values()))


@dataclass(frozen=True)
class Body:
    """The part as a refracting body: the media, for rays without an index of their own, and the finish of the base."""

    part: PartMesh
    grid: Grid
    media: Media
    base: Base = "polished"


@dataclass(frozen=True)
class Limits:
    """Rays with less than ``cut_off`` of the mean ray's flux are not followed, none beyond ``depth`` surfaces."""

    cut_off: float = 1e-4
    depth: int = 32


@dataclass(frozen=True)
class EscapedLight:
    """Light that has left the part for good: last points (mm), directions, flux (W), causes, wavelengths, fields."""

    points: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]
    wavelengths_nm: Float[np.ndarray, " n"]
    fields: Fields

    @property
    def stray(self) -> Bool[np.ndarray, " n"]:
        """True for light off the sequential path."""
        stray: Bool[np.ndarray, " n"] = self.causes != Cause.SEQUENTIAL
        return stray


@dataclass
class FluxBudget:
    """Flux (W) by its end: gone from the part, in pieces as it left, or lost."""

    pieces: list[EscapedLight] = field(default_factory=list)
    absorbed: float = 0.0
    base: float = 0.0
    cut_off: float = 0.0
    leaked: float = 0.0

    def escaped(self) -> EscapedLight:
        """All pieces joined."""
        names = EscapedLight.__annotations__
        return EscapedLight(*(np.concatenate([getattr(piece, name) for piece in self.pieces]) for name in names))


def follow(body: Body, rays: RayBundle, limits: Limits) -> FluxBudget:
    """Follow all light of ``rays`` until it has left the part."""
    budget, least = FluxBudget(), limits.cut_off * float(rays.flux.mean())
    for start in range(0, len(rays), _CHUNK):
        light = _emitted(body, rays.take(slice(start, start + _CHUNK)))
        for _ in range(limits.depth):
            light = _step(body, light, least, budget)
            if len(light.flux) == 0:
                break
        budget.cut_off += float(light.flux.sum())
    return budget


def _emitted(body: Body, rays: RayBundle) -> ActiveRays:
    """Rays as they leave the source; those that meet their first facet from behind start in the material.

    Neither these nor those that meet the outside of the lens first are on the sequential path.
    """
    count = len(rays)
    leg = Leg(rays.origins, rays.directions, np.zeros(count))
    hits = body.grid.first_hits(leg)
    inside = hits.found & (_along(body, leg, hits) > 0.0)
    nothing = np.zeros(count, dtype=np.int64)
    reached = np.where(hits.found, hits.distances, 0.0)[:, None] * leg.directions + leg.origins
    outside = hits.found & faces_away(reached, body.part.mesh.face_normals[hits.triangles])
    causes = np.where(inside | outside, Cause.BASE, Cause.SEQUENTIAL)
    media, fields = body.media, unpolarised(rays.directions)
    own = (rays.indices(media), rays.absorptions(media), rays.wavelengths(media), fields)
    return ActiveRays(leg, rays.flux.copy(), inside, causes, nothing, nothing - 1, *own)


def _along(body: Body, leg: Leg, hits: FacetHits) -> Float[np.ndarray, " n"]:
    along: Float[np.ndarray, " n"] = np.sum(leg.directions * body.part.mesh.face_normals[hits.triangles], axis=1)
    return along


def _step(body: Body, light: ActiveRays, least: float, budget: FluxBudget) -> ActiveRays:
    """Trace all rays to the next surface, or out; return those that go on from there."""
    hits = _next_hits(body, light)
    _escape(light.take(np.nonzero(~hits.found)[0]), budget)
    rows = np.nonzero(hits.found)[0]
    light, hits = light.take(rows), hits.take(rows)
    light = _absorbed(body, light, meet(body.part, light.leg, hits)[0], budget)
    if body.base == "black":
        kept = ~at_base(body.part, hits)
        budget.base += float(light.flux[~kept].sum())
        light, hits = light.take(np.nonzero(kept)[0]), hits.take(np.nonzero(kept)[0])
    children = _split(body, light, hits)
    bright = children.flux > least
    budget.cut_off += float(children.flux[~bright].sum())
    return children.take(np.nonzero(bright)[0])


def _next_hits(body: Body, light: ActiveRays) -> FacetHits:
    """First hits on facets whose side fits the ray's medium: a grazing ray may miss its own facet."""
    hits = body.grid.first_hits(light.leg)
    for _ in range(_SIDES):
        wrong = np.nonzero(hits.found & ((_along(body, light.leg, hits) > 0.0) != light.inside))[0]
        if len(wrong) == 0:
            break
        leg = light.leg.take(wrong)
        again = body.grid.first_hits(Leg(leg.origins, leg.directions, hits.distances[wrong] * (1.0 + 1e-9) + 1e-9))
        for name in ("triangles", "distances", "barycentric"):
            getattr(hits, name)[wrong] = getattr(again, name)
    return hits


def _absorbed(body: Body, light: ActiveRays, points: Float[np.ndarray, "n 3"], budget: FluxBudget) -> ActiveRays:
    """Rays after bulk absorption on their path to ``points``, by the Beer-Lambert law."""
    lengths = np.linalg.norm(points - light.leg.origins, axis=1)
    left = np.where(light.inside, np.exp(-light.absorptions * lengths), 1.0)
    budget.absorbed += float(np.sum(light.flux * (1.0 - left)))
    return replace(light, flux=light.flux * left)


def _split(body: Body, light: ActiveRays, hits: FacetHits) -> ActiveRays:
    """The transmitted and the reflected rays behind a surface, one after the other."""
    points, normals = meet(body.part, light.leg, hits)
    at = _at_face(body, light, points, normals, hits)
    causes = _causes(body, light, hits, at.transmittance)
    on_path = causes[0] == Cause.SEQUENTIAL
    entering = on_path & (light.crossings == 0)
    return ActiveRays(
        Leg(np.tile(points, (2, 1)), np.concatenate([at.bent, at.mirrored]), np.full(2 * len(points), _SKIN_MM)),
        np.concatenate([light.flux * at.transmittance, light.flux * (1.0 - at.transmittance)]),
        np.concatenate([~light.inside, light.inside]),
        np.concatenate(causes),
        np.tile(light.crossings + on_path, 2),
        np.tile(np.where(entering, body.part.faces[hits.triangles], light.entered_by), 2),
        np.tile(light.indices, 2),
        np.tile(light.absorptions, 2),
        np.tile(light.wavelengths_nm, 2),
        np.concatenate([at.passed, at.returned]),
    )


def _at_face(
    body: Body, light: ActiveRays, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], hits: FacetHits
) -> AtFace:
    """Light at the facets that were hit.

    On their other side is the cavity where they face the origin; the base below both faces is not coated.
    """
    media, base = body.media, at_base(body.part, hits)
    away = faces_away(points, body.part.mesh.face_normals[hits.triangles])
    bent, mirrored = np.empty((2, *points.shape))
    passed, returned = np.empty((2, *light.fields.shape), dtype=complex)
    found = AtFace(bent, mirrored, np.empty(len(points)), passed, returned)
    for outer, bare, inside in product((False, True), repeat=3):
        rows = np.nonzero((away == outer) & (base == bare) & (light.inside == inside))[0]
        around = np.full(len(rows), media.outside_index if outer else media.cavity_index)
        coating = None if bare else media.outer_coating if outer else media.inner_coating
        before, behind = (light.indices[rows], around) if inside else (around, light.indices[rows])
        face = RefractingFace(before, behind, coating, light.wavelengths_nm[rows], not inside)
        some = AtFace.of(face, light.leg.directions[rows], normals[rows], light.fields[rows])
        for name, values in vars(some).items():
            getattr(found, name)[rows] = values
    return found


def _causes(
    body: Body, light: ActiveRays, hits: FacetHits, transmittance: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Causes of the transmitted and of the reflected rays; an earlier cause is kept."""
    back = (light.crossings == 1) & (body.part.faces[hits.triangles] == light.entered_by)
    missed = [light.crossings >= 2, at_base(body.part, hits) | back]
    transmitted = np.select(missed, [Cause.MET_AGAIN, Cause.BASE], Cause.SEQUENTIAL)
    total = np.where(transmittance > 0.0, Cause.OUTER_REFLECTION, Cause.TOTAL_REFLECTION)
    reflection = np.where(light.crossings == 0, Cause.INNER_REFLECTION, total)
    reflected = np.where(transmitted == Cause.SEQUENTIAL, reflection, transmitted)
    first = light.causes == Cause.SEQUENTIAL
    return np.where(first, transmitted, light.causes), np.where(first, reflected, light.causes)


def _escape(light: ActiveRays, budget: FluxBudget) -> None:
    """Add light that hits nothing more to the budget."""
    out = ~light.inside
    budget.leaked += float(light.flux[light.inside].sum())
    leg = light.leg
    own = (light.flux[out], light.causes[out], light.wavelengths_nm[out], light.fields[out])
    budget.pieces.append(EscapedLight(leg.origins[out], leg.directions[out], *own))
