"""Spectrum of a source: a density of power over wavelength, wavelengths drawn from it, and its text files.

- Two columns, wavelength (nm) and relative power density, separated by blanks, tabs, semicolons, or commas; comments
  start with ``#``, and one line of column names may come first. Verified with two files of OSRAM.
- OPTIS spectrum (``.spectrum``): a line ``OPTIS - Spectrum file v1.0``, a line of text, the number of samples, and a
  row of wavelength (nm) and value for each. SPEOS itself reads a misspelt ``fie``; values are percent, here relative.
- LightTools spectrum (``.sre``): comments, ``dfat 1.0``, ``dataname: ...``, ``continuous`` or ``discrete``,
  ``radiometric``, and rows of wavelength (nm) and value.

Of the last two the layouts are those of public programs that read and write them; no file of their makers was at
hand.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.random import Generator

from lensforge.errors import InputError, remedy
from lensforge.results.files import MIB, read_file
from lensforge.sources.inverse_cdf import choose, linear_inverse
from lensforge.sources.photometric.photometric_file import number_in
from lensforge.spec.emitter_section import FileSpectrum, LineSpectrum, SpectrumSpec, TableSpectrum

_COUNT = re.compile(r"[0-9]{1,9}")
_OPTIS = re.compile(r"OPTIS\s*-\s*Spectrum\b", re.IGNORECASE)
_LIGHTTOOLS = re.compile(r"(dfat|dataname|continuous|discrete|radiometric|photometric)\b", re.IGNORECASE)
_MOST_BYTES = 8 * MIB  # a spectrum of 0.01 nm from 200 to 3000 nm has 6 MB
_HUGE = 1e12  # no wavelength in nm, no power density: what is larger comes from a damaged file
_MOST_LINES = 500_000
_LEAST_NM = 100.0  # below that are µm: no light here is shorter

Columns = tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]


class _Line(NamedTuple):
    """A line that is not empty, without the blanks around it, and its ``number`` in the file, from 1 on."""

    number: int
    text: str


def read_spectrum_file(path: Path) -> Columns:
    """Read wavelengths (nm), rising, and relative power densities. Raises :class:`InputError`, one line."""
    lines = _lines(Path(path))
    if lines and _OPTIS.match(lines[0].text):
        rows = _optis_rows(lines, path)
    elif lines and lines[0].text.upper().startswith("OPTIS -"):
        raise InputError(f"{path}: {_shown(lines[0].text)!r}: an OPTIS file, but not a spectrum; export the spectrum")
    elif any(_LIGHTTOOLS.match(line.text) for line in _uncommented(lines)):
        rows = _lighttools_rows(lines, path)
    else:
        rows = _plain_rows(lines, path)
    found = np.array(rows)
    if (np.diff(found[:, 0]) < 0.0).all():
        found = found[::-1]  # from red to blue
    if found[:, 0].max() < _LEAST_NM:
        raise InputError(
            f"{path}: wavelengths from {found[:, 0].min():g} to {found[:, 0].max():g}: nm are expected, µm can be one "
            "cause; multiply them by 1000"
        )
    return found[:, 0], found[:, 1]


def _lines(path: Path) -> list[_Line]:
    raw = read_file(path, missing="give the file of a spectrum", most_bytes=_MOST_BYTES)
    if b"\0" in raw:
        raise InputError(f"{path}: not a text file; export the spectrum as text, two columns")
    text = raw.removeprefix(b"\xef\xbb\xbf").decode("latin-1")
    numbered = (_Line(number, line.strip()) for number, line in enumerate(re.split(r"\r\n|\r|\n", text), start=1))
    lines = [line for line in numbered if line.text]
    if len(lines) > _MOST_LINES:
        raise InputError(f"{path}: {len(lines)} lines, at most {_MOST_LINES} are read; export it coarser")
    return lines


def _uncommented(lines: list[_Line]) -> list[_Line]:
    return [line for line in lines if not line.text.startswith("#")]


def _optis_rows(lines: list[_Line], path: Path) -> list[list[float]]:
    """Rows below the count, which is the second line where the line of text is empty."""
    at = next((place for place in (1, 2) if place < len(lines) and _COUNT.fullmatch(lines[place].text)), 0)
    if at == 0:
        raise InputError(f"{path}: line 3 of an OPTIS spectrum is the number of its samples; export it again")
    count, rows = int(lines[at].text), [_row(line, path) for line in lines[at + 1 :]]
    if len(rows) != count or not rows:
        where = f"{path}, line {lines[at].number}"
        raise InputError(f"{where}: {count} samples announced, {len(rows)} found; export it again")
    return rows


def _lighttools_rows(lines: list[_Line], path: Path) -> list[list[float]]:
    kept = _uncommented(lines)
    for number, text in kept:
        if text.lower().startswith(("discrete", "photometric")):
            where = f"{path}, line {number}"
            raise InputError(f"{where}: {text.split()[0]}: only continuous, radiometric spectra are read; export it so")
    rows = [_row(line, path) for line in kept if not _LIGHTTOOLS.match(line.text)]
    if not rows:
        raise InputError(f"{path}: no rows of wavelength and value below its header; export it again")
    return rows


def _plain_rows(lines: list[_Line], path: Path) -> list[list[float]]:
    kept = _uncommented(lines)
    if kept and not any(character.isdigit() for character in kept[0].text.split()[0]):
        kept = kept[1:]  # names of the columns
    if not kept:
        raise InputError(f"{path}: not two columns of numbers: it has none; wavelength (nm) and relative power density")
    return [_row(line, path) for line in kept]


def _row(line: _Line, path: Path) -> list[float]:
    """Two numbers separated by blanks or a semicolon, then with a point or a comma as decimal sign, or by a comma."""
    where = f"{path}, line {line.number}"
    words = [word.strip(",") for word in re.split(r"[\s;]+", line.text) if word.strip(",")]
    words = [word.replace(",", ".") for word in words] if len(words) > 1 else line.text.split(",")
    if len(words) != 2:
        raise InputError(f"{where}: {len(words)} columns, must be two: wavelength (nm) and relative power")
    try:
        row = [number_in(word) for word in words]
    except ValueError:
        raise InputError(f"{where}: not two columns of numbers; wavelength (nm) and power") from None
    if not all(abs(number) < _HUGE for number in row):
        raise InputError(f"{where}: its numbers are not all finite and below {_HUGE:g}; export it again")
    return row


def _shown(line: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in line[:40])


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
