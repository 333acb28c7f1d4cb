"""Roughness of faces as the reference tracer has it, in torch: normals of facets, and light that is spread by rings."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Complex, Float, Int
from torch import Tensor
from torch.nn.functional import normalize

from lensforge.optics.dielectric import fields_behind
from lensforge.scene.rough_faces import Roughness

Vectors = Float[Tensor, "n 3"]
Values = Float[Tensor, " n"]


class Meeting(NamedTuple):
    """Number of the face that rays meet at an event, and their own."""

    face: int
    event: int
    numbers: Int[Tensor, " n"]

    def take(self, rows: Tensor) -> "Meeting":
        """Some of the rays."""
        return self._replace(numbers=self.numbers[rows])


class Ahead(NamedTuple):
    """Cosine of incidence, and unit normals away from the origin and to the side of the light behind the face."""

    cosine: Values
    outward: Vectors
    normals: Vectors


@dataclass(frozen=True)
class ReferenceRoughness:
    """Roughness, as ``scene.rough_faces`` has it: noise and slopes of facets; shifts and their cosines."""

    facet: tuple[Float[Tensor, "n m"], Float[Tensor, " f"]] | None
    shifts: tuple[Float[Tensor, "n f w"], Float[Tensor, "f k"]] | None

    @staticmethod
    def of(rough: Roughness, there: Callable[[np.ndarray], Tensor]) -> "ReferenceRoughness":
        """Tensors of arrays; ``there``: to the device of the rays."""
        facet = None if rough.noise is None or rough.slopes is None else (there(rough.noise), there(rough.slopes))
        shifts = None if rough.shifts is None else (there(rough.shifts.rays), there(rough.shifts.cosines))
        return ReferenceRoughness(facet, shifts)

    def facets(self, normals: Vectors, directions: Vectors, met: Meeting) -> Vectors:
        """Unit normals of the facets that light meets on a face of these ``normals`` away from the origin."""
        unit: Tensor = normalize(normals, dim=1)
        if self.facet is None:
            return unit
        noise, slopes = self.facet
        x, y = (slopes[met.face] * noise[met.numbers, 2 * met.face + axis] for axis in (0, 1))
        c, squared = (directions * unit).sum(dim=1, keepdim=True), slopes[met.face] ** 2
        across = torch.sqrt(c**2 + 2.0 / torch.pi * squared * (1.0 - c**2) + 1e-30)
        seen = torch.sign(c) * squared / across * (directions - c * unit)  # their mean: light sees more of some
        return normalize(unit + seen + _on_face(torch.complex(x, y), unit, met), dim=1)

    def spread(
        self, directions: Vectors, fields: Complex[Tensor, "n 2 3"], ahead: Ahead, met: Meeting
    ) -> tuple[Vectors, Complex[Tensor, "n 2 3"]]:
        """Directions and fields behind a face, from those behind a polished one."""
        if self.shifts is None:
            return directions, fields
        rows, n = self.shifts[0][met.numbers, met.face], ahead.normals
        shift, keep = _amount(rows[:, 3:], self.shifts[1][met.face], ahead.cosine), rows[:, 2:3]
        shifted = _on_face(shift * torch.complex(rows[:, 0], rows[:, 1]), ahead.outward, met)
        t = shifted + keep * (directions - (directions * n).sum(dim=1, keepdim=True) * n)
        squared = (t * t).sum(dim=1, keepdim=True)
        t = torch.where(squared > 1.0, t / squared.clamp(min=1.0), t)
        to = t + torch.sqrt((1.0 - (t * t).sum(dim=1, keepdim=True)).clamp(min=1e-18)) * n
        to = torch.where((keep != 1.0) | (shift[:, None] != 0.0), to, directions)
        whole = torch.ones_like(shift), torch.zeros_like(shift)
        return to, fields_behind(fields, directions, to, n, whole)


def _on_face(slope: Complex[Tensor, " n"], normals: Vectors, met: Meeting) -> Vectors:
    """Vectors on faces with these unit ``normals`` away from the origin; a right angle on each time a face is met."""
    slope = slope * 1j ** (met.event - met.face)
    x, y = slope.real, slope.imag
    along = (x * normals[:, 0] + y * normals[:, 1]) / (1.0 + normals[:, 2])
    return torch.stack([x - along * normals[:, 0], y - along * normals[:, 1], -along * (1.0 + normals[:, 2])], dim=1)


def _amount(amounts: Float[Tensor, "n k"], cosines: Float[Tensor, " k"], cosine: Values) -> Values:
    """Amount of each shift at the cosine of incidence, even between those that are given."""
    if len(cosines) == 1:
        return amounts[:, 0]
    place = torch.searchsorted(cosines, cosine.detach().contiguous()).clamp(1, len(cosines) - 1)
    low, high = (amounts.gather(1, (place - back)[:, None])[:, 0] for back in (1, 0))
    share = (cosine - cosines[place - 1]) / (cosines[place] - cosines[place - 1])
    return low + share.clamp(0.0, 1.0) * (high - low)
