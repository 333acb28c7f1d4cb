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

import numpy as np

from lensforge.errors import InputError
from lensforge.sources.photometric.half_planes import tabulated
from lensforge.sources.photometric.photometric_file import (
    HUGE,
    MOST_NUMBERS,
    SMALLEST,
    UNDEFINED,
    PhotometricFile,
    PhotometricFormat,
    count_in,
    finite_number,
    require_promised,
    single_line,
    stated_or_none,
    words_of,
)

_HEADER_LINES = 26
_LINES_PER_SET = 6
_RATIOS = 10  # direct ratios of the utilisation method, not used here; 0 where written: not given
_NUMBERS = (*range(1, 7), *range(12, 26))  # lines of the header that hold one
_THOUSANDS = re.compile(r"[1-9]\d{0,2}([.,]\d{3})+")  # what is written like 1,234: in thousands, or with decimals
_SYMMETRY, _PLANES, _GAMMAS, _TEST, _NAME, _NUMBER, _LORL, _FACTOR, _SETS = 2, 3, 5, 7, 8, 9, 22, 23, 25
_TEXT = 78  # characters of a line of text
_OPENING = 15  # length or diameter of the luminous area; its width follows, 0 for a round one


def matches(text: str) -> bool:
    """True where the first lines hold the numbers that EULUMDAT has there."""
    lines = text.split("\n")
    try:
        return len(lines) > _HEADER_LINES and all(_number(lines[i], "") >= 0.0 for i in (1, 2, 3, 4, 5, 6))
    except InputError:
        return False


def decode(text: str, name: str) -> PhotometricFile:
    """The far field in ``text``; ``name`` is the file in errors. Raises :class:`InputError`."""
    lines = text.split("\n")
    if len(lines) < _HEADER_LINES + _LINES_PER_SET:
        raise InputError(
            f"{name}: truncated: {len(lines)} lines, the header alone has {_HEADER_LINES + _LINES_PER_SET}"
        )
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
    words = words_of("\n".join(lines[body:]))
    require_promised(len(words), needed, name, f" below line {body}")
    _require_one_reading([*(lines[i].strip() for i in _NUMBERS), *words], name)
    numbers = np.array([_number(word, name) for word in words])
    lumens = _number(lines[_HEADER_LINES + 2], name)  # of the first set; others are alternatives to it
    lumens = lumens if lumens > 0.0 else 1000.0
    c_deg, gamma_deg = np.split(numbers[_RATIOS : _RATIOS + planes + gammas], [planes])
    factor = (_number(lines[_FACTOR], name) or 1.0) * lumens / 1000.0
    candela = factor * numbers[_RATIOS + planes + gammas :].reshape(len(stored), gammas)
    if symmetry > 1 and len(stored) < 2:
        raise InputError(f"{name}: symmetry {symmetry} with {planes} half-planes C, which leaves one; export it again")
    c_deg = c_deg[stored]
    if symmetry == 3:  # in the order of the angles, C 90 to C 270
        c_deg, candela = c_deg[::-1], candela[::-1]
    intensity, warnings = tabulated(c_deg, gamma_deg, candela, name)
    if symmetry == 0 and planes == 1:
        warnings = (*warnings, "one half-plane and symmetry 0, none: taken as light of revolution")
    return PhotometricFile(
        intensity=intensity,
        lamp_lumens=None if _number_or_0(lines[_HEADER_LINES]) < 0.0 else lumens,  # the number of lamps
        stated_lumens=stated_or_none(lumens * _number(lines[_LORL], name) / 100.0),
        title=lines[_NAME].strip(),
        diameter_mm=_number(lines[_OPENING], name) if _number(lines[_OPENING + 1], name) == 0.0 else 0.0,
        watts=stated_or_none(_number_or_0(lines[_HEADER_LINES + _LINES_PER_SET - 1])) or 0.0,
        maker=lines[0].strip(),
        test=lines[_TEST].strip(),
        catalogue=lines[_NUMBER].strip(),
        generated=UNDEFINED,
        method="",
        laboratory="",
        format="eulumdat",
        warnings=warnings,
    )


def encode(photometric: PhotometricFile) -> str:
    """EULUMDAT without symmetry, or of revolution: per 1000 lm of the lamps, or of the luminaire where they state none.

    The latter is absolute photometry.
    """
    table = photometric.intensity
    lumens = photometric.lamp_lumens or table.flux()
    if not SMALLEST < lumens < HUGE:
        raise InputError(f"EULUMDAT holds intensities per 1000 lm: {lumens:g} lm must be above 0 and below {HUGE:g}")
    revolution = len(table.c_deg) == 1
    planes = table.c_deg if revolution else table.c_deg[:-1]
    values = table.values[: len(planes)] * (1000.0 / lumens)
    size = f"{photometric.diameter_mm:.6g}"
    date_and_remark = "; ".join(filter(None, (photometric.issued, *photometric.remarks[:1])))
    lines = [
        _text(photometric.maker), "1" if revolution else "3", "1" if revolution else "0", str(len(planes)),
        _step(planes), str(len(table.gamma_deg)), _step(table.gamma_deg), _text(photometric.test),
        _text(photometric.title), _text(photometric.catalogue), "", _text(date_and_remark),
        size, "0", "0", size, "0", "0", "0", "0", "0",
        f"{100.0 * table.share_up_to_90():.6g}", f"{100.0 * table.flux() / lumens:.6g}", "1", "0", "1",
        "-1" if photometric.lamp_lumens is None else "1", "LED", f"{lumens:.7g}", "", "", f"{photometric.watts:.6g}",
    ]  # fmt: skip
    numbers = [np.zeros(_RATIOS), planes, table.gamma_deg, values.ravel()]
    lines += [f"{number:.7g}" for number in np.concatenate(numbers)]
    return "\r\n".join(lines) + "\r\n"


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
    """The constant step of the angles, 0 where it is not constant."""
    steps = np.diff(angles)
    return f"{steps[0]:.6g}" if len(steps) and np.allclose(steps, steps[0]) else "0"


def _require_one_reading(words: list[str], name: str) -> None:
    """Raise :class:`InputError` where points and commas both occur, and one of them may separate thousands.

    A file with decimal commas only is common; beside decimal points, 1,234 can be either number.
    """
    if not all(any(mark in word for word in words) for mark in ".,"):
        return
    for mark in ".,":
        marked = [word.lstrip("+-") for word in words if mark in word]
        if all(_THOUSANDS.fullmatch(word) for word in marked):
            raise InputError(
                f"{name}: {marked[0]!r} beside numbers with a {'comma' if mark == '.' else 'point'}: in thousands, or "
                f"with decimals? Export it with decimal points only"
            )


def _number(word: str, name: str) -> float:
    return finite_number(word.strip() or "0", "EULUMDAT", name, commas=True)


def _number_or_0(line: str) -> float:
    """Number of a line in which some files have a text, or nothing: 0 there."""
    try:
        return _number(line, "")
    except InputError:
        return 0.0


FORMAT = PhotometricFormat(".ldt", matches, decode, encode)
