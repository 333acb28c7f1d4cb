"""Pixels of a face over the chart: maps of a change of its radius along the normal, and their extent by area.

Mean squares are over the area: the sum over the pixels inside the rim, each with the area of the face over it. On
201 x 201 pixels the mean square of a smooth change is exact to 1e-4.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.geometry.patch import Patch
from lensforge.measurement.comparison import area_extent
from lensforge.records import Extent
from lensforge.surfaces.chart import to_sphere
from lensforge.surfaces.surface import Surface

_MAP_PIXELS = 201


@dataclass(frozen=True)
class FacePixels:
    """Pixels of the chart inside the rim: their area (mm^2), and maps of radial changes along the normal (um)."""

    axis: Float[np.ndarray, " m"]
    area_mm2: Float[np.ndarray, "m m"]
    directions: Float[np.ndarray, "k 3"]
    cosine: Float[np.ndarray, " k"]

    @staticmethod
    def of(patch: Patch) -> "FacePixels":
        """Pixels of the face of ``patch``."""
        axis = np.linspace(-1.0, 1.0, _MAP_PIXELS)
        chart = np.stack(np.meshgrid(axis, axis), axis=-1)
        inside = np.sum(chart**2, axis=-1) <= 1.0
        jet, directions = patch.jet(chart[inside]), to_sphere(chart[inside])
        area = np.full(inside.shape, np.nan)
        area[inside] = jet.area_element * (axis[1] - axis[0]) ** 2
        return FacePixels(axis, area, directions, np.sum(jet.normal * directions, axis=1))

    def map_um(self, change: Surface) -> Float[np.ndarray, "m m"]:
        """A radial change along the normal (um), [Y, X], NaN outside the rim."""
        values = np.full(self.area_mm2.shape, np.nan)
        values[np.isfinite(self.area_mm2)] = 1e3 * self.cosine * change.radius(self.directions)
        return values

    def extent_um(self, change: Surface) -> Extent:
        """Largest absolute value and rms over the area of a radial change, along the normal (um)."""
        return area_extent(self.map_um(change), self.area_mm2)
