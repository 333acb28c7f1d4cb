"""Light of one gradient step: from the faces' tables and fresh rays, through the lens, to sums over each receiver.

A robust search traces parts in place of the lens as designed: pairs with opposite deviations, new in each step, by the
same rays. Half of the difference of their images, which is the spread of the parts to first order, then has hardly any
ray noise.

On the CPU the compiled kernels trace and sum, and the whole path is one torch operation: the backward pass recomputes
each exit ray from its path lengths. On another device torch does all, in chunks of rays whose graph is built again in
the backward pass: only the hits of each ray are kept, 17 bytes at each event.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from lensforge import seeds
from lensforge.light.crease import adjoint_on, crease_gradients
from lensforge.light.later_creases import later_crease_gradients
from lensforge.light.reference_bodies import ReferenceBody
from lensforge.light.reference_trace import HitMemory, trace_reference
from lensforge.light.table_trace import Scene, TracedBundle, face_bounds, trace_tables
from lensforge.scene.exit_rays import Sensitivities
from lensforge.scene.eye_view import EyeView
from lensforge.scene.lamp_pictures import LampPictures
from lensforge.scene.light_ends import LOSSES, cause_numbers
from lensforge.scene.made_part import ErrorField, FaceNodes, MadePart, PartMaker, waviness
from lensforge.scene.perturbations import Draws
from lensforge.scene.receiver import Landings, PosedReceiver
from lensforge.scene.rough_faces import wall_numbers
from lensforge.search.collected_light import Collected, collected, collected_on_device, mean_of_lamps
from lensforge.search.image_terms import SourceColour
from lensforge.search.parameters import Parametrisation
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.tolerances_section import Factor, factors_of
from lensforge.surfaces.bicubic_table import TableGrid

_RAYS_OF_OUTLINE = 2**12  # the hull of so many places lacks some hundredths of its area
# Noise of 2 % in the part of later creases.
_FANS = 128
_RAYS_OF_FAN = 32
# Light of a receiver that creases change, the picture first; names of :class:`Collected`.
_OF_CREASES = "image", "in_window", "outside_receiver", "total_reflection"


class _AtCreases(torch.autograd.Function):
    """The sums as they are; their gradient across creases, by the ``flux`` of the rays over the source's."""

    @staticmethod
    def forward(
        ctx: Any,
        tables: Tensor,
        scene: Scene,
        source: Source,
        receivers: tuple[PosedReceiver, ...],
        flux: float,
        *sums: Tensor,
    ) -> Any:
        ctx.tables = tables.detach().numpy()
        ctx.scene = scene
        ctx.source = source
        ctx.receivers = receivers
        ctx.flux = flux
        return tuple(sum.clone() for sum in sums)

    @staticmethod
    def backward(ctx: Any, *by: Tensor) -> Any:
        seen = [
            dict(zip(_OF_CREASES, by[first : first + len(_OF_CREASES)], strict=True))
            for first in range(0, len(by), len(_OF_CREASES))
        ]
        images = [gradients["image"].contiguous().numpy() for gradients in seen]
        sums = [np.array([float(gradients[name]) for name in _OF_CREASES[1:]]) for gradients in seen]
        places = ctx.tables, ctx.scene, ctx.source, adjoint_on(ctx.receivers, images, sums)
        bounds = face_bounds(ctx.tables, ctx.scene)
        by_creases = crease_gradients(*places, bounds=bounds)
        by_creases += later_crease_gradients(*places, _FANS, _RAYS_OF_FAN, bounds=bounds)
        return ctx.flux * torch.from_numpy(by_creases), None, None, None, None, *by


class EndedRays(NamedTuple):
    """Rays as they end: squared sine of the exit angle and flux (W), as of exit rays, and the number of the cause."""

    sin2_exit: Float[Tensor, " n"]
    flux: Float[Tensor, " n"]
    causes: Int[Tensor, " n"]


_CHUNK = 2**19  # rays; their graph takes 2.5 GiB


