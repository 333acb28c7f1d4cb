"""Files of materials: Zemax glass catalogues (.agf), tables (.csv, .txt), and files of refractiveindex.info (.yml).

Lines of a catalogue that are read: NM (name, number of the formula), CD (coefficients), LD (range, um), IT (wavelength
in um, internal transmittance, thickness in mm), TD (D0, D1, D2, E0, E1, pole in um and reference temperature of
SCHOTT's formula of the index against temperature), ED (coefficient of expansion from -30 to 70 C, in 1e-6/K). Indices
are relative to air at the reference temperature, as rays here are. Zeros in TD and ED mean that nothing is known.

Columns of a table are wavelength (nm), index, and internal transmittance over 1 mm or nothing, in this order or as a
line of names has them. Index and transmittance are linear between the rows, the latter in its logarithm.

A file of refractiveindex.info has a dispersion formula or a table of n, and a table of k where there is one;
wavelengths are in um. An index that its SPECS call absolute is that against vacuum. Absorption follows from the
extinction coefficient k: 4 pi k / wavelength.
"""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from math import log, nan, pi
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import FileWarning, InputError
from lensforge.optics.material import (
    COEFFICIENTS,
    HIGHEST_C,
    HUGE,
    LOWEST_C,
    MOST_COEFFICIENTS,
    REFERENCE_C,
    SCHOTT_COEFFICIENTS,
    Absorption,
    AgainstVacuum,
    Formula,
    IndexTable,
    Material,
    TemperatureLaw,
)
from lensforge.results.files import MIB, read_file
from lensforge.results.text_dialect import Line, decoded_text, lines_of, shown
from lensforge.results.text_table import Column, TextTable

_TAGS = ("NM", "CD", "LD", "TD", "ED")
_MOST_AGF_BYTES = 4 * MIB  # the largest catalogue of a glass maker has 1 MiB
_MOST_GLASSES, _LONGEST_NAME = 5000, 60  # all makers together have 3,000; a search for a name like it takes a second
# Catalogues write 0 for light that they could not measure; what is left of 25 mm then is lost in any lens.
_LEAST_TRANSMITTANCE = 1e-6


def read_agf(path: Path, glass: str) -> Material:
    """Read ``glass``, in capitals or not, from the catalogue at ``path``.

    Raises :class:`InputError` for a glass that is not there, with the closest names, for one that is there twice with
    different data, and for one without its lines.
    """
    lines = _lines_of(path, glass)
    words = {tag: line.text.split()[1:] for line in lines for tag in [line.text[:2].upper()] if tag in _TAGS}
    missing = [tag for tag in ("CD", "LD") if tag not in words]
    if missing or len(words["NM"]) < 2:
        raise InputError(f"{path}: {glass} has no line {missing[0] if missing else 'NM that names its formula'}")
    number, (low, high) = int(_number(words["NM"][1], path, glass)), _two(words["LD"], path, glass)
    if f"agf {number}" not in COEFFICIENTS:
        raise InputError(f"{path}: {glass} has the dispersion formula {number}, known are 1 to 13")
    return Material(
        name=words["NM"][0],
        dispersion=_formula(number, tuple(_number(word, path, glass) for word in words["CD"]), path, glass),
        range_nm=(1e3 * low, 1e3 * high),
        source=f"{path.name}: {words['NM'][0]}",
        extrapolation_error=None,
        absorption=_absorption_of(sorted(_absorptions(lines, path, glass))),
        temperature=_temperature_law(_known(words.get("TD", [])), _known(words.get("ED", [])), path, glass),
    )


def _formula(number: int, coefficients: tuple[float, ...], path: Path, glass: str) -> Formula:
    name = f"agf {number}"
    found, expected = len(coefficients), COEFFICIENTS[name]
    if any(coefficients[expected:]):
        words = f"{found} coefficients in its line CD, formula {number} has {expected}"
        raise InputError(f"{path}: {glass} has {words}: is one cut in two? Export the catalogue again")
    if found < expected:
        words = f"{found} of the {expected} coefficients of formula {number} in its line CD: the others are taken as 0"
        warnings.warn(f"{path}: {glass} has {words}", FileWarning, stacklevel=1)
    return Formula(name, coefficients)


def _absorption_of(rows: Sequence[Sequence[float]]) -> Absorption | None:
    return Absorption(*(tuple(column) for column in zip(*rows, strict=True))) if rows else None


