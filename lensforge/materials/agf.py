"""Zemax glass catalogues (.agf): one glass of many, its dispersion formula, internal transmittance and expansion.

Lines that are read: NM (name, number of the formula), CD (coefficients), LD (range, um), IT (wavelength in um, internal
transmittance, thickness in mm), TD (D0, D1, D2, E0, E1, pole in um and reference temperature of SCHOTT's formula of the
index against temperature), ED (coefficient of expansion from -30 to 70 C, in 1e-6/K). Indices are relative to air at
the reference temperature, as rays here are. Zeros in TD and ED mean that nothing is known.
"""

from difflib import get_close_matches
from math import log, nan
from pathlib import Path

from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.materials.data import MaterialData
from lensforge.materials.formulas import HUGE, NAMES, Formula
from lensforge.materials.temperature import HIGHEST_C, LOWEST_C, REFERENCE_C, SCHOTT_COEFFICIENTS, TemperatureLaw

_TAGS = ("NM", "CD", "LD", "TD", "ED")
_MOST_BYTES = 4 * MIB  # the largest catalogue of a glass maker has 1 MiB
_MOST_GLASSES, _LONGEST_NAME = 5000, 60  # all makers together have 3,000; a search for a name like it takes a second
# Catalogues write 0 for light that they could not measure; what is left of 25 mm then is lost in any lens.
_LEAST_TRANSMITTANCE = 1e-6


def read_agf(path: Path, glass: str) -> MaterialData:
    """Read ``glass``, in capitals or not, from the catalogue at ``path``.

    Raises :class:`InputError` for a glass that is not there, with the closest names, and for one without its lines.
    """
    lines = _lines_of(path, glass)
    words = {tag: line.split()[1:] for line in lines for tag in [line[:2].upper()] if tag in _TAGS}
    missing = [tag for tag in ("CD", "LD") if tag not in words]
    if missing or len(words["NM"]) < 2:
        raise InputError(f"{path}: {glass} has no line {missing[0] if missing else 'NM that names its formula'}")
    number, (low, high) = int(_number(words["NM"][1], path, glass)), _two(words["LD"], path, glass)
    if f"agf {number}" not in NAMES:
        raise InputError(f"{path}: {glass} has the dispersion formula {number}, known are 1 to 13")
    formula = Formula(f"agf {number}", tuple(_number(word, path, glass) for word in words["CD"]))
    dims = sorted(_absorptions(lines, path, glass))
    return MaterialData(
        name=words["NM"][0],
        index=formula,
        range_nm=(1e3 * low, 1e3 * high),
        absorption_nm=tuple(nm for nm, _ in dims),
        absorption_per_mm=tuple(per_mm for _, per_mm in dims),
        source=f"{path.name}: {words['NM'][0]}",
        temperature=_temperature_law(_known(words.get("TD", [])), _known(words.get("ED", [])), path, glass),
    )


def _lines_of(path: Path, glass: str) -> list[str]:
    """Lines of one glass, from its NM to the next."""
    raw = read_file(path, missing="give a glass catalogue", most_bytes=_MOST_BYTES)
    utf_16 = raw[:2] in (b"\xff\xfe", b"\xfe\xff")
    text = raw.decode("utf-16" if utf_16 else "latin-1", errors="replace")
    blocks: dict[str, list[str]] = {}
    current: list[str] = []
    for line in text.splitlines():
        words = line.split()
        if words and words[0].upper() == "NM" and len(words) > 1:
            current = blocks.setdefault(words[1].upper(), [])
        if words:
            current.append(line.strip())
    if len(blocks) > _MOST_GLASSES or max(map(len, blocks), default=0) > _LONGEST_NAME:
        raise InputError(
            f"{path}: {len(blocks)} glasses, at most {_MOST_GLASSES} are read, with names of {_LONGEST_NAME} "
            "characters; give the catalogue of one maker"
        )
    if glass.upper() not in blocks:
        close = get_close_matches(glass.upper(), blocks, 3, 0.5)
        hint = f"closest: {', '.join(close)}" if close else "lens.material must be one of its names"
        raise InputError(f"{path}: no glass {glass!r} among its {len(blocks)}; {hint}")
    return blocks[glass.upper()]


def _absorptions(lines: list[str], path: Path, glass: str) -> list[tuple[float, float]]:
    """Wavelength (nm) and absorption (1/mm) of each IT line with a thickness."""
    found = []
    for line in lines:
        words = line.split()[1:]
        if line[:2].upper() != "IT" or len(words) < 3:
            continue
        um, transmittance, thickness = (_number(word, path, glass) for word in words[:3])
        if thickness > 0.0:
            if not 0.0 <= transmittance <= 1.0:
                raise InputError(f"{path}: {glass} has an internal transmittance of {transmittance:g}, must be 0 to 1")
            found.append((1e3 * um, -log(max(transmittance, _LEAST_TRANSMITTANCE)) / thickness + 0.0))
    return found


def _temperature_law(td: list[str], ed: list[str], path: Path, glass: str) -> TemperatureLaw:
    """The law by the words of the lines TD and ED; missing numbers are 0, as in OpticStudio."""
    words = [*td, *["0"] * (SCHOTT_COEFFICIENTS - len(td)), str(REFERENCE_C)][: SCHOTT_COEFFICIENTS + 1]
    *schott, reference_c = (_number(word, path, glass) for word in words)
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


def _known(words: list[str]) -> list[str]:
    """``words`` with 0 for the dashes that some catalogues write for what is not known."""
    return ["0" if word in ("-", "_") else word for word in words]


def _two(words: list[str], path: Path, glass: str) -> tuple[float, float]:
    if len(words) < 2:
        raise InputError(f"{path}: {glass} has no two wavelengths in its line LD")
    return _number(words[0], path, glass), _number(words[1], path, glass)


def _number(word: str, path: Path, glass: str) -> float:
    try:
        number = float(word)
    except ValueError:
        number = nan
    if not abs(number) < HUGE:
        raise InputError(f"{path}: {glass} has {word[:20]!r} where a number must be")
    return number
