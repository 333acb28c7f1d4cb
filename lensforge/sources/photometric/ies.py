"""IES LM-63 (`.ies`): label lines, `TILT=`, then a stream of numbers, read whatever their line ends and separators.

The stream: lamps, lumens of each (-1: absolute photometry), multiplier, counts of gamma and C angles, photometric
type, unit (1 ft, 2 m), three sizes, ballast factor, a number for later use, watts; gamma angles, C angles, candela by
half-plane; after the last, nothing but the word END, which some programs write. Types A and B are converted to type C.
Tilt factors are for lamps that dim when tilted; the far field is that of the luminaire as installed, so they are
skipped.
"""

import re
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.half_planes import not_below_zero, tabulated
from lensforge.sources.photometric.record import (
    HUGE,
    MOST_NUMBERS,
    PhotometricFile,
    PhotometricFormat,
    known,
    number_in,
)
from lensforge.sources.photometric.types_a_and_b import converted

_Type = Literal["A", "B", "C"]
_TYPES: dict[float, _Type] = {1: "C", 2: "B", 3: "A"}
_TYPE_C, _METRES = 1, 2
_ABSOLUTE = -1.0  # lumens of a lamp in absolute photometry
_FIXED = 13  # numbers before the angles
_TILT = re.compile(r"^[ \t]*TILT[ \t]*=[ \t]*(\S+)[^\n]*$", re.MULTILINE | re.IGNORECASE)
_TITLE = re.compile(r"^\[LUMINAIRE\][ \t]*(.*)$", re.MULTILINE | re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"\d,\d")
_PER_LINE = 10
_MOST_LABEL = 240  # characters; LM-63 allows 256 on a line, its end and keyword included


def matches(text: str) -> bool:
    """True where ``text`` has the one line that all versions share."""
    return _TILT.search(text) is not None


def decode(text: str, name: str) -> PhotometricFile:
    """The far field in ``text``; ``name`` is the file in errors. Raises :class:`InputError`."""
    tilt = _TILT.search(text)
    if tilt is None:
        raise InputError(f"{name}: no line TILT=; not an LM-63 file")
    body = text[tilt.end() :]
    try:
        return _decode_numbers(body, tilt.group(1), name, text)
    except InputError as error:
        if _DECIMAL_COMMA.search(body) is None:
            raise
        raise InputError(
            f"{error}; its commas separate numbers, as LM-63 has it: where they are decimal commas, write points"
        ) from None


def _decode_numbers(body: str, tilt: str, name: str, text: str) -> PhotometricFile:
    """The far field by the numbers below TILT=, ``body``; the labels of the whole ``text`` say what it is."""
    stream = _numbers(body, name)
    if tilt.upper() == "INCLUDE":
        pairs = _count(stream[1] if len(stream) > 1 else np.nan, name)
        stream = stream[2 + 2 * pairs :]
    if len(stream) < _FIXED:
        raise InputError(f"{name}: truncated: {len(stream)} numbers below TILT=, the header alone has {_FIXED}")
    lamps, lumens, multiplier, gammas, planes, kind, unit, width, *_, ballast, _, watts = stream[:_FIXED]
    if kind not in _TYPES:
        raise InputError(f"{name}: photometric type {kind:g}: 1 (C), 2 (B) or 3 (A); export it again")
    g, c = _count(gammas, name), _count(planes, name)
    needed = _FIXED + g + c + c * g
    if len(stream) < needed:
        raise InputError(f"{name}: truncated: {len(stream)} numbers, its header promises {needed}")
    if len(stream) > needed:
        raise InputError(
            f"{name}: {len(stream)} numbers, its header promises {needed}: {len(stream) - needed} too many; "
            f"export it again"
        )
    angles = stream[_FIXED : _FIXED + g + c]
    candela = stream[_FIXED + g + c :].reshape(c, g) * (multiplier * ballast)
    intensity, warnings = _far_field(_TYPES[kind], angles[g:], angles[:g], candela, name)
    lamp_lumens = known(lamps * lumens) if lumens > 0.0 else None
    if lamp_lumens is None and lumens != _ABSOLUTE:
        warnings = (*warnings, f"{lamps:g} lamps of {lumens:g} lm: taken as absolute photometry, which says -1 there")
    title = _TITLE.search(text)
    return PhotometricFile(
        intensity=intensity,
        lamp_lumens=lamp_lumens,
        title=title.group(1).strip() if title else "",
        maker=_label(text, "MANUFAC"),
        test=_label(text, "TEST"),
        diameter_mm=-width * (1000.0 if unit == _METRES else 304.8) if width < 0.0 else 0.0,
        watts=known(watts) or 0.0,
        format="ies",
        photometric_type=_TYPES[kind],
        warnings=warnings,
    )


