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
from lensforge.light.coated_glass import behind_glass_by_arrays, face_transmittances
from lensforge.light.exact_trace import bracketed, to_plane
from lensforge.light.sequential_trace import EnteringRays, TracedSurface
from lensforge.optics.arrays import Array, codes, constant, lengths, module_of, replaced, rows_of, without_gradient
from lensforge.optics.dielectric import refract, transmitted_cosine_squared, unpolarised_fields
from lensforge.optics.media import BODY, CAVITY, OUTSIDE, Mirror
from lensforge.scene.as_made import through_frame
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays

_STEPS, _BISECTIONS = 512, 60
_DARK = 1e-12  # transmittance below which the slope of its root no longer counts
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
    fates, alive, points = _entered(faces, rays)
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


def _entered(faces: TracedFaces, rays: EnteringRays) -> tuple[Array, Array, Float[Array, "n 3"]]:
    """Fates; the rays in the cavity; the points of all rays: those from below z = 0 start at its opening."""
    xp, rise, height = module_of(rays.flux), rays.directions[:, 2], rays.origins[:, 2]
    rising = ~(rise <= 0.0)
    start = xp.where(height < 0.0, -height / xp.where(rising, rise, 1.0), 0.0)
    points = rays.origins + start[:, None] * rays.directions
    points[:, 2] = xp.where(height < 0.0, 0.0, height)
    with without_gradient(points):
        inside = faces.inside(CAVITY, points)
    enters = rising | (height > 0.0)
    outside = xp.where(inside, int(Fate.LEFT_LENS), int(Fate.OUTSIDE_CAVITY))
    return codes(xp.where(enters, outside, int(Fate.BACKWARD))), rows_of(enters & inside), points


def _event(
    faces: TracedFaces, rays: EnteringRays, light: _Light, medium: str, rows: Array, fresnel: bool, last: bool
) -> list[tuple[str, Array]]:
    """Take the rays ``rows``, all in one medium, to the next face and through it, or back from it.

    Returns the media in which they go on, with their rows.
    """
    xp, names = module_of(rays.flux), faces.chain.names
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
    lost = xp.where((along[:, 2] <= 0.0) & (medium == CAVITY), int(Fate.BACKWARD), int(Fate.BASE))
    light.fates[rows[~met]] = codes(lost)[~met]
    onward = []
    for number in range(len(names)):
        some = met & (numbers == number)
        if bool(some.any()):
            onward += _at_face(faces, rays, light, medium, number, rows[some], paths[some], fresnel, last)
    return onward


def _at_face(
    faces: TracedFaces, rays: EnteringRays, light: _Light, medium: str, number: int, rows: Array,
    paths: Float[Array, " k"], fresnel: bool, last: bool,
) -> list[tuple[str, Array]]:  # fmt: skip
    """Refract the rays ``rows`` at one face, or reflect them there."""
    xp, chain, surface = module_of(rays.flux), faces.chain, faces.surfaces[faces.chain.names[number]]
    from_behind = chain.behind[number] == medium and chain.before[number] != medium
    behind = chain.before[number] if from_behind else chain.behind[number]
    points, normals = _hit(surface, light.points[rows], light.directions[rows], paths)
    normals = -normals if from_behind else normals
    if medium == BODY and rays.absorptions is not None:
        through = xp.exp(-rays.absorptions[rows] * lengths(points - light.points[rows]))
        flux = _flux(rays, light)[rows]
        light.absorbed = replaced(light.absorbed, rows, light.absorbed[rows] + flux * (1.0 - through))
        light.clear = replaced(light.clear, rows, light.clear[rows] * through)
    before, ratio = light.directions[rows], _ratio(rays, medium, behind, rows)
    cosine = (before * normals).sum(1)
    squared = transmitted_cosine_squared(cosine, ratio)
    coating = rays.media.coating(chain.names[number])
    exits = behind == OUTSIDE and not isinstance(coating, Mirror)
    light.sin2_exit = replaced(light.sin2_exit, rows, 1.0 - squared if exits else 0.0 * squared)
    mirrored = constant(squared <= 0.0) | isinstance(coating, Mirror)
    onward = []
    for reflected in (False, True):
        own = mirrored if reflected else ~mirrored
        some = rows_of(own)
        if not len(some):
            continue
        if reflected and last:
            ends = Fate.MORE_EVENTS if isinstance(coating, Mirror) else Fate.TOTAL_REFLECTION
            light.fates[rows[some]] = int(ends)
            continue
        d, n, c, r = before[some], normals[some], cosine[some], ratio[some]
        b = d - 2.0 * c[:, None] * n if reflected else refract(d, n, r)
        if reflected:
            across, more = _reflecting(c, r, squared[some], coating)
        elif fresnel:
            table = rays.coatings.faces.get(chain.names[number])
            across, more = _passing(face_transmittances(c, r, table, rays.coatings.rows, rows[some]))
        else:
            across, more = c * 0.0 + 1.0, c * 0.0
        fields = _fields_behind(light.fields[rows[some]], across, more, n, c, d, b, reflected)
        light.fields = replaced(light.fields, rows[some], fields)
        light.points = replaced(light.points, rows[some], points[some])
        light.directions = replaced(light.directions, rows[some], b)
        onward.append((medium if reflected else behind, rows[some]))
    return onward