@dataclass(frozen=True)
class LightPath:
    """Path of the light through the lens and to the receivers, each of which sees every exit ray.

    ``source``: where faces meet in creases, for the light that crosses these; None if there is no such light, or
    where the source cannot say how much it is. ``colour``: of the source, from which the colours of its rays are
    collected; None if they do not count. ``losses``: causes whose flux counts; 0: none. The gradient of both is
    without the light that crosses creases.
    """

    scene: Scene
    receivers: tuple[PosedReceiver, ...]
    device: torch.device | None = None
    chunk: int = _CHUNK
    source: Source | None = None
    colour: SourceColour | None = None
    losses: int = 0

    @cached_property
    def lamps(self) -> tuple[LampPictures, ...]:
        """The pictures of one lamp that make the light on each receiver."""
        return tuple(map(LampPictures.of, self.receivers))

    @cached_property
    def seen(self) -> tuple[PosedReceiver, ...]:
        """The receivers of one lamp's light: of all pictures."""
        return tuple(receiver for lamp in self.lamps for receiver in lamp.receivers)

    def through(self, tables: Float[Tensor, "f side side"], rays: RayBundle, part: MadePart) -> tuple[Collected, ...]:
        """Light through one part of the lens with these tables; its source has a flux of its own."""
        scene = replace(self.scene, media=part.media(self.scene.media), made=part.made)
        part_rays = replace(rays, flux=part.flux * rays.flux)
        return replace(self, scene=scene).collect(part.tables(tables), part_rays)

    def collect(self, tables: Float[Tensor, "f side side"], rays: RayBundle) -> tuple[Collected, ...]:
        """Trace ``rays`` through tables on the CPU and collect the mean light of a lamp; differentiable in the tables.

        The same rays give the same bits on the same device; on another one they agree to rounding.
        """
        if self.device is None:
            landed, exits = landed_through(tables, self.scene, rays, self.seen)
            emitted = torch.from_numpy(rays.flux)
            weights = None if self.colour is None else torch.from_numpy(self.colour.weights(rays))
            light = tuple(
                self._with_losses(
                    collected(landings, exits.sin2_exit, emitted, receiver.grid, receiver.window, weights),
                    exits,
                    landings,
                )
                for receiver, landings in zip(self.seen, landed, strict=True)
            )
        else:
            bodies = ReferenceBody.by_tables(tables, self.scene, self.device)
            parts = [self._part(bodies, rays, start, self.device) for start in range(0, len(rays), self.chunk)]
            sums = [torch.stack(amountsreceiver).sum(dim=0).cpu() for amountsreceiver in zip(*parts, strict=True)]
            per_receiver = len(sums) // len(self.seen)
            counted = {"colours": self.colour is not None, "losses": self.losses > 0}
            names = [field.name for field in fields(Collected) if counted.get(field.name, True)]
            light = tuple(
                Collected(**dict(zip(names, sums[first : first + per_receiver], strict=True)))
                for first in range(0, len(sums), per_receiver)
            )
        return self._together(light if self.source is None else self._with_creases(tables, rays, light))

    def over_outlines(
        self, images: Sequence[Tensor], tables: Float[Tensor, "f side side"], rays: RayBundle
    ) -> list[Tensor]:
        """Pictures of eyes whose mean counts, over the area (mm²) of the outline of the lens, a constant; others as
        they are."""
        areas = [1.0] * len(images)
        if any(isinstance(receiver, EyeView) and receiver.of_mean for receiver in self.receivers):
            exits = trace_tables(tables.detach().numpy(), self.scene, rays.take(slice(_RAYS_OF_OUTLINE)))
            for number, seen_receiver in enumerate(self.receivers):
                if isinstance(seen_receiver, EyeView) and seen_receiver.of_mean:
                    areas[number] = seen_receiver.outline_mm2(exits)
        return [image / area for image, area in zip(images, areas, strict=True)]

    def _with_losses(self, light: Collected, exits: EndedRays, landings: Landings) -> Collected:
        if not self.losses:
            return light
        left = (exits.causes == LOSSES.index("beside")) | (exits.causes >= len(LOSSES))
        blocked = ((exits.flux - landings.flux) * (left & ~landings.missed_receiver)).sum()
        return light.with_losses(exits.flux, exits.causes, self.losses, blocked)

    def _together(self, collected: tuple[Collected, ...]) -> tuple[Collected, ...]:
        rest = iter(collected)
        return tuple(mean_of_lamps(lamps, [next(rest) for _ in lamps.rasters]) for lamps in self.lamps)

    def _with_creases(self, tables: Tensor, rays: RayBundle, collected: tuple[Collected, ...]) -> tuple[Collected, ...]:
        assert self.source is not None
        sums = [getattr(light, name) for light in collected for name in _OF_CREASES]
        places = self.scene, self.source, self.seen, float(rays.flux.sum()) / self.source.flux_w
        same = _AtCreases.apply(tables, *places, *sums)  # type: ignore[no-untyped-call]  # as torch has it
        rest = iter(same)
        return tuple(replace(light, **{name: next(rest) for name in _OF_CREASES}) for light in collected)

    def _part(
        self, bodies: tuple[ReferenceBody, ...], bundle: RayBundle, start: int, device: torch.device
    ) -> tuple[Tensor, ...]:
        rays = bundle.take(slice(start, start + self.chunk))

        def on_device(array: np.ndarray) -> Tensor:
            return torch.as_tensor(array).to(device, torch.float64)

        emitted = on_device(rays.flux)
        memory = HitMemory()
        weights = None if self.colour is None else on_device(self.colour.weights(rays))

        def light() -> tuple[Tensor, ...]:
            exit_rays = trace_reference(bodies, rays, self.scene.fresnel, device, memory, start)
            exit_rays = replace(exit_rays, draws=wall_numbers(rays, self.scene.media))
            sums: list[Tensor] = []
            for receiver in self.seen:
                landings = receiver.land_by_arrays(exit_rays)
                places = (receiver.grid, receiver.window)
                collected = collected_on_device(landings, exit_rays.sin2_exit, emitted, *places, weights)
                ended = EndedRays(exit_rays.sin2_exit, exit_rays.flux, cause_numbers(exit_rays, self.scene.chain))
                counted = self._with_losses(collected, ended, landings)
                sums += (total for total in vars(counted).values() if total is not None)
            return tuple(sums)

        return checkpoint(light, use_reentrant=False, preserve_rng_state=False)


