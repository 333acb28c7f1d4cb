"""Faces that scatter: facets, each as smooth as a polished face, whose normals are tilted at random.

A facet refracts and reflects by Snell and Fresnel: scatter is reciprocal, and no light is made. Its slope against the
mean face has no preferred azimuth: two numbers in [0, 1) give its amount and its azimuth. Light and shadow between
facets is left out: it counts at grazing angles.
"""

from dataclasses import dataclass
from math import asin

import numpy as np
from jaxtyping import Float

Values = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class FacetTurn:
    """Angles by which facets turn light: ``ratio`` of the indices before and behind the face; None for a mirror."""

    ratio: float | None

    @property
    def most_rad(self) -> float:
        """Largest angle by which a facet can turn light that comes along the normal of the face."""
        if self.ratio is None:
            return 0.5 * np.pi
        return 0.5 * np.pi - asin(min(self.ratio, 1.0 / self.ratio))

    def slopes(self, angles_rad: Values) -> Values:
        """Slopes of the facets that turn light along the normal by these angles, exact."""
        if self.ratio is None:
            return np.tan(0.5 * angles_rad)
        slopes: Values = np.sin(angles_rad) / np.abs(self.ratio - np.cos(angles_rad))
        return slopes


@dataclass(frozen=True)
class GaussianFacets:
    """Normally distributed slopes, rms ``slope`` along any line."""

    slope: float

    def amounts(self, numbers: Values) -> Values:
        """Slopes of Rayleigh's distribution."""
        amounts: Values = self.slope * np.sqrt(-2.0 * np.log1p(-numbers))
        return amounts


def gaussian(sigma_rad: float, turn: FacetTurn) -> GaussianFacets:
    """Facets whose rms slope turns light along the normal by ``sigma_rad``."""
    return GaussianFacets(float(turn.slopes(np.array([sigma_rad]))[0]))
