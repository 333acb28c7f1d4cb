"""Roughness of faces as the reference tracer has it, in torch: normals of facets, and light that is spread by rings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from lensforge.optics.dielectric import fields_behind
from lensforge.optics.scattering import GaussianFacets, RingScatter
from lensforge.scene.rough_faces import Keys, Roughness, numbers_again

Vectors = Float[Tensor, "n 3"]
Values = Float[Tensor, " n"]

_HALVINGS = 60
_WIDEST = 1.2  # of what is seen over the greater of 0 and the number that is drawn
_NEARLY_ALONG = 1e-4  # of rms slope and tangent of incidence: below it a series is closer than a difference


class Meeting(NamedTuple):
    """Number of the face that rays meet, how often each has met it before, and the rays' own numbers."""

    face: int
    times: Int[Tensor, " n"]
    numbers: Int[Tensor, " n"]

    def take(self, rows: Tensor) -> "Meeting":
        """Select rays by row."""
        return self._replace(times=self.times[rows], numbers=self.numbers[rows])


class Ahead(NamedTuple):
    """Cosine of incidence, and unit normals away from the origin and to the side of the light behind the face."""

    cosine: Values
    outward: Vectors
    normals: Vectors


@dataclass(frozen=True)
class ReferenceRoughness:
    """Roughness, as ``scene.rough_faces`` has it: noise and slopes of facets, models of rings and their numbers."""

    facet: tuple[Float[Tensor, "n m"], Float[Tensor, " f"]] | None
    rings: Float[Tensor, "n m"] | None
    models: tuple[GaussianFacets | RingScatter | None, ...]
    keys: Keys | None

    @staticmethod
    def of(
        rough: Roughness,
        models: Sequence[GaussianFacets | RingScatter | None],
        to_device: Callable[[np.ndarray], Tensor],
    ) -> "ReferenceRoughness":
        """Tensors from arrays; ``models``: of the faces; ``to_device``: moves an array to the device of the rays."""
        facet = (
            None if rough.noise is None or rough.slopes is None else (to_device(rough.noise), to_device(rough.slopes))
        )
        rings = None if rough.shifts is None else to_device(rough.shifts.numbers)
        return ReferenceRoughness(facet, rings, tuple(models), rough.keys)

    def facets(self, normals: Vectors, directions: Vectors, met: Meeting) -> Vectors:
        """Unit normals of the facets that light meets on a face with these ``normals`` away from the origin."""
        unit: Tensor = normalize(normals, dim=1)
        if self.facet is None:
            return unit
        noise, slopes = self.facet
        rms = slopes[met.face]
        normal = noise[met.numbers, 2 * met.face : 2 * met.face + 2]
        numbers = self._repeated_numbers(met)
        length = torch.sqrt(-2.0 * torch.log1p(-numbers[:, 0]))
        turn = 2.0 * torch.pi * numbers[:, 1]
        later = torch.stack([length * torch.cos(turn), length * torch.sin(turn)], dim=1)
        drawn = rms * torch.where(met.times[:, None] > 0, later, normal)
        tilt = _on_face(torch.complex(drawn[:, 0], drawn[:, 1]), unit)
        c = (directions * unit).sum(dim=1, keepdim=True)
        seen = _seen(rms, c, (directions * tilt).sum(dim=1, keepdim=True))
        return normalize(unit + tilt + seen * (directions - c * unit), dim=1)

    def spread(
        self, directions: Vectors, fields: Complex[Tensor, "n 2 3"], ahead: Ahead, met: Meeting
    ) -> tuple[Vectors, Complex[Tensor, "n 2 3"]]:
        """Directions and fields behind a face, from those behind a polished one."""
        model = self.models[met.face]
        if self.rings is None or not isinstance(model, RingScatter):
            return directions, fields
        first = self.rings[met.numbers, 2 * met.face : 2 * met.face + 2]
        n = ahead.normals
        numbers = torch.where(met.times[:, None] > 0, self._repeated_numbers(met), first)
        shift = _amount(model, numbers[:, 0], ahead.cosine)[:, None]
        keep = float(model.follows)
        turn = 2.0 * torch.pi * numbers[:, 1]
        shifted = shift * _on_face(torch.complex(torch.cos(turn), torch.sin(turn)), ahead.outward)
        t = shifted + keep * (directions - (directions * n).sum(dim=1, keepdim=True) * n)
        squared = (t * t).sum(dim=1, keepdim=True)
        t = torch.where(squared > 1.0, t / squared.clamp(min=1.0), t)
        to = t + torch.sqrt((1.0 - (t * t).sum(dim=1, keepdim=True)).clamp(min=1e-18)) * n
        to = torch.where(shift > 0.0, to, directions)
        whole = torch.ones_like(turn), torch.zeros_like(turn)
        return to, fields_behind(fields, directions, to, n, whole)

    def _repeated_numbers(self, met: Meeting) -> Float[Tensor, "n 2"]:
        """Random numbers for rays that have met the face before; 0 for the others."""
        drawn = torch.zeros((len(met.numbers), 2), dtype=torch.float64)
        rows = torch.nonzero(met.times.cpu() > 0)[:, 0]
        if self.keys is not None and len(rows):
            keys = self.keys[met.numbers.cpu()[rows].numpy()]
            times = met.times.cpu()[rows].numpy()
            drawn[rows] = torch.from_numpy(numbers_again(keys, met.face, times))
        return drawn.to(met.numbers.device)


