"""EULUMDAT (`.ldt`): one value on each line, by position; intensities in cd per 1000 lm of the lamps.

Half-planes left out by the symmetry code: 1 revolution (one half-plane), 2 plane C 0 - C 180, 3 plane C 90 - C 270
(stored from C 270 through C 0 to C 90), 4 both. The type indicator is 1 for light of revolution, 2 for a linear
luminaire, 3 for any other. A negative number of lamps says absolute photometry, with the lumens of the luminaire as
those of its lamps: a convention of LED luminaires, younger than the format. Decimal commas occur; nothing follows the
last intensity but the word END, which some programs write.

The format (Stockmar, Licht '90 and CIBSE 1998, as DIAL and the Photometric Toolbox list it) gives a number of
characters for each line: 78 for texts, which are kept, and few for numbers (4 for a light output ratio), which are for
the tables of its time: programs read numbers of any length, so they are written with all their digits.
"""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.photometric.candela_table import CandelaTable
from lensforge.sources.photometric.half_planes import tabulated
from lensforge.sources.photometric.opening import LuminousOpening
from lensforge.sources.photometric.photometric_file import (
    HUGE,
    MOST_NUMBERS,
    SMALLEST,
    UNDEFINED,
    LampSet,
    PhotometricFile,
    PhotometricFormat,
    count_in,
    finite_number,
    require_promised,
    single_line,
    stated_or_none,
    tokens_of,
)
from lensforge.sources.photometric.room_ratios import ROOM_INDICES, direct_ratios

_HEADER_LINES = 26
_LINES_PER_SET = 6
_RATIOS = len(ROOM_INDICES)  # direct ratios of the utilisation method; all 0 in a file: not given
_NUMBERS = (*range(1, 7), *range(12, 26))  # lines of the header that hold one
_THOUSANDS = re.compile(r"[1-9]\d{0,2}([.,]\d{3})+")  # what is written like 1,234: in thousands, or with decimals
_TYPE = 1
_SYMMETRY = 2
_PLANES = 3
_GAMMAS = 5
_TEST = 7
_NAME = 8
_NUMBER = 9
_FILE = 10
_DATE = 11
_HOUSING = 12  # length or diameter, width (0: round) and height
_AREA = 15  # of the light
_HEIGHTS = 17  # of the light's sides
_C_STEP = 4
_GAMMA_STEP = 6
_DOWNWARD = 21
_SAME_STEP = 0.01  # relative
_SAME_SHARE = 3.0  # per cent, which programs round or take from their own integral
_LORL = 22
_FACTOR = 23
_TILT = 24
_SETS = 25
_COUNT, _KIND, _LUMENS, _COLOUR, _RENDERING, _WATTS = range(_LINES_PER_SET)  # lines of a set of lamps
_LINEAR = 2.0  # type of a linear luminaire
_TEXT = 78  # characters of a line of text
_REMARK = "; "  # between date and remark
_UNDATED = "no date"  # before a remark without a date
_FEW_LM = 100.0  # of lamps whose watts are not known; of others, 1 lm/W: less is no lamp, but thousands may be meant


def matches(text: str) -> bool:
    """True if the first lines hold the numbers of an EULUMDAT header."""
    lines, _ = _lines(text)
    try:
        return len(lines) > _HEADER_LINES and all(_number(lines[i], "") >= 0.0 for i in (1, 2, 3, 4, 5, 6))
    except InputError:
        return False


