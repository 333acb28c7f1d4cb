"""Mean light of a region of a receiver, and its uniformities U0 and U1, without the noise of the rays."""

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from lensforge.evaluation.minimum import largest_without_noise, least_over_mean, least_without_noise, ratio_of
from lensforge.jackknife import jackknife_metric
from lensforge.records import Image, Metric, Record

Region = Literal["uniform", "bright"]
_BRIGHT = 0.5  # of the target's largest light: edges that fade are half outside
REGIONS: dict[Region, str] = {
    "uniform": "in the region of uniform light",
    "bright": "where the target is above half of its maximum",
}


class RegionLight(Record):
    """Light in a region of a receiver.

    ``region``: "uniform", that of the target's ``uniform_mm`` or ``uniform_deg``; "bright" of other targets, where the
    target is above half of its maximum. ``mean``: W/m², in the far field W/sr. ``u0``: least over mean, ``u1``: least
    over largest light (EN 12665).
    """

    region: Region
    mean: Metric
    u0: Metric
    u1: Metric

    @staticmethod
    def of(
        images: Float[np.ndarray, "r h w"], target: Image, mask: Bool[np.ndarray, "h w"] | None, unit: str
    ) -> "RegionLight | None":
        """Figures of filtered ``images`` in ``mask``, or where the ``target`` is bright; None in the dark."""
        inside = bright_region(target) if mask is None else mask
        readings = images[:, inside]
        means = readings.mean(axis=1)
        if not (means > 0.0).all():
            return None
        least, largest = least_without_noise(readings), largest_without_noise(readings)
        return RegionLight(
            region="bright" if mask is None else "uniform",
            mean=jackknife_metric(means, float, unit),
            u0=least_over_mean(readings).metric(),
            u1=ratio_of(least, largest),
        )


def bright_region(target: Image) -> Bool[np.ndarray, "h w"]:
    """Pixels where the target is above half of its maximum; those on its edge, which often have just half, are not."""
    inside: Bool[np.ndarray, "h w"] = target > _BRIGHT * (1.0 + 1e-9) * target.max()
    return inside
