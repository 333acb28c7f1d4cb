"""IES LM-63 (`.ies`): label lines, `TILT=`, then a stream of numbers, read whatever their line ends and separators.

The stream: lamps, lumens of each (-1: absolute photometry), multiplier, counts of gamma and C angles, photometric
type, unit (1 ft, 2 m), three sizes, ballast factor, a number whose meaning changed, watts; gamma angles, C angles,
candela by half-plane; after the last, nothing but the word END, which some programs write. Types A and B are converted
to type C. Tilt factors are for lamps that dim when tilted; the far field is that of the luminaire as installed, so they
are skipped. The number whose meaning changed is a factor of the candela until 1991 (ballast-lamp photometric factor), 1
and without meaning in 1995 and 2002, and the file generation type in 2019.

All editions are read, those of 2002 and 2019 are written. Labels: an edition of 1986 has no first line, and free text;
2002 and 2019 require [TEST], [TESTLAB], [ISSUEDATE] and [MANUFAC], and 2019 has [FILEGENINFO] for what the number of
the file generation type leaves open. Lines of labels have 256 characters, the two of their end included; [MORE]
continues the label before. After ANSI/IESNA LM-63-02, the overview of the five editions by the authors of Radiance's
ies2rad, and for 2019 the programs named in ``photometric_file``.
"""

import re
from collections.abc import Iterator
from textwrap import wrap
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.half_planes import converted, not_below_zero, tabulated
from lensforge.sources.photometric.photometric_file import (
    HUGE,
    MOST_NUMBERS,
    UNDEFINED,
    PhotometricFile,
    PhotometricFormat,
    count_in,
    generation_code,
    generation_title,
    number_in,
    require_promised,
    single_line,
    stated_or_none,
    words_of,
)

IesVersion = Literal[2002, 2019]
NEWEST: IesVersion = 2019
_FIRST_LINES: dict[IesVersion, str] = {2002: "IESNA:LM-63-2002", 2019: "IES:LM-63-2019"}
_LONG = 254  # characters of a line, without those of its end
_EDITION = re.compile(r"IES(?:NA)?:\s*LM-63-(\d{4})|IESNA(91)\s*$", re.IGNORECASE)
_LABEL = re.compile(r"\[\s*(\w+)\s*\][ \t]*(.*)$")
_NOT_STATED = "not stated"  # in labels that a file must have
_FIELDS = {
    "test": "TEST", "laboratory": "TESTLAB", "issued": "ISSUEDATE", "maker": "MANUFAC", "catalogue": "LUMCAT",
    "title": "LUMINAIRE", "method": "FILEGENINFO",
}  # fmt: skip
_REQUIRED = ("TEST", "TESTLAB", "ISSUEDATE", "MANUFAC")


def require_ies_version(version: int) -> IesVersion:
    """``version`` if it is a year of LM-63 that is written. Raises :class:`InputError`."""
    edition = next((year for year in _FIRST_LINES if year == version), None)
    if edition is None:
        raise InputError(f"ies_version = {version!r}: 2002 or {NEWEST}; leave it out for {NEWEST}")
    return edition


def label_lines(photometric: PhotometricFile, version: IesVersion) -> list[str]:
    """Lines of a file of the edition ``version`` above that of TILT=."""
    lines = [_FIRST_LINES[version]]
    for keyword, text in _labels(photometric, version):
        width = _LONG - len("[MORE] ") - max(len(keyword) - len("MORE"), 0)
        first, *rest = wrap(single_line(text), width, break_on_hyphens=False) or [""]
        lines += [f"[{keyword}] {first}".rstrip(), *(f"[MORE] {more}" for more in rest)]
    return lines


def _labels(photometric: PhotometricFile, version: IesVersion) -> Iterator[tuple[str, str]]:
    """Keywords and their texts, those that are required first."""
    for field, keyword in _FIELDS.items():
        text = getattr(photometric, field)
        if keyword in _REQUIRED or (text and (keyword != "FILEGENINFO" or version == NEWEST)):
            yield keyword, text or _NOT_STATED
    for remark in photometric.remarks:
        yield "OTHER", remark


def read_labels(head: str) -> tuple[int, dict[str, str]]:
    """Year of the edition, and the labels in ``head``, all above TILT=: the first of each keyword, continued by [MORE].

    A file without first line is one of 1986, and its first line of text the name of the luminaire.
    """
    lines = [line.strip() for line in head.split("\n") if line.strip()]
    named = _EDITION.match(lines[0]) if lines else None
    year = 1986 if named is None else int(named.group(1) or 1991)
    labels: dict[str, str] = {}
    last = ""
    for line in lines:
        label = _LABEL.match(line)
        if label is None:
            continue
        keyword, text = label.group(1).upper(), label.group(2).strip()
        if keyword == "MORE":
            labels[last] = f"{labels.get(last, '')} {text}".strip()
        else:
            last = keyword if keyword not in labels else ""
            labels.setdefault(keyword, text)
    if named is None and lines and not labels:
        labels["LUMINAIRE"] = lines[0]
    return year, {keyword: "" if text == _NOT_STATED else text for keyword, text in labels.items() if keyword}


