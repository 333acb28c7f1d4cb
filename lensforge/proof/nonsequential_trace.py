"""Non-sequential trace of the part: rays split at every surface and are absorbed in the bulk until all light has left.

Every ray splits into a transmitted and a reflected one; nothing is drawn at random, so the flux budget closes to
rounding. The polarisation of each ray goes with it.

Light that leaves is stray unless the sequential trace of the same rays through the same mesh has it. The board and the
chip under the lens are not modelled: they absorb all light that comes back to them.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from enum import IntEnum
from time import perf_counter
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.optics.media import Media
from lensforge.proof.facet_casting import Grid, Leg
from lensforge.proof.optical_faces import USUAL_LENS, OpticalFaces
from lensforge.proof.part_comparison import ONE_LAMP, LampStands
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_result import ReceiverStray, StrayByCause, StrayFlux, StrayLight
from lensforge.proof.receiver_screen import Screen, nmse
from lensforge.proof.refraction import AtFace, LitRays
from lensforge.proof.sequential_cast import (
    SKIN_MM,
    CastFate,
    MeshBody,
    Passage,
    SurfaceHits,
    at_faces,
    behind_lens,
    outside_leg,
    send_through,
)
from lensforge.results.arguments import require_choice
from lensforge.sources.ray_bundle import RayBundle

# A polished base is as clear as the lens; a black one absorbs all light that meets it, as a holder may.
Base = Literal["polished", "black"]

_FACETS = 0  # seed of those of further bodies
_CHUNK = 16384  # rays cast at a time: bounds the memory, and stays in the cache


class Cause(IntEnum):
    """First event that took light off the path of the sequential cast."""

    SEQUENTIAL = 0  # none: light on the sequential path
    INNER_REFLECTION = 1  # reflected where it should have entered
    OUTER_REFLECTION = 2  # reflected in part where it should have left
    TOTAL_REFLECTION = 3  # reflected as a whole, or not out of the lens, at its last event
    BASE = 4  # met a surface at or below z = 0, came back into the cavity, or came from outside of the lens
    MET_AGAIN = 5  # left the lens and met it again


@dataclass(frozen=True)
class SplitRays(LitRays):
    """Rays inside or behind the part: last points (mm), flux (W), cause.

    ``events``: on the sequential path; ``crossings``: 0 in the cavity, 1 in the body, 2 behind it. ``beside``: True for
    light that has met a neighbour of its lens.
    """

    points: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    causes: Int[np.ndarray, " n"]
    crossings: Int[np.ndarray, " n"]
    events: Int[np.ndarray, " n"]
    beside: Bool[np.ndarray, " n"]

    @property
    def stray(self) -> Bool[np.ndarray, " n"]:
        """True for light off the sequential path."""
        return self.causes != Cause.SEQUENTIAL


@dataclass(frozen=True)
class PartBody(MeshBody):
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
    """Flux (W) by its end: ``pieces`` of light that left the part, and losses. ``absorbed``: by the body and mirrors.

    ``neighbours``: of light when it first met a neighbour of its lens on a plate.
    """

    pieces: list[SplitRays] = field(default_factory=list)
    absorbed: float = 0.0
    base: float = 0.0
    cut_off: float = 0.0
    leaked: float = 0.0
    neighbours: float = 0.0

    def escaped(self) -> SplitRays:
        """All pieces joined."""
        return _joined(self.pieces)


@dataclass
class _Followed:
    """Light of some rays that has left the part, in pieces, and losses of flux (W) by their names in the budget.

    They are summed in order, so that the bits do not depend on the number of threads.
    """

    pieces: list[SplitRays] = field(default_factory=list)
    losses: list[tuple[str, float]] = field(default_factory=list)

    def lose(self, name: str, flux: Float[np.ndarray, " n"]) -> None:
        """Count the flux of some rays as lost."""
        self.losses.append((name, float(flux.sum())))


def _joined(parts: Sequence[SplitRays]) -> SplitRays:
    return SplitRays(*map(np.concatenate, zip(*(vars(part).values() for part in parts), strict=True)))


def follow(body: PartBody, rays: RayBundle, limits: Limits, threads: int = 1, chunk: int = _CHUNK) -> FluxBudget:
    """Follow all light of ``rays`` until it has left the part. The result does not depend on ``threads``.

    ``chunk``: rays that are cast at a time.
    """
    least = limits.cut_off * float(rays.flux.mean())

    def followed(start: int) -> _Followed:
        followed_light = _Followed()
        light = _emitted(body, rays.take(slice(start, start + chunk)))
        for _ in range(limits.depth):
            light = _step(body, light, least, followed_light)
            if len(light.flux) == 0:
                break
        followed_light.lose("cut_off", light.flux)
        return followed_light

    budget = FluxBudget()
    with ThreadPoolExecutor(threads) as pool:
        for chunk_light in pool.map(followed, range(0, len(rays), chunk)):
            budget.pieces += chunk_light.pieces
            for name, flux in chunk_light.losses:
                setattr(budget, name, getattr(budget, name) + flux)
    return budget


def _emitted(body: PartBody, rays: RayBundle) -> SplitRays:
    """Rays as they leave the source; those that meet their first facet from behind start in the material.

    Neither these nor those that meet the outside of the lens first are on the sequential path.
    """
    leg = outside_leg(rays, body.optical)
    hits = body.surface_hits(leg)
    causes = np.where(hits.leaving | hits.away, Cause.BASE, Cause.SEQUENTIAL)
    light = vars(LitRays.of(rays, body.media, body.optical.names))
    nothing = np.zeros(len(rays), dtype=np.int64)
    light |= {"inside": hits.leaving, "points": leg.origins, "flux": rays.flux.copy(), "causes": causes}
    return SplitRays(**light, crossings=nothing, events=nothing, beside=np.zeros(len(rays), dtype=bool))


def _step(body: PartBody, light: SplitRays, least: float, outcome: _Followed) -> SplitRays:
    """Trace all rays to the next surface, or out; return those that continue, and note the rest in ``outcome``."""
    leg = Leg(light.points, light.directions, np.full(len(light.flux), SKIN_MM))
    hits = body.surface_hits(leg, light.inside)
    gone = ~hits.found
    outcome.lose("leaked", light.flux[gone & light.inside])
    outcome.pieces.append(light.take(np.nonzero(gone & ~light.inside)[0]))
    rows = np.nonzero(~gone)[0]
    light = light.take(rows)
    hits = hits.take(rows)
    # By the law of Beer and Lambert.
    lengths = body.optical.expansion.scale * np.linalg.norm(hits.points - light.points, axis=1)
    left = np.where(light.inside, np.exp(-light.absorptions * lengths), 1.0)
    outcome.lose("absorbed", light.flux * (1.0 - left))
    light = replace(light, flux=light.flux * left)
    if body.base == "black":
        outcome.lose("base", light.flux[hits.base])
        rows = np.nonzero(~hits.base)[0]
        light = light.take(rows)
        hits = hits.take(rows)
    beside = body.optical.at_neighbour(hits.points)
    outcome.lose("neighbours", light.flux[beside & ~light.beside])
    light = replace(light, beside=light.beside | beside)
    at = at_faces(body.optical, body.media, light, hits)
    outcome.lose("absorbed", light.flux * (1.0 - at.transmittance - at.reflectance))  # by mirrors
    children = _split(body.optical, light, hits, at)
    bright = children.flux > least
    outcome.lose("cut_off", children.flux[~bright])
    return children.take(np.nonzero(bright)[0])


def _split(optical: OpticalFaces, light: SplitRays, hits: SurfaceHits, at: AtFace) -> SplitRays:
    """The transmitted, then the reflected rays behind a surface."""
    causes = _causes(optical, light, hits, at.transmittance)
    at_surface = replace(light, points=hits.points, events=light.events + 1, times=light.times_after(hits.faces))
    passed = replace(
        at_surface, directions=at.bent, fields=at.passed, flux=light.flux * at.transmittance, causes=causes[0]
    )
    passed = replace(passed, inside=~light.inside, crossings=np.where(light.inside, np.where(hits.away, 2, 0), 1))
    reflected = {
        "directions": at.mirrored,
        "fields": at.returned,
        "flux": light.flux * at.reflectance,
        "causes": causes[1],
    }
    return _joined([passed, replace(at_surface, **reflected)])


def _causes(
    optical: OpticalFaces, light: SplitRays, hits: SurfaceHits, transmittance: Float[np.ndarray, " n"]
) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    goes_on = optical.goes_on(light.events)
    whole = transmittance <= 0.0
    back = (light.crossings == 1) & ~hits.away
    enters = (light.crossings == 0) & (light.events + 1 >= optical.events)
    missed = [light.crossings >= 2, hits.base | back & ~goes_on, enters]
    transmitted = np.select(missed, [Cause.MET_AGAIN, Cause.BASE, Cause.TOTAL_REFLECTION], Cause.SEQUENTIAL)
    on_path = whole & goes_on
    total = np.where(whole, Cause.TOTAL_REFLECTION, Cause.OUTER_REFLECTION)
    reflection = np.where(light.crossings == 0, Cause.INNER_REFLECTION, total)
    reflection = np.where(on_path, Cause.SEQUENTIAL, reflection)
    reflected = np.where(transmitted == Cause.SEQUENTIAL, reflection, transmitted)
    return np.where(light.stray, light.causes, transmitted), np.where(light.stray, light.causes, reflected)


def trace_stray(
    stl: bytes,
    *,
    rays: RayBundle,
    media: Media,
    screens: Sequence[Screen],
    names: Sequence[str] = ("light",),
    base: Base = "polished",
    optical: OpticalFaces = USUAL_LENS,
    lamps: LampStands = ONE_LAMP,
    limits: Limits | None = None,
    threads: int = 1,
    inputs: Mapping[str, str] | None = None,
) -> StrayLight:
    """Follow ``rays`` through the part in the bytes of an STL file (mm) until all light has left it.

    Shares are of the emitted flux; "detected" is what lands in the window of each of ``screens``, of ``names``.
    ``optical``: the faces of the part, and the events of its light; ``lamps``: places of the lamps, all of which light
    each screen: shares are means over them. The result does not depend on ``threads``. ``inputs``: hashes of the
    inputs, by name. Raises :class:`InputError` for bytes that hold no mesh, and for an unknown ``base``.
    """
    require_choice("base", base, get_args(Base))
    start = perf_counter()
    limits = limits or Limits()
    part = read_part_mesh(stl, optical)
    grid = Grid(part.mesh)
    budget = follow(PartBody(part, grid, media, base), rays, limits, threads)
    escaped = budget.escaped()
    emitted = float(rays.flux.sum())
    split = _escaped(escaped, media, optical)
    passage = send_through(part, grid, rays, media, threads)
    light = _Light(lamps, emitted, budget, split, escaped.causes, passage)
    return StrayLight(
        inputs=dict(inputs or {}),
        receivers=tuple(light.on(name, screen) for name, screen in zip(names, screens, strict=True)),
        rays=len(rays),
        base=base,
        lenses=1 if optical.plate is None else len(optical.plate.places),
        neighbours=budget.neighbours / emitted,
        absorption_per_mm=media.body.absorption_per_mm,
        cut_off=limits.cut_off,
        depth=limits.depth,
        seconds=perf_counter() - start,
    )


def _escaped(light: SplitRays, media: Media, optical: OpticalFaces) -> Passage:
    """Light that has left the part, behind the further bodies and the cover glass."""
    rays = RayBundle(light.points, light.directions, light.flux).with_wavelengths(light.wavelengths_nm)
    ends = {"points": light.points, "directions": light.directions, "fields": light.fields}
    left = replace(Passage.of(rays, 0), fates=np.full(len(rays), CastFate.LANDED), **ends)
    return behind_lens(left, rays, media, optical, _FACETS)


@dataclass(frozen=True)
class _Light:
    """Light of one lamp that emits ``emitted_w``: split at the faces, by ``causes``, and the unsplit ``passage``.

    ``lamps``: places of the lamps that have it. ``lost``: flux (W) that has not left the part.
    """

    lamps: LampStands
    emitted_w: float
    lost: FluxBudget
    split: Passage
    causes: Int[np.ndarray, " n"]
    passage: Passage

    def of_lamp(self, number: int, screen: Screen, images: Float[np.ndarray, "3 h w"]) -> dict[str, float]:
        """Flux (W) of lamp ``number`` on a receiver by its end, with stray light by its cause.

        ``images``: unsplit light, direct light, and stray light, to which this lamp's is added.
        """
        split, plain = (self.lamps.stood(light, number).landed(screen) for light in (self.split, self.passage))
        reached = split.fates == CastFate.LANDED
        again = split.fates == CastFate.SECOND_WALL
        stray = self.causes != Cause.SEQUENTIAL
        inside = screen.in_window(split.landings)
        direct = ~stray
        images[0] += screen.irradiance(plain.landings, plain.flux)
        for image, some in zip(images[1:], (direct, stray), strict=True):
            image += screen.irradiance(split.landings[some], split.flux[some])
        by_cause = {f"by {cause.name.lower()}": inside & (self.causes == cause) for cause in Cause}
        ends = {
            "detected_direct": inside & direct,
            "detected_stray": inside & stray,
            "outside_direct": reached & ~inside & direct,
            "outside_stray": reached & ~inside & stray,
            "backward": ~reached & ~again,
            "second_wall": again,
        }
        return {name: float(split.flux[some].sum()) for name, some in (ends | by_cause).items()} | {
            "sequential": float(plain.flux[screen.in_window(plain.landings)].sum()),
            "absorbed": self.lost.absorbed,
            "cover_glass": float(split.in_glass.sum()),
            "bodies": float(split.in_bodies.sum()),
            "housing": float(split.in_housing.sum()),
            "base": self.lost.base,
            "too_dim": self.lost.cut_off,
            "leaked": self.lost.leaked,
        }

    def on(self, name: str, screen: Screen) -> ReceiverStray:
        """Stray light of all lamps on a receiver; shares are of the flux of all."""
        sums = Counter[str]()
        images = np.zeros((3, screen.rows, screen.columns))
        count = len(self.lamps.places)
        for number in range(count):
            sums.update(self.of_lamp(number, screen, images))
        shares = {end: watts / (count * self.emitted_w) for end, watts in sums.items()}
        (reference, direct, stray) = images
        flux = StrayFlux(**{end: shares[end] for end in StrayFlux.model_fields})
        whole = direct + stray
        misplaced_w = float(np.abs(whole - reference).sum()) * screen.pixel_measure
        return ReceiverStray(
            name=name,
            width=screen.width,
            height=screen.height,
            far_field=screen.is_far,
            flux=flux,
            balance_error=abs(sum(flux.model_dump().values()) - 1.0),
            detected_stray_by_cause=StrayByCause(**{name: shares[f"by {name}"] for name in StrayByCause.model_fields}),
            misplaced_flux=misplaced_w / (count * self.emitted_w),
            nmse_vs_sequential=nmse(whole, reference) if reference.any() else None,
            peak_of_mean=float(stray.max() / reference.mean()) if reference.any() else None,
            efficiency=flux.detected_direct + flux.detected_stray,
            efficiency_sequential=shares["sequential"],
            sequential=reference,
            direct=direct,
            stray=stray,
        )
