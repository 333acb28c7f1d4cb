"""Glare rating of outdoor sports: CIE 112:1994."""

from dataclasses import dataclass

import numpy as np

from lensforge.optics.arrays import Array
from lensforge.results import Metric, Sense
from lensforge.results.estimates import debiased_maximum, jackknife_metric
from lensforge.spec.quantities import DARK, Quantity, Readings, not_dark

_OFFSET = 27.0
_DECADE = 24.0
_POWER = 0.9
_LEAST = 10.0  # the end of its scale, below which glare is not noticed


@dataclass(frozen=True)
class GlareRating(Quantity):
    """Rating 27 + 24 lg(L_vl/L_ve^0.9), the largest of all eyes.

    The last place is L_ve, the veil of the environment (cd/m²), the others are L_vl, that of the lamps.
    """

    words = "glare rating"

    def value(self, readings: Readings, sense: Sense, unit: str, whole: Readings) -> Metric:
        """The largest rating, 10 at least; its error has in it that of the environment's luminance."""
        around = jackknife_metric(readings[:, -1], float)
        if not around.value > 0.0:
            return Metric(value=DARK, unit=unit, standard_error=0.0)
        veil = debiased_maximum(readings[:, :-1])
        ratio = veil.value / around.value**_POWER
        if ratio <= 10.0 ** ((_LEAST - _OFFSET) / _DECADE):
            return Metric(value=_LEAST, unit=unit, standard_error=0.0)
        rating = Metric(value=_OFFSET + _DECADE * float(np.log10(ratio)), unit=unit)
        if veil.standard_error is None or around.standard_error is None:
            return rating
        relative = np.hypot(veil.standard_error / veil.value, _POWER * around.standard_error / around.value)
        return rating.changed(standard_error=float(_DECADE / np.log(10.0) * relative))

    def relative(self, light: Array, bound: float, whole: Array) -> Array:
        """L_vl over what the bound allows before L_ve."""
        return light[:-1] / (not_dark(light[-1]) ** _POWER * 10.0 ** ((bound - _OFFSET) / _DECADE))
