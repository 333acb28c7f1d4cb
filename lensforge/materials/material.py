"""A material of a lens: refractive index and absorption against wavelength, and where both were published.

Wavelengths are in nm at the boundary and in um inside the formulas, as the coefficients are published. NumPy only.
"""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.materials.formulas import Formula
from lensforge.materials.temperature import UNKNOWN, TemperatureLaw

D_LINE_NM, F_LINE_NM, C_LINE_NM = 587.5618, 486.1327, 656.2725  # He d, H F, H C: where n_d and V_d are defined
_BEYOND = 0.1  # how far, in parts of the wavelength, formulas without a pole nearby are trusted beyond their range


@runtime_checkable
class Dispersion(Protocol):
    """A formula, or a table, for n(wavelength)."""

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The refractive index at each wavelength."""
        ...


@dataclass(frozen=True)
class Absorption:
    """Absorption (1/mm) at wavelengths (nm, rising), linear between them; beyond them that at the nearer end."""

    wavelengths_nm: tuple[float, ...]
    per_mm: tuple[float, ...]

    def at(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Absorption (1/mm) at each wavelength."""
        found: Float[np.ndarray, " n"] = np.interp(wavelengths_nm, self.wavelengths_nm, self.per_mm)
        return found


@dataclass(frozen=True)
class IndexAtTemperature:
    """The index of ``cold``, which is that at the reference temperature of ``law``, at ``celsius``."""

    cold: Dispersion
    law: TemperatureLaw
    celsius: float

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The refractive index at each wavelength."""
        return self.law.index(self.cold.index(wavelengths_nm), wavelengths_nm, self.celsius)


@dataclass(frozen=True)
class Material:
    """A lens material: its formula, the range (nm) in which it was measured, and its publication.

    ``extrapolation_error``: by how much other formulas fitted to the same numbers differ from it at the ends of the
    trusted range, measured by `benchmarks/extrapolation.py`; None where nothing is known of that, and the index is not
    used beyond the range. ``absorption`` is None where nothing is known of it: then the material is clear.
    ``temperature``: its change with temperature, where that is known.
    """

    name: str
    dispersion: Dispersion
    range_nm: tuple[float, float]
    source: str
    extrapolation_error: float | None
    absorption: Absorption | None = None
    temperature: TemperatureLaw = UNKNOWN

    @property
    def trusted_nm(self) -> tuple[float, float]:
        """Range (nm) in which the formula is used: that of the measurement and 10 % more, as spectra have tails."""
        low, high = self.range_nm
        if self.extrapolation_error is None:
            return low, high
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
        if self.extrapolation_error is None:
            return f"known from {low:g} to {high:g} nm"
        return f"known from {low:g} to {high:g} nm, and extrapolated from {least:g} to {most:g} nm"

    def index_at(self, wavelength_nm: float) -> float:
        """The refractive index at one wavelength."""
        return float(self.index(np.array([wavelength_nm]))[0])

    def at(self, law: TemperatureLaw, celsius: float) -> "Material":
        """The same with its index at ``celsius`` by ``law``; its absorption stays."""
        return replace(self, dispersion=IndexAtTemperature(self.dispersion, law, celsius))

    @property
    def abbe_number(self) -> float:
        """V_d = (n_d - 1) / (n_F - n_C)."""
        n_d, n_f, n_c = self.index(np.array([D_LINE_NM, F_LINE_NM, C_LINE_NM]))
        return float((n_d - 1.0) / (n_f - n_c))


def by_abbe_number(n_d: float, abbe_number: float, name: str = "custom", source: str = "") -> Material:
    """Material with n_d and V_d of a data sheet, by Cauchy's formula with two terms.

    It differs from the formulas of the catalogue's materials by up to 0.005 (`benchmarks/extrapolation.py`).
    """
    per_inverse_square = (n_d - 1.0) / abbe_number / ((1e3 / F_LINE_NM) ** 2 - (1e3 / C_LINE_NM) ** 2)
    cauchy = Formula("cauchy", (n_d - per_inverse_square * (1e3 / D_LINE_NM) ** 2, per_inverse_square))
    return Material(name, cauchy, (400.0, 1000.0), source or f"n_d = {n_d:g}, V_d = {abbe_number:g}", 0.005)
