"""Merit function of a search: from parameters and rays to the loss that a search minimises, and its parts.

Its terms are of the light on each receiver, and of the limits on it. All are differentiable on torch images
[row y, column x]. A limit's term is one-sided, 0 where the picture keeps the limit with a margin.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import mean
from typing import Generic, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter
from torch import Tensor

from lensforge.light.table_trace import Scene
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.scene.body import Chain
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import in_target, target_light, uniform_region
from lensforge.search.collected_light import Collected
from lensforge.search.colour_term import Colours, ColourTerm, SourceColour
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.kinds import LightOfKinds
from lensforge.search.light_path import LightPath, Pair
from lensforge.search.limit_terms import Image, Images, LimitTerm, RoadTerms, limit_terms, not_dark, smoothed
from lensforge.search.parameters import ChartMirrors, Parametrisation, chart_mirrors, mirrored_light
from lensforge.sources.build_source import summarise
from lensforge.sources.ray_bundle import RayBundle, Source, aims
from lensforge.spec import Spec, TargetSection
from lensforge.spec.lamps_section import EndlessLamps

# Factors of the terms added to an NMSE of order 0.01 to 1. A receiver that is judged by uniformity and efficiency has
# a strong efficiency term in every stage; elsewhere the NMSE itself includes efficiency.
_OUTSIDE_RECEIVER = 0.3
_EFFICIENCY, _UNIFORM_EFFICIENCY = 0.15, 1.2
# In the uniformity stage the image may be traded for an even mask.
_UNIFORM_VARIANCE = 10.0
_UNIFORM_SHORTFALL = 300.0
_UNIFORM_MARGIN = 0.03
_UNIFORM_IMAGE = 0.2


@dataclass(frozen=True)
class ImageTerms:
    """Light wanted on one receiver: the flux (W) on each pixel, the mask of uniform light, and its mirrors.

    ``share``: of all receivers' terms, which add up to 1. ``worth``: of the light on each pixel, 1 within the target,
    where all that counts is how much there is; None where its picture does.
    """

    wanted: Image
    mask: Bool[Tensor, "h w"] | None
    mirrors: ChartMirrors
    share: float
    worth: Image | None = None

    @staticmethod
    def of(
        targets: tuple[TargetSection, ...],
        receiver: PosedReceiver,
        flux_w: float,
        symmetry: str,
        share: float,
        aim: str = "pattern",
    ) -> "ImageTerms":
        """Terms of ``targets`` that together hold ``flux_w``; ``aim``: as of ``OptimiseSection``."""
        wanted = torch.from_numpy(target_light(targets, receiver)) * flux_w
        # half a pixel more: the outermost strip of the region belongs to pixels whose centres are outside it
        region = uniform_region(targets, receiver, wider_by_pixels=1.0)
        mask = None if region is None else torch.from_numpy(region)
        worth = _worth(wanted) if aim == "share" else None
        return ImageTerms(wanted, mask, chart_mirrors(receiver, symmetry) or (), share, worth)

    def mirrored(self, image: Image) -> Image:
        """Mean over the mirror images."""
        return mirrored_light(image, self.mirrors)

    def loss(self, flux: Image, uniform: bool) -> Float[Tensor, ""]:
        """Error of the image; with ``uniform`` that of the mask comes first."""
        if self.worth is not None:
            return 1.0 - torch.sum(self.worth * flux) / self.wanted.sum()
        nmse = nmse_loss(flux, self.wanted)
        if not (uniform and self.mask is not None):
            return nmse
        variance = _UNIFORM_VARIANCE * uniformity_loss(flux, self.mask)
        return _UNIFORM_IMAGE * nmse + (
            variance + _UNIFORM_SHORTFALL * shortfall_loss(flux, self.mask, _UNIFORM_MARGIN)
        )

    def judge(self, first: Image, second: Image, uniform: bool) -> Float[Tensor, ""]:
        """Loss by the images of two independent samples, without their noise.

        The product of the errors of both images has the expectation of the error without the noise of the rays; of
        the shortfall, whose image is smoothed, that of both together is taken.
        """
        wanted, image = self.wanted, 0.5 * (first + second)
        if self.worth is not None:
            return self.loss(image, uniform)
        error = torch.sum((first - wanted) * (second - wanted)) / torch.sum(wanted**2)
        if uniform and self.mask is not None:
            uneven = [inside / _scale(inside) - 1.0 for inside in (first[self.mask], second[self.mask])]
            error = _UNIFORM_IMAGE * error + _UNIFORM_VARIANCE * torch.mean(uneven[0] * uneven[1])
            error = error + _UNIFORM_SHORTFALL * shortfall_loss(image, self.mask, _UNIFORM_MARGIN)
        return error

    def flux_term(self, light: Collected) -> Float[Tensor, ""]:
        """Flux (W) that has no gradient in the image: outside of the receiver, and in its window."""
        efficiency = _EFFICIENCY if self.mask is None else _UNIFORM_EFFICIENCY
        return _OUTSIDE_RECEIVER * light.outside_receiver - efficiency * light.in_window


_SHARPEST = 0.7  # pixels: less, and the four-pixel splat has no slope
# Of light beside the target: some width counts as much as a part of the target's, so that light far off is drawn in.
_WORTH_WIDTHS = ((0.0, 0.7), (0.25, 0.2), (1.0, 0.1))  # sigma over the target's radius, and the share of that width


def _worth(wanted: Image) -> Image:
    """Worth of the light on each pixel: the target's bright part, and its edge blurred to several widths."""
    bright = in_target(wanted.numpy()).astype(float)
    radius = math.sqrt(bright.sum() / math.pi)  # pixels
    blurred = [
        share * gaussian_filter(bright, max(width * radius, _SHARPEST), mode="constant")
        for width, share in _WORTH_WIDTHS
    ]
    return torch.from_numpy(np.sum(blurred, axis=0))


