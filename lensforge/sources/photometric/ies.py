"""IES LM-63 (`.ies`): labels, `TILT=`, then a stream of numbers, read whatever their line ends and separators.

The stream: lamps, lumens of each (-1: absolute photometry), multiplier, counts of gamma and C angles, photometric
type, unit (1 ft, 2 m), three sizes, ballast factor, a number whose meaning changed, watts; gamma angles, C angles,
candela by half-plane; after the last, nothing but the word END, which some programs write. Types A and B are converted
to type C. Tilt factors are for lamps that dim when tilted; the far field is that of the luminaire as installed, so they
are kept, not applied. The number whose meaning changed is a factor of the candela until 1991 (ballast-lamp photometric
factor), 1 and without meaning in 1995 and 2002, and the file generation type in 2019.

All editions are read, those of 2002 and 2019 are written. After ANSI/IESNA LM-63-02, the overview of the five editions
by the authors of Radiance's ies2rad, and for 2019 the programs named in ``photometric_file``.
"""

import re
from typing import Literal

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, refused
from lensforge.results.text_dialect import number_in
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.half_planes import converted, not_below_zero, tabulated
from lensforge.sources.photometric.ies_labels import NEWEST, IesVersion, Labels, label_lines, read_labels
from lensforge.sources.photometric.opening import LuminousOpening
from lensforge.sources.photometric.photometric_file import (
    HUGE,
    MOST_NUMBERS,
    UNDEFINED,
    LampSet,
    PhotometricFile,
    PhotometricFormat,
    count_in,
    generation_code,
    generation_title,
    require_promised,
    stated_or_none,
    tokens_of,
)

_Type = Literal["A", "B", "C"]
_TYPES: dict[float, _Type] = {1: "C", 2: "B", 3: "A"}
_TYPE_C = 1
_METRES = 2
_ABSOLUTE = -1.0  # lumens of a lamp in absolute photometry
_FIXED = 13  # numbers before the angles
_TILT = re.compile(r"^[ \t]*TILT[ \t]*=[ \t]*(\S[^\n]*?)[ \t]*$", re.MULTILINE | re.IGNORECASE)
_FIRST = re.compile(r"\s*IES(NA)?[ :]*(LM-63|91)", re.IGNORECASE)
_NO_TILT = "NONE"
_INCLUDED = "INCLUDE"
_GENERATION = re.compile(r"1\.[01]{5}")  # how a file of 2019 writes the type of its generation
_DECIMAL_COMMA = re.compile(r"\d,\d")
_CHANGED = 11  # place, from 0, of the number whose meaning changed
_PER_LINE = 10  # of 12 characters at most


def matches(text: str) -> bool:
    """True if ``text`` has the TILT= line that all versions share, or a first line that names LM-63."""
    return _TILT.search(text) is not None or _FIRST.match(text) is not None


def decode(text: str, name: str) -> PhotometricFile:
    """The far field in ``text``; ``name`` is the file in errors. Raises :class:`InputError`."""
    tilt = _TILT.search(text)
    if tilt is None:
        raise InputError(f"{name}: an LM-63 file without its line TILT=: write TILT=NONE between labels and numbers")
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
    """The far field from the numbers below TILT=, ``body``, and from the labels above, ``head``."""
    tokens = _tokens(body, name)
    stream = _numbers(tokens, name)
    if tilt.split()[0].upper() == _INCLUDED:
        pairs = count_in(stream[1] if len(stream) > 1 else np.nan, 1, name)
        tilt = " ".join((_INCLUDED, *tokens[: 2 + 2 * pairs]))
        stream = stream[2 + 2 * pairs :]
        tokens = tokens[2 + 2 * pairs :]
    if len(stream) < _FIXED:
        raise InputError(f"{name}: truncated: {len(stream)} numbers below TILT=, the header alone has {_FIXED}")
    lamps, lumens, multiplier, _, _, kind, unit, *sizes, ballast, _, watts = stream[:_FIXED]
    if kind not in _TYPES:
        raise InputError(f"{name}: photometric type {kind:g}: 1 (C), 2 (B) or 3 (A); export it again")
    v_deg, h_deg, table = _split(stream, name)
    labels = read_labels(head)
    factor, warnings = _factor(tokens[_CHANGED], labels)
    intensity, more = _far_field(_TYPES[kind], h_deg, v_deg, table * (multiplier * ballast * factor), name)
    lamp_lumens = stated_or_none(lamps * lumens) if lumens > 0.0 else None
    metres = 1000.0 if unit == _METRES else 304.8
    opening = LuminousOpening.of_signs((metres * sizes[0], metres * sizes[1], metres * sizes[2]), labels.year)
    lamp = LampSet(
        lamp_lumens,
        watts=stated_or_none(watts) or 0.0,
        count=int(lamps) if lamps > 0.0 and float(lamps).is_integer() else 0,
        kind=labels.lamp,
        catalogue=labels.lamp_catalogue,
    )
    if lamp_lumens is None and lumens != _ABSOLUTE:
        more = (*more, f"{lamps:g} lamps of {lumens:g} lm: taken as absolute photometry, which says -1 there")
    if not opening.known:
        more = (*more, f"the signs of its width, length and height ({opening}) are those of no opening of LM-63")
    tilt = "" if tilt.split()[0].upper() == _NO_TILT else tilt
    if tilt:
        more = (*more, f"TILT={tilt.split()[0][:20]}: its factors are not applied, the light is that without tilt")
    return PhotometricFile(
        intensity=intensity,
        lamps=(lamp,),
        generated=generation_title(tokens[_CHANGED]) if labels.year >= NEWEST else UNDEFINED,
        edition=f"LM-63-{labels.year}",
        opening=opening,
        lamp_tilt=tilt,
        ballast_factor=float(ballast),
        format="ies",
        photometric_type=_TYPES[kind],
        remarks=labels.remarks,
        others=labels.others,
        warnings=(*warnings, *more),
        **labels.fields,
    )


