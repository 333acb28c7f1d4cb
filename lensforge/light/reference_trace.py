"""The reference tracer: light through bodies of any faces, event by event, in torch, in float64, on any device.

It is written to be read, and the compiled kernels are tested against it: fates, rays, flux, and gradients, which here
are torch's own. A ray in a medium meets the nearest of the faces that bound it, at most as many as its body has events;
the faces find their hits themselves (``reference_hits``). The light that each event lets pass or reflects is followed
as two complex fields. A ray that would meet another face, were a face moved, has no derivative.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from lensforge.kernels.fate import Fate
from lensforge.light.coated_glass import RayCoatings
from lensforge.light.reference_bodies import RaysInBody, ReferenceBody
from lensforge.light.reference_hits import CPU, Approach, Crossing
from lensforge.light.reference_roughness import Ahead, Meeting, ReferenceRoughness
from lensforge.optics.arrays import like
from lensforge.optics.coatings import GLASS
from lensforge.optics.dielectric import (
    Amplitudes,
    Transmittances,
    coated_transmittances,
    fields_behind,
    fresnel_transmittances,
    passing_amplitudes,
    reflecting_amplitudes,
    refract,
    transmitted_cosine_squared,
)
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.rough_faces import roughness
from lensforge.sources.ray_bundle import RayBundle

_PASSES = 8  # over the faces of a cavity, until a ray is in all of them
_ENDED = "ended"  # beside the media in which rays go on


class Hits(NamedTuple):
    """Next hits of rays: path (mm), number of the face (below 0 for none), and whether a search gave up."""

    paths_mm: Float[Tensor, " n"]
    faces: Int[Tensor, " n"]
    lost: Bool[Tensor, " n"]

    def with_nearer(self, crossing: Crossing, faces: Int[Tensor, " n"] | int) -> "Hits":
        """The hits, replaced by the crossings of other faces where these are nearer, or lost."""
        nearer = crossing.lost | (crossing.found & (crossing.paths_mm < self.paths_mm))
        paths = torch.where(nearer, crossing.paths_mm, self.paths_mm)
        return Hits(paths, torch.where(nearer, faces, self.faces), self.lost | crossing.lost)


@dataclass
class HitMemory:
    """Hits of a bundle of rays, searched once and reused when the graph is built again."""

    known: list[Hits] = field(default_factory=list)
    used: int = 0

    def recall(self, search: Callable[[], Hits]) -> Hits:
        """Hits of the next event, searched if not known yet."""
        if self.used == len(self.known):
            with torch.no_grad():
                self.known.append(search())
        self.used += 1
        return self.known[self.used - 1]


class Incidence(NamedTuple):
    """Rays at one face: unit normals along the rays, cosines of incidence, index ratios before over behind."""

    normals: Float[Tensor, "n 3"]
    cosine: Float[Tensor, " n"]
    ratio: Float[Tensor, " n"]

    def take(self, rows: Tensor) -> "Incidence":
        """Select rays by row."""
        return Incidence(*(values[rows] for values in self))


def trace_reference(
    bodies: Sequence[ReferenceBody],
    rays: RayBundle,
    fresnel: bool = True,
    device: torch.device = CPU,
    memory: HitMemory | None = None,
    first: int = 0,
) -> ExitRays:
    """Trace ``rays`` through ``bodies``, the lens first, and the cover glass behind them; tensors on ``device``.

    Differentiable in what the faces are differentiable in. Without ``fresnel`` all faces let all light through that
    they do not reflect totally, coated or not. ``memory``: of the hits of these rays, where they are traced again.
    ``first``: number of the first ray, where these are some of many: each has its own noise at rough faces.
    """
    memory = HitMemory() if memory is None else memory
    memory.used = 0
    lens, *optics = (_Passage.of(body, rays, fresnel, device, memory, first) for body in bodies)
    light = lens.through(RaysInBody.emitted(rays, device))
    exits = _exits(light, lens.absorbs)
    flux = exits.flux
    lost = []
    for optic in optics:
        came = light.left
        light = optic.through(light)
        left_w = torch.where(came, torch.where(light.left, light.flux, 0.0), flux)
        lost.append(flux - left_w)
        flux = left_w
    if lost:
        ends = _exits(light)
        exits = replace(exits, points=ends.points, directions=ends.directions, flux=flux, fates=ends.fates)
        exits = replace(exits, lost_in_bodies=torch.stack(lost))
    return lens.behind_glass(exits, light)


def as_arrays(exits: ExitRays) -> ExitRays:
    """Exit rays, tensors, as NumPy arrays."""
    tensors = {field.name: getattr(exits, field.name) for field in fields(exits)}
    return ExitRays(**{name: tensor.detach().cpu().numpy() for name, tensor in tensors.items() if tensor is not None})


def _exits(light: RaysInBody, absorbs: bool = False) -> ExitRays:
    """Exit rays; points and directions of rays that have not left are 0."""
    points, directions = (
        torch.where(light.left[:, None], vectors, 0.0) for vectors in (light.points, light.directions)
    )
    absorbed = light.absorbed if absorbs else None
    return ExitRays(
        points, directions, light.flux, light.sin2_exit, light.fates, absorbed, met=light.last[:, None].to(torch.int8)
    )


@dataclass(frozen=True)
class _Passage:
    """All rays of a bundle through one body, with its index and absorption (1/mm) at each ray's wavelength."""

    body: ReferenceBody
    indices: Float[Tensor, " n"]
    absorptions: Float[Tensor, " n"] | None
    coatings: RayCoatings
    rough: ReferenceRoughness
    fresnel: bool
    memory: HitMemory

    @staticmethod
    def of(
        body: ReferenceBody, rays: RayBundle, fresnel: bool, device: torch.device, memory: HitMemory, first: int
    ) -> "_Passage":
        medium = body.media.body
        made = body.made
        waves = rays.waves

        def there(array: np.ndarray) -> Tensor:
            return torch.tensor(array, dtype=torch.float64, device=device)

        absorptions = there(medium.absorptions(waves, len(rays))) if len(medium.absorption(waves)) else None
        if absorptions is not None and body.placement is not None:
            absorptions = absorptions * body.placement.factor_out  # paths are those in the lens as designed
        rough = roughness(body.media, body.chain.names, rays, made, first, body.scatters_before)
        models = body.media.scattering_of(body.chain.names)
        return _Passage(
            body,
            there(medium.indices(waves, len(rays))),
            absorptions,
            RayCoatings.of(rays, body.media, fresnel, body.origin),
            ReferenceRoughness.of(rough, models or (None,) * len(body.faces), there),
            fresnel,
            memory,
        )

    @property
    def absorbs(self) -> bool:
        """True where the body or its mirrors take light."""
        mirrors = (self.body.mirror(number) for number in range(len(self.body.faces)))
        return self.absorptions is not None or any(mirrors)

    def through(self, light: RaysInBody) -> RaysInBody:
        """Rays behind the body, in their order; those that had ended before are unchanged."""
        light = light._replace(times=light.numbers.new_zeros((len(light.numbers), len(self.body.faces))))
        place = self.body.placement
        ended = [light.take(~light.left)]
        going = light.take(light.left)
        entered, outside = self._entered(going if place is None else going.placed(place.into, place.factor_in))
        ended += outside
        media = {CAVITY: entered}
        for event in range(self.body.chain.events):
            onward = defaultdict[str, list[RaysInBody]](list)
            for medium, rays in media.items():
                for behind, some in self._met(rays, medium, event):
                    onward[behind].append(some)
            ended += onward.pop(_ENDED, []) + onward.pop(OUTSIDE, [])
            media = {medium: RaysInBody.joined(parts) for medium, parts in onward.items()}
        ended_rays = RaysInBody.joined(ended + [rays.ended(Fate.EVENT_LIMIT) for rays in media.values()])
        ended_rays = ended_rays.take(torch.argsort(ended_rays.numbers))
        return ended_rays if place is None else ended_rays.placed(place.back, place.factor_out)

    def _entered(self, light: RaysInBody) -> tuple[RaysInBody, list[RaysInBody]]:
        """Rays that enter the cavity, those from below z = 0 by its opening; and the others."""
        raised, _ = _raised(light)
        # in this form also where a number is NaN: such a ray is outside
        comes = ~(light.directions[:, 2] <= 0.0) | (light.points[:, 2] > 0.0)
        within = comes & self._inside(self.body.bounding(CAVITY)[: 1 if self.body.in_order else None], raised.points)
        backward = light.take(~comes)
        outside = light.take(comes & ~within)
        return raised.take(within), [backward.ended(Fate.BACKWARD), outside.ended(Fate.OUTSIDE_CAVITY)]

    @torch.no_grad()
    def _inside(self, numbers: Sequence[int], points: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        return torch.stack([self.body.faces[number].gap(points) > 0.0 for number in numbers]).all(dim=0)

    def _met(self, light: RaysInBody, medium: str, event: int) -> Iterator[tuple[str, RaysInBody]]:
        """Rays behind the next face that each meets in ``medium``: the medium beyond it, and the rays."""
        hits = self.memory.recall(lambda: self._hits(light, medium, event))
        height = (light.points[:, 2] + hits.paths_mm * light.directions[:, 2]).detach()
        met = (hits.faces >= 0) & ~hits.lost & (height >= 0.0)
        at_once = self.body.in_order & (medium == BODY) & (hits.paths_mm + light.gone_mm == 0.0)
        given_up = torch.where(at_once, int(Fate.SURFACES_INTERSECT), int(Fate.NOT_CONVERGED))
        through_opening = (light.directions[:, 2] <= 0.0) & (medium == CAVITY)
        through_plane = torch.where(through_opening, int(Fate.BACKWARD), int(Fate.BASE))
        fates = torch.where(hits.lost & ~(height < 0.0), given_up, through_plane).to(torch.int8)
        yield _ENDED, light._replace(fates=fates).take(~met)
        for number in range(len(self.body.faces)):
            rows = met & (hits.faces == number)
            if bool(rows.any()):
                yield from self._at_face(light.take(rows), hits.paths_mm[rows], medium, number, event)

    def _hits(self, light: RaysInBody, medium: str, event: int) -> Hits:
        """First crossings of the faces that bound a medium, from inside; in the body also back into the cavity."""
        infinite = torch.full_like(light.carried, torch.inf)
        hits = Hits(infinite, torch.full_like(light.last, -1), torch.zeros_like(light.left))
        rays = Approach(light.points, light.directions, torch.ones_like(infinite), hits.lost, infinite)
        for number in [event] if self.body.in_order else self.body.bounding(medium):
            nearer = rays._replace(on_face=light.last == number, limits_mm=hits.paths_mm)
            hits = hits.with_nearer(self.body.faces[number].next_crossing(nearer), number)
        back = medium == BODY and not self.body.in_order
        return self._back_into_cavity(rays, light.last, hits) if back else hits

    def _back_into_cavity(self, rays: Approach, last: Int[Tensor, " n"], hits: Hits) -> Hits:
        """Crossings where rays in the body enter the cavity again, which is the intersection of all its faces' insides.

        A ray outside of one of them is followed to where it enters that one, until it is in all: it cannot have been in
        the cavity before.
        """
        paths = torch.zeros_like(hits.paths_mm)
        faces = torch.full_like(last, -1)
        going = torch.ones_like(hits.lost)
        lost = torch.zeros_like(hits.lost)
        moved = True
        for _ in range(_PASSES):
            moved = False
            for number in self.body.bounding(CAVITY, (BODY,)):
                candidates = torch.nonzero(going & (faces != number))[:, 0]
                here = rays.take(candidates)
                way = paths[candidates]
                on_face = (last[candidates] == number) & (way == 0.0)
                points = here.at(way)
                outside = on_face | (self.body.faces[number].gap(points) < 0.0)
                here = Approach(points, here.directions, -here.sense, on_face, hits.paths_mm[candidates] - way).take(
                    outside
                )
                crossing = self.body.faces[number].next_crossing(here)
                some = candidates[outside]
                paths[some] = paths[some] + crossing.paths_mm
                faces[some] = torch.where(crossing.found, number, faces[some])
                going[some] = crossing.found
                lost[some] = crossing.lost
                moved |= len(some) > 0
        entered = going & (faces >= 0)
        return hits.with_nearer(Crossing(paths, entered, lost | (going & moved)), faces)

    def _at_face(
        self, light: RaysInBody, paths_mm: Float[Tensor, " n"], medium: str, number: int, event: int
    ) -> Iterator[tuple[str, RaysInBody]]:
        face = self.body.faces[number]
        mirror = self.body.mirror(number)
        before = self.body.chain.before[number]
        if mirror == 0.0:
            yield _ENDED, light._replace(sin2_exit=torch.zeros_like(paths_mm)).ended(Fate.FLANGE)
            return
        sense, behind = (1.0, self.body.chain.behind[number]) if before == medium else (-1.0, before)
        path, points = face.hit(light.points, light.directions, paths_mm, sense)
        light = self._dimmed(light, path, medium)
        met = Meeting(number, light.times[:, number], light.numbers)
        times = light.times.clone()
        times[:, number] += 1
        along = sense * face.normal(points)
        normals = sense * self.rough.facets(sense * along, light.directions, met)
        cosine = (light.directions * normals).sum(dim=1)
        ratio = self._ratio(light.numbers, medium, behind)
        squared = transmitted_cosine_squared(cosine, ratio)
        is_exit = number + 1 == len(self.body.faces)
        bends = behind == OUTSIDE and mirror is None
        sin2_exit = (1.0 - squared if is_exit else 1.0 + squared) if bends else 0.0 * squared
        light = light._replace(
            points=points,
            sin2_exit=sin2_exit,
            last=torch.full_like(light.last, number),
            gone_mm=0.0 * paths_mm,
            times=times,
        )
        yield _ENDED, light.take(~(cosine > 0.0)).ended(Fate.TOTAL_REFLECTION)  # tangents
        reflected = (squared <= 0.0) | (mirror is not None)
        at = Incidence(normals, cosine, ratio)
        past = ~reflected & (cosine > 0.0) & self._is_past_end(points, behind)
        yield _ENDED, light.take(past)._replace(sin2_exit=torch.zeros_like(path[past])).ended(Fate.FLANGE)
        for mirrored in (False, True):
            rows = (cosine > 0.0) & (reflected == mirrored) & ~past
            if bool(rows.any()):
                here = at.take(rows)
                some = self._turned(light.take(rows), here, number, mirrored)
                if not mirrored or mirror is not None:
                    ahead = Ahead(here.cosine, sense * here.normals, -here.normals if mirrored else here.normals)
                    to, turned = self.rough.spread(some.directions, some.fields, ahead, met.take(rows))
                    some = some._replace(directions=to, fields=turned)
                goes_on = event + 1 < self.body.chain.events and (mirrored or behind != OUTSIDE)
                if goes_on and self.rough.facet is not None and not self.body.in_order:
                    away = ((some.directions * along[rows]).sum(dim=1) > 0.0) == mirrored  # through its own face
                    yield _ENDED, some.take(away).ended(Fate.EVENT_LIMIT)
                    some = some.take(~away)
                yield from self._onward(some, medium if mirrored else behind, mirrored and mirror is None, event)

    def _is_past_end(self, points: Float[Tensor, "n 3"], behind: str) -> Bool[Tensor, " n"]:
        half_mm = self.body.half_mm
        if behind != OUTSIDE or half_mm is None:
            return torch.zeros(len(points), dtype=torch.bool, device=points.device)
        return points[:, 1].abs() > half_mm

    def _dimmed(self, light: RaysInBody, path_mm: Float[Tensor, " n"], medium: str) -> RaysInBody:
        if medium != BODY or self.absorptions is None:
            return light
        through = torch.exp(-self.absorptions[light.numbers] * (light.gone_mm + path_mm))
        absorbed = light.absorbed + (1.0 - through) * light.flux
        return light._replace(carried=through * light.carried, absorbed=absorbed)

    def _ratio(self, numbers: Int[Tensor, " n"], before: str, behind: str) -> Float[Tensor, " n"]:
        body_index = self.indices[numbers]
        media = self.body.media
        index_before, index_behind = (
            body_index if medium == BODY else media.around(medium) + 0.0 * body_index for medium in (before, behind)
        )
        return index_before / index_behind

    def _turned(self, light: RaysInBody, at: Incidence, number: int, mirrored: bool) -> RaysInBody:
        """Rays transmitted, or reflected, by one face."""
        mirror = self.body.mirror(number)
        before = light.directions
        if mirror is not None:
            light = light._replace(absorbed=light.absorbed + (1.0 - mirror) * light.flux)
        reflected = before - 2.0 * at.cosine[:, None] * at.normals
        behind = reflected if mirrored else refract(before, at.normals, at.ratio)
        amplitudes = self._amplitudes(light.numbers, at, number, mirrored)
        turned = fields_behind(light.fields, before, behind, at.normals, amplitudes, mirrored)
        return light._replace(directions=behind, fields=turned)

    def _amplitudes(self, numbers: Int[Tensor, " n"], at: Incidence, number: int, mirrored: bool) -> Amplitudes:
        """Amplitudes behind a face; a mirror has one for both polarisations."""
        mirror = self.body.mirror(number)
        equal = 0.0 * at.cosine
        if mirror is not None:
            return equal + mirror**0.5, equal
        if mirrored:
            return reflecting_amplitudes(at.cosine, at.ratio)
        if not self.fresnel:
            return equal + 1.0, equal
        return passing_amplitudes(self._transmittances(self.body.chain.names[number], at, numbers), at.ratio)

    def _transmittances(self, face: str, at: Incidence, numbers: Int[Tensor, " n"]) -> Transmittances:
        table = self.coatings.faces.get(face)
        rows = self.coatings.rows
        if table is None:
            return fresnel_transmittances(at.cosine, at.ratio)
        places = like(at.cosine, rows)
        places = places if len(rows) == 1 else places[numbers]
        return coated_transmittances(at.cosine, at.ratio, like(at.cosine, table), places)

    def _onward(
        self, light: RaysInBody, medium: str, reflected_totally: bool, event: int
    ) -> Iterator[tuple[str, RaysInBody]]:
        """Rays on their way to the next face, in its frame if faces are met in order."""
        last = event + 1 == self.body.chain.events
        place = self.body.placement
        if reflected_totally and (last or self.body.in_order):
            yield _ENDED, light.ended(Fate.TOTAL_REFLECTION)
        elif last or place is None or not self.body.in_order:
            yield medium, light
        else:
            light = light.placed(place.between[event])
            raised, path = _raised(light)
            # at the rim, below the plane in which a lowered or tilted face ends: into the body through it, or the base
            risen = (light.directions[:, 2] > 0.0) & self._inside([event + 1], raised.points)
            within = (light.points[:, 2] >= 0.0) | risen
            yield _ENDED, light.take(~within).ended(Fate.BASE)
            yield medium, raised._replace(gone_mm=path).take(within)

    def behind_glass(self, exits: ExitRays, light: RaysInBody) -> ExitRays:
        """``exits`` with fields ``light`` behind the cover glass; see ``light.coated_glass``."""
        glass = self.body.media.cover_glass
        media = self.body.media
        if glass is None:
            return exits
        meets = (exits.directions[:, 2] > 0.0) & exits.left_lens
        outside = torch.where(meets, exits.directions[:, 2], 1.0)
        ratio = media.outside_index / glass.refractive_index
        inside = torch.sqrt(transmitted_cosine_squared(outside, ratio))
        nearer = torch.where(meets, glass.thickness_mm * (1.0 - ratio * outside / inside), 0.0)
        passed = exits.flux * torch.exp(-glass.absorption_per_mm * glass.thickness_mm / inside)
        if self.fresnel:
            at = Incidence(exits.directions, outside, ratio + 0.0 * outside)
            t_s, t_p, excess = self._transmittances(GLASS, at, light.numbers)
            axial = torch.where(exits.left_lens, light.axial_flux, 0.0)
            in_plane = axial / torch.where(exits.flux > 0.0, exits.flux, 1.0)
            passed = passed * (t_s**2 + (t_s + t_p) * excess * in_plane)
            exits = replace(exits, axial=axial)
        flux = torch.where(meets, passed, exits.flux)
        points = exits.points + nearer[:, None] * like(exits.points, np.array([0.0, 0.0, 1.0]))
        return replace(exits, points=points, flux=flux, lost_in_glass=exits.flux - flux)


def _raised(light: RaysInBody) -> tuple[RaysInBody, Float[Tensor, " n"]]:
    """Rays from below z = 0 advanced to that plane, and the path (mm) there; 0 for the others."""
    height = light.points[:, 2]
    rise = light.directions[:, 2]
    rising = ~(rise <= 0.0)
    path = torch.where((height < 0.0) & rising, -height / torch.where(rising, rise, 1.0), 0.0)
    x, y, _ = (light.points + path[:, None] * light.directions).unbind(dim=1)
    return light._replace(points=torch.stack([x, y, torch.where(height < 0.0, 0.0, height)], dim=1)), path
