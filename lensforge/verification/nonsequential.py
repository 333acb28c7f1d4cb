"""Light followed through the part wherever it goes: split at every surface, dimmed in the bulk, until it has left.

Every ray splits into a transmitted and a reflected one, so nothing is drawn by lot and the account of flux closes to
rounding. Reflectances are unpolarised at each surface, whatever came before.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.sources.bundle import RayBundle
from lensforge.verification.casting import Grid, Hits, Leg
from lensforge.verification.part import Part
from lensforge.verification.passage import at_base, indices_of, meet, refract

# A polished base is as clear as the lens; a black one takes all light that meets it, as a holder may.
Base = Literal["polished", "black"]

_CHUNK = 16384  # rays cast at a time: bounds the memory, and stays in the cache
_SKIN_MM = 1e-6  # corners are followed, so no more may be passed over; the facet just left shows its wrong side
_SIDES = 4  # tries to get past facets whose side contradicts the medium that the ray is in


class Cause(IntEnum):
    """What first took light off the way that the sequential design knows; SEQUENTIAL: nothing has."""

    SEQUENTIAL = 0
    INNER_REFLECTION = 1  # reflected where it should have entered
    OUTER_REFLECTION = 2  # reflected in part where it should have left
    TOTAL_REFLECTION = 3  # totally reflected where it should have left
    BASE = 4  # met a surface at or below z = 0, or came back into the cavity
    MET_AGAIN = 5  # left the lens and met it again


@dataclass(frozen=True)
class Light:
    """Rays under way: leg, flux (W), whether in the material, cause, and the face by which they entered (-1: none).

    ``indices`` is what the lens is to each. ``crossings`` counts the surfaces passed as the design has it.
    """

    leg: Leg
    flux: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]
    crossings: Int[np.ndarray, " n"]
    entered_by: Int[np.ndarray, " n"]
    indices: Float[np.ndarray, " n"]

    def take(self, rows: Int[np.ndarray, " k"]) -> "Light":
        """Some of the rays."""
        names = ("flux", "inside", "causes", "crossings", "entered_by", "indices")
        rest = (getattr(self, name)[rows] for name in names)
        return Light(self.leg.take(rows), *rest)


@dataclass(frozen=True)
class Body:
    """The part under light: its index to rays that have none of their own, absorption (1/mm), what its base does."""

    part: Part
    grid: Grid
    refractive_index: float
    absorption_per_mm: float = 0.0
    base: Base = "polished"


@dataclass(frozen=True)
class Limits:
    """Rays with less than ``cut_off`` of the mean ray's flux are not followed, none beyond ``depth`` surfaces."""

    cut_off: float = 1e-4
    depth: int = 32


@dataclass(frozen=True)
class Landings:
    """Light on the receiver's plane: points (mm), flux (W), causes."""

    points: Float[np.ndarray, "n 2"]
    flux: Float[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]

    @property
    def stray(self) -> Bool[np.ndarray, " n"]:
        """Which of it the sequential design does not know."""
        stray: Bool[np.ndarray, " n"] = self.causes != Cause.SEQUENTIAL
        return stray


@dataclass
class Account:
    """Where the flux (W) ended: on the receiver's plane, piece by piece as it came, or otherwise."""

    pieces: list[Landings] = field(default_factory=list)
    backward: float = 0.0
    absorbed: float = 0.0
    base: float = 0.0
    cut_off: float = 0.0
    leaked: float = 0.0

    def landings(self) -> Landings:
        """All pieces in one."""
        names = ("points", "flux", "causes")
        return Landings(*(np.concatenate([getattr(piece, name) for piece in self.pieces]) for name in names))


def follow(body: Body, rays: RayBundle, distance_mm: float, limits: Limits) -> Account:
    """Follow all light of ``rays`` until it has left the part; the receiver's plane is z = ``distance_mm``."""
    account, least = Account(), limits.cut_off * float(rays.weights.mean())
    for start in range(0, len(rays), _CHUNK):
        light = _emitted(body, rays.take(slice(start, start + _CHUNK)))
        for _ in range(limits.depth):
            light = _step(body, light, distance_mm, least, account)
            if len(light.flux) == 0:
                break
        account.cut_off += float(light.flux.sum())
    return account


def _emitted(body: Body, rays: RayBundle) -> Light:
    """Light as it leaves the source; the first facet that it meets says whether that is in the material."""
    count = len(rays)
    leg = Leg(rays.origins, rays.directions, np.zeros(count))
    hits = body.grid.first_hits(leg)
    inside = hits.found & (_along(body, leg, hits) > 0.0)
    nothing = np.zeros(count, dtype=np.int64)
    causes = np.where(inside, Cause.BASE, Cause.SEQUENTIAL)
    return Light(
        leg, rays.weights.copy(), inside, causes, nothing, nothing - 1, indices_of(rays, body.refractive_index)
    )