def _lines_of(path: Path, glass: str) -> list[Line]:
    """Lines of one glass, from its NM to the next; a line that begins with a number goes on with the one before it."""
    content = read_file(path, missing="give a glass catalogue", most_bytes=_MOST_AGF_BYTES)
    blocks: dict[str, list[list[Line]]] = {}
    current: list[Line] = []
    for line in lines_of(decoded_text(content, str(path)), comments_behind=False):
        words = line.text.split()
        if words[0].upper() == "NM" and len(words) > 1:
            current = []
            blocks.setdefault(words[1].upper(), []).append(current)
        if current and _is_number(words[0]):
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
    first, *others = blocks[glass.upper()]
    for other in others:
        if [line.text.split() for line in other] != [line.text.split() for line in first]:
            places = f"lines {first[0].number} and {other[0].number}"
            raise InputError(f"{path}: {glass} is there twice, in {places}, with different data; delete one")
    return first


def _absorptions(lines: list[Line], path: Path, glass: str) -> list[tuple[float, float]]:
    absorptions = []
    for line in lines:
        words = line.text.split()[1:]
        if line.text[:2].upper() != "IT" or len(words) < 3:
            continue
        um, transmittance, thickness = (_number(word, path, glass) for word in words[:3])
        if thickness > 0.0:
            if not 0.0 <= transmittance <= 1.0:
                raise InputError(f"{path}: {glass} has an internal transmittance of {transmittance:g}, must be 0 to 1")
            absorptions.append((1e3 * um, -log(max(transmittance, _LEAST_TRANSMITTANCE)) / thickness + 0.0))
    return absorptions


def _temperature_law(td: list[str], ed: list[str], path: Path, glass: str) -> TemperatureLaw:
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


_MOST_TABLE_BYTES = 4 * MIB  # ten thousand rows, the most of a spec, have 0.3 MiB
_LEAST_NM = 100.0  # below that are um: no light here is shorter
_COLUMNS = (
    Column(("wavelength", "lambda", "λ", "wl", "nm", "wellenlänge"), {"nm": 1.0, "": 1.0, "um": 1e3}),
    Column(("index", "n", "refractive index", "brechzahl")),
    Column(
        ("transmittance", "t", "tau", "internal transmittance", "transmittance of 1 mm"),
        {"": 1.0, "%": 0.01},
        needed=False,
    ),
)


def read_material_table(path: Path, name: str) -> Material:
    """Read the table at ``path``; ``name``: what the material is called. Raises :class:`InputError`, one line."""
    rows = TextTable.read(path, missing="give a table of the index", most_bytes=_MOST_TABLE_BYTES)
    table = rows.columns(_COLUMNS)
    if len(table) < 2:
        raise InputError(f"{path}: must be two rows at least of wavelength (nm), index and, if known, transmittance")
    table = table[np.argsort(table[:, 0])]
    waves, transmittance = table[:, 0], table[:, 2]
    if waves[-1] < _LEAST_NM or (np.diff(waves) <= 0.0).any():
        raise InputError(f"{path}: wavelengths must be in nm, each once; they go from {waves[0]:g} to {waves[-1]:g}")
    known = not np.isnan(transmittance).all()
    if known and not ((transmittance > 0.0) & (transmittance <= 1.0)).all():
        raise InputError(f"{path}: an internal transmittance must be above 0 and at most 1{rows.advice}")
    index = IndexTable(tuple(waves.tolist()), tuple(table[:, 1].tolist()))
    absorption = np.column_stack([waves, -np.log(transmittance) + 0.0]).tolist() if known else []
    return Material(name, index, (float(waves[0]), float(waves[-1])), path.name, None, _absorption_of(absorption))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


_MOST_BYTES = 4 * MIB  # the largest table of the database has 1 MiB
_LEAST_UM = 1e-3  # no light of a lens is shorter
_MOST_EVENTS, _DEEPEST = 10_000, 16  # of YAML: a file of the database has a few hundred, four levels deep


def read_refractive_index_info(path: Path, name: str) -> Material:
    """Read the material at ``path``; ``name``: what it is called. Raises :class:`InputError`, one line."""
    content = _content(path)
    blocks = _blocks(content, path)
    index, span = _index(blocks, path)
    dispersion = AgainstVacuum(index) if _is_absolute(content, path) else index
    return Material(name, dispersion, span, path.name, None, _absorption_of(_absorption(blocks, path)))


def _is_absolute(content: Mapping[str, Any], path: Path) -> bool:
    """True where the file states its index against vacuum."""
    specs = content.get("SPECS")
    stated = str(specs.get("n_is_absolute", "false")).lower() if isinstance(specs, dict) else "false"
    if stated not in ("true", "false"):
        raise InputError(f"{path}: n_is_absolute: {shown(stated)}, must be true or false")
    return stated == "true"


