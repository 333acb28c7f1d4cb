"""Chains of events for any surfaces, in NumPy or in torch: the readable counterpart of ``kernels.chain``.

A ray leaves the medium in which it is where a dense scan along it first finds a point outside: the medium is where all
faces that bound it have a gap above 0, but for the cavity that the body surrounds. The face is the one whose gap is 0
there; a Newton step on it makes the hit differentiable. The light that each event lets pass or reflects is followed as
two complex fields. A ray that would meet another face, were a face moved, has no derivative.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.coated_glass import face_transmittances
from lensforge.light.exact_trace import bracketed, to_plane
from lensforge.light.sequential_trace import (
    EnteringRays,
    TracedSurface,
    as_seen,
    differentiable_hit,
    entered,
    fates_at_plane,
)
from lensforge.optics.arrays import Array, constant, lengths, module_of, replaced, rows_of, without_gradient
from lensforge.optics.dielectric import (
    Amplitudes,
    fields_behind,
    passing_amplitudes,
    reflecting_amplitudes,
    refract,
    transmitted_cosine_squared,
    unpolarised_fields,
)
from lensforge.optics.media import BODY, CAVITY, OUTSIDE, Mirror
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays

_STEPS, _BISECTIONS = 512, 60
_BACKED_OFF = 1e-9  # of the reach: a ray starts so far from the face that it has just met


@dataclass(frozen=True)
class TracedFaces:
    """The surfaces of a chain by name, and the length (mm) beyond which no ray is still in the body."""

    surfaces: Mapping[str, TracedSurface]
    chain: Chain
    reach_mm: float

    def bounding(self, medium: str) -> list[TracedSurface]:
        """Surfaces that bound a medium on the side away from the origin."""
        faces = zip(self.chain.names, self.chain.before, strict=True)
        return [self.surfaces[name] for name, before in faces if before == medium]

    def inside(self, medium: str, points: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """True for points in a medium."""
        held = _within(self.bounding(medium), points)
        return held & ~_within(self.bounding(CAVITY), points) if medium == BODY else held

    def nearest(self, medium: str, points: Float[Array, "n 3"]) -> Int[Array, " n"]:
        """Number of the face on which points lie that left a medium; no other but those that bound it."""
        xp, gaps = module_of(points), []
        for name, before, behind in zip(self.chain.names, self.chain.before, self.chain.behind, strict=True):
            gap = abs(self.surfaces[name].gap(points))
            gaps.append(gap if medium in (before, behind) else gap * 0.0 + np.inf)
        return xp.stack(gaps, 1).argmin(1)


def _within(surfaces: Sequence[TracedSurface], points: Float[Array, "n 3"]) -> Bool[Array, " n"]:
    held = surfaces[0].gap(points) >= 0.0
    for surface in surfaces[1:]:
        held = held & (surface.gap(points) >= 0.0)
    return held


@dataclass
class _Light:
    """All rays, and what the events have made of them; ``clear``: what absorption leaves of the flux."""

    points: Float[Array, "n 3"]
    directions: Float[Array, "n 3"]
    fields: Array
    clear: Float[Array, " n"]
    fates: Array
    absorbed: Float[Array, " n"]
    sin2_exit: Float[Array, " n"]


def trace_chain(faces: TracedFaces, rays: EnteringRays, fresnel: bool = True) -> ExitRays:
    """Trace ``rays`` out of a body of any faces; differentiable in what the surfaces are differentiable in.

    Raises :class:`InputError` for rough faces, which this tracer does not have.
    """
    if rays.made is not None and rays.made.slopes:
        raise InputError("rough faces: traced by the compiled kernels alone; leave out the roughness")
    xp = module_of(rays.flux)
    fates, alive, points = entered(rays, lambda points: faces.inside(CAVITY, points))
    nothing = xp.zeros_like(rays.flux)
    fields = unpolarised_fields(rays.directions) + 0.0j
    light = _Light(points, rays.directions, fields, nothing + 1.0, fates, nothing, nothing)
    going = {CAVITY: alive, BODY: alive[:0]}
    left = alive[:0]
    for event in range(faces.chain.events):
        onward: dict[str, list[Array]] = {CAVITY: [], BODY: [], OUTSIDE: []}
        for medium, rows in going.items():
            if len(rows):
                last = event + 1 == faces.chain.events
                for behind, some in _event(faces, rays, light, medium, rows, fresnel, last):
                    onward[behind].append(some)
        left = xp.concatenate([left, *onward[OUTSIDE]])
        going = {medium: xp.concatenate([alive[:0], *onward[medium]]) for medium in (CAVITY, BODY)}
    for rows in going.values():
        light.fates[rows] = int(Fate.MORE_EVENTS)
    return _exits(rays, light, left, fresnel)


def _event(
    faces: TracedFaces, rays: EnteringRays, light: _Light, medium: str, rows: Array, fresnel: bool, last: bool
) -> list[tuple[str, Array]]:
    """Take the rays ``rows``, all in one medium, to the next face and through it, or back from it.

    Returns the media in which they go on, with their rows.
    """
    starts, along = constant(light.points[rows]), constant(light.directions[rows])
    with without_gradient(starts):
        ahead = starts + _BACKED_OFF * faces.reach_mm * along
        crossing = bracketed(
            lambda paths: faces.inside(medium, ahead + paths[:, None] * along),
            faces.reach_mm, to_plane(ahead, along), _STEPS, _BISECTIONS,
        )  # fmt: skip
        paths = crossing.lengths + _BACKED_OFF * faces.reach_mm
        numbers = faces.nearest(medium, starts + paths[:, None] * along)
    above = (starts + paths[:, None] * along)[:, 2] >= 0.0
    met = crossing.found & above
    light.fates[rows[~met]] = fates_at_plane(along[~met], medium != CAVITY)
    onward = []
    for number in range(len(faces.chain.names)):
        some = met & (numbers == number)
        if bool(some.any()):
            onward += _at_face(faces, rays, light, medium, number, rows[some], paths[some], fresnel, last)
    return onward


def _at_face(
    faces: TracedFaces, rays: EnteringRays, light: _Light, medium: str, number: int, rows: Array,
    paths: Float[Array, " k"], fresnel: bool, last: bool,
) -> list[tuple[str, Array]]:  # fmt: skip
    """Refract the rays ``rows`` at one face, or reflect them there."""
    chain, surface = faces.chain, faces.surfaces[faces.chain.names[number]]
    coating = rays.media.coating(chain.names[number])
    if isinstance(coating, Mirror) and coating.reflectance == 0.0:
        light.fates[rows] = int(Fate.FLANGE)
        light.sin2_exit = replaced(light.sin2_exit, rows, 0.0 * paths)
        return []
    from_behind = chain.behind[number] == medium and chain.before[number] != medium
    behind = chain.before[number] if from_behind else chain.behind[number]
    points, normals = differentiable_hit(surface, light.points[rows], light.directions[rows], paths, from_behind)
    if medium == BODY:
        _absorb(rays, light, rows, points)
    before, ratio = light.directions[rows], _ratio(rays, medium, behind, rows)
    cosine = (before * normals).sum(1)
    squared = transmitted_cosine_squared(cosine, ratio)
    exits = behind == OUTSIDE and not isinstance(coating, Mirror)
    sense = 0.0 if not exits else -1.0 if number + 1 == len(chain.names) else 1.0  # 2 - s at a face that is to reflect
    light.sin2_exit = replaced(light.sin2_exit, rows, abs(sense) + sense * squared)
    mirrored = constant(squared <= 0.0) | isinstance(coating, Mirror)
    onward = []
    for reflected in (False, True):
        some = rows_of(mirrored if reflected else ~mirrored)
        if not len(some):
            continue
        if isinstance(coating, Mirror):
            _lose(rays, light, rows[some], 1.0 - coating.reflectance)
        d, n, c, r = before[some], normals[some], cosine[some], ratio[some]
        b = d - 2.0 * c[:, None] * n if reflected else refract(d, n, r)
        found = _amplitudes(rays, chain.names[number], c, r, rows[some], reflected, fresnel)
        fields = fields_behind(light.fields[rows[some]], d, b, n, found, reflected)
        light.fields = replaced(light.fields, rows[some], fields)
        light.points = replaced(light.points, rows[some], points[some])
        light.directions = replaced(light.directions, rows[some], b)
        if reflected and last and not isinstance(coating, Mirror):
            light.fates[rows[some]] = int(Fate.TOTAL_REFLECTION)
            continue
        onward.append((medium if reflected else behind, rows[some]))
    return onward


def _absorb(rays: EnteringRays, light: _Light, rows: Array, points: Float[Array, "k 3"]) -> None:
    """Take what the body absorbs of the rays ``rows`` on their way to ``points``."""
    if rays.absorptions is None:
        return
    through = module_of(points).exp(-rays.absorptions[rows] * lengths(points - light.points[rows]))
    _lose(rays, light, rows, 1.0 - through)
    light.clear = replaced(light.clear, rows, light.clear[rows] * through)


def _lose(rays: EnteringRays, light: _Light, rows: Array, share: Array | float) -> None:
    """Count a share of the flux that the rays ``rows`` have now as absorbed."""
    light.absorbed = replaced(light.absorbed, rows, light.absorbed[rows] + _flux(rays, light)[rows] * share)


def _amplitudes(
    rays: EnteringRays, face: str, cosine: Float[Array, " k"], ratio: Float[Array, " k"], rows: Array, reflected: bool,
    fresnel: bool,
) -> Amplitudes:  # fmt: skip
    """Amplitudes of the rays ``rows`` behind a face; a mirror has one for both polarisations."""
    coating, equal = rays.media.coating(face), cosine * 0.0
    if isinstance(coating, Mirror):
        return equal + coating.reflectance**0.5, equal
    if reflected:
        return reflecting_amplitudes(cosine, ratio)
    if not fresnel:
        return equal + 1.0, equal
    table = rays.coatings.faces.get(face)
    return passing_amplitudes(face_transmittances(cosine, ratio, table, rays.coatings.rows, rows), ratio)


def _ratio(rays: EnteringRays, before: str, behind: str, rows: Array) -> Float[Array, " k"]:
    """Index before over index behind a face, for some of the rays."""
    into, out_of = rays.entry_ratios[rows], rays.exit_ratios[rows]
    if before == CAVITY:
        return into if behind == BODY else into * out_of
    return out_of if behind == OUTSIDE else 1.0 / into


def _flux(rays: EnteringRays, light: _Light) -> Float[Array, " n"]:
    """Flux (W) of all rays as it is now."""
    return rays.flux * light.clear * 0.5 * (abs(light.fields) ** 2).sum((1, 2))


def _exits(rays: EnteringRays, light: _Light, left: Array, fresnel: bool) -> ExitRays:
    """The rays behind the body, and behind the cover glass."""
    flux = _flux(rays, light)
    exits = ExitRays(light.points, light.directions, flux, light.sin2_exit, light.fates, light.absorbed)
    return as_seen(exits, left, rays, light.fields, rays.flux * light.clear if fresnel else None)
