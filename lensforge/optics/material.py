"""A material of a lens: index and absorption against wavelength, their change with temperature, and a catalogue.

Dispersion formulas give n or n^2 by coefficients and the wavelength in um: ``agf 1`` to ``agf 13`` are those of Zemax
glass catalogues, in the order of the numbers that their NM lines give (OpticStudio help, "Glass dispersion formulas"),
``rii 1`` to ``rii 9`` those of refractiveindex.info ("Dispersion formulas", 2024). Missing coefficients are 0.

Wavelengths are in nm at the boundary and in um inside the formulas, as the coefficients are published. NumPy only.

SCHOTT TIE-19 (2016): the change of the index relative to vacuum, from the temperature of the catalogue on. Indices here
are relative to air, which thins as it warms: its own index, by Kohlrausch's formula of OpticStudio's help ("Index of
refraction computation"), falls by 0.9e-6 per kelvin at 20 C, nearly half of what N-BK7 changes by in air.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError

Waves = Float[np.ndarray, " n"]
HUGE = 1e30  # no number of a material is as large: what is comes from a damaged file
MOST_COEFFICIENTS = 24  # formula 4 of refractiveindex.info has 17, tables of polynomials a few more


def _series(coefficients: Sequence[float], powers: Sequence[float], um: Waves) -> Waves:
    terms = (c * um**p for c, p in zip(coefficients, powers, strict=False) if c != 0.0)
    return sum(terms, np.zeros_like(um))


def _poles(pairs: Sequence[tuple[float, float]], um: Waves) -> Waves:
    """Sum of ``b wavelength^2 / (wavelength^2 - c)`` over pairs ``(b, c)``."""
    return sum((b * um**2 / (um**2 - c) for b, c in pairs if b != 0.0), np.zeros_like(um))


def _pairs(coefficients: Sequence[float]) -> list[tuple[float, float]]:
    return list(zip(coefficients[::2], coefficients[1::2], strict=False))


def _sellmeier(c: Sequence[float], um: Waves) -> Waves:
    return 1.0 + _poles(_pairs(c), um)


def _powers(*powers: float) -> Callable[[Sequence[float], Waves], Waves]:
    return lambda c, um: _series(c, powers, um)


def _herzberger(c: Sequence[float], um: Waves) -> Waves:
    pole: Waves = 1.0 / (um**2 - 0.028)
    return _series(c[:3], (0.0, 1.0, 2.0), pole) + _series(c[3:], (2.0, 4.0, 6.0), um)


def _general(c: Sequence[float], um: Waves) -> Waves:
    terms = (c[k] * um ** c[k + 1] / (um**2 - c[k + 2] ** c[k + 3]) for k in (1, 5) if len(c) > k + 3 and c[k] != 0.0)
    return sum(terms, c[0] + _series(c[9::2], c[10::2], um))


def _gases(c: Sequence[float], um: Waves) -> Waves:
    return sum((b / (pole - um**-2.0) for b, pole in _pairs(c[1:])), np.full_like(um, 1.0 + c[0]))


def _retro(c: Sequence[float], um: Waves) -> Waves:
    right = c[0] + c[1] * um**2 / (um**2 - c[2]) + c[3] * um**2
    return (1.0 + 2.0 * right) / (1.0 - right)


@dataclass(frozen=True)
class _Kind:
    """A kind of formula: whether it gives n^2, how many coefficients it needs at least, and the function itself."""

    squared: bool
    least: int
    value: Callable[[Sequence[float], Waves], Waves]


_KINDS = {
    "sellmeier": _Kind(True, 2, _sellmeier),
    "cauchy": _Kind(False, 1, lambda c, um: _series(c, [-2.0 * k for k in range(len(c))], um)),
    "agf 1": _Kind(True, 6, _powers(0.0, 2.0, -2.0, -4.0, -6.0, -8.0)),
    "agf 2": _Kind(True, 6, _sellmeier),
    "agf 3": _Kind(False, 6, _herzberger),
    "agf 4": _Kind(True, 5, lambda c, um: 1.0 + c[0] + c[1] * um**2 / (um**2 - c[2] ** 2) + c[3] / (um**2 - c[4] ** 2)),
    "agf 5": _Kind(False, 3, _powers(0.0, -1.0, -3.5)),
    "agf 6": _Kind(True, 8, _sellmeier),
    "agf 7": _Kind(True, 4, lambda c, um: c[0] + c[1] / (um**2 - c[2]) - c[3] * um**2),
    "agf 8": _Kind(True, 4, lambda c, um: c[0] + c[1] * um**2 / (um**2 - c[2]) - c[3] * um**2),
    "agf 9": _Kind(True, 5, lambda c, um: c[0] + _poles([(c[1], c[2]), (c[3], c[4])], um)),
    "agf 10": _Kind(True, 8, _powers(0.0, 2.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0)),
    "agf 11": _Kind(True, 10, _sellmeier),
    "agf 12": _Kind(True, 8, _powers(0.0, 2.0, -2.0, -4.0, -6.0, -8.0, 4.0, 6.0)),
    "agf 13": _Kind(True, 9, _powers(0.0, 2.0, 4.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0)),
    "rii 1": _Kind(True, 3, lambda c, um: 1.0 + c[0] + _poles([(b, pole**2) for b, pole in _pairs(c[1:])], um)),
    "rii 2": _Kind(True, 3, lambda c, um: 1.0 + c[0] + _poles(_pairs(c[1:]), um)),
    "rii 3": _Kind(True, 1, lambda c, um: c[0] + _series(c[1::2], c[2::2], um)),
    "rii 4": _Kind(True, 5, _general),
    "rii 5": _Kind(False, 1, lambda c, um: c[0] + _series(c[1::2], c[2::2], um)),
    "rii 6": _Kind(False, 3, _gases),
    "rii 7": _Kind(False, 6, _herzberger),
    "rii 8": _Kind(True, 4, _retro),
    "rii 9": _Kind(
        True, 6, lambda c, um: c[0] + c[1] / (um**2 - c[2]) + c[3] * (um - c[4]) / ((um - c[4]) ** 2 + c[5])
    ),
}
COEFFICIENTS = {name: kind.least for name, kind in _KINDS.items()}  # by the name of a formula: as many as it has


@dataclass(frozen=True)
class Formula:
    """A dispersion formula with its coefficients; wavelengths in um inside. ``name``: one of ``COEFFICIENTS``."""

    name: str
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        kind = _KINDS.get(self.name)
        if kind is None:
            raise InputError(f"dispersion formula {self.name!r}: must be one of {', '.join(COEFFICIENTS)}")
        if len(self.coefficients) > MOST_COEFFICIENTS:
            raise InputError(f"{self.name}: {len(self.coefficients)} coefficients, at most {MOST_COEFFICIENTS}")

    def index(self, wavelengths_nm: Waves) -> Waves:
        """The refractive index at each wavelength; NaN where the formula gives none."""
        kind = _KINDS[self.name]
        zeros = (0.0 for _ in range(kind.least - len(self.coefficients)))
        given = [np.float64(coefficient) for coefficient in (*self.coefficients, *zeros)]  # whose powers raise no error
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            value = kind.value(given, 1e-3 * np.asarray(wavelengths_nm, dtype=np.float64))
            return np.sqrt(value) if kind.squared else value


@dataclass(frozen=True)
class IndexTable:
    """Measured indices, between which the index is linear in the wavelength (nm, rising)."""

    wavelengths_nm: tuple[float, ...]
    indices: tuple[float, ...]

    def index(self, wavelengths_nm: Waves) -> Waves:
        """Index at each wavelength; outside the table that of its nearer end."""
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.indices)


REFERENCE_C = 20.0  # of catalogues, and of a drawing's lengths (ISO 1)
LOWEST_C = -100.0
HIGHEST_C = 400.0
SCHOTT_COEFFICIENTS = 6
_MEASURED_C = (-100.0, 140.0)  # of SCHOTT's coefficients
_AIR_PER_K = 3.4785e-3  # at 15 C


@dataclass(frozen=True)
class TemperatureLaw:
    """Change of index and length from ``reference_c`` (Celsius) on; None or empty for what is not known.

    ``schott``: D0 (1/K), D1 (1/K^2), D2 (1/K^3), E0 (um^2/K), E1 (um^2/K^2), and the wavelength of the pole (um);
    without it ``index_per_k``, the change (1/K) of the index relative to air, at every wavelength.
    ``expansion_per_k``: coefficient of linear expansion (1/K).
    """

    reference_c: float = REFERENCE_C
    schott: tuple[float, ...] = ()
    index_per_k: float | None = None
    expansion_per_k: float | None = None

    @property
    def knows_index(self) -> bool:
        """True if the change of the index is known."""
        return bool(self.schott) or self.index_per_k is not None

    def index(self, cold: Waves, wavelengths_nm: Waves, celsius: float) -> Waves:
        """Index relative to air at ``celsius``, from the index ``cold`` at the reference temperature."""
        kelvin = celsius - self.reference_c
        if not self.schott:
            assert self.index_per_k is not None
            return cold + self.index_per_k * kelvin
        d0, d1, d2, e0, e1, pole_um = self.schott
        absolute = cold * air_index(wavelengths_nm, self.reference_c)
        near_pole = (e0 * kelvin + e1 * kelvin**2) / ((1e-3 * wavelengths_nm) ** 2 - pole_um**2)
        change = d0 * kelvin + d1 * kelvin**2 + d2 * kelvin**3 + near_pole
        warm = absolute + (absolute**2 - 1.0) / (2.0 * absolute) * change
        return warm / air_index(wavelengths_nm, celsius)

    def scale(self, celsius: float) -> float:
        """Factor of every length at ``celsius``, for a known expansion."""
        assert self.expansion_per_k is not None
        return 1.0 + self.expansion_per_k * (celsius - self.reference_c)

    def warnings(self, celsius: float) -> tuple[str, ...]:
        """Warning if SCHOTT's formula is used outside its range of temperatures."""
        low, high = _MEASURED_C
        if not self.schott or low <= celsius <= high:
            return ()
        return (f"the index at {celsius:g} C is extrapolated: SCHOTT's formula holds from {low:g} to {high:g} C",)


