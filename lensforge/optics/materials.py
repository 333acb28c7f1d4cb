"""Refractive index of lens materials: dispersion formulas with published coefficients; transmittance of a surface.

Wavelengths are in nm at the boundary and in um inside the formulas, as the coefficients are published. NumPy only.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError

D_LINE_NM, F_LINE_NM, C_LINE_NM = 587.5618, 486.1327, 656.2725  # He d, H F, H C: where n_d and V_d are defined
_BEYOND = 0.1  # how far, in parts of the wavelength, formulas without a pole nearby are trusted beyond their range


@runtime_checkable
class Dispersion(Protocol):
    """A formula for n(wavelength)."""

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The refractive index at each wavelength."""
        ...


@dataclass(frozen=True)
class Cauchy:
    """``n = a + b / wavelength^2 + c / wavelength^4 + ...``, wavelength in um."""

    coefficients: tuple[float, ...]

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The polynomial in the inverse square."""
        return np.polynomial.polynomial.polyval((1e3 / wavelengths_nm) ** 2, self.coefficients)


@dataclass(frozen=True)
class Sellmeier:
    """``n^2 - 1 = sum b wavelength^2 / (wavelength^2 - c)`` over pairs ``(b, c)``, wavelength in um, c in um^2."""

    terms: tuple[tuple[float, float], ...]

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The root of the sum."""
        squared = (1e-3 * wavelengths_nm) ** 2
        return np.sqrt(1.0 + sum(b * squared / (squared - c) for b, c in self.terms))


@dataclass(frozen=True)
class SchottPolynomial:
    """``n^2 = sum coefficient wavelength^power`` over pairs ``(coefficient, power)``, wavelength in um."""

    terms: tuple[tuple[float, int], ...]

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The root of the sum."""
        microns = 1e-3 * np.asarray(wavelengths_nm, dtype=np.float64)
        return np.sqrt(sum(coefficient * microns ** float(power) for coefficient, power in self.terms))


@dataclass(frozen=True)
class Material:
    """A lens material: its formula, the range (nm) in which it was measured, and its publication.

    ``extrapolation_error``: by how much other formulas fitted to the same numbers differ from it at the ends of the
    trusted range, measured by `benchmarks/extrapolation.py`.
    """

    name: str
    dispersion: Dispersion
    range_nm: tuple[float, float]
    source: str
    extrapolation_error: float

    @property
    def trusted_nm(self) -> tuple[float, float]:
        """Range (nm) in which the formula is used: that of the measurement and 10 % more, as spectra have tails."""
        low, high = self.range_nm
        return low * (1.0 - _BEYOND), high * (1.0 + _BEYOND)

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The refractive index at wavelengths of the trusted range. Raises :class:`InputError` for any other."""
        wavelengths = np.asarray(wavelengths_nm, dtype=np.float64)
        low, high = self.trusted_nm
        wrong = ~((wavelengths >= low) & (wavelengths <= high))
        if wrong.any():
            raise InputError(
                f"wavelength {wavelengths[wrong][0]:g} nm: the index of {self.name} is {self.known}; give a constant "
                "refractive index instead, or correct the spectrum"
            )
        return self.dispersion.index(wavelengths)

    def nearest_index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The refractive index at any wavelength; beyond the trusted range that at its end."""
        return self.dispersion.index(np.clip(wavelengths_nm, *self.trusted_nm))

    @property
    def known(self) -> str:
        """The measured and the trusted range in words."""
        (low, high), (least, most) = self.range_nm, self.trusted_nm
        return f"known from {low:g} to {high:g} nm, and extrapolated from {least:g} to {most:g} nm"

    def index_at(self, wavelength_nm: float) -> float:
        """The refractive index at one wavelength."""
        return float(self.index(np.array([wavelength_nm]))[0])

    @property
    def abbe_number(self) -> float:
        """V_d = (n_d - 1) / (n_F - n_C)."""
        n_d, n_f, n_c = self.index(np.array([D_LINE_NM, F_LINE_NM, C_LINE_NM]))
        return float((n_d - 1.0) / (n_f - n_c))


def by_abbe_number(n_d: float, abbe_number: float, name: str = "custom") -> Material:
    """Material with n_d and V_d of a data sheet, by Cauchy's formula with two terms.

    It differs from the formulas of the catalogue's materials by up to 0.005 (`benchmarks/extrapolation.py`).
    """
    per_inverse_square = (n_d - 1.0) / abbe_number / ((1e3 / F_LINE_NM) ** 2 - (1e3 / C_LINE_NM) ** 2)
    cauchy = Cauchy((n_d - per_inverse_square * (1e3 / D_LINE_NM) ** 2, per_inverse_square))
    return Material(name, cauchy, (400.0, 1000.0), f"n_d = {n_d:g}, V_d = {abbe_number:g}", 0.005)


_BEADIE = "G. Beadie, M. Brindza, R. A. Flynn, A. Rosenberg, J. S. Shirk, Appl. Opt. 54, F139 (2015)"
_SULTANOVA = "N. Sultanova, S. Kasarova, I. Nikolov, Acta Physica Polonica A 116, 585 (2009)"
_SCHOTT = "SCHOTT optical glass data sheets (2017)"
_MALITSON = "I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)"


def _catalogue(materials: Sequence[Material]) -> dict[str, Material]:
    return {material.name: material for material in materials}


MATERIALS = _catalogue([
    Material(
        "PMMA",
        SchottPolynomial((
            (2.1778, 0), (6.1209e-3, 2), (-1.5004e-3, 4), (2.3678e-2, -2), (-4.2137e-3, -4), (7.3417e-4, -6),
            (-4.5042e-5, -8),
        )),
        (420.0, 1620.0),
        _BEADIE,
        0.0011,
    ),
    Material("PC", Sellmeier(((1.4182, 0.021304),)), (436.8, 1052.0), _SULTANOVA, 0.0002),
    Material("PS", Sellmeier(((1.4435, 0.020216),)), (436.8, 1052.0), _SULTANOVA, 0.0002),
    Material(
        "N-BK7",
        Sellmeier(((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653))),
        (300.0, 2500.0),
        _SCHOTT,
        0.01,
    ),
    Material(
        "fused silica",
        Sellmeier(((0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2))),
        (210.0, 3710.0),
        _MALITSON,
        0.03,
    ),
])  # fmt: skip


def normal_transmittance(refractive_index: float) -> float:
    """Transmittance of one surface at normal incidence; two of them bound a lens's efficiency, 0.923 for PMMA."""
    return 1.0 - ((refractive_index - 1.0) / (refractive_index + 1.0)) ** 2