def _split(
    stream: Float[np.ndarray, " n"], name: str
) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " h"], Float[np.ndarray, "h v"]]:
    """Vertical and horizontal angles and the candela, as many as the header of the ``stream`` promises."""
    vertical, horizontal = (count_in(number, 1, name) for number in stream[3:5])
    require_promised(len(stream), _FIXED + vertical + horizontal + horizontal * vertical, name)
    v_deg, h_deg, candela = np.split(stream[_FIXED:], [vertical, vertical + horizontal])
    return v_deg, h_deg, candela.reshape(horizontal, vertical)


def _factor(word: str, labels: Labels) -> tuple[float, tuple[str, ...]]:
    """Ballast-lamp photometric factor by which the candela of files until 1991 are multiplied, and a warning on it."""
    number = number_in(word)
    if labels.year >= NEWEST or number == 1.0 or stated_or_none(number) is None:
        return 1.0, ()
    if labels.year > 1991:
        return 1.0, (f"{number:g} where LM-63-{labels.year} has 1, without a meaning: not used",)
    if not labels.named and _GENERATION.fullmatch(word):
        return 1.0, (f"its first line names no edition: {word} is taken as a file generation type, not as a factor",)
    return number, (
        f"candela multiplied by its ballast-lamp photometric factor, {number:g}, as LM-63-{labels.year} requires",
    )


def _far_field(
    kind: _Type, h_deg: Float[np.ndarray, " h"], v_deg: Float[np.ndarray, " v"], candela: np.ndarray, name: str
) -> tuple[CandelaTable, tuple[str, ...]]:
    """Intensity over C and gamma by the horizontal and vertical angles of the file, and warnings."""
    if kind == "C":
        table, warnings = tabulated(h_deg, v_deg, candela, name)
        if h_deg[-1] not in (h_deg[0], 90.0, 180.0, 270.0, 360.0) or (h_deg[0], h_deg[-1]) == (0.0, 270.0):
            line = f"its H angles end at {h_deg[-1]:g}, in LM-63 at 0, 90, 180 or 360: taken as those of a whole turn"
            warnings = (*warnings, line)
        return table, warnings
    candela, warnings = not_below_zero(candela, name)
    table, line = converted(kind, v_deg, h_deg, candela, name)
    return table, (*warnings, line)


def encode(photometric: PhotometricFile, version: IesVersion = NEWEST) -> str:
    """LM-63 of the edition ``version``, type C, metres; relative to the lumens of the lamp if known, else absolute."""
    table = photometric.intensity
    lamp = photometric.lamps[0]
    lumens = photometric.written_lumens
    lumens_per_lamp = _ABSOLUTE if lumens is None else lumens / max(lamp.count, 1)
    sizes = " ".join(f"{size / 1000.0:.6g}" for size in photometric.opening.signed_mm())
    counts = f"{len(table.gamma_deg)} {len(table.c_deg)} {_TYPE_C} {_METRES}"
    changed = generation_code(photometric.generated) if version == NEWEST else "1"
    tilt = photometric.lamp_tilt or _NO_TILT
    tilt, *tilt_numbers = tilt.split() if tilt.upper().startswith(_INCLUDED) else [tilt]
    lines = [
        *label_lines(photometric, version),
        f"TILT={tilt}",
        *_number_lines(tilt_numbers),
        f"{max(lamp.count, 1)} {lumens_per_lamp:.7g} 1 {counts} {sizes}",
        f"{photometric.ballast_factor:.7g} {changed} {photometric.watts:.6g}",
    ]
    for row in (table.gamma_deg, table.c_deg, *table.values / photometric.ballast_factor):
        lines += _number_lines([f"{number:.7g}" for number in row])
    return "\r\n".join(lines) + "\r\n"


def _number_lines(tokens: list[str]) -> list[str]:
    return [" ".join(tokens[start : start + _PER_LINE]) for start in range(0, len(tokens), _PER_LINE)]


def _tokens(text: str, name: str) -> list[str]:
    tokens = tokens_of(text.replace(",", " "))
    if len(tokens) > 2 * MOST_NUMBERS:
        raise InputError(f"{name}: more than {2 * MOST_NUMBERS} numbers; not a photometric file")
    return tokens


def _numbers(tokens: list[str], name: str) -> Float[np.ndarray, " n"]:
    with refused(name, "not all that follows TILT= are numbers; export it again", ValueError):
        numbers = np.array([number_in(word) for word in tokens])
    if not np.all(np.abs(numbers) < HUGE):
        raise InputError(f"{name}: its numbers are not all finite and below {HUGE:g}; export it again")
    return numbers


FORMAT = PhotometricFormat("IES LM-63", ".ies", matches, decode, encode)