UNKNOWN = TemperatureLaw()


def air_index(wavelengths_nm: Waves, celsius: float) -> Waves:
    """Index of dry air at one atmosphere and ``celsius``: F. Kohlrausch, Praktische Physik 1 (1968), p. 408."""
    squared = (1e-3 * wavelengths_nm) ** 2
    at_15 = 6432.8 + 2949810.0 * squared / (146.0 * squared - 1.0) + 25540.0 * squared / (41.0 * squared - 1.0)
    return 1.0 + 1e-8 * at_15 / (1.0 + (celsius - 15.0) * _AIR_PER_K)


# Wavelengths at which n_d and V_d are defined: He d, H F, H C.
D_LINE_NM = 587.5618
F_LINE_NM = 486.1327
C_LINE_NM = 656.2725
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
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.per_mm)


def absorption_of(rows: Sequence[Sequence[float]]) -> Absorption | None:
    """Absorption from rows of wavelength (nm) and 1/mm; None without rows."""
    return Absorption(*(tuple(column) for column in zip(*rows, strict=True))) if rows else None


def absorption_per_mm(extinction: Waves, wavelengths_nm: Waves) -> Waves:
    """Absorption (1/mm) by the extinction coefficient k at each wavelength."""
    return 4.0 * np.pi * extinction / (1e-6 * wavelengths_nm)


