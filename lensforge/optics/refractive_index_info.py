"""Materials of refractiveindex.info (.yml).

A file has a dispersion formula or a table of n, and a table of k where there is one; wavelengths are in um. An index
that its SPECS call absolute is that against vacuum. Absorption follows from the extinction coefficient k. Duplicate
statements are compared: a formula beside a table, a table of k beside one of n and k.
"""

import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import FileWarning, InputError
from lensforge.optics.material import (
    COEFFICIENTS,
    HUGE,
    MOST_COEFFICIENTS,
    AgainstVacuum,
    Formula,
    IndexTable,
    Material,
    absorption_of,
    absorption_per_mm,
)
from lensforge.results.files import MIB, read_file
from lensforge.results.text_dialect import number_in, shown
from lensforge.results.text_table import TextTable

_MOST_BYTES = 4 * MIB  # the largest table of the database has 1 MiB
_LEAST_UM = 1e-3  # no light of a lens is shorter
_MOST_EVENTS = 10_000  # of YAML: a file of the database has a few hundred
_DEEPEST = 16  # a file of the database is four levels deep


def read_refractive_index_info(path: Path, name: str) -> Material:
    """Read the material at ``path``; ``name``: of the material. Raises :class:`InputError`, one line.

    A :class:`FileWarning` tells of contradicting statements of index or absorption.
    """
    content = _content(path)
    blocks = _blocks(content, path)
    index, span = _index(blocks, path)
    dispersion = AgainstVacuum(index) if _is_absolute(content, path) else index
    return Material(name, dispersion, span, path.name, None, absorption_of(_absorption(blocks, path)))


_ABSOLUTE_KEYS = ("n_is_absolute", "n_absolute")  # the second of older files


def _is_absolute(content: Mapping[str, Any], path: Path) -> bool:
    """True if the file states its index relative to vacuum."""
    specs = content.get("SPECS")
    given = {key: str(specs[key]).lower() for key in _ABSOLUTE_KEYS if key in specs} if isinstance(specs, dict) else {}
    for key, value in given.items():
        if value not in ("true", "false"):
            raise InputError(f"{path}: {key}: {shown(value)}, must be true or false")
    if len({*given.values()}) > 1:
        raise InputError(f"{path}: n_is_absolute and n_absolute contradict each other; leave out one")
    return "true" in given.values()


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
    """Raise :class:`ValueError` for YAML that a few bytes can make huge or deep, before values are made."""
    depth = 0
    for number, event in enumerate(events):
        kind = type(event).__name__
        if kind == "AliasEvent":
            raise ValueError(f"an alias in line {event.start_mark.line + 1}, which no material needs")
        depth += kind in ("MappingStartEvent", "SequenceStartEvent")
        depth -= kind in ("MappingEndEvent", "SequenceEndEvent")
        if number > _MOST_EVENTS or depth > _DEEPEST:
            raise ValueError(f"more than {_MOST_EVENTS} entries, or more than {_DEEPEST} levels")


_Index = tuple[Formula | IndexTable, tuple[float, float]]  # and its range in nm
_SAME_INDEX = 1e-4
_SAME_ABSORPTION = 0.01  # relative
_COMPARED = 50  # wavelengths


def _index(blocks: dict[str, dict[str, Any]], path: Path) -> _Index:
    """The first index of the file, compared with any other one."""
    indices = {kind: index for kind, block in blocks.items() if (index := _index_of(kind, block, path)) is not None}
    if not indices:
        only = ", only tabulated k" if "tabulated k" in blocks else ""
        raise InputError(f"{path}: has no index{only}; give a file with n or a formula")
    first, *further = indices
    for kind in further:
        apart = _largest_difference(indices[first], indices[kind])
        if apart > _SAME_INDEX:
            doubt = f"{first} is taken, {kind} beside it has an index that differs by up to {apart:.2g}; leave out one"
            warnings.warn(f"{path}: {doubt}", FileWarning, stacklevel=1)
    return indices[first]


def _index_of(kind: str, block: dict[str, Any], path: Path) -> _Index | None:
    """The index of a block, and the wavelengths (nm) at which it is known; None for a block without one."""
    if kind.replace("formula", "rii") in COEFFICIENTS:
        low, high = _numbers(block, "wavelength_range", path, 2, 2)
        return Formula(kind.replace("formula", "rii"), _coefficients(kind, block, path)), (1e3 * low, 1e3 * high)
    if kind in ("tabulated n", "tabulated nk"):
        table = _table(block, path, 3 if kind == "tabulated nk" else 2)
        waves = tuple((1e3 * table[:, 0]).tolist())
        return IndexTable(waves, tuple(table[:, 1].tolist())), (waves[0], waves[-1])
    return None


