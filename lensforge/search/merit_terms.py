"""Terms of the merit function: of the light on one receiver, and of the limits on it.

All are differentiable on torch images [row y, column x]. A limit's term is one-sided, 0 where the picture keeps the
limit with a margin.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.scene.limit_readings import LightLimit, light_limits
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.target_pattern import target_light, uniform_region
from lensforge.search.light_path import Collected
from lensforge.search.symmetry import ChartMirrors, chart_mirrors, mirrored_light
from lensforge.spec import Spec, Target

# Factors of the terms added to an NMSE of order 0.01 to 1. A receiver that is judged by uniformity and efficiency has
# a strong efficiency term in every stage; elsewhere the NMSE itself includes efficiency.
_OUTSIDE_RECEIVER = 0.3
_EFFICIENCY, _UNIFORM_EFFICIENCY = 0.15, 1.2
# In the uniformity stage the image may be traded for an even mask.
_UNIFORM_VARIANCE = 10.0
_UNIFORM_SHORTFALL = 300.0
_UNIFORM_MARGIN = 0.03
_UNIFORM_IMAGE = 0.2

Image = Float[Tensor, "h w"]
Images = tuple[Float[Tensor, "_ _"], ...]  # of receivers, each with a shape of its own


@dataclass(frozen=True)
class ImageTerms:
    """Light wanted on one receiver: the flux (W) on each pixel, the mask of uniform light, and its mirrors.

    ``share``: of all receivers' terms, which add up to 1.
    """

    wanted: Image
    mask: Bool[Tensor, "h w"] | None
    mirrors: ChartMirrors
    share: float

    @staticmethod
    def of(
        targets: tuple[Target, ...], receiver: PosedReceiver, flux_w: float, symmetry: str, share: float
    ) -> "ImageTerms":
        """Terms of ``targets`` that together hold ``flux_w``."""
        wanted = torch.from_numpy(target_light(targets, receiver)) * flux_w
        # half a pixel more: the outermost strip of the region belongs to pixels whose centres are outside it
        region = uniform_region(targets, receiver, wider_by_pixels=1.0)
        mask = None if region is None else torch.from_numpy(region)
        return ImageTerms(wanted, mask, chart_mirrors(receiver, symmetry) or (), share)

    def image(self, light: Collected) -> Image:
        """Flux (W) on each pixel, as the mean over the mirror images."""
        return self.mirrored(light.image)

    def mirrored(self, image: Image) -> Image:
        """Mean over the mirror images."""
        return mirrored_light(image, self.mirrors)

    def loss(self, flux: Image, uniform: bool) -> Float[Tensor, ""]:
        """Error of the image; with ``uniform`` that of the mask comes first."""
        nmse = nmse_loss(flux, self.wanted)
        if not (uniform and self.mask is not None):
            return nmse
        variance = _UNIFORM_VARIANCE * uniformity_loss(flux, self.mask)
        return _UNIFORM_IMAGE * nmse + (
            variance + _UNIFORM_SHORTFALL * shortfall_loss(flux, self.mask, _UNIFORM_MARGIN)
        )

    def judge(self, first: Image, second: Image, uniform: bool) -> Float[Tensor, ""]:
        """The same from two independent samples, without their noise.

        The product of the errors of both images has the expectation of the error without the noise of the rays; of
        the shortfall, whose image is smoothed, that of both together is taken.
        """
        wanted, image = self.wanted, 0.5 * (first + second)
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


def nmse_loss(flux: Float[Tensor, "h w"], wanted: Float[Tensor, "h w"]) -> Float[Tensor, ""]:
    """Normalised mean-square error, Eq. (7); ``wanted`` is not scaled: a dim image has an error."""
    return torch.sum((flux - wanted) ** 2) / torch.sum(wanted**2)


def uniformity_loss(flux: Float[Tensor, "h w"], mask: Bool[Tensor, "h w"]) -> Float[Tensor, ""]:
    """Relative variance inside ``mask``, Eq. (8), with the mean taken over the mask's pixels."""
    inside = flux[mask]
    return torch.mean((inside / _scale(inside) - 1.0) ** 2)


def _scale(inside: Float[Tensor, " k"]) -> Float[Tensor, ""]:
    return not_dark(inside.mean())


def not_dark(scale: Float[Tensor, ""]) -> Float[Tensor, ""]:
    """``scale``; 1 where all is dark, so that a loss relative to it is large, not undefined."""
    return torch.where(scale > 0.0, scale, 1.0)