def landed_through(
    tables: Float[Tensor, "f side side"], scene: Scene, rays: RayBundle, receivers: tuple[PosedReceiver, ...]
) -> tuple[list[Landings], EndedRays]:
    """Landings of ``rays`` on each receiver, and how they end; differentiable in the tables, float64, CPU.

    Raises :class:`InputError` when a surface has a radius that is not positive.
    """
    sin2_exit, flux, causes, *landed = _Landing.apply(  # type: ignore[no-untyped-call]  # as torch has it
        tables, scene, rays, receivers
    )
    landings = [Landings(*landed[first : first + 4]) for first in range(0, len(landed), 4)]
    return landings, EndedRays(sin2_exit, flux, causes)


class _Landing(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, tables: Tensor, scene: Scene, rays: RayBundle, receivers: tuple[PosedReceiver, ...]) -> Any:
        traced = TracedBundle.of(tables.detach().numpy(), scene, rays)
        landed = [receiver.land(traced.exits) for receiver in receivers]
        ctx.traced = traced
        ctx.receivers = receivers
        ctx.landed = landed
        parts = [
            torch.from_numpy(field)
            for landings in landed
            for field in (landings.hits, landings.flux, landings.landed, landings.missed_receiver)
        ]
        flux = torch.from_numpy(traced.exits.flux)
        causes = torch.from_numpy(cause_numbers(traced.exits, scene.chain))
        ctx.mark_non_differentiable(causes, *(field for field in parts if field.dtype == torch.bool))
        return torch.from_numpy(traced.exits.sin2_exit), flux, causes, *parts

    @staticmethod
    def backward(ctx: Any, by_sin2: Tensor, by_exit_flux: Tensor, _by_causes: Tensor, *by_fields: Tensor) -> Any:
        exits = ctx.traced.exits
        total_flux = by_exit_flux.numpy()
        total: Sensitivities | None = None
        for k, (receiver, landings) in enumerate(zip(ctx.receivers, ctx.landed, strict=True)):
            by_hits, by_flux = by_fields[4 * k : 4 * k + 2]
            missed = landings.missed_receiver & ~landings.landed
            if missed.any():  # their hit and flux are constants; those of rays lost in the lens never count
                missed_rays = torch.from_numpy(missed)
                by_hits = by_hits.masked_fill(missed_rays[:, None], 0.0)
                by_flux = by_flux.masked_fill(missed_rays, 0.0)
            by, of_flux = receiver.adjoint(exits, by_hits.contiguous().numpy(), by_flux.contiguous().numpy(), landings)
            total = by if total is None else Sensitivities(*(a + b for a, b in zip(total, by, strict=True)))
            total_flux = total_flux + of_flux
        by_tables = ctx.traced.gradients(total, total_flux, by_sin2.contiguous().numpy())
        return torch.from_numpy(by_tables), None, None, None