def nmse_loss(flux: Float[Tensor, "h w"], wanted: Float[Tensor, "h w"]) -> Float[Tensor, ""]:
    """Normalised mean-square error, Eq. (7); ``wanted`` is not scaled: a dim image has an error."""
    return torch.sum((flux - wanted) ** 2) / torch.sum(wanted**2)


def uniformity_loss(flux: Float[Tensor, "h w"], mask: Bool[Tensor, "h w"]) -> Float[Tensor, ""]:
    """Relative variance inside ``mask``, Eq. (8), with the mean taken over the mask's pixels."""
    inside = flux[mask]
    return torch.mean((inside / _scale(inside) - 1.0) ** 2)


def _scale(inside: Float[Tensor, " k"]) -> Float[Tensor, ""]:
    return not_dark(inside.mean())


def shortfall_loss(flux: Float[Tensor, "h w"], mask: Bool[Tensor, "h w"], margin: float) -> Float[Tensor, ""]:
    """Mean square of the shortfall of pixels inside ``mask`` from ``1 - margin`` of the mask's mean.

    Uniformity is least over mean: a variance is insensitive to the one corner that decides it. The image is smoothed by
    the 3 x 3 Gaussian of the evaluation first, so that ray noise does not count as a shortfall.
    """
    inside = smoothed(flux)[mask]
    return torch.mean(torch.clamp(1.0 - margin - inside / _scale(inside), min=0.0) ** 2)


_TOTAL_REFLECTION, _UNIFORM_TOTAL_REFLECTION = 0.3, 0.1  # factors, the second in scenes with a region of uniform light


@dataclass(frozen=True)
class Evaluated:
    """One evaluation: the loss to minimise, constraints included, and its parts for the history.

    ``nmse``, ``efficiency``: of several receivers the mean by their shares.
    """

    loss: Float[Tensor, ""]
    nmse: float
    efficiency: float
    fields: Float[Tensor, "c k"]


@dataclass(frozen=True)
class SampledLight:
    """Light of a sample of rays: flux (W) on each receiver's pixels, the terms of the flux (W), and that emitted.

    ``halves``: in a robust search, half of the difference between the images of two opposite parts, for each pair; the
    images are then the mean over all parts. ``colours``: the mean likewise, where they count.
    """

    images: Images
    terms: Float[Tensor, ""]
    emitted_w: float
    halves: tuple[Images, ...] = ()
    colours: Colours = ()

    def of_parts(self) -> list[Images]:
        """The images of every part: of the lens as designed alone, unless the search is robust."""
        if not self.halves:
            return [self.images]
        return [
            tuple(mean + sign * half for mean, half in zip(self.images, halves, strict=True))
            for halves in self.halves
            for sign in (1.0, -1.0)
        ]

    @staticmethod
    def joined(parts: "Sequence[SampledLight]", emitted_w: float) -> "SampledLight":
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""
        share = emitted_w / sum(part.emitted_w for part in parts)
        images = tuple(share * torch.stack(same).sum(dim=0) for same in zip(*(p.images for p in parts), strict=True))
        halves = tuple(
            tuple(emitted_w / part.emitted_w * half for half in each) for part in parts for each in part.halves
        )
        terms = share * torch.stack([part.terms for part in parts]).sum()
        colours = [share * torch.stack(same).sum(dim=0) for same in zip(*(p.colours for p in parts), strict=True)]
        return SampledLight(images, terms, emitted_w, halves, colours)


