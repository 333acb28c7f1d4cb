"""Light at the brightest place, and so far above it: places that move with the light, as those of a bicycle lamp."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.optics.arrays import Array
from lensforge.public import public
from lensforge.results import Metric, Sense
from lensforge.results.estimates import debiased_maximum
from lensforge.spec.light_limits import LIGHT_UNITS, LimitSection, Places
from lensforge.spec.quantities import OfLight, Quantity, Readings, held
from lensforge.spec.spec_section import check

_Up = Annotated[float, Field(ge=1e-3, le=1e6)]


@dataclass(frozen=True, eq=False)
class PeakLight(OfLight):
    """Light of the brightest place."""

    phrase = "light of the brightest place"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Largest E, without the noise that would choose it."""
        return debiased_maximum(readings).changed(unit=unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E / bound at the brightest place, which is held."""
        brightest = int(np.asarray(held(light)).argmax())
        return light[brightest : brightest + 1] / bound


@dataclass(frozen=True, eq=False)
class AbovePeak(PeakLight):
    """Largest light ``up`` above the brightest place, and farther; ``heights``: y of all places."""

    phrase = "light above the brightest place"
    searched = False  # until the pattern is there its places jump: the target says where it is to be dark

    heights: Float[np.ndarray, " k"]
    up: float

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Largest E above; 0 where the picture ends below."""
        above = self._above(readings.mean(axis=0))
        if not above.any():
            return Metric(value=0.0, unit=unit, standard_error=0.0)
        return debiased_maximum(readings[:, above]).changed(unit=unit)

    def _above(self, light: Float[np.ndarray, " k"]) -> np.ndarray:
        return np.asarray(self.heights >= self.heights[int(light.argmax())] + self.up)


@public
class PeakLimit(LimitSection):
    """Light at the brightest place of a receiver, or everywhere ``up_mm`` (``up_deg``) above it and higher."""

    takes: ClassVar[tuple[str, ...]] = ("up", *LimitSection.takes)

    kind: Literal["peak"] = "peak"
    up_mm: _Up | None = Field(
        default=None, description="Height above the brightest place, along y, from which on all places count."
    )
    up_deg: _Up | None = None

    @property
    def places(self) -> tuple[tuple[float, float], ...]:
        """None: they move with the light."""
        return ()

    def reads_as(self, other: LimitSection) -> bool:
        """True for another limit at the brightest place, or for one above it."""
        return super().reads_as(other) and (self.length("up") is None) == (other.length("up") is None)

    def quantity(self, bounded: str, at: Places) -> Quantity:
        """Light at the brightest place, or above it."""
        up = self.length("up")
        return PeakLight() if up is None else AbovePeak(at[:, 1], up)

    @check
    def _bounds_light(self) -> None:
        if self.unit not in LIGHT_UNITS or self.unit == "relative":
            raise ValueError("unit: the brightest place is bounded in lx, cd, W/m² or W/sr")
        if self.length("up") is not None and self.at_least is not None:
            raise ValueError("light above the brightest place has a largest value; give at_most")