def _hit(
    surface: TracedSurface, origins: Float[Array, "k 3"], directions: Float[Array, "k 3"], paths: Float[Array, " k"]
) -> tuple[Float[Array, "k 3"], Float[Array, "k 3"]]:
    """The hit and its unit normal away from the origin, by one undamped Newton step."""
    with without_gradient(origins):
        slope = -(surface.normal(origins + paths[:, None] * directions) * directions).sum(1)
        slope = module_of(slope).where(slope == 0.0, np.inf, slope)
    exact = paths - surface.gap(origins + paths[:, None] * directions) / slope
    points = origins + exact[:, None] * directions
    normals = surface.normal(points)
    return points, normals / lengths(normals)[:, None]


def _ratio(rays: EnteringRays, before: str, behind: str, rows: Array) -> Float[Array, " k"]:
    """Index before over index behind a face, for some of the rays."""
    into, out_of = rays.entry_ratios[rows], rays.exit_ratios[rows]
    if before == CAVITY:
        return into if behind == BODY else into * out_of
    return out_of if behind == OUTSIDE else 1.0 / into


def _passing(found: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    """Amplitude across the plane of incidence, and its difference to that in it over the squared sine."""
    xp = module_of(found[0])
    root_s, root_p = (xp.sqrt(xp.where(each > _DARK, each, _DARK)) for each in found[:2])
    return root_s, found[2] / (root_s + root_p)


def _reflecting(
    cosine: Float[Array, " k"], ratio: Float[Array, " k"], squared: Float[Array, " k"], coating: object
) -> tuple[Array, Array]:
    """Amplitudes of a mirror, or of total reflection: ``(r c - q) / (r c + q)`` with q = i Q (Born and Wolf, 1.5.4)."""
    xp = module_of(cosine)
    if isinstance(coating, Mirror):
        return cosine * 0.0 + coating.reflectance**0.5, cosine * 0.0
    q = 1.0j * xp.sqrt(-squared)
    across = (ratio * cosine - q) / (ratio * cosine + q)
    return across, -2.0 * ratio * (ratio**2 - 1.0) / ((ratio * cosine + q) * (cosine + ratio * q))


def _fields_behind(
    fields: Array, across: Array, more: Array, n: Array, c: Array, d: Array, b: Array, reflected: bool
) -> Array:
    """Fields behind a face: ``M (a e + k (n.e) u)``, as in ``kernels.fields``."""
    u = n - c[:, None] * d
    onto = (fields * n[:, None, :]).sum(2)
    turned = across[:, None, None] * fields + (more[:, None] * onto)[:, :, None] * u[:, None, :]
    if reflected:
        return turned - 2.0 * (turned * n[:, None, :]).sum(2)[:, :, None] * n[:, None, :]
    along = (turned * b[:, None, :]).sum(2) / (1.0 + (d * b).sum(1))[:, None]
    return turned - along[:, :, None] * (d + b)[:, None, :]


def _flux(rays: EnteringRays, light: _Light) -> Float[Array, " n"]:
    """Flux (W) of all rays as it is now."""
    return rays.flux * light.clear * 0.5 * (abs(light.fields) ** 2).sum((1, 2))


def _exits(rays: EnteringRays, light: _Light, left: Array, fresnel: bool) -> ExitRays:
    """The rays behind the body, and behind the cover glass."""
    xp, flux = module_of(rays.flux), _flux(rays, light)
    points, directions = light.points[left], light.directions[left]
    fields = light.fields
    if rays.made is not None:
        frames, _, factor = rays.made.placed
        points, directions = through_frame(frames[-1], points, directions, factor)
        fields = fields @ (xp.asarray(frames[-1][:, :3].T.copy()) + 0.0j)
    points, directions = (replaced(xp.zeros_like(rays.origins), left, each) for each in (points, directions))
    axial = rays.flux * light.clear * 0.5 * (abs(fields[:, :, 2]) ** 2).sum(1)
    absorbed = None if rays.absorptions is None else light.absorbed
    exits = ExitRays(points, directions, flux, light.sin2_exit, light.fates, absorbed, axial=axial if fresnel else None)
    return behind_glass_by_arrays(exits, rays.media, fresnel, rays.coatings)