@dataclass(frozen=True)
class Assessed:
    """The light of one sample: the loss without constraints, and its parts for the history."""

    loss: Float[Tensor, ""]
    nmse: float
    efficiency: float


_Light = TypeVar("_Light")


class Merit(ABC, Generic[_Light]):
    """The merit that a search minimises, but for the constraints: of one LED, or of several."""

    parametrisation: Parametrisation

    @abstractmethod
    def light_of(self, tables: Float[Tensor, "f side side"], rays: RayBundle, pair: Pair | None = None) -> _Light:
        """The light of ``rays`` through the lens with these tables, or through a ``pair`` of its parts."""

    @abstractmethod
    def assessed(self, light: _Light, uniform: bool) -> Assessed:
        """The loss by one sample; ``uniform`` puts the uniformity of the masks before the images."""

    @abstractmethod
    def judge(self, first: _Light, second: _Light, uniform: bool) -> tuple[float, float]:
        """Merit without constraints from two independent samples, without their noise, and its part of the images."""

    @abstractmethod
    def joined(self, parts: Sequence[_Light], emitted_w: float) -> _Light:
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""

    def evaluate(
        self,
        weights: Float[Tensor, "k f"],
        offsets: Float[Tensor, " f"],
        rays: RayBundle,
        constraints: AugmentedLagrangian,
        uniform: bool,
        pair: Pair | None = None,
    ) -> Evaluated:
        """Trace ``rays`` and add the constraints; with a ``pair`` of opposite parts the mean over both."""
        tables = self.parametrisation.tables(weights, offsets)
        light = self.assessed(self.light_of(tables, rays, pair), uniform)
        fields = constraints.fields(tables)
        return Evaluated(light.loss + constraints.term(fields), light.nmse, light.efficiency, fields)