@dataclass(frozen=True)
class AgainstVacuum:
    """The vacuum index ``absolute`` relative to air at 20 C, as rays here have it."""

    absolute: Dispersion

    def index(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The refractive index at each wavelength."""
        return self.absolute.index(wavelengths_nm) / air_index(wavelengths_nm, REFERENCE_C)


@dataclass(frozen=True)
class IndexAtTemperature:
    """The index at ``celsius`` by ``law``, from the index ``cold`` at its reference temperature."""

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
    trusted range, measured by `benchmarks/extrapolation.py`; None if nothing is known of that, and the index is not
    used beyond the range. ``absorption`` is None if nothing is known of it: then the material is clear.
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
        (low, high) = self.range_nm
        (least, most) = self.trusted_nm
        if self.extrapolation_error is None:
            return f"known from {low:g} to {high:g} nm"
        return f"known from {low:g} to {high:g} nm, and extrapolated from {least:g} to {most:g} nm"

    def index_at(self, wavelength_nm: float) -> float:
        """The refractive index at one wavelength."""
        return float(self.index(np.array([wavelength_nm]))[0])

    def absorption_at(self, wavelength_nm: float, otherwise: float) -> float:
        """Absorption (1/mm) at one wavelength; ``otherwise`` where the material states none."""
        return otherwise if self.absorption is None else float(self.absorption.at(np.array([wavelength_nm]))[0])

    def at(self, law: TemperatureLaw, celsius: float) -> "Material":
        """Material whose index is that at ``celsius`` by ``law``; its absorption stays."""
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


_BEADIE = "G. Beadie, M. Brindza, R. A. Flynn, A. Rosenberg, J. S. Shirk, Appl. Opt. 54, F139 (2015)"
_SULTANOVA = "N. Sultanova, S. Kasarova, I. Nikolov, Acta Physica Polonica A 116, 585 (2009)"
_SCHOTT = "SCHOTT optical glass data sheets (2017)"
_MALITSON = "I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)"
_ZHANG = "X. Zhang, J. Qiu, X. Li, J. Zhao, L. Liu, Appl. Opt. 59, 2337 (2020), Sylgard 184 20:1, one term fitted"
_BOROFLOAT = "SCHOTT BOROFLOAT 33, Optical Properties (2021), fitted by M. Polyanskiy, refractiveindex.info"
_B270 = "SCHOTT B 270, Zemax catalogue"
_TOPAS = "G. Khanarian, Opt. Eng. 40, 1024 (2001): TOPAS 5013, n_d and V_d"
_OKP = "Osaka Gas Chemicals, OKP4 data sheet: n_d and V_d"


_CATALOGUE = (
    Material(
        "PMMA",
        Formula("agf 13", (2.1778, 6.1209e-3, -1.5004e-3, 2.3678e-2, -4.2137e-3, 7.3417e-4, -4.5042e-5)),
        (420.0, 1620.0),
        _BEADIE,
        0.0011,
    ),
    Material("PC", Formula("sellmeier", (1.4182, 0.021304)), (436.8, 1052.0), _SULTANOVA, 0.0002),
    Material("PS", Formula("sellmeier", (1.4435, 0.020216)), (436.8, 1052.0), _SULTANOVA, 0.0002),
    Material(
        "N-BK7",
        Formula("sellmeier", (1.03961212, 0.00600069867, 0.231792344, 0.0200179144, 1.01046945, 103.560653)),
        (300.0, 2500.0),
        _SCHOTT,
        0.01,
        temperature=TemperatureLaw(
            schott=(1.86e-6, 1.31e-8, -1.37e-11, 4.34e-7, 6.27e-10, 0.170), expansion_per_k=7.1e-6
        ),
    ),
    Material(
        "fused silica",
        Formula("sellmeier", (0.6961663, 0.0684043**2, 0.4079426, 0.1162414**2, 0.8974794, 9.896161**2)),
        (210.0, 3710.0),
        _MALITSON,
        0.03,
    ),
    Material("COP", Formula("sellmeier", (1.2969, 0.011721)), (436.8, 1052.0), _SULTANOVA, 2.2e-5),
    by_abbe_number(1.533, 56.2, "COC", _TOPAS),
    by_abbe_number(1.607, 27.0, "polyester", _OKP),
    Material("silicone", Formula("sellmeier", (0.94857825, 0.01122108)), (400.0, 750.0), _ZHANG, 2.2e-5),
    Material(
        "B270",
        Formula("agf 1", (2.286575, -8.7334582e-3, 1.1742884e-2, 2.9041756e-4, -1.2506695e-5, 9.2646253e-7)),
        (330.0, 2100.0),
        _B270,
        0.0055,
    ),
    Material(
        "borosilicate 3.3",
        Formula("rii 1", (0.3542, 0.78657, 0.10856, 0.18285, 4.427)),
        (240.0, 1550.0),
        _BOROFLOAT,
        0.0043,
    ),
)
MATERIALS = {material.name: material for material in _CATALOGUE}