def _largest_difference(first: _Index, second: _Index) -> float:
    """Largest difference of two indices over their common wavelengths; 0 if there are none."""
    low = max(first[1][0], second[1][0])
    high = min(first[1][1], second[1][1])
    if not low <= high:
        return 0.0
    waves = np.linspace(low, high, _COMPARED)
    return float(np.abs(first[0].index(waves) - second[0].index(waves)).max())


_FIXED_COUNTS = {"formula 7": (3, 6), "formula 8": (4, 4), "formula 9": (6, 6)}  # of 7 the last ones may be left out


def _coefficients(kind: str, block: dict[str, Any], path: Path) -> tuple[float, ...]:
    """The coefficients of a formula: as many as it has; for sums, in pairs after the first.

    Formula 4 has two terms of four before its pairs.
    """
    least, most = _FIXED_COUNTS.get(kind, (1, MOST_COEFFICIENTS))
    numbers = _numbers(block, "coefficients", path, least, most)
    cut = kind not in _FIXED_COUNTS and len(numbers) % 2 == 0
    if cut or (kind == "formula 4" and len(numbers) < 9 and (len(numbers) - 1) % 4):
        count = "as 1 + 4 + 4 and then in pairs" if kind == "formula 4" else "1 and then pairs, an odd number"
        fault = f"{len(numbers)} coefficients, {kind} has them {count}"
        raise InputError(f"{path}: {fault}: is the last one missing? Download it again")
    return tuple(numbers)


def _absorption(blocks: dict[str, dict[str, Any]], path: Path) -> list[list[float]]:
    """Rows of wavelength (nm) and absorption (1/mm); empty for a file without k."""
    tables = []
    for kind, columns in (("tabulated k", 2), ("tabulated nk", 3)):
        if kind in blocks:
            table = _table(blocks[kind], path, columns)
            waves = 1e3 * table[:, 0]
            tables.append(np.column_stack([waves, absorption_per_mm(table[:, columns - 1], waves)]))
    for further in tables[1:]:
        first = tables[0]
        common = further[(further[:, 0] >= first[0, 0]) & (further[:, 0] <= first[-1, 0])]
        taken = np.interp(common[:, 0], first[:, 0], first[:, 1])
        if (np.abs(taken - common[:, 1]) > _SAME_ABSORPTION * np.abs(taken)).any():
            doubt = "tabulated k is taken, tabulated nk beside it has another k; leave out one"
            warnings.warn(f"{path}: {doubt}", FileWarning, stacklevel=1)
    return tables[0].tolist() if tables else []


def _table(block: dict[str, Any], path: Path, columns: int) -> Float[np.ndarray, "k c"]:
    """Numbers of a table, by rising wavelength, without duplicates."""
    name = f"{path}: table of {block['type']}"
    table = TextTable.of(str(block.get("data", "")), name).numbers(used=range(columns))
    if not (np.abs(table) < HUGE).all() or table[:, 0].min() < _LEAST_UM:
        raise InputError(
            f"{name}: numbers must be below {HUGE:g}, wavelengths at least {_LEAST_UM:g} um; download it again"
        )
    rows = np.unique(table, axis=0)  # those that are there twice count once
    twice = np.flatnonzero(np.diff(rows[:, 0]) == 0.0)
    if len(twice):
        row, next_row = (" ".join(f"{number:g}" for number in rows[at, 1:]) for at in (twice[0], twice[0] + 1))
        raise InputError(f"{name}: {row} and {next_row} at one wavelength, {rows[twice[0], 0]:g} um; leave out one")
    return rows


def _numbers(block: dict[str, Any], name: str, path: Path, least: int, most: int = MOST_COEFFICIENTS) -> list[float]:
    numerals = str(block.get(name, "")).split()
    try:
        numbers = [number_in(word) for word in numerals]
    except ValueError:
        numbers = []
    if not least <= len(numbers) <= most or not np.isfinite(numbers).all():
        count = f"{least}" if least == most else f"{least} to {most}"
        raise InputError(f"{path}: {name}: {shown(' '.join(numerals))}, must be {count} numbers; download it again")
    return numbers
