"""Limits on the light, in the merit of a search: what each lacks to its bound, on torch images [row y, column x].

A term is one-sided: 0 where the picture keeps the limit with a margin.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.scene.limit_readings import LightLimit

Image = Float[Tensor, "h w"]
Images = tuple[Float[Tensor, "_ _"], ...]  # of receivers, each with a shape of its own
Losses = tuple[Float[Tensor, " c"], ...]  # flux by cause, of receivers; none where no limit asks for it


def smoothed(flux: Image) -> Image:
    """The picture after the 3 x 3 Gaussian of variance 1 pixel^2, as the evaluation filters it."""
    taps = torch.tensor([math.exp(-0.5), 1.0, math.exp(-0.5)], dtype=flux.dtype)
    kernel = torch.outer(taps, taps) / taps.sum() ** 2
    padded = torch.nn.functional.pad(flux[None, None], (1, 1, 1, 1), mode="replicate")
    return torch.nn.functional.conv2d(padded, kernel[None, None])[0, 0]


# The search aims this far inside each bound, relative to it: the picture of a step has noise, and pixels of its own.
_MARGIN = 0.03
_WIDE_MARGIN = 0.06  # a far field of 200 pixels shows a road up to 3 % too good; so does the wide kernel of eyes
_NOISE = 0.02  # of a reading by a step's rays, relative to its bound: of a place on road_wide 0.015 to 0.05
# Factors of the mean excess over the places of a limit: of a few places each counts, of many all together.
_OF_EACH = 30.0
_AT_MOST = 300.0
_OF_FLUX = 0.4  # the excess of a loss counts as a part of so much: with 0.1 a search for an oval keeps its narrow start


@dataclass(frozen=True, eq=False)
class LimitTerm:
    """One limit on the picture of a receiver: its readings as a torch matrix."""

    limit: LightLimit
    readings: Tensor
    factor: float
    margin: float

    @staticmethod
    def of(limit: LightLimit, by_parts: bool = False) -> "LimitTerm":
        """The term of ``limit``; ``by_parts``: it is pulled in by the spread of the parts, and for its pixels alone."""
        coo = limit.readings.tocoo()
        places = torch.from_numpy(np.stack([coo.row, coo.col]).astype(np.int64))
        matrix = torch.sparse_coo_tensor(places, torch.from_numpy(coo.data), coo.shape, check_invariants=False)
        factor = _OF_EACH * coo.shape[0]
        factor = limit.share * factor if limit.by_intensities else min(factor, limit.eyes * _AT_MOST)
        margin = _WIDE_MARGIN if limit.by_intensities or limit.quantity.of_view else _MARGIN
        return LimitTerm(limit, matrix.coalesce(), factor, margin - _MARGIN if by_parts else margin)

    @property
    def members(self) -> "tuple[LimitTerm, ...]":
        """Itself, as one of several."""
        return (self,)

    @property
    def noise(self) -> float:
        """Noise of the excess by the rays of a step."""
        return _NOISE * self.limit.bound / _OF_FLUX if self.limit.quantity.of_losses else _NOISE

    def is_missed(self, value: float) -> bool:
        """True for a ``value`` beyond the bound, less by what pictures of a search show too good."""
        closer = max(self.margin - _MARGIN, 0.0)
        if self.limit.sense == ">=":
            return value < (1.0 + closer) * self.limit.bound
        return value > (1.0 - closer) * self.limit.bound

    def loss(self, images: Images, losses: Losses = ()) -> Float[Tensor, ""]:
        """Mean of e^2/(1+e) over the places, e what is missing to the bound or above it, relative to the bound."""
        (excess,) = self.excesses(images, losses)
        return self.of_excess(excess)

    def of_excess(self, excess: Float[Tensor, " k"]) -> Float[Tensor, ""]:
        """The loss by the excess at the places of the limit."""
        excess = excess.clamp(min=0.0)
        return self.factor * torch.mean(excess**2 / (1.0 + excess))

    def excesses(self, images: Images, losses: Losses = ()) -> tuple[Float[Tensor, " k"]]:
        """Excess at each place, below 0 where the limit is held with its margin."""
        if self.limit.quantity.of_losses:
            by_cause = losses[self.limit.receiver]
            return (self.excess(torch.mv(self.readings, by_cause), by_cause),)
        picture = images[self.limit.receiver] if self.limit.quantity.of_view else smoothed(images[self.limit.receiver])
        return (self.excess(torch.mv(self.readings, picture.reshape(-1)), picture),)

    def excess(self, light: Float[Tensor, " k"], picture: Float[Tensor, "*_"]) -> Float[Tensor, " n"]:
        """Excess at each place that counts; of an even zone at its dark places, of a beam angle on the wrong side."""
        limit = self.limit
        quantity = limit.quantity
        if quantity.of_losses:  # by the bound, which may be small, a little too much would outweigh the pattern
            return (light - (1.0 - self.margin) * limit.bound) / _OF_FLUX
        relative = quantity.relative(light, limit.bound, limit.whole(picture))
        beyond = self._beyond(relative, quantity.at_least(limit.sense))
        counted = quantity.counted(limit.bound, limit.sense)
        return beyond if counted is None else torch.where(torch.from_numpy(counted), beyond, -1.0)

    def _beyond(self, relative: Float[Tensor, " n"], at_least: bool) -> Float[Tensor, " n"]:
        """Excess of light relative to its bound over that with its margin."""
        return 1.0 + self.margin - relative if at_least else relative - (1.0 - self.margin)


@dataclass(frozen=True, eq=False)
class JoinedTerms:
    """Limits on one picture: it is smoothed once, and read by one matrix."""

    members: tuple[LimitTerm, ...]
    readings: Tensor

    @staticmethod
    def of(limits: Sequence[LightLimit], by_parts: bool = False) -> "JoinedTerms":
        """The terms of ``limits``, all on one receiver."""
        terms = tuple(LimitTerm.of(limit, by_parts) for limit in limits)
        return JoinedTerms(terms, torch.cat([term.readings for term in terms]).coalesce())

    def loss(self, images: Images, losses: Losses = ()) -> Float[Tensor, ""]:
        """Sum of the losses of all limits."""
        excesses = zip(self.members, self.excesses(images), strict=True)
        return torch.stack([term.of_excess(excess) for term, excess in excesses]).sum()

    def excesses(self, images: Images, losses: Losses = ()) -> tuple[Float[Tensor, " _"], ...]:
        """Excess at the places of each limit."""
        picture = smoothed(images[self.members[0].limit.receiver])
        light = torch.mv(self.readings, picture.reshape(-1)).split([len(term.readings) for term in self.members])
        return tuple(term.excess(part, picture) for term, part in zip(self.members, light, strict=True))


def limit_terms(limits: Sequence[LightLimit], by_parts: bool = False) -> tuple[LimitTerm | JoinedTerms, ...]:
    """The terms of those ``limits`` that a search seeks to keep.

    Of those that intensities judge, which all are on the far field, one together.
    """
    limits = [limit for limit in limits if limit.quantity.searched]
    joined = [limit for limit in limits if limit.by_intensities]
    plain = (LimitTerm.of(limit, by_parts) for limit in limits if not limit.by_intensities)
    return (*plain, *([JoinedTerms.of(joined, by_parts)] if joined else []))
