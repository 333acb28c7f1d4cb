"""Record of a photometric file of any format: candela over C and gamma, and all that its header states.

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
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from lensforge.errors import InputError
from lensforge.results.text_dialect import number_in
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.opening import NO_OPENING, LuminousOpening
from lensforge.version import __version__

SIMULATED = "Computer Simulation"
UNDEFINED = "Undefined"
_UNACCREDITED = "Test at an unaccredited lab"
_ACCREDITED = "Test at an accredited lab"
_SCALED = " that has been lumen scaled"
_INTERPOLATED = " with interpolated angle set"
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

    A bare 1 is undefined, too: older programs write it without meaning.
    """
    whole, _, digits = word.partition(".")
    if len(digits) < 5 and not digits.strip("0"):
        return UNDEFINED
    return _TITLES.get(f"{whole}.{digits.rstrip('0'):0<5}", UNDEFINED)


def generation_code(title: str) -> str:
    """Number by which a file of 2019 states how its data were generated."""
    return _CODES.get(title, _CODES[UNDEFINED])


def turned_over(table: CandelaTable) -> CandelaTable:
    """Table with C counted the other way: from a file's frame to the lens's, where C runs from +x to +y, or back."""
    if len(table.c_deg) == 1:
        return table
    return CandelaTable(np.ascontiguousarray(360.0 - table.c_deg[::-1]), table.gamma_deg, table.values[::-1])


MOST_NUMBERS = 10**6  # of intensities: 721 x 361 is the finest seen; more comes from a damaged header
MOST_PLANES = 3601  # in steps of 0.1 and 0.01 degrees
MOST_GAMMAS = 18_001  # finer than any goniophotometer
HUGE = 1e12  # above any real candela or lumen; squares of sums stay finite
SMALLEST = 1e-30  # below any real candela, lumen or watt but 0


def stated_or_none(value: float) -> float | None:
    """A number of lumens or watts, or None for the ways of writing unknown: 0, negative, absurd."""
    return value if SMALLEST < value < HUGE else None


def finite_number(word: str, place: str, name: str, *, commas: bool = False) -> float:
    """The number at a ``place`` of the file ``name``, with ``commas`` also as decimal sign.

    Raises :class:`InputError` for any other word, and unless the number is finite and below 1e12.
    """
    try:
        number = number_in(word.replace(",", ".") if commas else word)
    except ValueError:
        raise InputError(f"{name}: {word[:20]!r} where {place} has a number; export it again") from None
    if not abs(number) < HUGE:
        raise InputError(f"{name}: a number of {place} is not finite and below {HUGE:g}; export it again")
    return number


def tokens_of(text: str) -> list[str]:
    """The words of a stream of numbers, without the END that some programs write behind it."""
    tokens = text.split()
    return tokens[:-1] if tokens and tokens[-1].upper() == "END" else tokens


def count_in(number: float, least: int, name: str) -> int:
    """A ``number`` in the header of the file ``name`` as a count. Raises :class:`InputError` unless it is one."""
    if not (least <= number <= MOST_NUMBERS and float(number).is_integer()):
        raise InputError(f"{name}: a count of {number:g} in its header; export it again")
    return int(number)


def require_promised(count: int, needed: int, name: str, where: str = "") -> None:
    """Raise :class:`InputError` unless a file holds as many numbers as its header states; ``where``: their place."""
    promise = f"{count} numbers{where}, its header promises {needed}"
    if count < needed:
        raise InputError(f"{name}: truncated: {promise}")
    if count > needed:
        raise InputError(f"{name}: {promise}: {count - needed} too many; export it again")


def _stated(default: Any, label: str) -> Any:
    """A field stated by a file, and its ``label`` in the report of a conversion."""
    return field(default=default, metadata={"label": label})