def _far_field(
    kind: _Type, h_deg: Float[np.ndarray, " h"], v_deg: Float[np.ndarray, " v"], candela: np.ndarray, name: str
) -> tuple[TabulatedIntensity, tuple[str, ...]]:
    """Intensity over C and gamma by the horizontal and vertical angles of the file, and warnings."""
    if kind == "C":
        return tabulated(h_deg, v_deg, candela, name)
    candela, warnings = not_below_zero(candela, name)
    table, line = converted(kind, v_deg, h_deg, candela, name)
    return table, (*warnings, line)


def encode(photometric: PhotometricFile) -> str:
    """LM-63-2002, type C, metres; relative to the lamp's lumens where they are known, absolute elsewhere."""
    table = photometric.intensity
    size = f"{-photometric.diameter_mm / 1000.0:.6g}"
    counts = f"{len(table.gamma_deg)} {len(table.c_deg)} {_TYPE_C} {_METRES}"
    lines = [
        "IESNA:LM-63-2002",
        f"[TEST] {photometric.test[:_MOST_LABEL]}",
        "[TESTLAB] none",
        "[ISSUEDATE] none",
        f"[MANUFAC] {photometric.maker[:_MOST_LABEL]}",
        f"[LUMINAIRE] {photometric.title[:_MOST_LABEL]}",
        *(f"[OTHER] {remark[:_MOST_LABEL]}" for remark in photometric.remarks),
        "TILT=NONE",
        f"1 {photometric.lamp_lumens or -1:.7g} 1 {counts} {size} {size} 0",
        f"1 1 {photometric.watts:.6g}",
    ]
    for row in (table.gamma_deg, table.c_deg, *table.values):
        words = [f"{number:.7g}" for number in row]
        lines += [" ".join(words[start : start + _PER_LINE]) for start in range(0, len(words), _PER_LINE)]
    return "\r\n".join(lines) + "\r\n"


def _label(text: str, keyword: str) -> str:
    found = re.search(rf"^\[{keyword}\][ \t]*(.*)$", text, re.MULTILINE | re.IGNORECASE)
    return found.group(1).strip() if found else ""


def _numbers(text: str, name: str) -> np.ndarray:
    words = text.replace(",", " ").split()
    words = words[:-1] if words and words[-1].upper() == "END" else words
    if len(words) > 2 * MOST_NUMBERS:
        raise InputError(f"{name}: more than {2 * MOST_NUMBERS} numbers; not a photometric file")
    try:
        numbers = np.array([number_in(word) for word in words])
    except ValueError:
        raise InputError(f"{name}: not all that follows TILT= are numbers; export it again") from None
    if not np.all(np.abs(numbers) < HUGE):
        raise InputError(f"{name}: its numbers are not all finite and below {HUGE:g}; export it again")
    return numbers


def _count(number: float, name: str) -> int:
    if not (1.0 <= number <= MOST_NUMBERS and float(number).is_integer()):
        raise InputError(f"{name}: a count of {number:g} angles in its header; export it again")
    return int(number)


FORMAT = PhotometricFormat(".ies", matches, decode, encode)