def decode(text: str, name: str) -> PhotometricFile:
    """The far field in ``text``; ``name`` is the file in errors. Raises :class:`InputError`."""
    lines, doubled = _lines(text)
    if len(lines) < _HEADER_LINES + _LINES_PER_SET:
        raise InputError(
            f"{name}: truncated: {len(lines)} lines, the header alone has {_HEADER_LINES + _LINES_PER_SET}"
        )
    for line in (_PLANES, _GAMMAS):
        if not lines[line].strip():
            raise InputError(f"{name}, line {line + 1}: blank where EULUMDAT has a count: is a blank line before it?")
    numbers_of_header = (_number(lines[i], name) for i in (_SYMMETRY, _PLANES, _GAMMAS, _SETS))
    symmetry, planes, gammas, sets = (count_in(number, 0, name) for number in numbers_of_header)
    if planes < 1 or gammas < 1:
        raise InputError(f"{name}: {planes} half-planes C and {gammas} angles gamma in its header; export it again")
    sets = max(sets, 1)
    body = _HEADER_LINES + _LINES_PER_SET * sets
    stored = _stored_planes(symmetry, planes, name)
    needed = _RATIOS + planes + gammas + len(stored) * gammas
    if needed > MOST_NUMBERS:
        raise InputError(
            f"{name}: its header promises {needed} numbers, at most {MOST_NUMBERS} are read; export it again"
        )
    tokens = tokens_of("\n".join(lines[body:]))
    require_promised(len(tokens), needed, name, f" below line {body}")
    of_lamps = [
        lines[at + entry].strip() for at in range(_HEADER_LINES, body, 6) for entry in (_COUNT, _LUMENS, _WATTS)
    ]
    _require_one_reading([*(lines[i].strip() for i in _NUMBERS), *of_lamps, *tokens], name)
    numbers = np.array([_number(word, name) for word in tokens])
    lamps = tuple(_lamps(lines[at : at + _LINES_PER_SET], name) for at in range(_HEADER_LINES, body, _LINES_PER_SET))
    absolute = _number_or_0(lines[_HEADER_LINES + _COUNT]) < 0.0  # the number of lamps
    lumens = lamps[0].lumens
    c_deg, gamma_deg = np.split(numbers[_RATIOS : _RATIOS + planes + gammas], [planes])
    factor = (_number(lines[_FACTOR], name) or 1.0) * (lumens or 1000.0) / 1000.0
    candela = factor * numbers[_RATIOS + planes + gammas :].reshape(len(stored), gammas)
    if symmetry > 1 and len(stored) < 2:
        raise InputError(f"{name}: symmetry {symmetry} with {planes} half-planes C, which leaves one; export it again")
    steps = [*_steps(lines, _C_STEP, "C", c_deg), *_steps(lines, _GAMMA_STEP, "gamma", gamma_deg)]
    c_deg = c_deg[stored]
    if symmetry == 3:  # in the order of the angles, C 90 to C 270
        c_deg = c_deg[::-1]
        candela = candela[::-1]
    intensity, warnings = tabulated(c_deg, gamma_deg, candela, name)
    down = _downward(lines[_DOWNWARD], intensity)
    date, _, remark = lines[_DATE].strip().partition(_REMARK)
    file = PhotometricFile(
        intensity=intensity,
        lamps=(replace(lamps[0], lumens=None), *lamps[1:]) if absolute else lamps,
        stated_lumens=stated_or_none((lumens or 0.0) * _number(lines[_LORL], name) / 100.0),
        title=lines[_NAME].strip(),
        maker=lines[0].strip(),
        test=lines[_TEST].strip(),
        catalogue=lines[_NUMBER].strip(),
        file_name=lines[_FILE].strip(),
        issued="" if date == _UNDATED else date,
        remarks=(remark,) if remark else (),
        generated=UNDEFINED,
        method="",
        laboratory="",
        format="eulumdat",
        warnings=(
            *doubled,
            *warnings,
            *_warnings(lines, lamps, c_deg, tokens[_RATIOS + planes + gammas :]),
            *steps,
            *down,
        ),
        per_1000_lm=lumens is None,
    )
    return _with_sizes(file, lines, numbers[:_RATIOS])


def _lines(text: str) -> tuple[list[str], tuple[str, ...]]:
    """The lines of a file; if every other line is blank, without those, and with a warning."""
    lines = text.split("\n")
    if len(lines) > 2 * _HEADER_LINES and not any(line.strip() for line in lines[1::2]):
        return lines[::2], ("a blank line follows each of its lines: these are left out",)
    return lines, ()


def _steps(lines: list[str], place: int, name: str, angles: Float[np.ndarray, " n"]) -> Iterator[str]:
    """Warning on a step stated in the header that the angles do not have."""
    stated = _number_or_0(lines[place])
    steps = np.diff(angles)
    if stated > 0.0 and len(steps) and np.abs(steps - stated).max() > _SAME_STEP * stated:
        least = f"{steps.min():g}"
        actual = least if np.ptp(steps) < _SAME_STEP * stated else f"{least} to {steps.max():g}"
        statement = f"line {place + 1} states steps of {name} of {stated:g} degrees"
        yield f"{statement}, its angles have {actual}: these are taken"


def _downward(line: str, intensity: CandelaTable) -> Iterator[str]:
    """Warning on a stated downward share of light that differs from that of the intensities."""
    actual = 100.0 * intensity.share_up_to(90.0)
    stated = _number_or_0(line)
    if line.strip() and _is_number(line) and abs(stated - actual) > _SAME_SHARE:
        yield f"line {_DOWNWARD + 1}: {stated:g} % of its light go down, by its intensities it is {actual:.3g} %"


