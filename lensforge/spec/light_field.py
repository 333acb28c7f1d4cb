"""The light field of a lamp that lights one place, as that of surgery (IEC 60601-2-41).

Its central illuminance is that in its middle. d10 and d50 are the diameters at which a tenth and half of it are left,
each a mean over four diameters, 45 degrees apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import cos, pi, sin
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.optics.arrays import Array, like
from lensforge.public import public
from lensforge.results import Metric, Sense
from lensforge.results.estimates import jackknife_metric
from lensforge.results.level_width import width_above
from lensforge.spec.light_limits import LIGHT_UNITS, Fraction, LimitSection, Places, ReceiverPicture
from lensforge.spec.quantities import OfLight, Quantity, Readings, held, not_dark
from lensforge.spec.spec_section import Coordinate, check
from lensforge.spec.target_sections import DegreesOff

_CUTS = 4
_WELL_INSIDE = 2.0  # relative light of places that do not count
Diameter = Annotated[float, Field(ge=1e-3, le=1e6)]


@dataclass(frozen=True, eq=False)
class _OfCuts(Quantity):
    """A figure of four cuts through the middle; ``radii``: places along each, the middle among them."""

    radii: Float[np.ndarray, " m"]

    @property
    def middle(self) -> int:
        """Number of the reading in the middle."""
        return len(self.radii) // 2

    def diameter(self, light: Float[np.ndarray, " k"], level: float) -> float:
        """Mean diameter at ``level`` of the light in the middle."""
        least = level * float(light[self.middle])
        cuts = light.reshape(_CUTS, -1)
        return float(np.mean([width_above(self.radii, cut, least) or 0.0 for cut in cuts]))

    def within(self, light: Array, diameter: float) -> Array:
        """1 at the places within the ``diameter``, else 0."""
        return like(light, np.tile(np.abs(self.radii) < 0.5 * diameter, _CUTS).astype(np.float64))


class CentralLight(_OfCuts, OfLight):
    """Light in the middle."""

    phrase = "central light"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Light of the middle."""
        return jackknife_metric(readings[:, self.middle], float, unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E of the middle / bound."""
        return light[self.middle : self.middle + 1] / bound


@dataclass(frozen=True, eq=False)
class FieldDiameter(_OfCuts):
    """Diameter at ``level`` of the light in the middle."""

    phrase = "diameter of the light field"

    level: float

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Mean of the widths of four cuts."""
        return jackknife_metric(readings, partial(self.diameter, level=self.level), unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E / (level · E of the middle), the latter held."""
        return light / (self.level * not_dark(held(light[self.middle])))

    def counted(self, bound: float, sense: Sense) -> np.ndarray:
        """Places within a least diameter, or outside of a largest one."""
        off = np.tile(np.abs(self.radii) - 0.5 * bound, _CUTS)
        return off < 0.0 if sense == ">=" else off > 0.0


class DepthOfEdge(_OfCuts):
    """Diameter at half over that at a tenth of the light in the middle."""

    phrase = "d50/d10"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient d50 / d10; 0 in the dark."""
        return jackknife_metric(readings, self._quotient)

    def _quotient(self, light: Float[np.ndarray, " k"]) -> float:
        wide = self.diameter(light, 0.1)
        return self.diameter(light, 0.5) / wide if wide > 0.0 else 0.0

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E / (0.5 · E of the middle) within bound · d10; E of the middle and d10 are held."""
        values = np.asarray(held(light))
        inside = self.within(light, bound * self.diameter(values, 0.1))
        return inside * light / (0.5 * not_dark(held(light[self.middle]))) + (1.0 - inside) * _WELL_INSIDE


@public
class LightFieldLimit(LimitSection):
    """Light in the middle of a lit place, and the diameters of its field (IEC 60601-2-41).

    ``d10``, ``d50``: at a tenth and at half of the light in the middle, each the mean of four diameters.
    """

    takes: ClassVar[tuple[str, ...]] = (
        "centre",
        *(f"at_{side}_{name}" for side in ("least", "most") for name in ("d10", "d50")),
        *LimitSection.takes,
    )
    others: ClassVar[Mapping[str, type[Quantity]]] = {
        f"{name}_{unit}": FieldDiameter for name in ("d10", "d50") for unit in ("mm", "deg")
    } | {"d50_over_d10": DepthOfEdge}

    kind: Literal["light_field"] = "light_field"
    centre_mm: tuple[Coordinate, Coordinate] | None = Field(
        default=None, description="Middle of the light field, by default on the axis."
    )
    centre_deg: tuple[DegreesOff, DegreesOff] | None = None
    at_least_d10_mm: Diameter | None = Field(default=None, description="Least diameter at a tenth.")
    at_most_d10_mm: Diameter | None = Field(default=None, description="Largest diameter at a tenth.")
    at_least_d50_mm: Diameter | None = Field(default=None, description="Least diameter at half.")
    at_most_d50_mm: Diameter | None = Field(default=None, description="Largest diameter at half.")
    at_least_d10_deg: Diameter | None = None
    at_most_d10_deg: Diameter | None = None
    at_least_d50_deg: Diameter | None = None
    at_most_d50_deg: Diameter | None = None
    at_least_d50_over_d10: Fraction | None = Field(
        default=None, description="Least quotient of both diameters: surgery requires 0.5."
    )

    @property
    def middle(self) -> tuple[float, float]:
        """Middle of the field."""
        centre: tuple[float, float] = self.length("centre") or (0.0, 0.0)
        return centre

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """The middle."""
        return (self.middle,)

    def read_at(self, picture: ReceiverPicture) -> Places:
        """Places along four diameters."""
        half = picture.half - float(np.hypot(*self.middle))
        radii = np.linspace(-half, half, picture.steps + 1)
        turns = np.array([(cos(k * pi / _CUTS), sin(k * pi / _CUTS)) for k in range(_CUTS)])
        return (np.array(self.middle) + turns[:, None, :] * radii[None, :, None]).reshape(-1, 2)

    def quantity(self, bounded: str, at: Places) -> Quantity:
        """Light in the middle, a diameter, or their quotient."""
        radii = at.reshape(_CUTS, -1, 2)[0, :, 0] - self.middle[0]
        if bounded in LIGHT_UNITS:
            return CentralLight(radii)
        if bounded == "d50_over_d10":
            return DepthOfEdge(radii)
        return FieldDiameter(radii, 0.1 if bounded.startswith("d10") else 0.5)

    @check
    def _is_no_share_of_the_peak(self) -> None:
        if self.unit == "relative":
            raise ValueError('unit = "relative": the light in the middle is a level; give lx, W/m², cd or W/sr')
