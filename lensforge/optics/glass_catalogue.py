"""Glasses of a Zemax catalogue (.agf).

Lines that are read: NM (name, number of the formula, code, n_d, v_d), CD (coefficients), LD (range, um), IT (wavelength
in um, internal transmittance, thickness in mm), TD (D0, D1, D2, E0, E1, pole in um and reference temperature of
SCHOTT's formula of the index against temperature), ED (coefficient of expansion from -30 to 70 C, in 1e-6/K). Indices
are relative to air at the reference temperature, as rays here are. Zeros in TD and ED mean that nothing is known.

The index n_d and Abbe's number v_d of a glass stand beside its coefficients: where they differ, one is wrong.
"""

import warnings
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from math import log, nan
from pathlib import Path

import numpy as np

from lensforge.errors import FileWarning, InputError
from lensforge.optics.material import (
    COEFFICIENTS,
    HIGHEST_C,
    HUGE,
    LOWEST_C,
    REFERENCE_C,
    SCHOTT_COEFFICIENTS,
    Formula,
    Material,
    TemperatureLaw,
    absorption_of,
)
from lensforge.results.files import MIB, read_file
from lensforge.results.text_dialect import Line, decoded_text, lines_of, number_in

_TAGS = ("NM", "CD", "LD", "TD", "ED")
_MOST_AGF_BYTES = 4 * MIB  # the largest catalogue of a glass maker has 1 MiB
_MOST_GLASSES = 5000  # all makers together have 3,000; a search for a similar name takes a second
_LONGEST_NAME = 60
# Catalogues write 0 for light that they could not measure; what is left of 25 mm then is lost in any lens.
_LEAST_TRANSMITTANCE = 1e-6


def read_agf(path: Path, glass: str) -> Material:
    """Read ``glass``, in capitals or not, from the catalogue at ``path``.

    Raises :class:`InputError` for a missing glass, with the closest names, for contradicting duplicates, and for one
    without its lines. A :class:`FileWarning` says where n_d or v_d contradict coefficients.
    """
    lines = _lines_of(path, glass)
    entries = {tag: line.text.split()[1:] for line in lines for tag in [line.text[:2].upper()] if tag in _TAGS}
    missing = [tag for tag in ("CD", "LD") if tag not in entries]
    if missing or len(entries["NM"]) < 2:
        raise InputError(f"{path}: {glass} has no line {missing[0] if missing else 'NM that names its formula'}")
    number = int(_number(entries["NM"][1], path, glass))
    (low, high) = _two(entries["LD"], path, glass)
    if f"agf {number}" not in COEFFICIENTS:
        raise InputError(f"{path}: {glass} has the dispersion formula {number}, known are 1 to 13")
    material = Material(
        name=entries["NM"][0],
        dispersion=_formula(number, tuple(_number(word, path, glass) for word in entries["CD"]), path, glass),
        range_nm=(1e3 * low, 1e3 * high),
        source=f"{path.name}: {entries['NM'][0]}",
        extrapolation_error=None,
        absorption=absorption_of(sorted(_absorptions(lines, path, glass))),
        temperature=_temperature_law(_known(entries.get("TD", [])), _known(entries.get("ED", [])), path, glass),
    )
    for contradiction in _contradictions(material, entries["NM"][3:5]):
        warnings.warn(f"{path}: {glass}: {contradiction}", FileWarning, stacklevel=1)
    return material


_LINES_NM = np.array([587.5618, 486.1327, 656.2725])  # d of helium, F and C of hydrogen
_SAME_INDEX = 1e-4  # n_d has 5 digits in catalogues
_SAME_DISPERSION = 2e-5  # n_F - n_C by an Abbe number of 2 decimals has 7


def _contradictions(material: Material, stated: Sequence[str]) -> Iterator[str]:
    """Warning on a ``stated`` index n_d, or Abbe number v_d, that contradicts the coefficients."""
    low, high = material.range_nm
    if not (low <= _LINES_NM.min() and _LINES_NM.max() <= high):
        return
    n_d, n_f, n_c = material.index(_LINES_NM).tolist()
    given_n, given_v = (_number_or_0(word) for word in [*stated, "0", "0"][:2])
    if given_n > 0.0 and not abs(given_n - n_d) <= _SAME_INDEX:
        yield f"its line NM states n_d = {given_n:g}, its coefficients make {n_d:.6f}, which are taken; check both"
    if given_n > 0.0 and given_v > 0.0 and not abs((n_d - 1.0) / given_v - (n_f - n_c)) <= _SAME_DISPERSION:
        abbe = (n_d - 1.0) / (n_f - n_c)
        yield f"its line NM states v_d = {given_v:g}, its coefficients make {abbe:.2f}, which are taken; check both"


def _number_or_0(word: str) -> float:
    return number_in(word) if _is_number(word) else 0.0