@dataclass(frozen=True)
class MeritFunction(Merit[SampledLight]):
    """The scene of a design with one LED: its light path, and the terms of each receiver."""

    spec: Spec
    parametrisation: Parametrisation
    light: LightPath | LightOfKinds
    terms: tuple[ImageTerms, ...]
    limits: tuple[LimitTerm | RoadTerms, ...] = ()
    colour: ColourTerm | None = None

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
        kernels trace the usual lens in single precision.
        """
        receivers, sections = receivers_of(spec, spec.optimise.pixels), spec.all_receivers
        fresnel = spec.optimise.fresnel
        limit = (transmittance_of(spec.media) if fresnel else 1.0) * source.flux_w
        total = sum(section.share for section in sections)
        terms = tuple(
            ImageTerms.of(
                section.targets, receiver, limit, spec.lens.basis.symmetry, section.share / total, spec.optimise.aim
            )
            for section, receiver in zip(sections, receivers, strict=True)
        )
        single = single and not isinstance(spec.lamps, EndlessLamps)  # whose light comes from any distance
        scene = Scene(spec.media, parametrisation.grid, fresnel, chain=Chain.of_lens(spec.lens), single=single)
        efficacy = summarise(source, spec.source).lumens_per_watt if spec.has_limits else None
        limits = limit_terms(light_limits(spec, receivers, efficacy, source.flux_w))
        crossing = source if scene.chain is not None and aims(source) else None
        light, term, colour = LightPath(scene, receivers, device, source=crossing), None, spec.colour
        if colour is not None and colour.weight > 0.0:
            light = replace(light, colour=SourceColour.of(source))
            wanted, shares = zip(*((each.wanted, each.share) for each in terms), strict=True)
            term = ColourTerm(colour.weight, wanted, shares)
        path = LightOfKinds.of(light, spec.all_lamps) if spec.all_lamps.kinds else light
        return MeritFunction(spec, parametrisation, path, terms, limits, term)

    def assessed(self, light: SampledLight, uniform: bool) -> Assessed:
        """The loss by one sample; ``uniform`` puts the uniformity of the masks before the images."""
        efficiency = self._weighted(light.images, lambda terms, image: float(image.detach().sum())) / light.emitted_w
        parts = light.of_parts()
        nmse = mean(
            self._weighted(images, lambda terms, image: nmse_loss(image.detach(), terms.wanted).item())
            for images in parts
        )
        loss = torch.stack([self._image_loss(images, uniform) for images in parts]).mean()
        loss = loss + light.terms / light.emitted_w + torch.stack([self._limit_term(images) for images in parts]).mean()
        if self.colour is not None:
            loss = loss + self.colour.error(light.colours, light.colours)
        return Assessed(loss, nmse, efficiency)

    def joined(self, parts: Sequence[SampledLight], emitted_w: float) -> SampledLight:
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""
        return SampledLight.joined(parts, emitted_w)

    def light_of(self, tables: Float[Tensor, "f side side"], rays: RayBundle, pair: Pair | None = None) -> SampledLight:
        """The light of ``rays`` through the lens with these tables, or through a ``pair`` of its parts.

        Both parts are traced with all rays: fewer in their difference from the lens as designed save time, but where
        the change moves rays to other pixels the gradient's noise is that of few rays.
        """
        emitted_w = float(rays.flux.sum())
        if pair is None:
            light = self.light.collect(tables, rays)
            return SampledLight(self._images(light), self._flux_term(light), emitted_w, (), self._colours((light,)))
        assert isinstance(self.light, LightPath), "a robust search has one lens"
        one, other = (self.light.through(tables, rays, part) for part in pair)
        both = list(zip(self.terms, one, other, strict=True))
        # only the mean over all parts has the symmetry of the scene: each part alone has none
        images = tuple(terms.mirrored(0.5 * (a.image + b.image)) for terms, a, b in both)
        halves = tuple(0.5 * (a.image - b.image) for _, a, b in both)
        flux = 0.5 * (self._flux_term(one) + self._flux_term(other))
        return SampledLight(images, flux, emitted_w, (halves,), self._colours((one, other)))

    def judge(self, first: SampledLight, second: SampledLight, uniform: bool) -> tuple[float, float]:
        """Merit without constraints from two independent samples, without their noise, and its part of the images.

        Of a robust search the error of the mean image: gains are relative to it, and no lens lowers the spread of its
        parts by much.
        """
        both = zip(first.of_parts(), second.of_parts(), strict=True)
        error = torch.stack([self._judged(one, other, uniform) for one, other in both]).mean()
        of_flux = 0.5 * (first.terms / first.emitted_w + second.terms / second.emitted_w)
        of_images = self._judged(first.images, second.images, uniform) if first.halves else error
        of_colours = 0.0 if self.colour is None else float(self.colour.error(first.colours, second.colours))
        return float(error + of_flux) + of_colours, float(of_images) + of_colours

    def _judged(self, first: Images, second: Images, uniform: bool) -> Float[Tensor, ""]:
        """The error of the images of one part by two samples."""
        parts = zip(self.terms, first, second, strict=True)
        error = torch.stack([terms.share * terms.judge(one, other, uniform) for terms, one, other in parts]).sum()
        return error + self._limit_term(tuple(0.5 * (one + other) for one, other in zip(first, second, strict=True)))

    def _weighted(self, images: Images, value: Callable[[ImageTerms, Image], float]) -> float:
        """Mean of ``value`` over the receivers by their shares."""
        return sum(terms.share * value(terms, image) for terms, image in zip(self.terms, images, strict=True))

    def _image_loss(self, images: Images, uniform: bool) -> Float[Tensor, ""]:
        pairs = zip(self.terms, images, strict=True)
        return torch.stack([terms.share * terms.loss(image, uniform) for terms, image in pairs]).sum()

    def _limit_term(self, images: Images) -> Float[Tensor, ""]:
        """Excess over the limits; that of the joined picture, whose noise is small, in a judgement."""
        if not self.limits:
            return torch.zeros((), dtype=torch.float64)
        return torch.stack([limit.loss(images) for limit in self.limits]).sum()

    def _images(self, light: tuple[Collected, ...]) -> Images:
        return tuple(terms.mirrored(each.image) for terms, each in zip(self.terms, light, strict=True))

    def _colours(self, parts: Sequence[tuple[Collected, ...]]) -> Colours:
        """Mean colours over parts; none where they do not count."""
        colours = []
        for terms, *same in zip(self.terms, *parts, strict=True):
            own = [each.colours for each in same if each.colours is not None]
            if own:
                colours.append(torch.stack([terms.mirrored(each) for each in torch.stack(own).mean(dim=0)]))
        return tuple(colours)

    def _flux_term(self, light: tuple[Collected, ...]) -> Float[Tensor, ""]:
        """Flux (W) that has no gradient in the images."""
        even = any(terms.mask is not None for terms in self.terms)
        lost = (_UNIFORM_TOTAL_REFLECTION if even else _TOTAL_REFLECTION) * light[0].total_reflection
        received = [terms.share * terms.flux_term(each) for terms, each in zip(self.terms, light, strict=True)]
        return lost + torch.stack(received).sum()
