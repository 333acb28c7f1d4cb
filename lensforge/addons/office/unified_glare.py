"""Unified glare rating: CIE 117:1995, eq. 4.1."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.optics.arrays import Array
from lensforge.results import Metric, Sense
from lensforge.results.estimates import jackknife_metric
from lensforge.spec.quantities import DARK, Quantity, Readings, not_dark

_FACTOR = 0.25
_DECADE = 8.0  # by which the rating grows where the sum does tenfold
_LEAST = 0.0  # below 10 it says nothing


@dataclass(frozen=True)
class UnifiedGlare(Quantity):
    """Rating 8 lg(0.25/L_b sum of L² ω/p²): the last place is L_b (cd/m²), the others are the roots of L² ω/p²."""

    phrase = "unified glare rating"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """The rating of the mean light; 0 at least, and of lamps that are dark the largest."""
        return jackknife_metric(readings, _rating, unit)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """The sum over the one that the bound allows."""
        glare = _FACTOR * (light[:-1] ** 2).sum() / not_dark(light[-1])
        return glare.reshape(1) / 10.0 ** (bound / _DECADE)


def _rating(light: Float[np.ndarray, " k"]) -> float:
    if not light[-1] > 0.0:
        return DARK
    glare = _FACTOR * float((light[:-1] ** 2).sum() / light[-1])
    return _DECADE * float(np.log10(glare)) if glare > 10.0 ** (_LEAST / _DECADE) else _LEAST
