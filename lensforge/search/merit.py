"""Merit function of a search: from parameters and rays to the loss that a search minimises, and its parts.

Its terms are of the light on each receiver, and of the limits on it. All are differentiable on torch images
[row y, column x]. A limit's term is one-sided, 0 where the picture keeps the limit with a margin.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import mean
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.light.judged_limits import limit_value
from lensforge.light.table_trace import Scene
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.scene.housing_room import exit_radius_mm
from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.limit_views import searched_views
from lensforge.scene.made_part import at_work
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.collected_light import Collected
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.image_terms import Colours, ColourTerm, ImageTerms, SourceColour, nmse_loss
from lensforge.search.kinds import LightOfKinds
from lensforge.search.light_path import LightPath, Pairs
from lensforge.search.limit_terms import Image, Images, JoinedTerms, LimitTerm, Losses, limit_terms, smoothed
from lensforge.search.parameters import Parametrisation
from lensforge.search.share_of_parts import share_term
from lensforge.sources.joined_spectrum import efficacy_of
from lensforge.sources.ray_bundle import RayBundle, Source, aims
from lensforge.spec import Spec
from lensforge.spec.lamps_section import EndlessLamps

_TOTAL_REFLECTION = 0.3  # factor of the flux near total reflection in the loss
_UNIFORM_TOTAL_REFLECTION = 0.1  # the same in scenes with a region of uniform light


@dataclass(frozen=True)
class StepLoss:
    """Loss of a gradient step, constraints included, and its parts for the history.

    ``nmse``, ``efficiency``: of several receivers the mean by their shares. ``images``: on each, as its light was.
    """

    loss: Float[Tensor, ""]
    nmse: float
    efficiency: float
    fields: Float[Tensor, "c k"]
    images: Images


class PairLight(NamedTuple):
    """Half of the difference of two opposite parts by the same rays: of images, and of losses where these count."""

    images: Images
    losses: Losses

    def times(self, factor: float) -> "PairLight":
        """The pair with ``factor`` times the light."""
        return PairLight(*(tuple(factor * tensor for tensor in tensors) for tensors in self))

    def mean(self, other: "PairLight") -> "PairLight":
        """The mean with the same pair by other rays."""
        return PairLight(*(_added(first, second) for first, second in zip(self, other, strict=True))).times(0.5)


def _added(first: tuple[Tensor, ...], second: tuple[Tensor, ...], factor: float = 1.0) -> tuple[Tensor, ...]:
    return tuple(base + factor * added for base, added in zip(first, second, strict=True))


@dataclass(frozen=True)
class SampledLight:
    """Light of a sample of rays: flux (W) on each receiver's pixels, the terms of the flux (W), and that emitted.

    Behind the images of receivers stand those of the eyes of limits.

    ``pairs``: in a robust search, of opposite parts; ``images``, ``losses`` and ``colours`` are then the mean over all
    parts. Losses and colours are there where they count.
    """

    images: Images
    terms: Float[Tensor, ""]
    emitted_w: float
    pairs: tuple[PairLight, ...] = ()
    colours: Colours = ()
    losses: Losses = ()

    def of_parts(self) -> list[tuple[Images, Losses]]:
        """The images and losses of every part: of the lens as designed alone, unless the search is robust."""
        if not self.pairs:
            return [(self.images, self.losses)]
        return [
            (_added(self.images, pair.images, sign), _added(self.losses, pair.losses, sign))
            for pair in self.pairs
            for sign in (1.0, -1.0)
        ]

    @staticmethod
    def joined(parts: "Sequence[SampledLight]", emitted_w: float) -> "SampledLight":
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""
        share = emitted_w / sum(part.emitted_w for part in parts)
        images = tuple(share * torch.stack(same).sum(dim=0) for same in zip(*(p.images for p in parts), strict=True))
        pairs = [pair.times(emitted_w / part.emitted_w) for part in parts for pair in part.pairs]
        terms = share * torch.stack([part.terms for part in parts]).sum()
        colours = [share * torch.stack(same).sum(dim=0) for same in zip(*(p.colours for p in parts), strict=True)]
        losses = [share * torch.stack(same).sum(dim=0) for same in zip(*(p.losses for p in parts), strict=True)]
        return SampledLight(images, terms, emitted_w, tuple(pairs), colours, tuple(losses))

    @staticmethod
    def mean(first: "SampledLight", second: "SampledLight") -> "SampledLight":
        """The mean of two samples of the same flux, of the same parts."""
        both = SampledLight.joined((first, second), first.emitted_w)
        pairs = [first.mean(second) for first, second in zip(first.pairs, second.pairs, strict=True)]
        return replace(both, pairs=tuple(pairs))


@dataclass(frozen=True)
class SampleLoss:
    """Loss of one sample of rays, without constraints, its parts for the history, and the images."""

    loss: Float[Tensor, ""]
    nmse: float
    efficiency: float
    images: Images


class MeritParts(NamedTuple):
    """The merit without constraints; its part of the images, with their limits; and the part of the limits alone."""

    all: float
    image: float
    limits: float


def _read_by(limit: LightLimit, light: SampledLight) -> Tensor:
    """The flux that ``limit`` reads of a sample: a picture, or losses by cause."""
    if limit.quantity.of_losses:
        return light.losses[limit.receiver]
    picture = light.images[limit.receiver]
    return picture if limit.quantity.of_view else smoothed(picture)


_Light = TypeVar("_Light")


class Merit(ABC, Generic[_Light]):
    """The merit that a search minimises, but for the constraints: of one LED, or of several."""

    parametrisation: Parametrisation

    @abstractmethod
    def light_of(self, tables: Float[Tensor, "f side side"], rays: RayBundle, pairs: Pairs = ()) -> _Light:
        """The light of ``rays`` through the lens with these tables, or through ``pairs`` of its parts."""

    @abstractmethod
    def training_loss(self, light: _Light, uniform: bool, limit_weight: float = 1.0) -> SampleLoss:
        """Loss by one sample, biased by its noise; ``uniform`` puts the uniformity of the masks before the images.

        ``limit_weight``: of the limits on the light.
        """

    @abstractmethod
    def unbiased_merit(self, first: _Light, second: _Light, uniform: bool) -> MeritParts:
        """Merit without constraints from two independent samples, without their noise."""

    @abstractmethod
    def limits_missed(self, samples: Sequence[_Light]) -> int:
        """Number of limits that independent ``samples`` of the light, each of the whole flux, do not keep."""

    @abstractmethod
    def joined(self, parts: Sequence[_Light], emitted_w: float) -> _Light:
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""

    def step_loss(
        self,
        weights: Float[Tensor, "k f"],
        offsets: Float[Tensor, " f"],
        rays: RayBundle,
        constraints: AugmentedLagrangian,
        uniform: bool,
        pairs: Pairs = (),
        limit_weight: float = 1.0,
    ) -> StepLoss:
        """Trace ``rays`` and add the constraints; with ``pairs`` of opposite parts by all of these."""
        tables = self.parametrisation.tables(weights, offsets)
        light = self.training_loss(self.light_of(tables, rays, pairs), uniform, limit_weight)
        fields = constraints.fields(tables)
        return StepLoss(light.loss + constraints.term(fields), light.nmse, light.efficiency, fields, light.images)


@dataclass(frozen=True)
class MeritFunction(Merit[SampledLight]):
    """The scene of a design with one LED: its light path, and the terms of each receiver.

    ``share``: of the parts that are to hold the limits; None if each part is to hold them by their own margins.
    """

    spec: Spec
    parametrisation: Parametrisation
    light: LightPath | LightOfKinds
    terms: tuple[ImageTerms, ...]
    limits: tuple[LimitTerm | JoinedTerms, ...] = ()
    colour: ColourTerm | None = None
    share: float | None = None

    @staticmethod
    def of(
        spec: Spec,
        source: Source,
        parametrisation: Parametrisation,
        device: torch.device | None = None,
        single: bool = False,
    ) -> "MeritFunction":
        """Merit function whose targets carry the flux of the theoretical limit, so that the NMSE includes efficiency.

        Rays are traced on ``device``, or by the compiled kernels for None; all else stays on the CPU. ``single``: the
        kernels trace a double-freeform lens in single precision.
        """
        receivers = tuple(
            receiver.searched(spec.optimise.rim_deg, exit_radius_mm(spec))
            for receiver in receivers_of(spec, spec.optimise.pixels)
        )
        sections = spec.all_receivers
        fresnel = spec.optimise.fresnel
        limit = (transmittance_of(spec.media) if fresnel else 1.0) * source.flux_w
        total = sum(section.share for section in sections)
        terms = tuple(
            ImageTerms.of(
                section.targets,
                receiver,
                limit,
                spec.lens.basis.symmetry,
                section.share / total,
                light_alone=spec.optimise.counts_light_alone,
            )
            for section, receiver in zip(sections, receivers, strict=True)
        )
        single = single and not isinstance(spec.lamps, EndlessLamps)  # whose light comes from any distance
        scene = Scene.of_lens(spec.lens, spec.media, parametrisation.grid, fresnel=fresnel, single=single)
        scene = replace(scene, made=at_work(spec, scene.names))
        efficacy = efficacy_of(source, spec.source, photons=spec.counts_photons)
        views = searched_views(spec)
        asked = light_limits(spec, receivers, efficacy, source.flux_w, views)
        crossing = source if scene.chain is not None and aims(source) else None
        losses = max((limit.readings.shape[1] for limit in asked if limit.quantity.of_losses), default=0)
        places = (*receivers, *views)
        term = None
        colour = spec.colour
        light = LightPath(scene, places, device, source=crossing, losses=losses)
        if colour is not None and colour.weight > 0.0:
            light = replace(light, colour=SourceColour.of(source))
            wanted, shares = zip(*((term.wanted, term.share) for term in terms), strict=True)
            term = ColourTerm(colour.weight, wanted, shares)
        path = LightOfKinds.of(light, spec.all_lamps) if spec.all_lamps.kinds else light
        share = spec.optimise.share
        limits = limit_terms(asked, by_parts=share is not None)
        return MeritFunction(spec, parametrisation, path, terms, limits, term, share)

    def training_loss(self, light: SampledLight, uniform: bool, limit_weight: float = 1.0) -> SampleLoss:
        """Loss by one sample, biased by its noise; ``uniform`` puts the uniformity of the masks before the images.

        ``limit_weight``: of the limits on the light.
        """
        efficiency = self._weighted(light.images, lambda terms, image: float(image.detach().sum())) / light.emitted_w
        parts = light.of_parts()
        nmse = mean(
            self._weighted(images, lambda terms, image: nmse_loss(image.detach(), terms.wanted).item())
            for images, _ in parts
        )
        loss = torch.stack([self._image_loss(images, uniform) for images, _ in parts]).mean()
        loss = loss + light.terms / light.emitted_w + limit_weight * self._limit_term(light)
        if self.colour is not None:
            loss = loss + self.colour.error(light.colours, light.colours)
        return SampleLoss(loss, nmse, efficiency, tuple(image.detach() for image in light.images))

    def joined(self, parts: Sequence[SampledLight], emitted_w: float) -> SampledLight:
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""
        return SampledLight.joined(parts, emitted_w)

    def light_of(self, tables: Float[Tensor, "f side side"], rays: RayBundle, pairs: Pairs = ()) -> SampledLight:
        """The light of ``rays`` through the lens with these tables, or through ``pairs`` of its parts.

        Both parts of a pair are traced with the same rays, of several pairs each with its share of them: fewer in their
        difference from the lens as designed save time, but where the change moves rays to other pixels the gradient's
        noise is that of few rays.
        """
        emitted_w = float(rays.flux.sum())
        if len(pairs) > 1:
            slices = zip(rays.divided(len(pairs)), pairs, strict=True)
            return SampledLight.joined([self.light_of(tables, sample, (pair,)) for sample, pair in slices], emitted_w)
        if not pairs:
            light = self.light.collect(tables, rays)
            images = self._mirrored(self.light.over_outlines([collected.image for collected in light], tables, rays))
            colours = self._colours((light,))
            losses = _losses((light,))
            return SampledLight(images, self._flux_term(light), emitted_w, (), colours, losses)
        assert isinstance(self.light, LightPath), "a robust search has one lens"
        made = [part.in_state(self.spec) for part in pairs[0]]
        light_of_part, light_of_opposite = (self.light.through(tables, rays, part) for part in made)
        lit = (
            self.light.over_outlines([collected.image for collected in light], tables, rays)
            for light in (light_of_part, light_of_opposite)
        )
        both = list(zip(*lit, strict=True))
        # only the mean over all parts has the symmetry of the scene: each part alone has none
        images = self._mirrored([0.5 * (a + b) for a, b in both])
        losses = _losses((light_of_part, light_of_opposite))
        apart = _added(_losses((light_of_part,)), _losses((light_of_opposite,)), -1.0)
        halves = tuple(0.5 * (a - b) for a, b in both), tuple(0.5 * loss for loss in apart)
        pair_light = PairLight(*halves)
        flux = 0.5 * (self._flux_term(light_of_part) + self._flux_term(light_of_opposite))
        return SampledLight(
            images, flux, emitted_w, (pair_light,), self._colours((light_of_part, light_of_opposite)), losses
        )

    def unbiased_merit(self, first: SampledLight, second: SampledLight, uniform: bool) -> MeritParts:
        """Merit without constraints from two independent samples, without their noise.

        Of a robust search the error of the mean image: gains are relative to it, and no lens lowers the spread of its
        parts by much.
        """
        both = SampledLight.mean(first, second)
        parts = zip(first.of_parts(), second.of_parts(), strict=True)
        error = torch.stack(
            [self._unbiased_image_error(images, second_images, uniform) for (images, _), (second_images, _) in parts]
        ).mean()
        of_limits = self._limit_term(both)
        of_flux = both.terms / both.emitted_w
        of_images = self._unbiased_image_error(first.images, second.images, uniform) if both.pairs else error
        of_colours = 0.0 if self.colour is None else float(self.colour.error(first.colours, second.colours))
        whole = float(error + of_limits + of_flux) + of_colours
        return MeritParts(whole, float(of_images + of_limits) + of_colours, float(of_limits))

    def limits_missed(self, samples: Sequence[SampledLight]) -> int:
        """Number of limits that independent ``samples`` of the light, each of the whole flux, do not keep."""
        seen: dict[tuple[int, bool, bool], np.ndarray] = {}
        missed = 0
        for term in (term for limit in self.limits for term in limit.members):
            limit = term.limit
            quantity = limit.quantity
            key = (limit.receiver, quantity.of_losses, quantity.of_view)
            if key not in seen:
                seen[key] = np.stack([_read_by(limit, sample).numpy() for sample in samples])
            missed += term.is_missed(limit_value(limit, seen[key]).value)  # few rays decide nothing: the side counts
        return missed

    def _unbiased_image_error(self, first: Images, second: Images, uniform: bool) -> Float[Tensor, ""]:
        receivers = zip(self.terms, first, second, strict=False)
        return torch.stack(
            [terms.share * terms.judge(image, second_image, uniform) for terms, image, second_image in receivers]
        ).sum()

    def _mirrored(self, images: Sequence[Tensor]) -> Images:
        """The images with the mirrors of the scene; behind those of receivers come the views of eyes, as they are."""
        receivers = len(self.terms)
        return (*(terms.mirrored(image) for terms, image in zip(self.terms, images, strict=False)), *images[receivers:])

    def _weighted(self, images: Images, value: Callable[[ImageTerms, Image], float]) -> float:
        """Mean of ``value`` over the receivers by their shares."""
        return sum(terms.share * value(terms, image) for terms, image in zip(self.terms, images, strict=False))

    def _image_loss(self, images: Images, uniform: bool) -> Float[Tensor, ""]:
        pairs = zip(self.terms, images, strict=False)
        return torch.stack([terms.share * terms.loss(image, uniform) for terms, image in pairs]).sum()

    def _limit_term(self, light: SampledLight) -> Float[Tensor, ""]:
        """Excess of the parts over the limits, or their share; of joined samples, with less noise, in a judgement."""
        if not self.limits:
            return torch.zeros((), dtype=torch.float64)
        parts = light.of_parts()
        if self.share is None:
            return torch.stack([limit.loss(*part) for part in parts for limit in self.limits]).sum() / len(parts)
        excesses = [[excess for limit in self.limits for excess in limit.excesses(*part)] for part in parts]
        noise = [term.noise for limit in self.limits for term in limit.members]
        return share_term([torch.stack(same) for same in zip(*excesses, strict=True)], noise, self.share)

    def _colours(self, parts: Sequence[tuple[Collected, ...]]) -> Colours:
        colours = []
        for terms, *same in zip(self.terms, *parts, strict=False):
            colours_of_parts = [collected.colours for collected in same if collected.colours is not None]
            if colours_of_parts:
                colours.append(
                    torch.stack(
                        [terms.mirrored(colour_image) for colour_image in torch.stack(colours_of_parts).mean(dim=0)]
                    )
                )
        return tuple(colours)

    def _flux_term(self, light: tuple[Collected, ...]) -> Float[Tensor, ""]:
        """Flux (W) that has no gradient in the images."""
        even = any(terms.mask is not None for terms in self.terms)
        lost = (_UNIFORM_TOTAL_REFLECTION if even else _TOTAL_REFLECTION) * light[0].total_reflection
        received = [
            terms.share * terms.flux_term(collected) for terms, collected in zip(self.terms, light, strict=False)
        ]
        return lost + torch.stack(received).sum()


def _losses(parts: Sequence[tuple[Collected, ...]]) -> Losses:
    """Mean flux by cause on each receiver over parts; none where no limit asks for it."""
    by_receiver = zip(*parts, strict=True)
    counted = [[light.losses for light in same if light.losses is not None] for same in by_receiver]
    return tuple(torch.stack(same).mean(dim=0) for same in counted if same)
