"""Glare rating of outdoor sports: CIE 112:1994."""

from dataclasses import dataclass
from math import inf

import numpy as np

from lensforge.optics.arrays import Array
from lensforge.results import Metric, Sense
from lensforge.results.estimates import scaled
from lensforge.spec.quantities import DARK, GlareLaw, Quantity, Readings

_OFFSET = 27.0
_DECADE = 24.0
_RATIO = GlareLaw("veiling luminance over that of the environment", ((inf, 1.0, 0.9),))
_LEAST = 10.0  # the end of its scale, below which glare is not noticed


@dataclass(frozen=True)
class GlareRating(Quantity):
    """Rating 27 + 24 lg(L_vl/L_ve^0.9), the largest of all eyes.

    The last place is L_ve, the veil of the environment (cd/m²), the others are L_vl, that of the lamps.
    """

    phrase = "glare rating"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """Largest rating, at least 10. Its error includes the uncertainty of the environment's luminance."""
        ratio = _RATIO.value(readings, sense, "", whole)
        if ratio.value >= DARK:
            return ratio.changed(unit=unit)
        if ratio.value <= 10.0 ** ((_LEAST - _OFFSET) / _DECADE):
            return Metric(value=_LEAST, unit=unit, standard_error=0.0)
        rating = _OFFSET + _DECADE * float(np.log10(ratio.value))
        slope = _DECADE / (np.log(10.0) * ratio.value)
        return scaled(ratio, slope, unit).changed(value=rating)

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """L_vl over what the bound allows before L_ve."""
        return _RATIO.relative(light, 10.0 ** ((bound - _OFFSET) / _DECADE), whole)
