"""Merit function of a search, and the problem that a stage solves with it under the constraints.

From parameters and rays to the loss that a search minimises, and its parts for the history. A problem is the merit of
lenses with certain levels of functions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import mean

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.light.table_trace import Scene
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.light_path import Collected, LightPath
from lensforge.search.merit_terms import Image, Images, ImageTerms, LimitTerm, limit_terms, nmse_loss
from lensforge.search.parameters import Parametrisation
from lensforge.search.robust_parts import Pair, SearchParts
from lensforge.sources.build_source import summarise
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec

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
    images are then the mean over all parts.
    """

    images: Images
    terms: Float[Tensor, ""]
    emitted_w: float
    halves: tuple[Images, ...] = ()

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
        return SampledLight(images, share * torch.stack([part.terms for part in parts]).sum(), emitted_w, halves)


@dataclass(frozen=True)
class MeritFunction:
    """The scene of a design: its light path, and the terms of each receiver."""

    spec: Spec
    parametrisation: Parametrisation
    light: LightPath
    terms: tuple[ImageTerms, ...]
    limits: tuple[LimitTerm, ...] = ()

    @staticmethod
    def of(
        spec: Spec, source: Source, parametrisation: Parametrisation, device: torch.device | None = None
    ) -> "MeritFunction":
        """Merit function whose targets carry the flux of the theoretical limit, so that the NMSE includes efficiency.

        Rays are traced on ``device``, or by the compiled kernels for None; all else stays on the CPU.
        """
        receivers, sections = receivers_of(spec, spec.optimise.pixels), spec.all_receivers
        fresnel = spec.optimise.fresnel
        limit = (transmittance_of(spec.lens.media) if fresnel else 1.0) * source.flux_w
        total = sum(section.share for section in sections)
        terms = tuple(
            ImageTerms.of(section.targets, receiver, limit, spec.lens.basis.symmetry, section.share / total)
            for section, receiver in zip(sections, receivers, strict=True)
        )
        scene = Scene(spec.lens.media, parametrisation.grid, fresnel)
        efficacy = summarise(source, spec.source).lumens_per_watt if spec.limits else None
        limits = limit_terms(spec, receivers, efficacy, source.flux_w)
        return MeritFunction(spec, parametrisation, LightPath(scene, receivers, device), terms, limits)

    def evaluate(
        self,
        weights: Float[Tensor, "k 2"],
        offsets: Float[Tensor, "2"],
        rays: RayBundle,
        constraints: AugmentedLagrangian,
        uniform: bool,
        pair: Pair | None = None,
    ) -> Evaluated:
        """Trace ``rays``; ``uniform`` puts the uniformity of the masks before the images.

        With a ``pair`` of opposite parts the mean over both.
        """
        inner, outer = self.parametrisation.tables(weights, offsets)
        light = self.light_of(inner, outer, rays, pair)
        efficiency = self._weighted(light.images, lambda terms, image: float(image.detach().sum())) / light.emitted_w
        parts = light.of_parts()
        nmse = mean(
            self._weighted(images, lambda terms, image: nmse_loss(image.detach(), terms.wanted).item())
            for images in parts
        )
        loss = torch.stack([self._image_loss(images, uniform) for images in parts]).mean()
        limits = torch.stack([self._limit_term(images) for images in parts]).mean()
        loss = loss + light.terms / light.emitted_w + limits
        fields = constraints.fields(inner, outer)
        return Evaluated(loss + constraints.term(fields), nmse, efficiency, fields)

    def light_of(
        self,
        inner: Float[Tensor, "side side"],
        outer: Float[Tensor, "side side"],
        rays: RayBundle,
        pair: Pair | None = None,
    ) -> SampledLight:
        """The light of ``rays`` through the lens with these tables, or through a ``pair`` of its parts.

        Both parts are traced with all rays: fewer in their difference from the lens as designed save time, but where
        the change moves rays to other pixels the gradient's noise is that of few rays.
        """
        emitted_w = float(rays.flux.sum())
        if pair is None:
            light = self.light.collect(inner, outer, rays)
            return SampledLight(self._images(light), self._flux_term(light), emitted_w)
        one, other = (self.light.through(inner, outer, rays, part) for part in pair)
        both = list(zip(self.terms, one, other, strict=True))
        # only the mean over all parts has the symmetry of the scene: each part alone has none
        images = tuple(terms.mirrored(0.5 * (a.image + b.image)) for terms, a, b in both)
        halves = tuple(0.5 * (a.image - b.image) for _, a, b in both)
        flux = 0.5 * (self._flux_term(one) + self._flux_term(other))
        return SampledLight(images, flux, emitted_w, (halves,))

    def judge(self, first: SampledLight, second: SampledLight, uniform: bool) -> tuple[float, float]:
        """Merit without constraints from two independent samples, without their noise, and its part of the images.

        Of a robust search the error of the mean image: gains are relative to it, and no lens lowers the spread of its
        parts by much.
        """
        both = zip(first.of_parts(), second.of_parts(), strict=True)
        error = torch.stack([self._judged(one, other, uniform) for one, other in both]).mean()
        of_flux = 0.5 * (first.terms / first.emitted_w + second.terms / second.emitted_w)
        of_images = self._judged(first.images, second.images, uniform) if first.halves else error
        return float(error + of_flux), float(of_images)

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
        return tuple(terms.image(each) for terms, each in zip(self.terms, light, strict=True))

    def _flux_term(self, light: tuple[Collected, ...]) -> Float[Tensor, ""]:
        """Flux (W) that has no gradient in the images."""
        even = any(terms.mask is not None for terms in self.terms)
        lost = (_UNIFORM_TOTAL_REFLECTION if even else _TOTAL_REFLECTION) * light[0].total_reflection
        received = [terms.share * terms.flux_term(each) for terms, each in zip(self.terms, light, strict=True)]
        return lost + torch.stack(received).sum()