_Type = Literal["A", "B", "C"]
_TYPES: dict[float, _Type] = {1: "C", 2: "B", 3: "A"}
_TYPE_C, _METRES = 1, 2
_ABSOLUTE = -1.0  # lumens of a lamp in absolute photometry
_FIXED = 13  # numbers before the angles
_TILT = re.compile(r"^[ \t]*TILT[ \t]*=[ \t]*(\S+)[^\n]*$", re.MULTILINE | re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"\d,\d")
_CHANGED = 11  # place, from 0, of the number whose meaning changed
_PER_LINE = 10  # of 12 characters at most


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
        return _decode_numbers(body, tilt.group(1), name, text[: tilt.start()])
    except InputError as error:
        if _DECIMAL_COMMA.search(body) is None:
            raise
        raise InputError(
            f"{error}; its commas separate numbers, as LM-63 has it: where they are decimal commas, write points"
        ) from None


def _decode_numbers(body: str, tilt: str, name: str, head: str) -> PhotometricFile:
    """The far field by the numbers below TILT=, ``body``; the labels above, ``head``, say what it is."""
    words = _words(body, name)
    stream = _numbers(words, name)
    if tilt.upper() == "INCLUDE":
        pairs = count_in(stream[1] if len(stream) > 1 else np.nan, 1, name)
        stream, words = stream[2 + 2 * pairs :], words[2 + 2 * pairs :]
    if len(stream) < _FIXED:
        raise InputError(f"{name}: truncated: {len(stream)} numbers below TILT=, the header alone has {_FIXED}")
    lamps, lumens, multiplier, _, _, kind, unit, width, *_, ballast, _, watts = stream[:_FIXED]
    if kind not in _TYPES:
        raise InputError(f"{name}: photometric type {kind:g}: 1 (C), 2 (B) or 3 (A); export it again")
    v_deg, h_deg, table = _split(stream, name)
    year, labels = read_labels(head)
    factor, warnings = _factor(stream[_CHANGED], year)
    intensity, more = _far_field(_TYPES[kind], h_deg, v_deg, table * (multiplier * ballast * factor), name)
    lamp_lumens = stated_or_none(lamps * lumens) if lumens > 0.0 else None
    if lamp_lumens is None and lumens != _ABSOLUTE:
        more = (*more, f"{lamps:g} lamps of {lumens:g} lm: taken as absolute photometry, which says -1 there")
    stated: dict[str, Any] = {field: labels.get(keyword, "") for field, keyword in _FIELDS.items()}
    return PhotometricFile(
        intensity=intensity,
        lamp_lumens=lamp_lumens,
        generated=generation_title(words[_CHANGED]) if year >= NEWEST else UNDEFINED,
        edition=f"LM-63-{year}",
        diameter_mm=-width * (1000.0 if unit == _METRES else 304.8) if width < 0.0 else 0.0,
        watts=stated_or_none(watts) or 0.0,
        format="ies",
        photometric_type=_TYPES[kind],
        warnings=(*warnings, *more),
        **stated,
    )


def _split(
    stream: Float[np.ndarray, " n"], name: str
) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " h"], Float[np.ndarray, "h v"]]:
    """Vertical and horizontal angles and the candela, as many as the header of the ``stream`` promises."""
    vertical, horizontal = (count_in(number, 1, name) for number in stream[3:5])
    require_promised(len(stream), _FIXED + vertical + horizontal + horizontal * vertical, name)
    v_deg, h_deg, candela = np.split(stream[_FIXED:], [vertical, vertical + horizontal])
    return v_deg, h_deg, candela.reshape(horizontal, vertical)


def _factor(number: float, year: int) -> tuple[float, tuple[str, ...]]:
    """Ballast-lamp photometric factor by which the candela of files until 1991 are multiplied, and the words on it."""
    if year > 1991 or number == 1.0 or stated_or_none(number) is None:
        return 1.0, ()
    return float(number), (
        f"candela multiplied by its ballast-lamp photometric factor, {number:g}, as LM-63-{year} asks",
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


def encode(photometric: PhotometricFile, version: IesVersion = NEWEST) -> str:
    """LM-63 of the edition ``version``, type C, metres; relative to the lumens of the lamp if known, else absolute."""
    table = photometric.intensity
    size = f"{-photometric.diameter_mm / 1000.0:.6g}" if photometric.diameter_mm > 0.0 else "0"
    counts = f"{len(table.gamma_deg)} {len(table.c_deg)} {_TYPE_C} {_METRES}"
    changed = generation_code(photometric.generated) if version == NEWEST else "1"
    lines = [
        *label_lines(photometric, version),
        "TILT=NONE",
        f"1 {photometric.lamp_lumens or -1:.7g} 1 {counts} {size} {size} 0",
        f"1 {changed} {photometric.watts:.6g}",
    ]
    for row in (table.gamma_deg, table.c_deg, *table.values):
        words = [f"{number:.7g}" for number in row]
        lines += [" ".join(words[start : start + _PER_LINE]) for start in range(0, len(words), _PER_LINE)]
    return "\r\n".join(lines) + "\r\n"


def _words(text: str, name: str) -> list[str]:
    words = words_of(text.replace(",", " "))
    if len(words) > 2 * MOST_NUMBERS:
        raise InputError(f"{name}: more than {2 * MOST_NUMBERS} numbers; not a photometric file")
    return words


def _numbers(words: list[str], name: str) -> Float[np.ndarray, " n"]:
    try:
        numbers = np.array([number_in(word) for word in words])
    except ValueError:
        raise InputError(f"{name}: not all that follows TILT= are numbers; export it again") from None
    if not np.all(np.abs(numbers) < HUGE):
        raise InputError(f"{name}: its numbers are not all finite and below {HUGE:g}; export it again")
    return numbers


FORMAT = PhotometricFormat(".ies", matches, decode, encode)