def _lamps(lines: list[str], name: str) -> LampSet:
    return LampSet(
        lumens=stated_or_none(_number(lines[_LUMENS], name)),
        watts=stated_or_none(_number_or_0(lines[_WATTS])) or 0.0,
        count=int(abs(_number_or_0(lines[_COUNT]))),
        kind=lines[_KIND].strip(),
        colour=lines[_COLOUR].strip(),
        rendering=lines[_RENDERING].strip(),
    )


def _with_sizes(file: PhotometricFile, lines: list[str], ratios: Float[np.ndarray, " ratios"]) -> PhotometricFile:
    """The file with what its lines state of luminaire and light, including direct ratios."""
    sizes = [max(_number_or_0(line), 0.0) for line in lines[_HOUSING : _HEIGHTS + 4]]
    long, wide, high, length, width, c0, c90, c180, c270 = sizes
    circular = length > 0.0 and width == 0.0
    return replace(
        file,
        linear=_number_or_0(lines[_TYPE]) == _LINEAR,
        housing_mm=(long, wide, high),
        opening=LuminousOpening.of_area(length, length if circular else width, (c0, c90, c180, c270), circular),
        tilt_deg=_number_or_0(lines[_TILT]),
        direct_ratios=tuple(ratios.tolist()) if ratios.any() else (),
    )


def encode(photometric: PhotometricFile) -> str:
    """EULUMDAT without symmetry, or of revolution: per 1000 lm of the lamps, or of the luminaire if these are unknown.

    The latter is absolute photometry.
    """
    table = photometric.intensity
    lumens = photometric.rated_lumens
    if not SMALLEST < lumens < HUGE:
        raise InputError(f"EULUMDAT holds intensities per 1000 lm: {lumens:g} lm must be above 0 and below {HUGE:g}")
    revolution = len(table.c_deg) == 1
    planes = table.c_deg if revolution else table.c_deg[:-1]
    values = table.values[: len(planes)] * (1000.0 / lumens)
    kind = _LINEAR if photometric.linear else 1 if revolution else 3
    opening = photometric.opening
    count = max(photometric.lamps[0].count, 1)
    first = replace(photometric.lamps[0], lumens=None if photometric.per_1000_lm else lumens)
    date_and_remark = _REMARK.join((photometric.issued or _UNDATED, *photometric.remarks[:1]))
    date_and_remark = "" if date_and_remark == _UNDATED else date_and_remark
    lines = [
        _text(photometric.maker), f"{kind:g}", "1" if revolution else "0", str(len(planes)),
        _step(planes), str(len(table.gamma_deg)), _step(table.gamma_deg), _text(photometric.test),
        _text(photometric.title), _text(photometric.catalogue), _text(photometric.file_name), _text(date_and_remark),
        *(f"{size:.6g}" for size in photometric.housing_mm), f"{opening.length_mm:.6g}",
        f"{0.0 if opening.diameter_mm > 0.0 else opening.width_mm:.6g}",
        *(f"{height:.6g}" for height in opening.heights_mm),
        f"{100.0 * table.share_up_to(90.0):.6g}", f"{100.0 * table.flux() / lumens:.6g}", "1",
        f"{photometric.tilt_deg:.6g}", str(len(photometric.lamps)),
        *_lines_of(first, -count if photometric.absolute else first.count),
        *(line for lamps in photometric.lamps[1:] for line in _lines_of(lamps, lamps.count)),
    ]  # fmt: skip
    ratios = np.array(photometric.direct_ratios or direct_ratios(table))
    numbers = [ratios, planes, table.gamma_deg, values.ravel()]
    lines += [f"{number:.7g}" for number in np.concatenate(numbers)]
    return "\r\n".join(lines) + "\r\n"


def _lines_of(lamps: LampSet, count: int) -> Iterator[str]:
    yield from (str(count), _text(lamps.kind), f"{lamps.lumens or 0.0:.7g}", _text(lamps.colour))
    yield from (_text(lamps.rendering), f"{lamps.watts:.6g}")


def _text(text: str) -> str:
    return single_line(text)[:_TEXT]


