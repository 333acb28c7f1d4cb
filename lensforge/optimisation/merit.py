"""Merit function: from parameters and rays to the loss that a search minimises, and its parts for the history.

The terms of the image are differentiable on torch images [row y, column x].
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.optics.materials import normal_transmittance
from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.collect import Collected
from lensforge.optimisation.light_path import LightPath
from lensforge.optimisation.parameters import Parametrisation
from lensforge.optimisation.symmetry import mirror_mean
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.targets import target_irradiance
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.tracing.tables import Scene

# Factors of the terms added to an NMSE of order 0.01 to 1. A scene that is evaluated by uniformity and efficiency has
# a strong efficiency term in every stage; elsewhere the NMSE itself includes efficiency.
_OUTSIDE_RECEIVER = 0.3
_IMAGE_FACTORS = {"total_reflection": 0.3, "efficiency": 0.15}
_UNIFORM_FACTORS = {"total_reflection": 0.1, "efficiency": 1.2}
# In the uniformity stage the image may be traded for an even mask.
_UNIFORM_VARIANCE = 10.0
_UNIFORM_SHORTFALL = 300.0
_UNIFORM_MARGIN = 0.03
_UNIFORM_IMAGE = 0.2


@dataclass(frozen=True)
class Evaluated:
    """One evaluation: the loss to minimise, constraints included, and its parts for the history."""

    loss: Float[Tensor, ""]
    nmse: float
    efficiency: float
    fields: Float[Tensor, "c k"]


@dataclass(frozen=True)
class SampledLight:
    """Light of a sample of rays: flux (W) on each pixel, the terms of the flux (W), and the flux emitted (W)."""

    image: Float[Tensor, "p p"]
    terms: Float[Tensor, ""]
    emitted_w: float

    @staticmethod
    def joined(parts: "Sequence[SampledLight]", emitted_w: float) -> "SampledLight":
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""
        share = emitted_w / sum(part.emitted_w for part in parts)
        image, terms = (
            torch.stack(values).sum(dim=0) for values in zip(*((p.image, p.terms) for p in parts), strict=True)
        )
        return SampledLight(share * image, share * terms, emitted_w)


@dataclass(frozen=True)
class MeritFunction:
    """The scene of a design: its light path, and the target flux (W) on each pixel of the receiver."""

    spec: Spec
    parametrisation: Parametrisation
    light: LightPath
    wanted: Float[Tensor, "p p"]
    mask: Bool[Tensor, "p p"] | None

    @staticmethod
    def of(
        spec: Spec, source: Source, parametrisation: Parametrisation, device: torch.device | None = None
    ) -> "MeritFunction":
        """Merit function whose target carries the flux of the theoretical limit, so that the NMSE includes efficiency.

        Rays are traced on ``device``, or by the compiled kernels for None; all else stays on the CPU.
        """
        receiver = PlaneReceiver.of(spec.target, spec.optimise.pixels)
        fresnel = spec.optimise.fresnel
        limit = (normal_transmittance(spec.lens.refractive_index) ** 2 if fresnel else 1.0) * source.flux_w
        wanted = torch.from_numpy(target_irradiance(spec.target, receiver.grid))
        scene = Scene(spec.lens.refractive_index, parametrisation.grid, fresnel)
        light = LightPath(scene, receiver, spec.evaluate.window_mm or spec.target.receiver_mm, device)
        mask = None
        if spec.target.uniform_mm is not None:
            # half a pixel more: the outermost strip of the region belongs to pixels whose centres are outside it
            mask = torch.from_numpy(receiver.grid.square_mask(spec.target.uniform_mm + receiver.grid.pitch_mm))
        return MeritFunction(spec, parametrisation, light, wanted * limit, mask)

    def evaluate(
        self,
        weights: Float[Tensor, "k 2"],
        offsets: Float[Tensor, "2"],
        rays: RayBundle,
        constraints: AugmentedLagrangian,
        uniform: bool,
    ) -> Evaluated:
        """Trace ``rays``; ``uniform`` puts the uniformity of the mask before the image."""
        inner, outer = self.parametrisation.tables(weights, offsets)
        light = self.light.collect(inner, outer, rays)
        flux = self._mirrored(light)
        emitted_w = float(rays.flux.sum())
        efficiency = float(flux.detach().sum()) / emitted_w
        nmse = nmse_loss(flux, self.wanted)
        loss = self._image_term(flux, nmse, uniform) + self._flux_term(light) / emitted_w
        fields = constraints.fields(inner, outer)
        return Evaluated(loss + constraints.term(fields), nmse.item(), efficiency, fields)

    def light_of(
        self, inner: Float[Tensor, "side side"], outer: Float[Tensor, "side side"], rays: RayBundle
    ) -> SampledLight:
        """The light of ``rays`` through the lens with these tables."""
        light = self.light.collect(inner, outer, rays)
        return SampledLight(self._mirrored(light), self._flux_term(light), float(rays.flux.sum()))

    def judge(self, first: SampledLight, second: SampledLight, uniform: bool) -> tuple[float, float]:
        """Merit without constraints from two independent samples, and its part of the image.

        The product of the errors of both images has the expectation of the error without the noise of the rays; of
        the shortfall, whose image is smoothed, that of both together is taken.
        """
        wanted, image = self.wanted, 0.5 * (first.image + second.image)
        error = torch.sum((first.image - wanted) * (second.image - wanted)) / torch.sum(wanted**2)
        if uniform and self.mask is not None:
            uneven = [inside / _scale(inside) - 1.0 for inside in (first.image[self.mask], second.image[self.mask])]
            error = _UNIFORM_IMAGE * error + _UNIFORM_VARIANCE * torch.mean(uneven[0] * uneven[1])
            error = error + _UNIFORM_SHORTFALL * shortfall_loss(image, self.mask, _UNIFORM_MARGIN)
        of_flux = 0.5 * (first.terms / first.emitted_w + second.terms / second.emitted_w)
        return float(error + of_flux), float(error)

    def _mirrored(self, light: Collected) -> Float[Tensor, "p p"]:
        return mirror_mean(light.image, self.spec.lens.basis.symmetry)

    def _image_term(self, flux: Float[Tensor, "p p"], nmse: Float[Tensor, ""], uniform: bool) -> Float[Tensor, ""]:
        if uniform and self.mask is not None:
            return _UNIFORM_IMAGE * nmse + self._nonuniformity(flux, self.mask)
        return nmse

    def _flux_term(self, light: Collected) -> Float[Tensor, ""]:
        return _flux_terms(light, **(_IMAGE_FACTORS if self.mask is None else _UNIFORM_FACTORS))

    def _nonuniformity(self, flux: Float[Tensor, "p p"], mask: Bool[Tensor, "p p"]) -> Float[Tensor, ""]:
        variance = _UNIFORM_VARIANCE * uniformity_loss(flux, mask)
        return variance + _UNIFORM_SHORTFALL * shortfall_loss(flux, mask, _UNIFORM_MARGIN)


def _flux_terms(light: Collected, total_reflection: float, efficiency: float) -> Float[Tensor, ""]:
    """Flux (W) that has no gradient in the image: outside of the receiver, totally reflected, in the window."""
    lost = _OUTSIDE_RECEIVER * light.outside_receiver + total_reflection * light.total_reflection
    return lost - efficiency * light.in_window


def nmse_loss(flux: Float[Tensor, "p p"], wanted: Float[Tensor, "p p"]) -> Float[Tensor, ""]:
    """Normalised mean-square error, Eq. (7); ``wanted`` is not scaled: a dim image has an error."""
    return torch.sum((flux - wanted) ** 2) / torch.sum(wanted**2)


def uniformity_loss(flux: Float[Tensor, "p p"], mask: Bool[Tensor, "p p"]) -> Float[Tensor, ""]:
    """Relative variance inside ``mask``, Eq. (8), with the mean taken over the mask's pixels."""
    inside = flux[mask]
    return torch.mean((inside / _scale(inside) - 1.0) ** 2)


def _scale(inside: Float[Tensor, " k"]) -> Float[Tensor, ""]:
    """The mean; 1 where all is dark, so that the loss of a mask without rays is large, not undefined."""
    mean = inside.mean()
    return torch.where(mean > 0.0, mean, 1.0)


def shortfall_loss(flux: Float[Tensor, "p p"], mask: Bool[Tensor, "p p"], margin: float) -> Float[Tensor, ""]:
    """Mean square of the shortfall of pixels inside ``mask`` from ``1 - margin`` of the mask's mean.

    Uniformity is least over mean: a variance is insensitive to the one corner that decides it. The image is smoothed by
    the 3 x 3 Gaussian of the evaluation first, so that ray noise does not count as a shortfall.
    """
    taps = torch.tensor([math.exp(-0.5), 1.0, math.exp(-0.5)], dtype=flux.dtype)
    kernel = torch.outer(taps, taps) / taps.sum() ** 2
    padded = torch.nn.functional.pad(flux[None, None], (1, 1, 1, 1), mode="replicate")
    inside = torch.nn.functional.conv2d(padded, kernel[None, None])[0, 0][mask]
    return torch.mean(torch.clamp(1.0 - margin - inside / _scale(inside), min=0.0) ** 2)
