"""Metrics of a pattern, and their standard errors by the jackknife over replicates."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from lensforge.records import Image, Metric


def nmse(irradiance: Image, target: Image) -> float:
    """Eq. (7), with the target scaled to the flux of ``irradiance``: it measures the shape, efficiency the amount.

    1 for a dark image, as for a target that is not scaled.
    """
    total = irradiance.sum()
    if not total > 0.0:
        return 1.0
    wanted = target * (total / target.sum())
    return float(np.sum((irradiance - wanted) ** 2) / np.sum(wanted**2))


def uniformity(irradiance: Image, mask: Bool[np.ndarray, "h w"]) -> float:
    """Least over mean irradiance inside ``mask``."""
    inside = irradiance[mask]
    return float(inside.min() / inside.mean()) if inside.mean() > 0.0 else 0.0


def relative_deviation(irradiance: Image, mask: Bool[np.ndarray, "h w"]) -> float:
    """RSD: standard deviation over mean inside ``mask``."""
    inside = irradiance[mask]
    return float(inside.std() / inside.mean()) if inside.mean() > 0.0 else 0.0


def relative_square(both: Float[np.ndarray, "2 h w"]) -> float:
    """NMSE between two pictures without scaling: mean square difference over that of the second; 0 where it is dark."""
    reference = float(np.sum(both[1] ** 2))
    return float(np.sum((both[0] - both[1]) ** 2)) / reference if reference > 0.0 else 0.0


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
