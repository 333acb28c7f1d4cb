"""Terms of the light in the merit of a search: the error of the picture on a receiver, the flux it misses, its colour.

All are differentiable on torch images [row y, column x].

The light on every pixel is to have the colour of the whole source.
With U = 4 X - u0 D, V = 9 Y - v0 D and D = X + 15 Y + 3 Z, where (u0, v0) are u', v' of the source, both are 0 where a
pixel has that colour, and linear in its light: pictures of the rays by two weights of each. Their square sum over that
of D is the mean square of the distance in u', v', each pixel by the square of its light. D is that of the light that is
wanted, so that the product of two independent samples has no noise. All pixels count, not those of the beam alone: of
one sample the noise is then the same wherever light goes, and a search does not lower it by sending light away. Halves
of one sample would not do: in a quasi-random sequence they complement each other, pixel by pixel.

A ray is of one chip, and its colour far from the mean: the square has 0.0012 of noise by 16,384 rays of four chips,
where mixed light has 1e-6. Colours differ over many pixels, so that the pictures are blurred first: 9e-6 are left.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import gaussian_filter
from torch import Tensor

from lensforge.optics.colorimetry import away_from, denominator, uv_of
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.target_pattern import in_target, target_light, uniform_region
from lensforge.search.collected_light import Collected
from lensforge.search.limit_terms import Image, smoothed
from lensforge.search.parameters import ChartMirrors, chart_mirrors, mirrored_light
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import TargetSection
from lensforge.spec.quantities import not_dark

# Factors of the terms added to an NMSE of order 0.01 to 1. A receiver that is judged by uniformity and efficiency has
# a strong efficiency term in every stage; elsewhere the NMSE itself includes efficiency.
_OUTSIDE_RECEIVER = 0.3
_EFFICIENCY = 0.15
_UNIFORM_EFFICIENCY = 1.2
# The uniformity stage may raise the NMSE by no more than the other two terms fall. With a fifth of it, a bright square
# stood in a disc; flat_top, three seeds, then has an NMSE of 0.014 to 0.017 instead of 0.006 to 0.007, and an RSD of
# 0.008 to 0.010 instead of 0.008 to 0.011.
_UNIFORM_VARIANCE = 10.0
_UNIFORM_SHORTFALL = 300.0
_UNIFORM_MARGIN = 0.03


@dataclass(frozen=True)
class ImageTerms:
    """Light wanted on one receiver: the flux (W) on each pixel, the mask of uniform light, and its mirrors.

    ``share``: of all receivers' terms, which add up to 1. ``worth``: of the light on each pixel, 1 within the target,
    where all that counts is how much there is; None if its picture does.
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
        *,
        light_alone: bool = False,
    ) -> "ImageTerms":
        """Terms of ``targets`` that together hold ``flux_w``; ``light_alone``: its flux counts, not its picture."""
        wanted = torch.from_numpy(target_light(targets, receiver)) * flux_w
        # half a pixel more: the outermost strip of the region belongs to pixels whose centres are outside it
        region = uniform_region(targets, receiver, wider_by_pixels=1.0)
        mask = None if region is None else torch.from_numpy(region)
        worth = _worth(wanted) if light_alone else None
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
        return nmse + variance + _UNIFORM_SHORTFALL * shortfall_loss(flux, self.mask, _UNIFORM_MARGIN)

    def judge(self, first: Image, second: Image, uniform: bool) -> Float[Tensor, ""]:
        """Loss by the images of two independent samples, without their noise.

        The product of the errors of both images has the expectation of the error without the noise of the rays; of
        the shortfall, whose image is smoothed, that of both together is taken.
        """
        wanted = self.wanted
        image = 0.5 * (first + second)
        if self.worth is not None:
            return self.loss(image, uniform)
        error = torch.sum((first - wanted) * (second - wanted)) / torch.sum(wanted**2)
        if uniform and self.mask is not None:
            uneven = [inside / _scale(inside) - 1.0 for inside in (first[self.mask], second[self.mask])]
            error = error + _UNIFORM_VARIANCE * torch.mean(uneven[0] * uneven[1])
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


# Sample by which the source's colour is known.
_RAYS = 2**16
_SEED = 0
# Blur of the images, in pixels.
_SIGMA = 2.0
_REACH = 6

Colours = Sequence[Float[Tensor, "2 _ _"]]  # U and V over D per W (W), on each receiver


@dataclass(frozen=True, eq=False)
class SourceColour:
    """Colour of a whole source: u', v', and ``X + 15 Y + 3 Z`` (lm) of 1 W."""

    uv: Float[np.ndarray, " 2"]
    per_watt: float

    @staticmethod
    def of(source: Source) -> "SourceColour":
        """Mean over the rays of ``source``, which carry their colours."""
        rays = source.sample(min(_RAYS, source.ray_count or _RAYS), _SEED)
        mean = rays.flux @ rays.colours / rays.flux.sum()
        return SourceColour(uv_of(mean), float(denominator(mean)))

    def weights(self, rays: RayBundle) -> Float[np.ndarray, "2 n"]:
        """U and V of 1 W of each ray, over D of 1 W of the source."""
        return np.ascontiguousarray(away_from(self.uv, rays.colours).T / self.per_watt)


@dataclass(frozen=True, eq=False)
class ColourTerm:
    """Error of the colours of light of which so much is ``wanted`` (W), times ``weight``; receivers by ``shares``."""

    weight: float
    wanted: tuple[Float[Tensor, "_ _"], ...]
    shares: tuple[float, ...]

    def error(self, first: Colours, second: Colours) -> Float[Tensor, ""]:
        """The term by the colours of two samples; of one alone, given twice, with the noise of its rays."""
        errors = [
            share * torch.sum(blurred(colours) * blurred(other_colours)) / torch.sum(wanted**2)
            for colours, other_colours, wanted, share in zip(first, second, self.wanted, self.shares, strict=True)
        ]
        return self.weight * torch.stack(errors).sum()


def blurred(pictures: Float[Tensor, "2 h w"]) -> Float[Tensor, "2 h w"]:
    """Pictures blurred by a Gaussian, dark around them."""
    steps = torch.arange(-_REACH, _REACH + 1, dtype=pictures.dtype)
    bell = torch.exp(-0.5 * (steps / _SIGMA) ** 2)
    bell = bell / bell.sum()
    across = torch.nn.functional.conv2d(pictures[:, None], bell[None, None, None, :], padding=(0, _REACH))
    return torch.nn.functional.conv2d(across, bell[None, None, :, None], padding=(_REACH, 0))[:, 0]
