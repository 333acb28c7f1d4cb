"""Metrics of a pattern."""

import numpy as np
from jaxtyping import Bool, Float

from lensforge.records import Image


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