def _content(path: Path) -> Mapping[str, Any]:
    raw = read_file(path, missing="give a file of refractiveindex.info", most_bytes=_MOST_BYTES)
    import yaml  # seldom needed, and slow to load

    loader: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # no types, no tags; in C where PyYAML has it
    try:
        _require_plain(yaml.parse(raw, Loader=loader))
        content = yaml.load(raw, Loader=loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = "" if mark is None else f" from line {mark.line + 1}, column {mark.column + 1} on"
        raise InputError(f"{path}: not YAML{place}; download it again") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}; give a file of refractiveindex.info") from None
    return content if isinstance(content, dict) else {}


def _blocks(content: Mapping[str, Any], path: Path) -> dict[str, dict[str, Any]]:
    data = content.get("DATA")
    if not isinstance(data, list) or not all(isinstance(block, dict) for block in data):
        raise InputError(f"{path}: has no list DATA; give a file of refractiveindex.info")
    blocks = {str(block.get("type")): block for block in data}
    if len(blocks) < len(data):
        raise InputError(f"{path}: DATA has two blocks of one type; leave out one")
    return blocks


def _require_plain(events: Iterable[Any]) -> None:
    """Raise :class:`ValueError` for YAML that a few bytes can make huge or deep: it is asked before values are made."""
    depth = 0
    for number, event in enumerate(events):
        kind = type(event).__name__
        if kind == "AliasEvent":
            raise ValueError(f"an alias in line {event.start_mark.line + 1}, which no material needs")
        depth += kind in ("MappingStartEvent", "SequenceStartEvent")
        depth -= kind in ("MappingEndEvent", "SequenceEndEvent")
        if number > _MOST_EVENTS or depth > _DEEPEST:
            raise ValueError(f"more than {_MOST_EVENTS} entries, or more than {_DEEPEST} levels")


def _index(blocks: dict[str, dict[str, Any]], path: Path) -> tuple[Formula | IndexTable, tuple[float, float]]:
    for kind, block in blocks.items():
        if kind.replace("formula", "rii") in COEFFICIENTS:
            low, high = _numbers(block, "wavelength_range", path, 2, 2)
            formula = Formula(kind.replace("formula", "rii"), tuple(_numbers(block, "coefficients", path, 1)))
            return formula, (1e3 * low, 1e3 * high)
        if kind in ("tabulated n", "tabulated nk"):
            table = _table(block, path, 3 if kind == "tabulated nk" else 2)
            waves = tuple((1e3 * table[:, 0]).tolist())
            return IndexTable(waves, tuple(table[:, 1].tolist())), (waves[0], waves[-1])
    only = ", only tabulated k" if "tabulated k" in blocks else ""
    raise InputError(f"{path}: has no index{only}; give a file with n or a formula")


def _absorption(blocks: dict[str, dict[str, Any]], path: Path) -> list[list[float]]:
    """Rows of wavelength (nm) and absorption (1/mm); none where the file has no k."""
    for kind, columns in (("tabulated k", 2), ("tabulated nk", 3)):
        if kind in blocks:
            table = _table(blocks[kind], path, columns)
            per_mm = 4.0 * pi * table[:, columns - 1] / (1e-3 * table[:, 0])
            return np.column_stack([1e3 * table[:, 0], per_mm]).tolist()
    return []


def _table(block: dict[str, Any], path: Path, columns: int) -> Float[np.ndarray, "k c"]:
    """Numbers of a table, by rising wavelength, each wavelength once."""
    name = f"{path}: table of {block['type']}"
    table = TextTable.of(str(block.get("data", "")), name).numbers(used=range(columns))
    if not (np.abs(table) < HUGE).all() or table[:, 0].min() < _LEAST_UM:
        raise InputError(
            f"{name}: numbers must be below {HUGE:g}, wavelengths at least {_LEAST_UM:g} um; download it again"
        )
    return table[np.unique(table[:, 0], return_index=True)[1]]


def _numbers(block: dict[str, Any], name: str, path: Path, least: int, most: int = MOST_COEFFICIENTS) -> list[float]:
    words = str(block.get(name, "")).split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if not least <= len(numbers) <= most or not np.isfinite(numbers).all():
        count = f"{least}" if least == most else f"{least} to {most}"
        raise InputError(f"{path}: {name}: {shown(' '.join(words))}, must be {count} numbers; download it again")
    return numbers


SUFFIXES = (".agf", ".yml", ".yaml", ".csv", ".txt")


def read_material(path: Path, name: str | None) -> Material:
    """Read a material; ``name``: of the glass in a catalogue, or what the material is to be called.

    Raises :class:`InputError` for another kind of file, a catalogue without ``name``, and what cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a material is read from {', '.join(SUFFIXES)}")
    if suffix == ".agf":
        if name is None:
            raise InputError(f"{path}: name the glass in it by lens.material")
        return read_agf(path, name)
    called = path.stem if name is None else name
    if suffix in (".yml", ".yaml"):
        return read_refractive_index_info(path, called)
    return read_material_table(path, called)
