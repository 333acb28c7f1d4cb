"""Record of a photometric file of any format: candela over C and gamma, lamp lumens, luminous opening.

Generation of the data: section 5.13 and table 2 of ANSI/IES LM-63-19, a number 1.XXXXX in the place that LM-63-2002
keeps for later use. Its digits say: accredited laboratory, interpolated angles, scaled lumens, computer simulation,
undefined. A program shall show the titles of that table and add nothing to them. The standard is not free: this is the
table as three programs have it that agree, eulumdat-rs among them; photompy 0.3.1 has the digits in another order.

Orientation: LM-63 (type C) and EULUMDAT count C counterclockwise as seen from above on a luminaire that shines down
(ANSI/IESNA LM-63-02, section 3; Radiance's ies2rad aims it along -z with C = 0 at +x and C = 90 at +y). A lens here
shines up, along +z. Turned over about its x axis it shines down: so C = 0 is its x axis and C = 90 its -y axis. With +y
instead, every pattern without mirror symmetry would appear mirrored in a lighting program.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lensforge.errors import InputError
from lensforge.optics.photopic import LARGEST_LM_PER_W
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.version import __version__

SIMULATED, UNDEFINED = "Computer Simulation", "Undefined"
_UNACCREDITED, _ACCREDITED = "Test at an unaccredited lab", "Test at an accredited lab"
_SCALED, _INTERPOLATED = " that has been lumen scaled", " with interpolated angle set"
_TITLES = {
    "1.00001": UNDEFINED,
    "1.00010": SIMULATED,
    "1.00000": _UNACCREDITED,
    "1.00100": _UNACCREDITED + _SCALED,
    "1.01000": _UNACCREDITED + _INTERPOLATED,
    "1.01100": _UNACCREDITED + _INTERPOLATED + _SCALED,
    "1.10000": _ACCREDITED,
    "1.10100": _ACCREDITED + _SCALED,
    "1.11000": _ACCREDITED + _INTERPOLATED,
    "1.11100": _ACCREDITED + _INTERPOLATED + _SCALED,
}
_CODES = {title: code for code, title in _TITLES.items()}


def generation_title(word: str) -> str:
    """Title of the number ``word`` of a file of 2019; undefined for what the table does not have.

    A bare 1 is undefined, too: older programs write it there, and mean nothing by it.
    """
    whole, _, digits = word.partition(".")
    if len(digits) < 5 and not digits.strip("0"):
        return UNDEFINED
    return _TITLES.get(f"{whole}.{digits.rstrip('0'):0<5}", UNDEFINED)


def generation_code(title: str) -> str:
    """Number by which a file of 2019 says how its data were generated."""
    return _CODES.get(title, _CODES[UNDEFINED])


def turned_over(table: TabulatedIntensity) -> TabulatedIntensity:
    """Table with C counted the other way: from a file's frame to the lens's, where C runs from +x to +y, or back."""
    if len(table.c_deg) == 1:
        return table
    return TabulatedIntensity(np.ascontiguousarray(360.0 - table.c_deg[::-1]), table.gamma_deg, table.values[::-1])


MOST_NUMBERS = 10**6  # of intensities: 721 x 361 is the finest seen; more comes from a damaged header
MOST_PLANES, MOST_GAMMAS = 3601, 18_001  # in steps of 0.1 and 0.01 degrees, finer than any goniophotometer
HUGE = 1e12  # above any real candela or lumen; squares of sums stay finite
SMALLEST = 1e-30  # below any real candela, lumen or watt but 0


def stated_or_none(value: float) -> float | None:
    """A number of lumens or watts, or None where it is a way of writing unknown: 0, negative, absurd."""
    return value if SMALLEST < value < HUGE else None


def number_in(word: str) -> float:
    """The number that a word of a file is. Raises :class:`ValueError` for what only Python takes for one."""
    if "_" in word or not word.isascii():
        raise ValueError(f"{word[:20]!r} is no number")
    return float(word)


def finite_number(word: str, place: str, name: str, *, commas: bool = False) -> float:
    """The number at a ``place`` of the file ``name``, with ``commas`` also as decimal sign.

    Raises :class:`InputError` for any other word, and for what is not finite and below 1e12.
    """
    try:
        number = number_in(word.replace(",", ".") if commas else word)
    except ValueError:
        raise InputError(f"{name}: {word[:20]!r} where {place} has a number; export it again") from None
    if not abs(number) < HUGE:
        raise InputError(f"{name}: a number of {place} is not finite and below {HUGE:g}; export it again")
    return number


def words_of(text: str) -> list[str]:
    """The words of a stream of numbers, without the END that some programs write behind it."""
    words = text.split()
    return words[:-1] if words and words[-1].upper() == "END" else words


def count_in(number: float, least: int, name: str) -> int:
    """A ``number`` of the header of the file ``name`` as a count. Raises :class:`InputError` for one that is none."""
    if not (least <= number <= MOST_NUMBERS and float(number).is_integer()):
        raise InputError(f"{name}: a count of {number:g} in its header; export it again")
    return int(number)


def require_promised(found: int, needed: int, name: str, where: str = "") -> None:
    """Raise :class:`InputError` unless a file holds as many numbers as its header says, ``where`` in words."""
    promise = f"{found} numbers{where}, its header promises {needed}"
    if found < needed:
        raise InputError(f"{name}: truncated: {promise}")
    if found > needed:
        raise InputError(f"{name}: {promise}: {found - needed} too many; export it again")


@dataclass(frozen=True, eq=False)
class PhotometricFile:
    """Far field. ``intensity`` in cd for ``lamp_lumens``; None where the file is absolute and states no lamp flux.

    ``stated_lumens`` is the luminaire's flux by the file itself (EULUMDAT's light output ratio), None where it states
    none. ``diameter_mm``: of the luminous opening, where it is round; 0 elsewhere. ``photometric_type``: of the angles
    in the file, C, B or A; ``intensity`` is always over C and gamma. ``warnings``: whatever was not taken as it
    stands, one line each. ``remarks``: lines on the data, such as its noise, for whoever opens the file; written to
    LM-63 as [OTHER], not read. ``maker`` of the luminaire, its number in the ``catalogue``, and the ``test`` report
    that the data come from. ``generated``: by simulation or measurement, in the words of LM-63-2019; ``method``: more
    on that; ``laboratory``, and the date on which the data were ``issued``, empty where nothing states one: it is never
    that of the clock. ``edition``: of the standard that the file follows, by its own words.
    """

    intensity: TabulatedIntensity
    lamp_lumens: float | None = None
    stated_lumens: float | None = None
    title: str = ""
    diameter_mm: float = 0.0
    watts: float = 0.0
    format: str = ""
    photometric_type: Literal["A", "B", "C"] = "C"
    warnings: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    maker: str = "lensforge"
    test: str = "none: computed by tracing rays"
    catalogue: str = ""
    generated: str = SIMULATED
    method: str = f"rays traced through the lens by lensforge {__version__}"
    laboratory: str = "none: not measured, computed by lensforge"
    issued: str = ""
    edition: str = ""


def single_line(text: str) -> str:
    """``text`` without line ends, tabs and other characters that no line of a file may hold."""
    return " ".join("".join(mark if mark.isprintable() else " " for mark in text).split())


@dataclass(frozen=True)
class PhotometricFormat:
    """A format: ``matches`` a text by its content, ``decode`` a text and its file's name, ``encode`` a far field.

    The texts have "\\n" for line ends, whatever the file has. ``encoding``: of the bytes that are written.
    """

    suffix: str
    matches: Callable[[str], bool]
    decode: Callable[[str, str], PhotometricFile]
    encode: Callable[[PhotometricFile], str]
    encoding: str = "latin-1"


_FLUX_TOLERANCE = 0.01  # integral and stated flux of real files agree this well
_CUT_SHARE = 0.01  # of the peak: more than that at the last gamma, and the file has lost light beyond it


def far_field_warnings(file: PhotometricFile) -> tuple[str, ...]:
    """List what was not taken as it stands in the file, and what contradicts itself there."""
    return (*file.warnings, *_contradictions(file), *_cut(file))


def _contradictions(file: PhotometricFile) -> Iterator[str]:
    lumens, stated, watts = file.intensity.flux(), file.stated_lumens, file.watts
    if stated and abs(lumens / stated - 1.0) > _FLUX_TOLERANCE:
        yield f"its intensities integrate to {lumens:.6g} lm, the file states {stated:.6g} lm"
    if file.lamp_lumens and lumens > file.lamp_lumens * (1.0 + _FLUX_TOLERANCE):
        yield f"its light has {lumens:.6g} lm, its lamps only {file.lamp_lumens:.6g} lm: check its factors"
    if watts > 0.0 and lumens > LARGEST_LM_PER_W * watts:
        yield f"{lumens / watts:.4g} lm per W, no light has more than 683: check its lumens and watts"


def cut_below(file: PhotometricFile) -> str | None:
    """Words for a last gamma at which there is light, so that some is not in the file; None where it is complete."""
    table = file.intensity
    last, at_last = float(table.gamma_deg[-1]), float(table.values[:, -1].max() / table.values.max())
    if last in (90.0, 180.0) or at_last <= _CUT_SHARE:
        return None
    return f"its last gamma is {last:g} degrees, with {100.0 * at_last:.3g} % of the largest intensity"


def _cut(file: PhotometricFile) -> Iterator[str]:
    first = float(file.intensity.gamma_deg[0])
    if (words := cut_below(file)) is not None:
        yield f"{words}: light beyond is not in the file"
    if first > 0.0:
        yield f"its first gamma is {first:g} degrees: no light is taken within that"
