"""Dispersion formulas as catalogues publish them: n or n^2 by coefficients and the wavelength in um.

``sellmeier`` and ``cauchy`` are those of textbooks; ``agf 1`` to ``agf 13`` those of Zemax glass catalogues, in the
order of the numbers that their NM lines give (OpticStudio help, "Glass dispersion formulas"); ``rii 1`` to ``rii 9``
those of refractiveindex.info ("Dispersion formulas", 2024). Missing coefficients are 0. NumPy only.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError

Waves = Float[np.ndarray, " n"]
HUGE = 1e30  # no number of a material is as large: what is comes from a damaged file
MOST_COEFFICIENTS = 24  # formula 4 of refractiveindex.info has 17, tables of polynomials a few more


def _series(coefficients: Sequence[float], powers: Sequence[float], um: Waves) -> Waves:
    """Sum of coefficient times wavelength to a power."""
    terms = (c * um**p for c, p in zip(coefficients, powers, strict=False) if c != 0.0)
    return sum(terms, np.zeros_like(um))


def _poles(pairs: Sequence[tuple[float, float]], um: Waves) -> Waves:
    """Sum of ``b wavelength^2 / (wavelength^2 - c)`` over pairs ``(b, c)``."""
    return sum((b * um**2 / (um**2 - c) for b, c in pairs if b != 0.0), np.zeros_like(um))


def _pairs(coefficients: Sequence[float]) -> list[tuple[float, float]]:
    return list(zip(coefficients[::2], coefficients[1::2], strict=False))


def _sellmeier(c: Sequence[float], um: Waves) -> Waves:
    return 1.0 + _poles(_pairs(c), um)


def _cauchy(c: Sequence[float], um: Waves) -> Waves:
    return _series(c, [-2.0 * k for k in range(len(c))], um)


def _herzberger(c: Sequence[float], um: Waves) -> Waves:
    pole: Waves = 1.0 / (um**2 - 0.028)
    near: Waves = _series(c[:3], (0.0, 1.0, 2.0), pole) + _series(c[3:], (2.0, 4.0, 6.0), um)
    return near


def _sellmeier_2(c: Sequence[float], um: Waves) -> Waves:
    return 1.0 + c[0] + c[1] * um**2 / (um**2 - c[2] ** 2) + c[3] / (um**2 - c[4] ** 2)


def _handbook_1(c: Sequence[float], um: Waves) -> Waves:
    return c[0] + c[1] / (um**2 - c[2]) - c[3] * um**2


def _handbook_2(c: Sequence[float], um: Waves) -> Waves:
    return c[0] + c[1] * um**2 / (um**2 - c[2]) - c[3] * um**2


def _sellmeier_4(c: Sequence[float], um: Waves) -> Waves:
    return c[0] + _poles([(c[1], c[2]), (c[3], c[4])], um)


def _rii_sellmeier(c: Sequence[float], um: Waves) -> Waves:
    return 1.0 + c[0] + _poles([(b, pole**2) for b, pole in _pairs(c[1:])], um)


def _rii_sellmeier_2(c: Sequence[float], um: Waves) -> Waves:
    return 1.0 + c[0] + _poles(_pairs(c[1:]), um)


def _rii_polynomial(c: Sequence[float], um: Waves) -> Waves:
    return c[0] + _series(c[1::2], c[2::2], um)


def _rii_general(c: Sequence[float], um: Waves) -> Waves:
    terms = (c[k] * um ** c[k + 1] / (um**2 - c[k + 2] ** c[k + 3]) for k in (1, 5) if len(c) > k + 3 and c[k] != 0.0)
    return sum(terms, c[0] + _series(c[9::2], c[10::2], um))


def _rii_gases(c: Sequence[float], um: Waves) -> Waves:
    return sum((b / (pole - um**-2.0) for b, pole in _pairs(c[1:])), np.full_like(um, 1.0 + c[0]))


def _rii_retro(c: Sequence[float], um: Waves) -> Waves:
    right = c[0] + c[1] * um**2 / (um**2 - c[2]) + c[3] * um**2
    return (1.0 + 2.0 * right) / (1.0 - right)


def _rii_exotic(c: Sequence[float], um: Waves) -> Waves:
    return c[0] + c[1] / (um**2 - c[2]) + c[3] * (um - c[4]) / ((um - c[4]) ** 2 + c[5])


def _powers(*powers: float) -> Callable[[Sequence[float], Waves], Waves]:
    return lambda c, um: _series(c, powers, um)


@dataclass(frozen=True)
class _Kind:
    """A kind of formula: whether it gives n^2, how many coefficients it needs at least, and the function itself."""

    squared: bool
    least: int
    value: Callable[[Sequence[float], Waves], Waves]


_KINDS = {
    "sellmeier": _Kind(True, 2, _sellmeier),
    "cauchy": _Kind(False, 1, _cauchy),
    "agf 1": _Kind(True, 6, _powers(0.0, 2.0, -2.0, -4.0, -6.0, -8.0)),
    "agf 2": _Kind(True, 6, _sellmeier),
    "agf 3": _Kind(False, 6, _herzberger),
    "agf 4": _Kind(True, 5, _sellmeier_2),
    "agf 5": _Kind(False, 3, _powers(0.0, -1.0, -3.5)),
    "agf 6": _Kind(True, 8, _sellmeier),
    "agf 7": _Kind(True, 4, _handbook_1),
    "agf 8": _Kind(True, 4, _handbook_2),
    "agf 9": _Kind(True, 5, _sellmeier_4),
    "agf 10": _Kind(True, 8, _powers(0.0, 2.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0)),
    "agf 11": _Kind(True, 10, _sellmeier),
    "agf 12": _Kind(True, 8, _powers(0.0, 2.0, -2.0, -4.0, -6.0, -8.0, 4.0, 6.0)),
    "agf 13": _Kind(True, 9, _powers(0.0, 2.0, 4.0, -2.0, -4.0, -6.0, -8.0, -10.0, -12.0)),
    "rii 1": _Kind(True, 3, _rii_sellmeier),
    "rii 2": _Kind(True, 3, _rii_sellmeier_2),
    "rii 3": _Kind(True, 1, _rii_polynomial),
    "rii 4": _Kind(True, 5, _rii_general),
    "rii 5": _Kind(False, 1, _rii_polynomial),
    "rii 6": _Kind(False, 3, _rii_gases),
    "rii 7": _Kind(False, 6, _herzberger),
    "rii 8": _Kind(True, 4, _rii_retro),
    "rii 9": _Kind(True, 6, _rii_exotic),
}
NAMES = tuple(_KINDS)


@dataclass(frozen=True)
class Formula:
    """A dispersion formula with its coefficients; wavelengths in um inside. ``name``: one of ``NAMES``."""

    name: str
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        kind = _KINDS.get(self.name)
        if kind is None:
            raise InputError(f"dispersion formula {self.name!r}: must be one of {', '.join(NAMES)}")
        if len(self.coefficients) > MOST_COEFFICIENTS:
            raise InputError(f"{self.name}: {len(self.coefficients)} coefficients, at most {MOST_COEFFICIENTS}")

    def index(self, wavelengths_nm: Waves) -> Waves:
        """The refractive index at each wavelength; NaN where the formula gives none."""
        kind = _KINDS[self.name]
        zeros = (0.0 for _ in range(kind.least - len(self.coefficients)))
        given = [np.float64(each) for each in (*self.coefficients, *zeros)]  # whose powers raise no error
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            value = kind.value(given, 1e-3 * np.asarray(wavelengths_nm, dtype=np.float64))
            return np.sqrt(value) if kind.squared else value


@dataclass(frozen=True)
class IndexTable:
    """Measured indices, between which the index is linear in the wavelength (nm, rising)."""

    wavelengths_nm: tuple[float, ...]
    indices: tuple[float, ...]

    def index(self, wavelengths_nm: Waves) -> Waves:
        """The refractive index at each wavelength; beyond the table that at its end."""
        found: Waves = np.interp(wavelengths_nm, self.wavelengths_nm, self.indices)
        return found
