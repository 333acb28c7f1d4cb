"""Colour as a term of the merit: the light on every pixel is to have the colour of the whole source.

With U = 4 X - u0 D, V = 9 Y - v0 D and D = X + 15 Y + 3 Z, where (u0, v0) are u', v' of the source, both are 0 where a
pixel has that colour, and linear in its light: pictures of the rays by two weights of each. Their square sum over that
of D is the mean square of the distance in u', v', each pixel by the square of its light. D is that of the light that is
wanted, so that the product of two independent samples has no noise. All pixels count, not those of the beam alone: of
one sample the noise is then the same wherever light goes, and a search does not lower it by sending light away. Halves
of one sample would not do: in a quasi-random sequence they complement each other, pixel by pixel.

A ray is of one chip, and its colour far from the mean: the square has 0.0012 of noise by 16,384 rays of four chips,
where mixed light has 1e-6. Colours differ over many pixels, so that the pictures are blurred first: 9e-6 are left.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.optics.colorimetry import away_from, denominator, uv_of
from lensforge.sources.ray_bundle import RayBundle, Source

_RAYS, _SEED = 2**16, 0  # of the source's colour
_SIGMA, _REACH = 2.0, 6  # pixels, of the blur

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
        each = [
            share * torch.sum(blurred(one) * blurred(other)) / torch.sum(wanted**2)
            for one, other, wanted, share in zip(first, second, self.wanted, self.shares, strict=True)
        ]
        return self.weight * torch.stack(each).sum()


def blurred(pictures: Float[Tensor, "2 h w"]) -> Float[Tensor, "2 h w"]:
    """Pictures blurred by a Gaussian, dark around them."""
    steps = torch.arange(-_REACH, _REACH + 1, dtype=pictures.dtype)
    bell = torch.exp(-0.5 * (steps / _SIGMA) ** 2)
    bell = bell / bell.sum()
    across = torch.nn.functional.conv2d(pictures[:, None], bell[None, None, None, :], padding=(0, _REACH))
    return torch.nn.functional.conv2d(across, bell[None, None, :, None], padding=(_REACH, 0))[:, 0]
