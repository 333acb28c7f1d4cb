"""The cut-off of a headlamp: how sharp its edge is (UN Regulations 112 and 149).

Along a vertical line the gradient is G = max over v of log10 I(v) - log10 I(v + 0.1°).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.optics.arrays import Array, module_of
from lensforge.public import public
from lensforge.results import Metric, Sense
from lensforge.results.estimates import jackknife_metric
from lensforge.spec.light_limits import LimitSection, Places, ReceiverPicture
from lensforge.spec.quantities import Quantity, Readings, held
from lensforge.spec.spec_section import check
from lensforge.spec.target_sections import DegreesOff

_SHIFT_DEG = 0.1
_STEPS = 4  # places in a shift
_FAINT = 1e-9  # of the largest intensity: below, it is dark
Gradient = Annotated[float, Field(gt=0.0, le=10.0)]


@dataclass(frozen=True)
class CutOffGradient(Quantity):
    """Largest gradient along a line from below to above the cut-off."""

    phrase = "gradient G of the cut-off"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Largest log10 I(v) / I(v + 0.1°) of the mean light; 0 in the dark."""
        return jackknife_metric(readings, lambda light: float(_falls(light).max()) if light.max() > 0.0 else 0.0)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """G / bound where the gradient is largest, a place that is held."""
        falls = _falls(light)
        steepest = int(np.asarray(held(falls)).argmax())
        return falls[steepest : steepest + 1] / bound


def _falls(light: Float[Array, " k"]) -> Float[Array, " n"]:
    module = module_of(light)
    faint = _FAINT * held(light).max() + np.finfo(np.float64).tiny
    logs = module.log10(light + faint)
    return logs[:-_STEPS] - logs[_STEPS:]


@public
class CutOffLimit(LimitSection):
    """Gradient G of a cut-off, along a vertical line between two heights (UN Regulation 149).

    The cut-off is where the intensity falls fastest upwards. Pixels of the far field are to be finer than 0.1 degrees.
    """

    others: ClassVar[Mapping[str, type[Quantity]]] = {"gradient": CutOffGradient}
    far_field_only: ClassVar[bool] = True

    kind: Literal["cut_off"] = "cut_off"
    across_deg: DegreesOff = Field(default=-2.5, description="Place of the line along x.")
    from_deg: DegreesOff = Field(default=-3.0, description="Lower end of the line, along y.")
    to_deg: DegreesOff = Field(default=1.0, description="Its upper end.")
    at_least_gradient: Gradient | None = Field(default=None, description="Least gradient: 0.13 by UN R149.")
    at_most_gradient: Gradient | None = Field(default=None, description="Largest gradient: 0.40 by UN R149.")

    @property
    def given_unit(self) -> Literal["deg"]:
        """Degrees: it is of the far field."""
        return "deg"

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """Both ends."""
        return ((self.across_deg, self.from_deg), (self.across_deg, self.to_deg))

    def read_at(self, picture: ReceiverPicture) -> Places:
        """Places so close that whole steps make the shift of the gradient."""
        count = ceil((self.to_deg - self.from_deg) / (_SHIFT_DEG / _STEPS)) + 1
        heights = self.from_deg + np.arange(count) * (_SHIFT_DEG / _STEPS)
        return np.stack([np.full(count, self.across_deg), heights], axis=1)

    @check
    def _has_a_line(self) -> None:
        if self.to_deg - self.from_deg < 2.0 * _SHIFT_DEG:
            raise ValueError(
                f"to_deg = {self.to_deg:g} is not above from_deg = {self.from_deg:g}; the cut-off is between"
            )
        if self.unit is not None:
            raise ValueError("a cut-off is bounded by at_least_gradient and at_most_gradient")