Pair = tuple[MadePart, MadePart]
Pairs = tuple[Pair, ...]  # none: the lens as designed

_BLOCK = 2**10  # pairs of one Sobol sequence: consecutive steps share one, so that their parts complement each other
_OF_SHARE = 4  # pairs of a step that seeks a share of the parts: the spread of a reading is then known to a third
_NO_DETAIL = TableGrid(4)  # so coarse that it resolves no waviness


@dataclass(eq=False)
class SearchParts:
    """Pairs of parts for the lenses of one search that have tables on one grid.

    ``pairs``: of a step. Form errors are those of the surfaces from which the search starts, as they depend on it by
    the cosine between radius and normal alone. All waviness counts as roughness, by its slope: as tables it would take
    seconds to prepare, and it spreads the light of a part by far less than the shifts do.
    """

    maker: PartMaker
    factors: tuple[Factor, ...]
    pairs: int = 1
    _drawn: dict[int, tuple[Draws, Draws]] = field(default_factory=dict)

    @staticmethod
    def of(spec: Spec, parametrisation: Parametrisation) -> "SearchParts":
        """Prepare the parts. Raises :class:`InputError` where all tolerances are 0."""
        factors = factors_of(spec.part_tolerances)
        section = spec.tolerances
        surfaces = parametrisation.start_surfaces
        smooth = tuple(factor for factor in factors if "waviness" not in factor.name)
        maker = PartMaker.of(spec, surfaces, parametrisation.grid, smooth)
        errors = dict(maker.errors)
        side = parametrisation.grid.side
        names = {factor.name for factor in factors}
        band = (section.waviness_shortest_mm, section.waviness_longest_mm)
        for face, surface in surfaces.items():
            if (name := f"{face}_waviness_um") in names:
                slope = waviness(FaceNodes.of(_NO_DETAIL, surface), *band, 0).slope
                errors[name] = ErrorField(np.zeros((0, side, side)), slope)
        return SearchParts(replace(maker, errors=errors), factors, 1 if spec.optimise.share is None else _OF_SHARE)

    def of_step(self, seed: int, step: int) -> Pairs:
        """The pairs of one gradient step, counted over all levels of a search."""
        return tuple(self._of_row(seed, self.pairs * step + number) for number in range(self.pairs))

    def _of_row(self, seed: int, number: int) -> Pair:
        """A pair of the endless row of a search."""
        block, number = divmod(number, _BLOCK)
        own_seed = seeds.of_parts_of_steps(seed, block)
        if own_seed not in self._drawn:
            draws = Draws.seeded(self.factors, _BLOCK, own_seed)
            self._drawn = {own_seed: (draws, draws.mirrored())}
        return self._made(self._drawn[own_seed], number)

    def of_validation(self, seed: int, count: int) -> Pairs:
        """The ``count`` pairs by which a search with ``seed`` judges its progress."""
        draws = Draws.seeded(self.factors, count, seeds.of_validation_parts(seed))
        return tuple(self._made((draws, draws.mirrored()), number) for number in range(count))

    def _made(self, draws: tuple[Draws, Draws], number: int) -> Pair:
        first, second = (self.maker.part(draw.deviations(number)) for draw in draws)
        return first, second
