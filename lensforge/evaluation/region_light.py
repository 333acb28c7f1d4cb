"""Mean light of a region of a receiver, its evenness, and the peak, without the noise of the rays."""

from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from lensforge.evaluation.minimum import largest_without_noise, least_over_mean, least_without_noise, ratio_of
from lensforge.jackknife import jackknife_metric
from lensforge.records import Image, Metric, Record, Share

Region = Literal["uniform", "bright"]
_BRIGHT = 0.5  # of the target's largest light: edges that fade are half outside
_INNER = 0.9  # of the area of the region
REGIONS: dict[Region, str] = {
    "uniform": "in the region of uniform light",
    "bright": "where the target is above half of its maximum",
}


class RegionLight(Record):
    """Light in a region of a receiver.

    ``region``: "uniform", that of the target's ``uniform_mm`` or ``uniform_deg``; "bright" of other targets, where the
    target is above half of its maximum. ``mean``: W/m², in the far field W/sr. ``u0``: least over mean, ``u1``: least
    over largest light (EN 12665). ``inner``: least over mean in the region without its rim, which leaves
    ``inner_share`` of its area, about 0.9. ``peak``: largest light on the receiver over the target's largest.
    """

    region: Region
    mean: Metric
    u0: Metric
    u1: Metric
    inner: Metric
    inner_share: Share
    peak: Metric

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
        inner = inner_region(inside)
        scaled = images * (target.sum() / target.max() / images.sum(axis=(1, 2)))[:, None, None]
        return RegionLight(
            region="bright" if mask is None else "uniform",
            mean=jackknife_metric(means, float, unit),
            u0=least_over_mean(readings).metric(),
            u1=ratio_of(least, largest),
            inner=least_over_mean(images[:, inner]).metric(),
            inner_share=float(inner.sum() / inside.sum()),
            peak=largest_without_noise(scaled.reshape(len(images), -1)),
        )


def bright_region(target: Image) -> Bool[np.ndarray, "h w"]:
    """Pixels where the target is above half of its maximum; those on its edge, which often have just half, are not."""
    inside: Bool[np.ndarray, "h w"] = target > _BRIGHT * (1.0 + 1e-9) * target.max()
    return inside


def inner_region(inside: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """``inside`` without its rim: the pixels at least so far from those outside that 90 % are left, or nearest to that.

    Distances are those of pixel centres, in pixels; all beyond the edge of the picture is outside.
    """
    from scipy.ndimage import distance_transform_edt

    distance = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
    steps, counts = np.unique(distance[inside], return_counts=True)
    left = counts[::-1].cumsum()[::-1] / counts.sum()
    inner: Bool[np.ndarray, "h w"] = distance >= steps[np.abs(left - _INNER).argmin()]
    return inner