def shortfall_loss(flux: Float[Tensor, "h w"], mask: Bool[Tensor, "h w"], margin: float) -> Float[Tensor, ""]:
    """Mean square of the shortfall of pixels inside ``mask`` from ``1 - margin`` of the mask's mean.

    Uniformity is least over mean: a variance is insensitive to the one corner that decides it. The image is smoothed by
    the 3 x 3 Gaussian of the evaluation first, so that ray noise does not count as a shortfall.
    """
    inside = smoothed(flux)[mask]
    return torch.mean(torch.clamp(1.0 - margin - inside / _scale(inside), min=0.0) ** 2)


def smoothed(flux: Image) -> Image:
    """The picture after the 3 x 3 Gaussian of variance 1 pixel^2, as the evaluation filters it."""
    taps = torch.tensor([math.exp(-0.5), 1.0, math.exp(-0.5)], dtype=flux.dtype)
    kernel = torch.outer(taps, taps) / taps.sum() ** 2
    padded = torch.nn.functional.pad(flux[None, None], (1, 1, 1, 1), mode="replicate")
    return torch.nn.functional.conv2d(padded, kernel[None, None])[0, 0]


# The search aims this far inside each bound, relative to it: the picture of a step has noise, and pixels of its own.
_MARGIN = 0.03
# Factors of the mean excess over the places of a limit: of a few places each counts, of many all together.
_OF_EACH, _AT_MOST = 30.0, 300.0


@dataclass(frozen=True, eq=False)
class LimitTerm:
    """One limit on the picture of a receiver: its readings as a torch matrix."""

    limit: LightLimit
    readings: Tensor
    factor: float

    @staticmethod
    def of(limit: LightLimit) -> "LimitTerm":
        """The term of ``limit``."""
        coo = limit.readings.tocoo()
        places = torch.from_numpy(np.stack([coo.row, coo.col]).astype(np.int64))
        matrix = torch.sparse_coo_tensor(places, torch.from_numpy(coo.data), coo.shape, check_invariants=False)
        return LimitTerm(limit, matrix.coalesce(), min(_OF_EACH * coo.shape[0], _AT_MOST))

    def loss(self, images: Images) -> Float[Tensor, ""]:
        """Mean of e^2/(1+e) over the places, e what is missing to the bound or above it, relative to the bound."""
        picture = smoothed(images[self.limit.receiver])
        light = torch.mv(self.readings, picture.reshape(-1))
        excess = self._excess(light, picture).clamp(min=0.0)
        return self.factor * torch.mean(excess**2 / (1.0 + excess))

    def _excess(self, light: Float[Tensor, " k"], picture: Image) -> Float[Tensor, " k"]:
        """Excess at each place; of an even zone at its dark places, of a beam angle at those on the wrong side."""
        limit = self.limit
        match limit.quantity:
            case "light" | "share":
                scale: Tensor | float = 1.0
            case "relative":
                scale = not_dark(picture.detach().max() * limit.light_per_flux)
            case "min_over_mean":
                scale = not_dark(light.mean())
            case "min_over_max":
                scale = not_dark(light.detach().max())
            case "beam_angle":
                return self._beside_the_beam(light)
        return self._beyond(light / (scale * limit.bound))

    def _beyond(self, relative: Float[Tensor, " k"]) -> Float[Tensor, " k"]:
        """Excess of light relative to its bound over that with its margin."""
        return 1.0 + _MARGIN - relative if self.limit.sense == ">=" else relative - (1.0 - _MARGIN)

    def _beside_the_beam(self, light: Float[Tensor, " k"]) -> Float[Tensor, " k"]:
        """Light within a least angle must be above the level, light outside of a largest one below it."""
        limit = self.limit
        assert limit.angles_deg is not None
        off = torch.from_numpy(np.abs(limit.angles_deg)) - 0.5 * limit.bound
        beyond = self._beyond(light / (limit.level * not_dark(light.detach().max())))
        return torch.where(off < 0.0 if limit.sense == ">=" else off > 0.0, beyond, 0.0)


def limit_terms(
    spec: Spec, receivers: tuple[PosedReceiver, ...], lumens_per_watt: float | None, flux_w: float
) -> tuple[LimitTerm, ...]:
    """Terms of all limits of ``spec``. Raises :class:`InputError` for limits that no light keeps."""
    return tuple(LimitTerm.of(limit) for limit in light_limits(spec, receivers, lumens_per_watt, flux_w))
