"""Capability of a process: Cp and Cpk by ISO 22514-2, for scatter that is normal, with standard errors.

Those are A. F. Bissell's, Applied Statistics 39, 331 (1990): for Cpk the root of 1/(9 n) + Cpk^2/(2 nu), by the mean of
n parts and a standard deviation of nu degrees of freedom.
"""

from collections.abc import Sequence
from math import inf, sqrt

import numpy as np
from jaxtyping import Float

from lensforge.results import Metric

CAPABLE = 1.33  # customary: four standard deviations from mean to limit


def cp(width: float, deviation: Metric) -> Metric:
    """Cp of a figure that may lie anywhere in a zone of ``width``, by its standard deviation: width over six of it."""
    ratio = width / (6.0 * deviation.value)
    error = deviation.standard_error
    return Metric(value=ratio, standard_error=None if error is None else ratio * error / deviation.value)


def pooled(groups: Sequence[Float[np.ndarray, " _"]], unit: str = "") -> Metric:
    """Standard deviation within ``groups`` of parts. At least one group has two that differ."""
    freedom = sum(map(len, groups)) - len(groups)
    scatter = sqrt(sum(float(np.sum((group - group.mean()) ** 2)) for group in groups) / freedom)
    return Metric(value=scatter, unit=unit, standard_error=scatter / sqrt(2.0 * freedom))


def cpk(groups: Sequence[Float[np.ndarray, " _"]], most: float, least: float = -inf) -> Metric:
    """Cpk of a figure from ``least`` to ``most``: of the worst of the ``groups`` of parts, by their common scatter."""
    margins = [min(most - float(group.mean()), float(group.mean()) - least) for group in groups]
    worst = int(np.argmin(margins))
    freedom = sum(map(len, groups)) - len(groups)
    ratio = margins[worst] / (3.0 * pooled(groups).value)
    error = sqrt(1.0 / (9.0 * len(groups[worst])) + ratio**2 / (2.0 * freedom))
    return Metric(value=ratio, standard_error=error)
