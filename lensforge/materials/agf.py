"""Zemax glass catalogues (.agf): one glass of many, its dispersion formula and its internal transmittance.

Lines that are read: NM (name, number of the formula), CD (coefficients), LD (range, um), IT (wavelength in um, internal
transmittance, thickness in mm). Indices are relative to air at the temperature of the catalogue, as rays here are.
"""

from difflib import get_close_matches
from math import log
from pathlib import Path

from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.materials.data import MaterialData
from lensforge.materials.formulas import NAMES, Formula

_MOST_BYTES = 16 * MIB  # the largest catalogue of a glass maker has 1 MiB
# Catalogues write 0 for light that they could not measure; what is left of 25 mm then is lost in any lens.
_LEAST_TRANSMITTANCE = 1e-6


def read_agf(path: Path, glass: str) -> MaterialData:
    """Read ``glass``, in capitals or not, from the catalogue at ``path``.

    Raises :class:`InputError` for a glass that is not there, with the closest names, and for one without its lines.
    """
    lines = _lines_of(path, glass)
    words = {tag: line.split()[1:] for line in lines for tag in [line[:2].upper()] if tag in ("NM", "CD", "LD")}
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


def _two(words: list[str], path: Path, glass: str) -> tuple[float, float]:
    if len(words) < 2:
        raise InputError(f"{path}: {glass} has no two wavelengths in its line LD")
    return _number(words[0], path, glass), _number(words[1], path, glass)


def _number(word: str, path: Path, glass: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{path}: {glass} has {word[:20]!r} where a number must be") from None
