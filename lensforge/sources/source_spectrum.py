"""Spectrum of a source: a density of power over wavelength, wavelengths drawn from it, and its text files.

A file is rows of two columns, wavelength (nm) and relative power density. Lines of text before the rows are a header:
names of the columns, that of an OPTIS spectrum (``.spectrum``, with the number of its samples as last line), or that of
LightTools (``.sre``). Verified with two files of OSRAM; the layouts of the others are those of public programs that
read and write them.
"""

import re
import warnings
from dataclasses import dataclass
from functools import cached_property
from math import nan
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.random import Generator

from lensforge.errors import FileWarning, InputError, remedy
from lensforge.optics.colorimetry import efficacy_at
from lensforge.results.files import MIB
from lensforge.results.table_names import NANOMETRES, Column
from lensforge.results.text_dialect import shown
from lensforge.results.text_table import TextTable
from lensforge.sources.inverse_cdf import choose, linear_inverse
from lensforge.sources.photometric.half_planes import not_below_zero
from lensforge.spec.emitter_section import FileSpectrum, GaussianSpectrum, LineSpectrum, SpectrumSpec, TableSpectrum

_ANOTHER_KIND = re.compile(r"OPTIS\s*-(?!\s*Spectrum\b)|discrete\b|photometric\b", re.IGNORECASE)
_MOST_BYTES = 8 * MIB  # a spectrum of 0.01 nm from 200 to 3000 nm has 6 MB
_HUGE = 1e12  # no wavelength in nm, no power density: what is larger comes from a damaged file
_MOST_ROWS = 500_000
_LEAST_NM = 100.0  # below that are µm: no light here is shorter
_LINEAR = {
    *("w", "mw", "uw", "nw", "kw", "watt", "watts", "j", "s", "a", "sr", "sq", "nm", "um", "mm", "cm", "m", "per"),
    *("u", "au", "arb", "rel", "relative", "unit", "units", "norm", "normalized", "normalised", "counts", "cps", "%"),
}


def _linear(unit: str) -> float:
    """1 for a unit to which power is proportional, whatever its size; NaN for decibels, photons, lumens and others."""
    return 1.0 if {*re.findall(r"[^\W\d_]+|%", unit)} <= _LINEAR else nan


_POWER = (
    *("power", "power density", "spectral power", "spectral power density", "spectral power distribution", "spd"),
    *("radiant power", "optical power", "radiant flux", "spectral flux", "flux", "leistung", "radiance", "irradiance"),
    *("spectral radiance", "spectral irradiance", "intensity", "intensität", "weight", "value", "counts", "signal"),
)
_RELATIVE = ("relative", "rel", "normalized", "normalised")
_COLUMNS = (
    Column(("wavelength", "lambda", "λ", "wl", "nm", "wellenlänge"), NANOMETRES),
    Column((*_POWER, *(f"{word} {name}" for word in _RELATIVE for name in _POWER)), _linear),
)

Columns = tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]


def read_spectrum_file(path: Path) -> Columns:
    """Read wavelengths (nm), rising, and relative power densities; noise below 0 is set to 0, with a warning.

    Raises :class:`InputError`, one line.
    """
    table_file = TextTable.read(path, missing="give the file of a spectrum", most_bytes=_MOST_BYTES, counted=True)
    if len(table_file.rows) > _MOST_ROWS:
        raise InputError(f"{path}: {len(table_file.rows)} rows, at most {_MOST_ROWS} are read; export it coarser")
    _require_continuous(table_file)
    table = table_file.columns(_COLUMNS)
    for row, column in np.argwhere(np.abs(table) >= _HUGE)[:1]:
        raise table_file.refuse(
            row, column, f"a number of {table[row, column]:g}, must be below {_HUGE:g}; export it again"
        )
    if (np.diff(table[:, 0]) < 0.0).all():
        table = table[::-1]  # from red to blue
    if table[:, 0].max() < _LEAST_NM:
        raise InputError(
            f"{path}: wavelengths from {table[:, 0].min():g} to {table[:, 0].max():g}: nm are expected, µm can be one "
            "cause; multiply them by 1000"
        )
    density, noise = not_below_zero(table[:, 1:], str(path), "power densities", "")
    for warning in noise:
        warnings.warn(f"{path}: {warning}", FileWarning, stacklevel=1)
    return table[:, 0], density[:, 0]


def _require_continuous(table: TextTable) -> None:
    """Refuse a file whose header says that its rows are no continuous spectrum, or does not say how many there are."""
    for line in table.header:
        if _ANOTHER_KIND.match(line.text):
            advice = "only continuous, radiometric spectra are read; export it so"
            raise InputError(f"{table.name}, line {line.number}: {shown(line.text)}: {advice}")
    if table.count is None and table.header and table.header[0].text.upper().startswith("OPTIS"):
        raise InputError(f"{table.name}: line 3 of an OPTIS spectrum is the number of its samples; export it again")