def _stored_planes(symmetry: int, planes: int, name: str) -> np.ndarray:
    """Indices of the C angles whose intensities are in the file, in its order."""
    if symmetry == 0:
        return np.arange(planes)
    if symmetry == 1:
        return np.zeros(1, dtype=int)
    if symmetry == 2:
        return np.arange(planes // 2 + 1) % planes
    if symmetry == 3:
        return (3 * planes // 4 - np.arange(planes // 2 + 1)) % planes
    if symmetry == 4:
        return np.arange(planes // 4 + 1) % planes
    raise InputError(f"{name}: symmetry {symmetry}: 0 to 4; export it again")


def _step(angles: np.ndarray) -> str:
    steps = np.diff(angles)
    return f"{steps[0]:.6g}" if len(steps) and np.allclose(steps, steps[0]) else "0"


def _require_one_reading(tokens: list[str], name: str) -> None:
    """Raise :class:`InputError` where points and commas both occur, and one of them may separate thousands.

    A file with decimal commas only is common; beside decimal points, 1,234 can be either number.
    """
    if not all(any(mark in word for word in tokens) for mark in ".,"):
        return
    for mark in ".,":
        marked = [word.lstrip("+-") for word in tokens if mark in word]
        if all(_THOUSANDS.fullmatch(word) for word in marked):
            raise InputError(
                f"{name}: {marked[0]!r} beside numbers with a {'comma' if mark == '.' else 'point'}: in thousands, or "
                f"with decimals? Export it with decimal points only"
            )


def _warnings(
    lines: list[str], lamps: tuple[LampSet, ...], c_deg: Float[np.ndarray, " c"], intensities: list[str]
) -> Iterator[str]:
    """Warnings on what the file leaves open, and how it is read."""
    if lamps[0].lumens is None:
        yield "it states no lumens of its lamps: its intensities are taken as they stand, per 1000 lm of the lamps"
    if len(lamps) > 1:
        lumens = ", ".join(f"{lamp.lumens or 0.0:.6g}" for lamp in lamps)
        yield f"{len(lamps)} sets of lamps, of {lumens} lm, one of which is in it: the first is taken"
    if tilt := _number_or_0(lines[_TILT]):
        yield f"tilted by {tilt:g} degrees during its measurement: its angles are taken as those of no tilt"
    if _number_or_0(lines[_SYMMETRY]) == 0.0 and len(c_deg) == 1:
        yield "one half-plane and symmetry 0, none: taken as light of revolution"
    elif _number_or_0(lines[_SYMMETRY]) == 0.0 and len(c_deg) > 2 and c_deg[-1] - c_deg[0] <= 180.0:
        yield f"symmetry 0, none, but its half-planes end at C {c_deg[-1]:g}: taken as mirrored there"
    of_lamps = (at for lines_of in range(len(lamps)) for at in (_COUNT + 6 * lines_of, _WATTS + 6 * lines_of))
    for place in (_TYPE, *range(_HOUSING, _HEIGHTS + 4), _TILT, *(_HEADER_LINES + at for at in of_lamps)):
        if not _is_number(lines[place]):
            yield f"line {place + 1}: {lines[place].strip()[:20]!r} where EULUMDAT has a number: left out"
    yield from _thousands_or_decimals(lines[_HEADER_LINES + _LUMENS].strip(), lamps[0], intensities)


def _thousands_or_decimals(lumens: str, lamps: LampSet, intensities: list[str]) -> Iterator[str]:
    """Warning on lumens and intensities whose decimals may be thousands."""
    marked = [word for word in intensities if "." in word or "," in word]
    whole = max((float(word) for word in intensities if word.lstrip("+-").isdecimal()), default=0.0)
    doubtful = marked[:1] if 100.0 <= whole < 1000.0 and all(map(_THOUSANDS.fullmatch, marked)) else []
    if _THOUSANDS.fullmatch(lumens) and (lamps.lumens or 0.0) < (lamps.watts or _FEW_LM):
        doubtful = [lumens, *doubtful]
    for word in doubtful:
        yield f"{word!r} is read as {_number(word, ''):g}: if it is in thousands, write it without a separator"


def _number(word: str, name: str) -> float:
    return finite_number(word.strip() or "0", "EULUMDAT", name, commas=True)


def _number_or_0(line: str) -> float:
    return _number(line, "") if _is_number(line) else 0.0


def _is_number(line: str) -> bool:
    try:
        return bool(np.isfinite(_number(line, "")))
    except InputError:
        return False


FORMAT = PhotometricFormat("EULUMDAT", ".ldt", matches, decode, encode)
