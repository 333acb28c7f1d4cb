"""Light in the uniform region of a target, or where the target is bright, corrected for the noise of the rays."""

from typing import Annotated, Literal

import numpy as np
from jaxtyping import Bool, Float

from lensforge.results import Image, Metric, Record
from lensforge.results.estimates import debiased_maximum, debiased_minimum, jackknife_metric, least_over_mean, ratio_of
from lensforge.results.figure import Figure

Region = Literal["uniform", "bright"]
_BRIGHT = 0.5  # of the target's largest light: edges that fade are half outside
_REGIONS: dict[Region, str] = {
    "uniform": "in the region of uniform light",
    "bright": "where the target is above half of its maximum",
}


class RegionLight(Record):
    """Light in a region of a receiver.

    ``region``: "uniform", that of the target's ``uniform_mm`` or ``uniform_deg``; "bright" of other targets, where the
    target is above half of its maximum. ``mean``: W/m², in the far field W/sr. ``u0``: min/mean, ``u1``: min/max
    of the light (EN 12665). ``peak``: largest light on the receiver over the target's largest.
    """

    region: Region
    mean: Metric
    u0: Annotated[Metric, Figure("U0", "min/mean of the light {where}")]
    u1: Annotated[Metric, Figure("U1", "min/max of the light {where}")]
    peak: Annotated[Metric, Figure("Peak/target peak", "max. light/max. of the target, at equal flux")]

    @property
    def where(self) -> str:
        """Phrase for the region."""
        return _REGIONS[self.region]

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
        least = debiased_minimum(readings)
        largest = debiased_maximum(readings)
        scaled = images * (target.sum() / target.max() / images.sum(axis=(1, 2)))[:, None, None]
        return RegionLight(
            region="bright" if mask is None else "uniform",
            mean=jackknife_metric(means, float, unit),
            u0=least_over_mean(readings).metric(),
            u1=ratio_of(least, largest),
            peak=debiased_maximum(scaled.reshape(len(images), -1)),
        )


def bright_region(target: Image) -> Bool[np.ndarray, "h w"]:
    """Pixels where the target is above half of its maximum; pixels of exactly half, often on its edge, are not."""
    return target > _BRIGHT * (1.0 + 1e-9) * target.max()
