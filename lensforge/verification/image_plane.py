"""Irradiance on the receiver by hard bins, its noise for a finite number of rays, and the NMSE between images."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import convolve1d

from lensforge.errors import InputError


@dataclass(frozen=True)
class ImagePlane:
    """A square of ``side_mm`` centred on the axis, ``pixels`` x ``pixels``; images are indexed [y, x].

    ``filter_variance`` (pixels^2) is that of the paper's 3 x 3 Gaussian filter; 0: none. At the edge of the receiver
    the filter repeats the outermost pixels.
    """

    side_mm: float
    pixels: int
    filter_variance: float = 1.0

    def irradiance(
        self, landings: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "pixels pixels"]:
        """Irradiance (W/m^2) of rays with ``flux`` (W) at ``landings`` (mm); NaN lands nowhere."""
        smooth = self._filter()
        image: Float[np.ndarray, "pixels pixels"] = smooth @ self._sums(landings, flux) @ smooth.T / self._pixel_m2
        return image

    def noise(
        self, landings: Float[np.ndarray, "n 2"], flux: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "pixels pixels"]:
        """Variance ((W/m^2)^2) of :meth:`irradiance` if the n rays were drawn independently.

        Each pixel is a sum of n terms, most of them zero: ``n Var = sum f^2 - (sum f)^2 / n``, f the flux. Quasi-
        random rays are less noisy: for them this is an upper bound.
        """
        variance = self._sums(landings, flux**2) - self._sums(landings, flux) ** 2 / len(flux)
        squared = self._filter() ** 2
        filtered: Float[np.ndarray, "pixels pixels"] = squared @ np.maximum(variance, 0.0) @ squared.T
        return filtered / self._pixel_m2**2

    @property
    def _pixel_m2(self) -> float:
        return (self.side_mm / self.pixels * 1e-3) ** 2

    def _sums(
        self, landings: Float[np.ndarray, "n 2"], values: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "pixels pixels"]:
        inside = within(landings, self.side_mm)
        index = np.floor((landings[inside] / self.side_mm + 0.5) * self.pixels).astype(np.int64)
        index = np.minimum(index, self.pixels - 1)  # the far edge belongs to the last pixel
        flat = index[:, 1] * self.pixels + index[:, 0]
        sums = np.zeros(self.pixels**2)
        np.add.at(sums, flat, values[inside])
        return sums.reshape(self.pixels, self.pixels)

    def _filter(self) -> Float[np.ndarray, "pixels pixels"]:
        """Matrix of the filter along one axis."""
        unit = np.eye(self.pixels)
        if self.filter_variance == 0.0:
            return unit
        taps = np.exp(-0.5 * np.array([1.0, 0.0, 1.0]) / self.filter_variance)
        filtered: Float[np.ndarray, "pixels pixels"] = convolve1d(unit, taps / taps.sum(), axis=0, mode="nearest")
        return filtered


def within(landings: Float[np.ndarray, "n 2"], side_mm: float) -> Bool[np.ndarray, " n"]:
    """True for landings in the centred square of ``side_mm``; False for NaN."""
    inside: Bool[np.ndarray, " n"] = (np.abs(landings) <= 0.5 * side_mm).all(axis=1)
    return inside


def squared_norm(reference: Float[np.ndarray, "p p"]) -> float:
    """Sum of squares of a ``reference`` image; :class:`InputError` where it is dark or not finite."""
    total = float(np.sum(reference**2))
    if not 0.0 < total < np.inf:
        raise InputError(f"design irradiance: its sum of squares is {total:g}, must be above 0; do rays reach it?")
    return total


def nmse(image: Float[np.ndarray, "p p"], reference: Float[np.ndarray, "p p"]) -> float:
    """Normalised mean squared error, ``sum (image - reference)^2 / sum reference^2``; no scale is fitted."""
    return float(np.sum((image - reference) ** 2)) / squared_norm(reference)
