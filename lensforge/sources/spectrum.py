"""Wavelengths of rays: drawn from a spectrum so that every ray carries the same power whatever its colour."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.areas import choose, linear_inverse
from lensforge.spec.spectrum import FileSpectrum, LineSpectrum, TableSpectrum
from lensforge.spec.spectrum import Spectrum as SpectrumSpec


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Power density ``weights`` (relative, per nm), linear between ``wavelengths_nm``; one wavelength alone is a line.

    Raises :class:`InputError` if it is no such function, with ``name`` in front.
    """

    wavelengths_nm: Float[np.ndarray, " k"]
    weights: Float[np.ndarray, " k"]
    name: str = "spectrum"

    def __post_init__(self) -> None:
        waves, weights = self.wavelengths_nm, self.weights
        if not (np.isfinite(waves).all() and (waves > 0.0).all() and (np.diff(waves) > 0.0).all()):
            raise InputError(f"{self.name}: wavelengths must be above 0 nm, each longer than the one before")
        if not (np.isfinite(weights).all() and (weights >= 0.0).all() and weights.any()):
            raise InputError(f"{self.name}: weights must be finite, none below 0, and not all zero")

    @cached_property
    def _cumulative(self) -> Float[np.ndarray, " cells"]:
        return np.cumsum(0.5 * (self.weights[1:] + self.weights[:-1]) * np.diff(self.wavelengths_nm))

    def at(self, numbers: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Numbers in [0, 1) to wavelengths (nm): the exact inverse of the power up to a wavelength."""
        if len(self.wavelengths_nm) == 1:
            return np.full(len(numbers), self.wavelengths_nm[0])
        cell, rest = choose(self._cumulative, numbers)
        place = linear_inverse(self.weights[cell], self.weights[cell + 1], rest)
        low = self.wavelengths_nm[cell]
        wavelengths: Float[np.ndarray, " n"] = low + place * (self.wavelengths_nm[cell + 1] - low)
        return wavelengths

    def draw(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """``count`` wavelengths, one from each of as many equal shares of the power, in random order.

        So they pad the Sobol points of place and direction (Owen, Latin supercube sampling, 1998) and tell nothing of
        either.
        """
        random = np.random.default_rng([seed, 5])
        return self.at((random.permutation(count) + random.random(count)) / count)


def spectrum_of(spec: SpectrumSpec) -> Spectrum:
    """The spectrum that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used."""
    match spec:
        case LineSpectrum():
            return Spectrum(np.array([spec.wavelength_nm]), np.ones(1))
        case TableSpectrum():
            return Spectrum(np.array(spec.wavelength_nm), np.array(spec.weight))
        case FileSpectrum():
            return _read(spec.file)


def _read(path: Path) -> Spectrum:
    try:
        rows = np.loadtxt(path, ndmin=2, encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"source.spectrum.file = {path}: no such file") from None
    except (OSError, ValueError) as error:
        problem = " ".join(str(error).split())[:160]
        raise InputError(f"source.spectrum.file = {path}: not two columns of numbers ({problem})") from None
    if rows.shape[1] != 2 or len(rows) == 0:
        raise InputError(f"source.spectrum.file = {path}: {rows.shape[1]} columns; two, nm and weight")
    return Spectrum(rows[:, 0], rows[:, 1], f"source.spectrum.file = {path}")
