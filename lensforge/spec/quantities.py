"""Quantities that limits bound: figures of the light at some places, and how far a search is from their bounds.

A quantity is declared here once: its phrase, its value with its standard error, and the light of each place relative to
its bound, which gradients follow. Sections of a spec name the quantities that they bound.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float

from lensforge.optics.arrays import Array
from lensforge.results import Metric, Sense
from lensforge.results.estimates import (
    debiased_maximum,
    debiased_minimum,
    jackknife_metric,
    least_over_mean,
    ratio_of,
    scaled,
    with_error,
)
from lensforge.results.level_width import width_above

DARK = 1e6  # glare where there is no light, and what is over light of 0
Readings = Float[np.ndarray, "r k"]  # light at each place, by every replicate


def not_dark(scale: Array) -> Array:
    """``scale``; 1 where all is dark, so that light relative to it is defined."""
    return scale + (scale <= 0.0) * (1.0 - scale)


def held(scale: Array) -> Array:
    """``scale``, which gradients do not follow."""
    return scale if isinstance(scale, np.ndarray | float) else scale.detach()


def extreme(readings: Readings, sense: Sense) -> Metric:
    """The least reading for a lower bound, the largest for an upper one, without the noise that would choose it."""
    return debiased_minimum(readings) if sense == ">=" else debiased_maximum(readings)


class Quantity(ABC):
    """A figure of the light at ``k`` places.

    ``phrase``: its name on screens and pages. ``flux_power``: power of the flux of the source by which it grows.
    ``searched``: a search lowers what it lacks. ``of_view``: it is of what an eye sees, or of a body, ``of_losses``: of
    flux by cause, ``of_whole``: it compares places with the whole picture.
    """

    phrase: ClassVar[str]
    of_view: ClassVar[bool] = False
    of_losses: ClassVar[bool] = False
    of_whole: ClassVar[bool] = False
    is_share: ClassVar[bool] = False
    searched: ClassVar[bool] = True

    @property
    def flux_power(self) -> float:
        """Power of the flux of the source by which it grows."""
        return 0.0

    @abstractmethod
    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """The figure by every replicate of ``readings``; ``whole``: light on all pixels, where it is ``of_whole``."""

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """Light at each place that counts, NumPy or torch: 1 where the figure just has the value ``bound``."""
        raise NotImplementedError

    def at_least(self, sense: Sense) -> bool:
        """True where relative light is to be 1 at least."""
        return sense == ">="

    def counted(self, bound: float, sense: Sense) -> Bool[np.ndarray, " k"] | None:
        """Places that count for a ``bound``; None for all."""
        return None


class OfLight(Quantity):
    """A quantity in a unit of light, which grows as the flux of the source."""

    @property
    def flux_power(self) -> float:
        """Power of the flux of the source by which it grows."""
        return 1.0


@dataclass(frozen=True)
class PlaceLight(OfLight):
    """Light at the place that has least or most of it."""

    phrase = "light"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Least E for a lower bound, largest for an upper one."""
        return extreme(readings, sense).changed(unit=unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E / bound."""
        return light / bound


@dataclass(frozen=True)
class SpotLuminance(PlaceLight):
    """Luminance of the spot that an eye sees brightest."""

    phrase = "luminance of the brightest spot"
    of_view = True


@dataclass(frozen=True)
class MeanLuminance(PlaceLight):
    """Mean luminance that an eye sees."""

    phrase = "mean luminance over the outline"
    of_view = True


@dataclass(frozen=True)
class BodyLight(PlaceLight):
    """Light on the patch of a body that has least or most of it."""

    phrase = "light on the body"
    of_view = True


@dataclass(frozen=True)
class BodyMean(BodyLight):
    """Mean light on a body."""

    phrase = "mean light on the body"


@dataclass(frozen=True)
class MeanLight(OfLight):
    """Mean light."""

    phrase = "mean light"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Mean of all places."""
        return jackknife_metric(readings.mean(axis=1), float, unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """Mean E / bound."""
        return (light.mean() / bound)[None]


@dataclass(frozen=True)
class RelativeLight(Quantity):
    """Light over the largest of the whole picture."""

    phrase = "light relative to its maximum"
    of_whole = True

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """E / max E over the picture: at most 1."""
        return ratio_of(extreme(readings, sense), extreme(whole, "<="))

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E / (max E · bound); the largest light is held."""
        return light / (not_dark(held(whole).max()) * bound)


@dataclass(frozen=True)
class FluxShare(Quantity):
    """Share of the flux of the source, the sum of all readings."""

    phrase = "share of the flux"
    is_share = True

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Sum of the shares of all readings."""
        return jackknife_metric(readings.sum(axis=1), float)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """Shares / bound."""
        return light / bound


@dataclass(frozen=True)
class LostShare(FluxShare):
    """Share of the flux of the source that ends by one cause."""

    phrase = "lost share of the flux"
    of_losses = True


@dataclass(frozen=True)
class LeastOverMean(Quantity):
    """Least over mean light."""

    phrase = "min/mean of the light"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient min E / mean E."""
        return least_over_mean(readings).metric()

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E / (mean E · bound)."""
        return light / (not_dark(light.mean()) * bound)


@dataclass(frozen=True)
class LeastOverMost(Quantity):
    """Least over largest light."""

    phrase = "min/max of the light"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient min E / max E: at most 1."""
        return ratio_of(extreme(readings, ">="), extreme(readings, "<="))

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E / (max E · bound); the largest light is held."""
        return light / (not_dark(held(light).max()) * bound)


@dataclass(frozen=True)
class Contrast(Quantity):
    """Half the range of the light over the middle of that range: the non-uniformity of IEC 60904-9."""

    phrase = "(max − min)/(max + min) of the light"
    searched = False  # the range of few rays is noise: a search seeks even light by its relative variance

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient (1 - q)/(1 + q), with q = min E / max E."""
        quotient = ratio_of(extreme(readings, ">="), extreme(readings, "<="))
        whole_range = (1.0 - quotient.value) / (1.0 + quotient.value)
        return scaled(quotient, 2.0 / (1.0 + quotient.value) ** 2, "").changed(value=whole_range)


class _OverLeast(Quantity):
    """A quotient over the least light: at most so many times the least is at least that part of it."""

    def at_least(self, sense: Sense) -> bool:
        return True


@dataclass(frozen=True)
class MeanOverLeast(_OverLeast):
    """Mean over least light."""

    phrase = "mean/min of the light"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient mean E / min E."""
        return _inverse(least_over_mean(readings).metric())

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E · bound / mean E."""
        return light * bound / not_dark(light.mean())


@dataclass(frozen=True)
class MostOverLeast(_OverLeast):
    """Largest over least light."""

    phrase = "max/min of the light"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Quotient max E / min E."""
        return _inverse(ratio_of(extreme(readings, ">="), extreme(readings, "<=")))

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E · bound / max E; the largest light is held."""
        return light * bound / not_dark(held(light).max())


@dataclass(frozen=True)
class RatioOfTwo(Quantity):
    """Light at the first place over that at the second."""

    phrase = "ratio of means"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """E1 / E2; 0 where the second is dark."""
        return jackknife_metric(readings, lambda mean: float(mean[0] / mean[1]) if mean[1] > 0.0 else 0.0, unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """E1 / (E2 · bound)."""
        return light[:1] / (not_dark(light[1]) * bound)


@dataclass(frozen=True, eq=False)
class BeamAngle(Quantity):
    """Full angle between the outermost places of a cut at ``level`` of its maximum, linear between places.

    ``angles_deg``: of the places.
    """

    phrase = "beam angle"

    angles_deg: Float[np.ndarray, " k"]
    level: float

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Width of the mean cut above its level."""
        return jackknife_metric(readings, self._angle, unit)

    def _angle(self, light: Float[np.ndarray, " k"]) -> float:
        return width_above(self.angles_deg, light, self.level * float(light.max())) or 0.0

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """I / (level · max I); the largest intensity is held."""
        return light / (self.level * not_dark(held(light).max()))

    def counted(self, bound: float, sense: Sense) -> Bool[np.ndarray, " k"]:
        """Places within a least angle, whose light must be above the level, or outside of a largest one."""
        off = np.abs(self.angles_deg) - 0.5 * bound
        return off < 0.0 if sense == ">=" else off > 0.0


@dataclass(frozen=True)
class GlareLaw(Quantity):
    """Glare called ``words`` by the veiling luminance L_v (cd/m²) before a mean luminance L: factor L_v / L^power.

    The last place is the mean luminance, the others are veiling luminance. ``steps``: up to which L each factor and
    power holds.
    """

    phrase: str  # type: ignore[misc]  # of each law, not of the class
    steps: tuple[tuple[float, float, float], ...]

    def at(self, mean_cd_per_m2: float) -> tuple[float, float]:
        """Factor and power at a mean luminance."""
        return next((factor, power) for most, factor, power in self.steps if mean_cd_per_m2 <= most)

    @property
    def flux_power(self) -> float:
        """Power of the flux that it has in the dark."""
        return 1.0 - self.at(0.0)[1]

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Largest glare on the way; its error has in it that of the mean luminance."""
        mean = jackknife_metric(readings[:, -1], float)
        if not mean.value > 0.0:
            return Metric(value=DARK, unit=unit, standard_error=0.0)
        factor, power = self.at(mean.value)
        glare = scaled(debiased_maximum(readings[:, :-1]), factor / mean.value**power, unit)
        return with_error(glare, power * glare.value * (mean.standard_error or 0.0) / mean.value)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """L_v factor / (L^power · bound), by the law at L."""
        factor, power = self.at(float(held(light[-1])))
        return light[:-1] / (not_dark(light[-1]) ** power / factor * bound)


def _inverse(ratio: Metric) -> Metric:
    if not ratio.value > 1.0 / DARK:
        return Metric(value=DARK, standard_error=0.0)
    return scaled(ratio, ratio.value**-2, "")
