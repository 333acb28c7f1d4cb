"""IES LM-63 (`.ies`): label lines, `TILT=`, then a stream of numbers, read whatever their line ends and separators.

The stream: lamps, lumens of each (-1: absolute photometry), multiplier, counts of gamma and C angles, photometric
type, unit (1 ft, 2 m), three sizes, ballast factor, a number for later use, watts; gamma angles, C angles, candela by
half-plane. Only type C is read: B and A turn about other axes. Tilt factors are for lamps that dim when tilted; the
far field is that of the luminaire as installed, so they are skipped.
"""

import re

import numpy as np

from lensforge.errors import InputError
from lensforge.sources.photometric.record import HUGE, MOST_NUMBERS, PhotometricFile, PhotometricFormat, tabulated

_TYPES = {1: "C", 2: "B", 3: "A"}
_TYPE_C, _METRES = 1, 2
_FIXED = 13  # numbers before the angles
_TILT = re.compile(r"^[ \t]*TILT[ \t]*=[ \t]*(\S+)[^\n]*$", re.MULTILINE | re.IGNORECASE)
_TITLE = re.compile(r"^\[LUMINAIRE\][ \t]*(.*)$", re.MULTILINE | re.IGNORECASE)
_PER_LINE = 10


def matches(text: str) -> bool:
    """True where ``text`` has the one line that all versions share."""
    return _TILT.search(text) is not None


def decode(text: str, name: str) -> PhotometricFile:
    """The far field in ``text``; ``name`` is the file in errors. Raises :class:`InputError`."""
    tilt = _TILT.search(text)
    if tilt is None:
        raise InputError(f"{name}: no line TILT=; not an LM-63 file")
    stream = _numbers(text[tilt.end() :], name)
    if tilt.group(1).upper() == "INCLUDE":
        pairs = _count(stream[1] if len(stream) > 1 else np.nan, name)
        stream = stream[2 + 2 * pairs :]
    if len(stream) < _FIXED:
        raise InputError(f"{name}: truncated: {len(stream)} numbers below TILT=, the header alone has {_FIXED}")
    lamps, lumens, multiplier, gammas, planes, kind, unit, width, *_, ballast, _, watts = stream[:_FIXED]
    if kind != _TYPE_C:
        raise InputError(f"{name}: photometric type {_TYPES.get(int(kind), int(kind))}: only type C; export it as such")
    g, c = _count(gammas, name), _count(planes, name)
    if len(stream) < _FIXED + g + c + c * g:
        raise InputError(f"{name}: truncated: {len(stream)} numbers, its header promises {_FIXED + g + c + c * g}")
    angles = stream[_FIXED : _FIXED + g + c]
    candela = stream[_FIXED + g + c :][: c * g].reshape(c, g) * (multiplier * ballast)
    title = _TITLE.search(text)
    return PhotometricFile(
        intensity=tabulated(angles[g:], angles[:g], candela, name),
        lamp_lumens=lamps * lumens if lumens > 0.0 else None,
        title=title.group(1).strip() if title else "",
        diameter_mm=-width * (1000.0 if unit == _METRES else 304.8) if width < 0.0 else 0.0,
        watts=watts,
        format="ies",
    )


def encode(photometric: PhotometricFile) -> str:
    """LM-63-2002, type C, metres; relative to the lamp's lumens where they are known, absolute elsewhere."""
    table = photometric.intensity
    size = f"{-photometric.diameter_mm / 1000.0:.6g}"
    counts = f"{len(table.gamma_deg)} {len(table.c_deg)} {_TYPE_C} {_METRES}"
    lines = [
        "IESNA:LM-63-2002",
        "[TEST] none: computed by tracing rays",
        "[TESTLAB] none",
        "[ISSUEDATE] none",
        "[MANUFAC] lensforge",
        f"[LUMINAIRE] {photometric.title}",
        "TILT=NONE",
        f"1 {photometric.lamp_lumens or -1:.7g} 1 {counts} {size} {size} 0",
        f"1 1 {photometric.watts:.6g}",
    ]
    for row in (table.gamma_deg, table.c_deg, *table.values):
        words = [f"{number:.7g}" for number in row]
        lines += [" ".join(words[start : start + _PER_LINE]) for start in range(0, len(words), _PER_LINE)]
    return "\r\n".join(lines) + "\r\n"


def _numbers(text: str, name: str) -> np.ndarray:
    words = text.replace(",", " ").split()
    if len(words) > 2 * MOST_NUMBERS:
        raise InputError(f"{name}: more than {2 * MOST_NUMBERS} numbers; not a photometric file")
    try:
        numbers = np.array([float(word) for word in words])
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