@dataclass(frozen=True)
class Problem:
    """Merit function and constraints for the levels of ``spec``, numbers here; ``sparse``: the latter at few points.

    ``parts``: of a robust search.
    """

    spec: Spec
    merit: MeritFunction
    constraints: AugmentedLagrangian
    sparse: bool = False
    parts: SearchParts | None = None

    @property
    def parametrisation(self) -> Parametrisation:
        """Parameters and tables of its lenses."""
        return self.merit.parametrisation

    def in_full(self) -> tuple[Parametrisation, AugmentedLagrangian]:
        """Parametrisation and constraints of the end of a search: where its steps look at few points, at many.

        Those between the nodes, too: there led_colours exceeds its radius by 9 um in a draft.
        """
        if not self.sparse:
            return self.parametrisation, self.constraints
        finer = self.parametrisation.refined()
        return finer, AugmentedLagrangian.of(self.spec, finer.grid)

    def multipliers_of(self, before: "Problem", multipliers: Float[Tensor, "c j"]) -> Float[Tensor, "c k"]:
        """``multipliers`` of another problem at the points of this one: those of the nearest point."""
        return self.constraints.at_nearest(before.constraints, multipliers)


@dataclass
class Problems:
    """The problems of one search, of which the last is kept; constraints of automatic levels hold at fewer points."""

    spec: Spec
    source: Source
    nodes_per_sigma: float
    device: torch.device | None
    _last: Problem | None = None

    def of(self, levels: tuple[int, ...]) -> Problem:
        """The problem of lenses with ``levels``."""
        if self._last is None or self._last.spec.lens.levels != levels:
            spec = self.spec.with_levels(levels)
            automatic = self.spec.lens.levels == "auto"
            parametrisation = Parametrisation.of(spec, self.nodes_per_sigma)
            merit = MeritFunction.of(spec, self.source, parametrisation, self.device)
            constraints = AugmentedLagrangian.of(spec, parametrisation.grid, sparse=automatic)
            parts = SearchParts.of(spec, parametrisation) if spec.optimise.robust else None
            self._last = Problem(spec, merit, constraints, automatic, parts)
        return self._last