def _along(body: Body, leg: Leg, hits: Hits) -> Float[np.ndarray, " n"]:
    along: Float[np.ndarray, " n"] = np.sum(leg.directions * body.part.mesh.face_normals[hits.triangles], axis=1)
    return along


def _step(body: Body, light: Light, distance_mm: float, least: float, account: Account) -> Light:
    """Take all light to the next surface, or out; what goes on from there."""
    hits = _next_hits(body, light)
    _escape(light.take(np.nonzero(~hits.found)[0]), distance_mm, account)
    rows = np.nonzero(hits.found)[0]
    light, hits = light.take(rows), hits.take(rows)
    light = _dimmed(body, light, meet(body.part, light.leg, hits)[0], account)
    if body.base == "black":
        kept = ~at_base(body.part, hits)
        account.base += float(light.flux[~kept].sum())
        light, hits = light.take(np.nonzero(kept)[0]), hits.take(np.nonzero(kept)[0])
    children = _split(body, light, hits)
    bright = children.flux > least
    account.cut_off += float(children.flux[~bright].sum())
    return children.take(np.nonzero(bright)[0])


def _next_hits(body: Body, light: Light) -> Hits:
    """First hits on facets that face the ray as its medium demands: a grazing ray may slip by its own facet."""
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


def _dimmed(body: Body, light: Light, points: Float[np.ndarray, "n 3"], account: Account) -> Light:
    """Light after its way through the bulk to ``points``, by Beer and Lambert."""
    lengths = np.linalg.norm(points - light.leg.origins, axis=1)
    left = np.where(light.inside, np.exp(-body.absorption_per_mm * lengths), 1.0)
    account.absorbed += float(np.sum(light.flux * (1.0 - left)))
    return replace(light, flux=light.flux * left)


def _split(body: Body, light: Light, hits: Hits) -> Light:
    """The transmitted and the reflected light behind a surface, one after the other."""
    points, normals = meet(body.part, light.leg, hits)
    directions = light.leg.directions
    outward, into = refract(directions, normals, light.indices), refract(directions, normals, 1.0 / light.indices)
    bent = np.where(light.inside[:, None], outward[0], into[0])
    transmittance = np.where(light.inside, outward[1], into[1])
    mirrored = directions - 2.0 * np.sum(directions * normals, axis=1)[:, None] * normals
    causes = _causes(body, light, hits, transmittance)
    on_way = causes[0] == Cause.SEQUENTIAL
    entering = on_way & (light.crossings == 0)
    return Light(
        Leg(np.tile(points, (2, 1)), np.concatenate([bent, mirrored]), np.full(2 * len(points), _SKIN_MM)),
        np.concatenate([light.flux * transmittance, light.flux * (1.0 - transmittance)]),
        np.concatenate([~light.inside, light.inside]),
        np.concatenate(causes),
        np.tile(light.crossings + on_way, 2),
        np.tile(np.where(entering, body.part.faces[hits.triangles], light.entered_by), 2),
        np.tile(light.indices, 2),
    )


def _causes(
    body: Body, light: Light, hits: Hits, transmittance: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Causes of the transmitted and of the reflected light; one that there is already stays."""
    back = (light.crossings == 1) & (body.part.faces[hits.triangles] == light.entered_by)
    missed = [light.crossings >= 2, at_base(body.part, hits) | back]
    transmitted = np.select(missed, [Cause.MET_AGAIN, Cause.BASE], Cause.SEQUENTIAL)
    total = np.where(transmittance > 0.0, Cause.OUTER_REFLECTION, Cause.TOTAL_REFLECTION)
    reflection = np.where(light.crossings == 0, Cause.INNER_REFLECTION, total)
    reflected = np.where(transmitted == Cause.SEQUENTIAL, reflection, transmitted)
    first = light.causes == Cause.SEQUENTIAL
    return np.where(first, transmitted, light.causes), np.where(first, reflected, light.causes)


def _escape(light: Light, distance_mm: float, account: Account) -> None:
    """Note light that meets nothing more: it lands on the receiver's plane or goes backward."""
    directions, height = light.leg.directions, distance_mm - light.leg.origins[:, 2]
    rises = ~light.inside & (directions[:, 2] > 0.0) & (height > 0.0)
    account.leaked += float(light.flux[light.inside].sum())
    account.backward += float(light.flux[~light.inside & ~rises].sum())
    slope = directions[rises, :2] / directions[rises, 2:]
    points = light.leg.origins[rises, :2] + height[rises, None] * slope
    account.pieces.append(Landings(points, light.flux[rises], light.causes[rises]))
