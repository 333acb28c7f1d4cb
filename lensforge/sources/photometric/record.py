"""Record of a photometric file of any format: candela over C and gamma, lamp lumens, luminous opening."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.generation import SIMULATED
from lensforge.version import __version__

MOST_NUMBERS = 10**6  # of intensities: 721 x 361 is the finest seen; more comes from a damaged header
MOST_PLANES, MOST_GAMMAS = 3601, 18_001  # in steps of 0.1 and 0.01 degrees, finer than any goniophotometer
HUGE = 1e12  # above any real candela or lumen; squares of sums stay finite
SMALLEST = 1e-30  # below any real candela, lumen or watt but 0


def known(value: float) -> float | None:
    """A number of lumens or watts, or None where it is a way of writing unknown: 0, negative, absurd."""
    return value if SMALLEST < value < HUGE else None


def number_in(word: str) -> float:
    """The number that a word of a file is. Raises :class:`ValueError` for what only Python takes for one."""
    if "_" in word or not word.isascii():
        raise ValueError(f"{word[:20]!r} is no number")
    return float(word)


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