_LIGHT_NM = 1.0, 1e7  # from X-rays to 1 cm: other wavelengths come from a damaged file
_FINEST_NM = 1e-6  # between two wavelengths; slopes over less are rounding
# A density in any unit whose sums stay within floating point.
_LEAST_PEAK = 1e-30
_LARGEST_PEAK = 1e30


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Spectral power density (relative, per nm), linear between ``wavelengths_nm``; one wavelength alone is a line.

    Raises :class:`InputError`, ``name`` in front, unless wavelengths rise and densities are 0 or above, not all 0.
    """

    wavelengths_nm: Float[np.ndarray, " k"]
    power_density: Float[np.ndarray, " k"]
    name: str = "spectrum"

    def __post_init__(self) -> None:
        waves = self.wavelengths_nm
        density = self.power_density
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
        """Map numbers in [0, 1) to wavelengths (nm): the exact inverse of the cumulative power."""
        if len(self.wavelengths_nm) == 1:
            return np.full(len(numbers), self.wavelengths_nm[0])
        cell, position = choose(self._cumulative, numbers)
        place = linear_inverse(self.power_density[cell], self.power_density[cell + 1], position)
        low = self.wavelengths_nm[cell]
        return np.asarray(low + place * (self.wavelengths_nm[cell + 1] - low))

    def share_up_to(self, wavelength_nm: float) -> float:
        """Share of the power at wavelengths up to ``wavelength_nm``, exact."""
        waves = self.wavelengths_nm
        density = self.power_density
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


_SIGMAS = 4.0  # of a normal distribution: beyond is 6e-5 of it
_NODES = 100  # linear between nodes it errs by 1e-4


def usable_wavelengths(wavelengths_nm: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Mask of physically possible wavelengths of light."""
    with np.errstate(invalid="ignore"):
        return (wavelengths_nm >= _LIGHT_NM[0]) & (wavelengths_nm < _LIGHT_NM[1])


@dataclass
class ColourSums:
    """Sums over rays by their wavelengths (nm): the ends, and ``coloured``, the flux of those that have a usable one.

    ``as_lumens``: that flux times the lm/W of each ray, ``as_watts``: divided by it, infinite where a ray is invisible.
    """

    low_nm: float = np.inf
    high_nm: float = -np.inf
    coloured: float = 0.0
    flux_nm: float = 0.0
    as_lumens: float = 0.0
    as_watts: float = 0.0

    def add(self, flux: Float[np.ndarray, " n"], wavelengths_nm: Float[np.ndarray, " n"]) -> None:
        """Count some of the rays."""
        usable = usable_wavelengths(wavelengths_nm)
        waves = wavelengths_nm[usable]
        power = flux[usable]
        self.low_nm = min(self.low_nm, float(waves.min(initial=np.inf)))
        self.high_nm = max(self.high_nm, float(waves.max(initial=-np.inf)))
        self.coloured += float(power.sum())
        self.flux_nm += float((waves * power).sum())
        efficacy = efficacy_at(waves)
        self.as_lumens += float((power * efficacy).sum())
        with np.errstate(divide="ignore"):
            self.as_watts += float((power * (1.0 / efficacy)).sum())

    @property
    def mean_nm(self) -> float | None:
        """Mean wavelength by flux; None if no ray has a usable one."""
        return self.flux_nm / self.coloured if self.coloured > 0.0 else None

    def luminous_efficacy(self, in_watts: bool) -> float | None:
        """The lm/W of rays whose flux is in W, or in lm; None without wavelengths, and for invisible light in lm."""
        if not self.coloured > 0.0 or not (in_watts or np.isfinite(self.as_watts)):
            return None
        return self.as_lumens / self.coloured if in_watts else 1.0 / (self.as_watts / self.coloured)


def spectrum_of(spec: SpectrumSpec) -> Spectrum:
    """Make the spectrum that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used."""
    match spec:
        case LineSpectrum():
            return Spectrum(np.array([spec.wavelength_nm]), np.ones(1))
        case TableSpectrum():
            return Spectrum(np.array(spec.wavelength_nm), np.array(spec.weight))
        case FileSpectrum():
            with remedy("correct this file of a spectrum, or its path in the spec"):
                return Spectrum(*read_spectrum_file(spec.file), str(spec.file))
        case GaussianSpectrum():
            sigma = spec.fwhm_nm / np.sqrt(8.0 * np.log(2.0))
            waves = spec.peak_nm + sigma * np.linspace(-_SIGMAS, _SIGMAS, 2 * _NODES + 1)
            waves = waves[usable_wavelengths(waves)]
            return Spectrum(waves, np.exp(-0.5 * ((waves - spec.peak_nm) / sigma) ** 2))
