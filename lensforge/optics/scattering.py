"""Faces that scatter: facets, each as smooth as a polished face and tilted at random, or rings of scattered light.

A facet refracts and reflects by Snell and Fresnel: scatter is reciprocal, and no light is made. Its slope against the
mean face has no preferred azimuth but that of the light, which sees more of the facets that face it. Shadow between
facets is left out: it counts at grazing angles.

Facets turn light by a limited angle; wider scatter is described by rings. Two numbers in [0, 1) of each ray give the
amount and the azimuth of either.
"""

from collections.abc import Callable
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


@dataclass(frozen=True)
class RingScatter:
    """Light spread by wide angles: the direction cosines behind a polished face are shifted at random.

    Rings about the polished direction (``follows``) or about the normal have each a share of the light, even over the
    ring. ``shares``: cumulative, of light within each of the ``radii`` of direction cosines, from 0 on, one row for
    each of the ascending ``cosines`` of incidence, and linear between these; the remainder to 1 is not scattered.
    """

    radii: tuple[float, ...]
    shares: tuple[tuple[float, ...], ...]
    cosines: tuple[float, ...] = (1.0,)
    follows: bool = True

    @property
    def rms(self) -> float:
        """Shift, rms along any line, of all light; the largest over the incidences."""
        middle = 0.25 * (np.square(self.radii[1:]) + np.square(self.radii[:-1]))
        return float(np.sqrt(max(np.diff(row) @ middle for row in self.shares)))

    def amounts(self, numbers: Values) -> Float[np.ndarray, "n k"]:
        """Shift of each ray at each incidence; 0 for light that is not scattered, which has the first numbers."""
        squares = np.square(self.radii)
        columns = [np.interp(numbers - (1.0 - row[-1]), row, squares) for row in self.shares]
        amounts: Float[np.ndarray, "n k"] = np.sqrt(np.column_stack(columns))
        return amounts


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def lambertian(share: float) -> RingScatter:
    """The share of the light that leaves to all sides alike, the same luminance everywhere: even over |t| < 1."""
    return RingScatter((0.0, 1.0), ((0.0, share),), follows=False)


def shares_within(radii: Values, density: Callable[[Values], Values]) -> Values:
    """Light within each of the ``radii`` of direction cosines by a ``density`` (1/sr) about the polished direction.

    The cosine of a scatter function is in it: ``density`` times it and the solid angle is ``density`` d^2 t.
    """
    middle = 0.5 * (radii[1:] + radii[:-1])
    half = 0.5 * np.diff(radii)
    places = middle[:, None] + half[:, None] * _NODES
    rings = half * ((2.0 * np.pi * places * density(places.ravel()).reshape(places.shape)) @ _WEIGHTS)
    return np.concatenate([[0.0], np.cumsum(rings)])