@dataclass(frozen=True)
class LampSet:
    """Lamps of a luminaire: lumens and watts (with ballast) of all ``count`` together.

    ``lumens``: None if the file states none; ``count``: 0 where it states none. ``colour``, the appearance or the
    colour temperature, and ``rendering``, a group or an index, are texts in EULUMDAT.
    """

    lumens: float | None = _stated(None, "lumens of the lamps")
    watts: float = _stated(0.0, "watts")
    count: int = _stated(1, "number of lamps")
    kind: str = _stated("", "lamp")
    catalogue: str = _stated("", "catalogue number of the lamp")
    colour: str = _stated("", "colour of the lamp")
    rendering: str = _stated("", "colour rendering of the lamp")

    def __str__(self) -> str:
        flux = "" if self.lumens is None else f"{self.lumens:.6g} lm"
        power = f"{self.watts:.6g} W" if self.watts > 0.0 else ""
        lamps = f"{self.count} x {self.kind or 'not named'}"
        return ", ".join(filter(None, (lamps, self.catalogue, flux, self.colour, self.rendering, power)))


@dataclass(frozen=True, eq=False)
class PhotometricFile:
    """Far field, and all that a file states beside it.

    ``intensity`` in cd for the ``lamp_lumens``, over C and gamma, whatever the ``photometric_type`` of the angles in
    the file. ``lamps``: sets of lamps, the first that of the intensities, others instead of it. Its lumens are None
    where the file is absolute, or gives ``per_1000_lm`` of lamps whose lumens it does not state. ``stated_lumens``: the
    luminaire's flux by the file itself, None if it states none. ``warnings``: whatever was not taken as it stands,
    one line each. ``remarks``: lines on the data, such as its noise, for whoever opens the file.

    ``generated``: by simulation or measurement, in the words of LM-63-2019; ``method``: more on that. ``issued``: date
    of the data, empty if nothing states one: it is never that of the clock. ``edition``: of the standard that the
    file follows, by its own words. ``housing_mm``: length, width (0: round) and height of the luminaire. ``tilt_deg``:
    of the luminaire during the measurement. ``lamp_tilt``: what stands behind TILT= in LM-63, in words; its factors and
    the ``ballast_factor`` are LM-63's, the latter is in the intensities. ``others``: what no other field holds, by name
    and text: keywords of LM-63, elements of TM-33 by their path.
    """

    intensity: CandelaTable
    lamps: tuple[LampSet, ...] = (LampSet(),)
    stated_lumens: float | None = _stated(None, "stated lumens of the luminaire")
    title: str = _stated("", "name of the luminaire")
    opening: LuminousOpening = field(default=NO_OPENING, metadata={"label": "opening"})
    format: str = ""
    photometric_type: Literal["A", "B", "C"] = "C"
    warnings: tuple[str, ...] = ()
    remarks: tuple[str, ...] = _stated((), "remark")
    maker: str = _stated("lensforge", "maker")
    test: str = _stated("none: computed by tracing rays", "number of the report")
    catalogue: str = _stated("", "catalogue number")
    generated: str = _stated(SIMULATED, "generation of the data")
    method: str = _stated(f"rays traced through the lens by lensforge {__version__}", "method")
    laboratory: str = _stated("none: not measured, computed by lensforge", "laboratory")
    issued: str = _stated("", "date of issue")
    edition: str = ""
    per_1000_lm: bool = False
    housing_mm: tuple[float, float, float] = _stated((0.0, 0.0, 0.0), "length, width and height of the luminaire (mm)")
    linear: bool = _stated(False, "type of the luminaire, linear")
    tilt_deg: float = _stated(0.0, "tilt during the measurement (deg)")
    lamp_tilt: str = _stated("", "TILT of the lamp")
    ballast_factor: float = _stated(1.0, "ballast factor, which is in the intensities")
    direct_ratios: tuple[float, ...] = _stated((), "direct ratios")
    file_name: str = _stated("", "name of the file in it")
    others: tuple[tuple[str, str], ...] = _stated((), "")

    @property
    def lamp_lumens(self) -> float | None:
        """Lumens of the lamps to which the intensities belong; None if unknown."""
        return self.lamps[0].lumens

    @property
    def absolute(self) -> bool:
        """True if the intensities are those of the luminaire, whatever the lumens of its lamps."""
        return self.lamp_lumens is None and not self.per_1000_lm

    @property
    def written_lumens(self) -> float | None:
        """Lumens of the lamps for a format that needs them: 1000 if unknown; None for an absolute file."""
        return 1000.0 if self.per_1000_lm else self.lamp_lumens

    @property
    def watts(self) -> float:
        """Electric power of these lamps; 0 where it is not known."""
        return self.lamps[0].watts

    @property
    def rated_lumens(self) -> float:
        """Lumens to which the intensities belong: of the lamps, or for an absolute file of its light."""
        return self.written_lumens or self.intensity.flux()


