"""Spectrum of a source: a density of power over wavelength, and wavelengths drawn from it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.random import Generator

from lensforge.errors import InputError, remedy
from lensforge.sources.inverse_cdf import choose, linear_inverse
from lensforge.sources.spectrum_file import read_spectrum_file
from lensforge.spec.emission import FileSpectrum, LineSpectrum, SpectrumSpec, TableSpectrum

_LIGHT_NM = 1.0, 1e7  # from X-rays to 1 cm: other wavelengths come from a damaged file
_FINEST_NM = 1e-6  # between two wavelengths; slopes over less are rounding
_LEAST_PEAK, _LARGEST_PEAK = 1e-30, 1e30  # of a density in any unit: its sums stay within floating point


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Spectral power density (relative, per nm), linear between ``wavelengths_nm``; one wavelength alone is a line.

    Raises :class:`InputError`, ``name`` in front, unless wavelengths rise and densities are 0 or above, not all 0.
    """

    wavelengths_nm: Float[np.ndarray, " k"]
    power_density: Float[np.ndarray, " k"]
    name: str = "spectrum"

    def __post_init__(self) -> None:
        waves, density = self.wavelengths_nm, self.power_density
        if not (usable_wavelengths(waves).all() and (np.diff(waves) >= _FINEST_NM).all()):
            low, high = _LIGHT_NM
            raise InputError(
                f"{self.name}: wavelengths must lie within {low:g} to {high:g} nm, each longer than the one before"
            )
        if not (density.min() >= 0.0 and _LEAST_PEAK < density.max() < _LARGEST_PEAK):
            raise InputError(f"{self.name}: power densities must be finite, none below 0, and not all zero")

    @cached_property
    def _cumulative(self) -> Float[np.ndarray, " cells"]:
        return np.cumsum(0.5 * (self.power_density[1:] + self.power_density[:-1]) * np.diff(self.wavelengths_nm))

    def at(self, numbers: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Map numbers in [0, 1) to wavelengths (nm): the exact inverse of the power up to a wavelength."""
        if len(self.wavelengths_nm) == 1:
            return np.full(len(numbers), self.wavelengths_nm[0])
        cell, rest = choose(self._cumulative, numbers)
        place = linear_inverse(self.power_density[cell], self.power_density[cell + 1], rest)
        low = self.wavelengths_nm[cell]
        wavelengths: Float[np.ndarray, " n"] = low + place * (self.wavelengths_nm[cell + 1] - low)
        return wavelengths

    def share_up_to(self, wavelength_nm: float) -> float:
        """Share of the power at wavelengths up to ``wavelength_nm``, exact."""
        waves, density = self.wavelengths_nm, self.power_density
        if len(waves) == 1:
            return float(waves[0] <= wavelength_nm)
        below = np.append(waves[waves < wavelength_nm], np.clip(wavelength_nm, waves[0], waves[-1]))
        return float(np.trapezoid(np.interp(below, waves, density), below) / self._cumulative[-1])

    def draw(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """Draw ``count`` wavelengths (nm), one from each of as many equal shares of the power, in random order.

        So they pad the Sobol points of position and direction (Owen, Latin supercube sampling, 1998) and are
        independent of both.
        """
        return WavelengthDraw.of(self, count, seed).take(count)


@dataclass(eq=False)
class WavelengthDraw:
    """Wavelengths that :meth:`Spectrum.draw` draws, part by part; ``order``: of the shares of the power."""

    spectrum: Spectrum
    order: Int[np.ndarray, " n"]
    random: Generator
    taken: int = 0

    @staticmethod
    def of(spectrum: Spectrum, count: int, seed: int) -> "WavelengthDraw":
        """Begin to draw ``count`` wavelengths."""
        random = np.random.default_rng([seed, 5])
        return WavelengthDraw(spectrum, random.permutation(count), random)

    def take(self, count: int) -> Float[np.ndarray, " m"]:
        """The next ``count`` wavelengths (nm)."""
        shares = self.order[self.taken : self.taken + count]
        self.taken += count
        return self.spectrum.at((shares + self.random.random(count)) / len(self.order))


def usable_wavelengths(wavelengths_nm: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Mask of the wavelengths that light can have."""
    with np.errstate(invalid="ignore"):
        usable: Bool[np.ndarray, " n"] = (wavelengths_nm >= _LIGHT_NM[0]) & (wavelengths_nm < _LIGHT_NM[1])
        return usable


def spectrum_of(spec: SpectrumSpec) -> Spectrum:
    """Make the spectrum that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used."""
    match spec:
        case LineSpectrum():
            return Spectrum(np.array([spec.wavelength_nm]), np.ones(1))
        case TableSpectrum():
            return Spectrum(np.array(spec.wavelength_nm), np.array(spec.weight))
        case FileSpectrum():
            with remedy("correct source.spectrum.file"):
                return Spectrum(*read_spectrum_file(spec.file), str(spec.file))
