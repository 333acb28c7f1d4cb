"""Light of a projected picture by its nine and thirteen points (ISO/IEC 21118; ANSI IT7.228).

The nine are the centres of nine equal rectangles of the picture; four more lie a tenth of the way from each corner to
its centre.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.optics.arrays import Array
from lensforge.public import public
from lensforge.results import Metric, Sense
from lensforge.results.estimates import debiased_maximum, debiased_minimum, jackknife_metric
from lensforge.spec.light_limits import LIGHT_UNITS, Fraction, LimitSection, Places, ReceiverPicture
from lensforge.spec.quantities import OfLight, Quantity, Readings, not_dark
from lensforge.spec.spec_section import Coordinate, Millimetres, check
from lensforge.spec.target_sections import DegreesOff, DegreesWide

_NINE = np.array([(x / 3.0, y / 3.0) for y in (1.0, 0.0, -1.0) for x in (-1.0, 0.0, 1.0)])  # of half the size
_CORNERS = np.array([(x * 0.9, y * 0.9) for y in (1.0, -1.0) for x in (-1.0, 1.0)])


@dataclass(frozen=True)
class MeanOfNine(OfLight):
    """Mean light of the nine points."""

    phrase = "mean light of nine points"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Mean of the nine."""
        return jackknife_metric(readings[:, :9].mean(axis=1), float, unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """Mean of the nine / bound."""
        return (light[:9].mean() / bound)[None]


@dataclass(frozen=True)
class LeastOverNine(Quantity):
    """Least light of the thirteen points over the mean of the nine."""

    phrase = "min of 13 points/mean of 9"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient min E13 / mean E9."""
        return debiased_minimum(_over_nine(readings), np.inf)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E13 / (mean E9 · bound)."""
        return light / (not_dark(light[:9].mean()) * bound)


@dataclass(frozen=True)
class MostOverNine(LeastOverNine):
    """Largest light of the thirteen points over the mean of the nine."""

    phrase = "max of 13 points/mean of 9"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient max E13 / mean E9."""
        return debiased_maximum(_over_nine(readings), 0.0)


def _over_nine(readings: Readings) -> Float[np.ndarray, "r k"]:
    means = readings[:, :9].mean(axis=1, keepdims=True)
    return np.asarray(readings / np.where(means > 0.0, means, 1.0))


@public
class ScreenLimit(LimitSection):
    """Light of a projected picture by nine and thirteen points (ISO/IEC 21118).

    Its light is the mean of the nine; that times the area of the picture is the light output of a projector (lm).
    """

    needs: ClassVar[tuple[str, ...]] = ("width", "height")
    takes: ClassVar[tuple[str, ...]] = ("centre", *LimitSection.takes)
    others: ClassVar[Mapping[str, type[Quantity]]] = {"min_over_mean": LeastOverNine, "max_over_mean": MostOverNine}

    kind: Literal["screen"] = "screen"
    width_mm: Millimetres | None = Field(default=None, description="Width of the picture on a surface.")
    width_deg: DegreesWide | None = None
    height_mm: Millimetres | None = Field(default=None, description="Height of the picture on a surface.")
    height_deg: DegreesWide | None = None
    centre_mm: tuple[Coordinate, Coordinate] | None = Field(
        default=None, description="Centre of the picture, by default on the axis."
    )
    centre_deg: tuple[DegreesOff, DegreesOff] | None = None
    at_least_min_over_mean: Fraction | None = Field(
        default=None, description="Smallest allowed light of the 13 points over the mean of the nine."
    )
    at_most_max_over_mean: Annotated[float, Field(ge=1.0, le=100.0)] | None = Field(
        default=None, description="Largest allowed light of the 13 points over the mean of the nine."
    )

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """The thirteen points."""
        half = 0.5 * np.array([self.length("width"), self.length("height")])
        shifted = np.concatenate([2.0 * _NINE, _CORNERS]) * half + np.array(self.length("centre") or (0.0, 0.0))
        return tuple((float(x), float(y)) for x, y in shifted)

    def read_at(self, picture: ReceiverPicture) -> Places:
        """The thirteen points, the nine first."""
        return np.array(self.places)

    def quantity(self, bounded: str, at: Places) -> Quantity:
        """The mean of the nine, or a quotient over it."""
        return MeanOfNine() if bounded in LIGHT_UNITS else super().quantity(bounded, at)

    @check
    def _is_no_share_of_the_peak(self) -> None:
        if self.unit == "relative":
            raise ValueError('unit = "relative": the light of nine points is a mean; give at_least_min_over_mean')
