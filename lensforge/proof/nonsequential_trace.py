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
from lensforge.proof.facet_casting import Leg, RayRows
from lensforge.proof.refraction import AtFace, Fields, RefractingFace, unpolarised
from lensforge.proof.sequential_cast import MeshBody, SurfaceHits, outside_leg
from lensforge.sources.ray_bundle import RayBundle

# A polished base is as clear as the lens; a black one absorbs all light that meets it, as a holder may.
Base = Literal["polished", "black"]

_CHUNK = 16384  # rays cast at a time: bounds the memory, and stays in the cache
_SKIN_MM = 1e-6  # small, so that light in corners is followed too; the facet just left is recognised by its side


class Cause(IntEnum):
    """First event that took light off the sequential path, in through one face and out through the other."""

    SEQUENTIAL = 0  # none: light on the sequential path
    INNER_REFLECTION = 1  # reflected where it should have entered
    OUTER_REFLECTION = 2  # reflected in part where it should have left
    TOTAL_REFLECTION = 3  # totally reflected where it should have left
    BASE = 4  # met a surface at or below z = 0, came back into the cavity, or came from outside of the lens
    MET_AGAIN = 5  # left the lens and met it again


@dataclass(frozen=True)
class SplitRays(RayRows):
    """Rays on their way or out of the part: last points (mm), directions, flux (W), True in the material, cause.

    ``crossings``: surfaces passed on the sequential path. ``indices``, ``absorptions``: refractive index and absorption
    (1/mm) of the lens for each, at ``wavelengths_nm``.
    """

    points: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]
    crossings: Int[np.ndarray, " n"]
    indices: Float[np.ndarray, " n"]
    absorptions: Float[np.ndarray, " n"]
    wavelengths_nm: Float[np.ndarray, " n"]
    fields: Fields

    @property
    def stray(self) -> Bool[np.ndarray, " n"]:
        """True for light off the sequential path."""
        stray: Bool[np.ndarray, " n"] = self.causes != Cause.SEQUENTIAL
        return stray


@dataclass(frozen=True)
class Body(MeshBody):
    """The part as a refracting body: the media, for rays without an index of their own, and the finish of the base."""

    media: Media
    base: Base = "polished"


@dataclass(frozen=True)
class Limits:
    """Rays with less than ``cut_off`` of the mean ray's flux are not followed, none beyond ``depth`` surfaces."""

    cut_off: float = 1e-4
    depth: int = 32


@dataclass
class FluxBudget:
    """Flux (W) by its end: gone from the part, in pieces as it left, or lost."""

    pieces: list[SplitRays] = field(default_factory=list)
    absorbed: float = 0.0
    base: float = 0.0
    cut_off: float = 0.0
    leaked: float = 0.0

    def escaped(self) -> SplitRays:
        """All pieces joined."""
        names = SplitRays.__annotations__
        return SplitRays(*(np.concatenate([getattr(piece, name) for piece in self.pieces]) for name in names))


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


def _emitted(body: Body, rays: RayBundle) -> SplitRays:
    """Rays as they leave the source; those that meet their first facet from behind start in the material.

    Neither these nor those that meet the outside of the lens first are on the sequential path.
    """
    hits = body.surface_hits(outside_leg(rays))
    causes = np.where(hits.leaving | hits.away, Cause.BASE, Cause.SEQUENTIAL)
    nothing, media = np.zeros(len(rays), dtype=np.int64), body.media
    own = (rays.indices(media), rays.absorptions(media), rays.wavelengths(media), unpolarised(rays.directions))
    return SplitRays(rays.origins, rays.directions, rays.flux.copy(), hits.leaving, causes, nothing, *own)