def _on_face(slope: Complex[Tensor, " n"], normals: Vectors) -> Vectors:
    """Vectors turned with the frame that takes z to the unit ``normals``."""
    x, y = slope.real, slope.imag
    along = (x * normals[:, 0] + y * normals[:, 1]) / (1.0 + normals[:, 2])
    return torch.stack([x - along * normals[:, 0], y - along * normals[:, 1], -along * (1.0 + normals[:, 2])], dim=1)


def _seen(rms: Float[Tensor, ""], c: Float[Tensor, "n 1"], along: Float[Tensor, "n 1"]) -> Float[Tensor, "n 1"]:
    """Visible slope less drawn slope along the light, over the sine of incidence.

    ``along``: the slope that is drawn, times that sine. The number a of the slope over its rms becomes x, below which
    the same share of the density (k + x) exp(-x^2/2) lies.
    """
    sign = torch.where(c > 0.0, 1.0, -1.0).to(c.dtype)
    cosine = sign * c
    drawn = sign * along
    squared = (1.0 - c**2).clamp(min=0.0)
    nearly = rms * torch.sqrt(squared) <= _NEARLY_ALONG * cosine
    a, w = (torch.where(nearly, values, 0.0) / torch.where(nearly, cosine, 1.0) for values in (drawn, 0.0 * c + rms))
    series = rms * w * (1.0 - 0.5 * a + (a**2 - w**2 * squared) / 3.0)
    sine = torch.sqrt(torch.where(nearly, 1.0, squared))
    width = rms * torch.where(nearly, 1.0, sine)
    width = torch.where(width > 0.0, width, 1.0)
    number = torch.where(nearly, 0.0, drawn) / width
    cotangent = torch.where(nearly, 1.0, cosine) / width
    return sign * torch.where(nearly, series, rms * (_seen_number(number, cotangent) - number) / sine)


def _seen_number(a: Float[Tensor, "n 1"], k: Float[Tensor, "n 1"]) -> Float[Tensor, "n 1"]:
    """The visible number x, by bisection; its derivatives are those of one Newton step."""
    with torch.no_grad():
        low = torch.maximum(a, -k)
        high = a.clamp(min=0.0) + _WIDEST
        for _ in range(_HALVINGS):
            x = 0.5 * (low + high)
            less = _missing(x, a, k) > 0.0
            low = torch.where(less, x, low)
            high = torch.where(less, high, x)
        density = (k + x) * _bell(x)
    return x + _missing(x, a, k) / density


def _missing(x: Tensor, a: Tensor, k: Tensor) -> Tensor:
    """Deficit of visible light below x, computed from the smaller of both tails."""
    area = k * torch.special.ndtr(k) + _bell(k)
    above = k * torch.special.ndtr(-x) + _bell(x) - area * torch.special.ndtr(-a)
    below = area * torch.special.ndtr(a) - k * (torch.special.ndtr(x) - torch.special.ndtr(-k)) - _bell(k) + _bell(x)
    return torch.where(a > 0.0, above, below)


def _bell(x: Tensor) -> Tensor:
    return torch.exp(-0.5 * x**2) / (2.0 * torch.pi) ** 0.5


def _amount(model: RingScatter, numbers: Values, cosine: Values) -> Values:
    """Amount of each shift at the cosine of incidence, interpolated linearly."""
    amounts = torch.from_numpy(model.amounts(numbers.cpu().numpy())).to(numbers.device)
    cosines = torch.tensor(model.cosines, dtype=torch.float64, device=numbers.device)
    if len(cosines) == 1:
        return amounts[:, 0]
    place = torch.searchsorted(cosines, cosine.detach().contiguous()).clamp(1, len(cosines) - 1)
    low, high = (amounts.gather(1, (place - back)[:, None])[:, 0] for back in (1, 0))
    share = (cosine - cosines[place - 1]) / (cosines[place] - cosines[place - 1])
    return low + share.clamp(0.0, 1.0) * (high - low)