def _formula(number: int, coefficients: tuple[float, ...], path: Path, glass: str) -> Formula:
    name = f"agf {number}"
    count = len(coefficients)
    expected = COEFFICIENTS[name]
    if any(coefficients[expected:]):
        fault = f"{count} coefficients in its line CD, formula {number} has {expected}"
        raise InputError(f"{path}: {glass} has {fault}: is one cut in two? Export the catalogue again")
    if count < expected:
        fault = f"{count} of the {expected} coefficients of formula {number} in its line CD: the others are taken as 0"
        warnings.warn(f"{path}: {glass} has {fault}", FileWarning, stacklevel=1)
    return Formula(name, coefficients)


def _lines_of(path: Path, glass: str) -> list[Line]:
    """Lines of one glass, from its NM to the next; a line that begins with a number continues the previous one."""
    content = read_file(path, missing="give a glass catalogue", most_bytes=_MOST_AGF_BYTES)
    blocks: dict[str, list[list[Line]]] = {}
    current: list[Line] = []
    for line in lines_of(decoded_text(content, str(path)), comments_behind=False):
        entries = line.text.split()
        if entries[0].upper() == "NM" and len(entries) > 1:
            current = []
            blocks.setdefault(entries[1].upper(), []).append(current)
        if current and _is_number(entries[0]):
            current[-1] = Line(current[-1].number, f"{current[-1].text} {line.text}")
        else:
            current.append(line)
    if len(blocks) > _MOST_GLASSES or max(map(len, blocks), default=0) > _LONGEST_NAME:
        raise InputError(
            f"{path}: {len(blocks)} glasses, at most {_MOST_GLASSES} are read, with names of {_LONGEST_NAME} "
            "characters; give the catalogue of one maker"
        )
    if glass.upper() not in blocks:
        close = get_close_matches(glass.upper(), blocks, 3, 0.5)
        hint = f"closest: {', '.join(map(repr, close))}" if close else "lens.material must be one of its names"
        raise InputError(f"{path}: no glass {glass!r} among its {len(blocks)}; {hint}")
    first, *further = blocks[glass.upper()]
    for block in further:
        if [line.text.split() for line in block] != [line.text.split() for line in first]:
            places = f"lines {first[0].number} and {block[0].number}"
            raise InputError(f"{path}: {glass} is there twice, in {places}, with different data; delete one")
    return first


def _absorptions(lines: list[Line], path: Path, glass: str) -> list[tuple[float, float]]:
    absorptions = []
    for line in lines:
        entries = line.text.split()[1:]
        if line.text[:2].upper() != "IT" or len(entries) < 3:
            continue
        um, transmittance, thickness = (_number(word, path, glass) for word in entries[:3])
        if thickness > 0.0:
            if not 0.0 <= transmittance <= 1.0:
                raise InputError(f"{path}: {glass} has an internal transmittance of {transmittance:g}, must be 0 to 1")
            absorptions.append((1e3 * um, -log(max(transmittance, _LEAST_TRANSMITTANCE)) / thickness + 0.0))
    return absorptions


def _temperature_law(td: list[str], ed: list[str], path: Path, glass: str) -> TemperatureLaw:
    entries = [*td, *["0"] * (SCHOTT_COEFFICIENTS - len(td)), str(REFERENCE_C)][: SCHOTT_COEFFICIENTS + 1]
    *schott, reference_c = (_number(word, path, glass) for word in entries)
    known = any(schott[:-1])
    if not known and reference_c == 0.0:
        reference_c = REFERENCE_C
    if not LOWEST_C <= reference_c <= HIGHEST_C:
        raise InputError(
            f"{path}: {glass} has a reference temperature of {reference_c:g} C in its line TD, must be {LOWEST_C:g} to "
            f"{HIGHEST_C:g}"
        )
    per_k = _number([*ed, "0"][0], path, glass) / 1e6
    return TemperatureLaw(reference_c, tuple(schott) if known else (), expansion_per_k=per_k if per_k > 0.0 else None)


def _known(entries: list[str]) -> list[str]:
    """``entries`` with dashes, the mark of unknown values in some catalogues, replaced by 0."""
    return ["0" if word in ("-", "_") else word for word in entries]


def _two(entries: list[str], path: Path, glass: str) -> tuple[float, float]:
    if len(entries) < 2:
        raise InputError(f"{path}: {glass} has no two wavelengths in its line LD")
    return _number(entries[0], path, glass), _number(entries[1], path, glass)


def _number(word: str, path: Path, glass: str) -> float:
    try:
        number = number_in(word)
    except ValueError:
        number = nan
    if not abs(number) < HUGE:
        raise InputError(f"{path}: {glass} has {word[:20]!r} where a number must be")
    return number


def _is_number(word: str) -> bool:
    try:
        number_in(word)
    except ValueError:
        return False
    return True