def _step(body: Body, light: SplitRays, least: float, budget: FluxBudget) -> SplitRays:
    """Trace all rays to the next surface, or out; return those that go on from there."""
    leg = Leg(light.points, light.directions, np.full(len(light.flux), _SKIN_MM))
    hits = body.surface_hits(leg, light.inside)
    gone = ~hits.found
    budget.leaked += float(light.flux[gone & light.inside].sum())
    budget.pieces.append(light.take(np.nonzero(gone & ~light.inside)[0]))
    rows = np.nonzero(~gone)[0]
    light, hits = light.take(rows), hits.take(rows)
    # By the law of Beer and Lambert.
    lengths = np.linalg.norm(hits.points - light.points, axis=1)
    left = np.where(light.inside, np.exp(-light.absorptions * lengths), 1.0)
    budget.absorbed += float(np.sum(light.flux * (1.0 - left)))
    light = replace(light, flux=light.flux * left)
    if body.base == "black":
        budget.base += float(light.flux[hits.base].sum())
        rows = np.nonzero(~hits.base)[0]
        light, hits = light.take(rows), hits.take(rows)
    children = _split(body.media, light, hits)
    bright = children.flux > least
    budget.cut_off += float(children.flux[~bright].sum())
    return children.take(np.nonzero(bright)[0])


def _split(media: Media, light: SplitRays, hits: SurfaceHits) -> SplitRays:
    """The transmitted and the reflected rays behind a surface, one after the other."""
    at = _at_face(media, light, hits)
    causes = _causes(light, hits, at.transmittance)
    on_path = causes[0] == Cause.SEQUENTIAL
    return SplitRays(
        np.tile(hits.points, (2, 1)),
        np.concatenate([at.bent, at.mirrored]),
        np.concatenate([light.flux * at.transmittance, light.flux * (1.0 - at.transmittance)]),
        np.concatenate([~light.inside, light.inside]),
        np.concatenate(causes),
        np.tile(light.crossings + on_path, 2),
        np.tile(light.indices, 2),
        np.tile(light.absorptions, 2),
        np.tile(light.wavelengths_nm, 2),
        np.concatenate([at.passed, at.returned]),
    )


def _at_face(media: Media, light: SplitRays, hits: SurfaceHits) -> AtFace:
    """Light at the facets that were hit.

    On their other side is the cavity where they face the origin; the base below both faces is not coated.
    """
    bent, mirrored = np.empty((2, *hits.points.shape))
    passed, returned = np.empty((2, *light.fields.shape), dtype=complex)
    found = AtFace(bent, mirrored, np.empty(len(hits.points)), passed, returned)
    for outer, bare, inside in product((False, True), repeat=3):
        rows = np.nonzero((hits.away == outer) & (hits.base == bare) & (light.inside == inside))[0]
        around = np.full(len(rows), media.outside_index if outer else media.cavity_index)
        coating = None if bare else media.outer_coating if outer else media.inner_coating
        before, behind = (light.indices[rows], around) if inside else (around, light.indices[rows])
        face = RefractingFace(before, behind, coating, light.wavelengths_nm[rows], not inside)
        some = AtFace.of(face, light.directions[rows], hits.normals[rows], light.fields[rows])
        for name, values in vars(some).items():
            getattr(found, name)[rows] = values
    return found


def _causes(
    light: SplitRays, hits: SurfaceHits, transmittance: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Causes of the transmitted and of the reflected rays; an earlier cause is kept."""
    back = (light.crossings == 1) & ~hits.away
    missed = [light.crossings >= 2, hits.base | back]
    transmitted = np.select(missed, [Cause.MET_AGAIN, Cause.BASE], Cause.SEQUENTIAL)
    total = np.where(transmittance > 0.0, Cause.OUTER_REFLECTION, Cause.TOTAL_REFLECTION)
    reflection = np.where(light.crossings == 0, Cause.INNER_REFLECTION, total)
    reflected = np.where(transmitted == Cause.SEQUENTIAL, reflection, transmitted)
    return np.where(light.stray, light.causes, transmitted), np.where(light.stray, light.causes, reflected)
