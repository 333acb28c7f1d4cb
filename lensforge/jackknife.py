"""Standard errors by the jackknife (Efron & Stein 1981), from replicates or from parts of a sample."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from lensforge.records import Metric


def jackknife(
    replicates: Float[np.ndarray, "r *shape"], statistic: Callable[[np.ndarray], float]
) -> tuple[float, float | None]:
    """``statistic`` of the mean over replicates, and its standard error (Efron & Stein 1981); None for one."""
    count = len(replicates)
    total = replicates.sum(axis=0)
    value = statistic(total / count)
    if count < 2:
        return value, None
    return value, jackknife_error(np.array([statistic((total - one) / (count - 1)) for one in replicates]))


def jackknife_metric(
    replicates: Float[np.ndarray, "r *shape"], statistic: Callable[[np.ndarray], float], unit: str = ""
) -> Metric:
    """:func:`jackknife` as a record."""
    value, error = jackknife(replicates, statistic)
    return Metric(value=value, unit=unit, standard_error=error)


def jackknife_error(left_out: Float[np.ndarray, " r"]) -> float:
    """Standard error of a statistic, from its values ``left_out`` with one replicate at a time left out."""
    count = len(left_out)
    return float(np.sqrt((count - 1) / count * np.sum((left_out - left_out.mean()) ** 2)))