def single_line(text: str) -> str:
    """``text`` without line ends, tabs and other characters that no line of a file may hold."""
    return " ".join("".join(mark if mark.isprintable() else " " for mark in text).split())


class UnknownFarField(InputError):
    """A file whose content is none of the known formats."""


@dataclass(frozen=True)
class PhotometricFormat:
    """A format: ``matches`` a text by its content, ``decode`` a text and its file's name, ``encode`` a far field.

    The texts have "\\n" for line ends, whatever the file has. ``encoding``: of the bytes that are written.
    """

    title: str
    suffix: str
    matches: Callable[[str], bool]
    decode: Callable[[str, str], PhotometricFile]
    encode: Callable[[PhotometricFile], str]
    encoding: str = "latin-1"


_LARGEST_LM_PER_W = 683.002  # of light at 555 nm, the peak of V
_FLUX_TOLERANCE = 0.01  # integral and stated flux of real files agree this well
# Sides of a luminous opening or a luminaire.
_SMALLEST_MM = 1.0
_LARGEST_MM = 10_000.0
_CUT_SHARE = 0.01  # of the peak: more than that at the last gamma, and the file has lost light beyond it


def far_field_warnings(file: PhotometricFile) -> tuple[str, ...]:
    """Warnings on anything in the file that was reinterpreted, or contradicts itself."""
    return (*file.warnings, *_contradictions(file), *_strange_sizes(file), *_cut(file))


def _contradictions(file: PhotometricFile) -> Iterator[str]:
    lumens = file.intensity.flux()
    stated = file.stated_lumens
    watts = file.watts
    if stated and abs(lumens / stated - 1.0) > _FLUX_TOLERANCE:
        yield f"its intensities integrate to {lumens:.6g} lm, the file states {stated:.6g} lm"
    if file.lamp_lumens and lumens > file.lamp_lumens * (1.0 + _FLUX_TOLERANCE):
        yield f"its light has {lumens:.6g} lm, its lamps only {file.lamp_lumens:.6g} lm: check its factors"
    if watts > 0.0 and lumens > _LARGEST_LM_PER_W * watts:
        yield f"{lumens / watts:.4g} lm per W, no light has more than 683: check its lumens and watts"


def _strange_sizes(file: PhotometricFile) -> Iterator[str]:
    """Warnings on sizes that no luminaire has: they may be in another unit."""
    opening = file.opening
    of_light = (opening.width_mm, opening.length_mm, opening.height_mm)
    of_housing = file.housing_mm
    for name, (width, length, height) in (("luminous opening", of_light), ("luminaire", of_housing)):
        sizes = [size for size in (width, length) if size > 0.0]
        if max(width, length, height) > _LARGEST_MM or min(sizes, default=_SMALLEST_MM) < _SMALLEST_MM:
            limits = f"within {_SMALLEST_MM:g} mm and {_LARGEST_MM / 1000.0:g} m"
            yield f"its {name} is {width:.6g} x {length:.6g} x {height:.6g} mm, sizes are {limits}: in another unit?"


def cut_below(file: PhotometricFile) -> str | None:
    """Warning on light at the last gamma, beyond which the file misses some; None if it is complete."""
    table = file.intensity
    last = float(table.gamma_deg[-1])
    at_last = float(table.values[:, -1].max() / table.values.max())
    if last in (90.0, 180.0) or at_last <= _CUT_SHARE:
        return None
    return f"its last gamma is {last:g} degrees, with {100.0 * at_last:.3g} % of the largest intensity"


def _cut(file: PhotometricFile) -> Iterator[str]:
    first = float(file.intensity.gamma_deg[0])
    if (notice := cut_below(file)) is not None:
        yield f"{notice}: light beyond is not in the file"
    if first > 0.0:
        yield f"its first gamma is {first:g} degrees: no light is taken within that"
