"""Terms of the light on one receiver, in the merit of a search: the error of its picture, and the flux it misses.

All are differentiable on torch images [row y, column x].
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter
from torch import Tensor

from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.target_pattern import in_target, target_light, uniform_region
from lensforge.search.collected_light import Collected
from lensforge.search.limit_terms import Image, not_dark, smoothed
from lensforge.search.parameters import ChartMirrors, chart_mirrors, mirrored_light
from lensforge.spec import TargetSection

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
