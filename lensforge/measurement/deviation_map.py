"""Map of a form deviation over the chart of a face, and its extent over the area of the face.

Mean squares are over the area: the sum over the samples of the chart inside the rim, each with the area element of the
face there times the area of its cell. On 201 x 201 samples the mean square of a smooth deviation is exact to 1e-4.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.geometry.patch import Patch
from lensforge.measurement.comparison import DeviationExtent
from lensforge.surfaces.chart import to_sphere

Radius = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]

_PIXELS = 201


@dataclass(frozen=True)
class DeviationMap:
    """Deviation along the normal (um) at chart coordinates ``axis`` x ``axis``, [Y, X], NaN outside the rim.

    ``area_mm2``: area of the face that each sample stands for.
    """

    axis: Float[np.ndarray, " m"]
    deviation_um: Float[np.ndarray, "m m"]
    area_mm2: Float[np.ndarray, "m m"]

    @property
    def extent(self) -> DeviationExtent:
        """Extent over the face, its mean square by area."""
        inside = np.isfinite(self.deviation_um)
        return extent_of(self.deviation_um[inside], self.area_mm2[inside])


def map_deviation(patch: Patch, deviation: Radius) -> DeviationMap:
    """Map the radial ``deviation`` (mm) from ``patch`` as a function of unit directions, projected on the normal."""
    axis = np.linspace(-1.0, 1.0, _PIXELS)
    chart = np.stack(np.meshgrid(axis, axis), axis=-1)
    inside = np.sum(chart**2, axis=-1) <= 1.0
    directions, jet = to_sphere(chart[inside]), patch.jet(chart[inside])
    height, area = np.full((2, *inside.shape), np.nan)
    height[inside] = 1e3 * deviation(directions) * np.sum(jet.normal * directions, axis=1)
    area[inside] = jet.area_element * (axis[1] - axis[0]) ** 2
    return DeviationMap(axis, height, area)


def extent_of(values: Float[np.ndarray, " n"], areas: Float[np.ndarray, " n"] | None = None) -> DeviationExtent:
    """Extent of ``values``; the mean square is weighted by ``areas``, or each value counts once."""
    return DeviationExtent(
        pv=float(np.ptp(values)),
        rms=float(np.sqrt(np.average(values**2, weights=areas))),
        min=float(values.min()),
        max=float(values.max()),
    )
