"""Files of refractiveindex.info (.yml): a dispersion formula or a table of n, and a table of k where there is one.

Read by PyYAML as tables, lists and texts; wavelengths are in um. Absorption follows from the extinction coefficient k:
4 pi k / wavelength.
"""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.dispersion_formulas import HUGE, NAMES, Formula, IndexTable
from lensforge.optics.material import MaterialData
from lensforge.results.files import MIB, read_file

_MOST_BYTES = 4 * MIB  # the largest table of the database has 1 MiB
_LEAST_UM = 1e-3  # no light of a lens is shorter
_MOST_EVENTS, _DEEPEST = 10_000, 16  # of YAML: a file of the database has a few hundred, four levels deep
_Loader: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # no types, no tags; in C where PyYAML was built with it


def read_refractive_index_info(path: Path, name: str) -> MaterialData:
    """Read the material at ``path``; ``name``: what it is called. Raises :class:`InputError`, one line."""
    blocks = _blocks(path)
    index, span = _index(blocks, path)
    absorption = _absorption(blocks, path)
    return MaterialData(
        name=name,
        index=index,
        range_nm=span,
        absorption_nm=() if absorption is None else tuple(absorption[:, 0].tolist()),
        absorption_per_mm=() if absorption is None else tuple(absorption[:, 1].tolist()),
        source=path.name,
    )


def _blocks(path: Path) -> dict[str, dict[str, Any]]:
    """Blocks of data by their type."""
    raw = read_file(path, missing="give a file of refractiveindex.info", most_bytes=_MOST_BYTES)
    try:
        _require_plain(raw)
        content = yaml.load(raw, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = "" if mark is None else f" from line {mark.line + 1}, column {mark.column + 1} on"
        raise InputError(f"{path}: not YAML{place}; download it again") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}; give a file of refractiveindex.info") from None
    data = content.get("DATA") if isinstance(content, dict) else None
    if not isinstance(data, list) or not all(isinstance(block, dict) for block in data):
        raise InputError(f"{path}: has no list DATA; give a file of refractiveindex.info")
    return {str(block.get("type")): block for block in data}


def _require_plain(raw: bytes) -> None:
    """Raise :class:`ValueError` for YAML that a few bytes can make huge or deep: it is asked before values are made."""
    depth = 0
    for number, event in enumerate(yaml.parse(raw, Loader=_Loader)):
        if isinstance(event, yaml.AliasEvent):
            raise ValueError(f"an alias in line {event.start_mark.line + 1}, which no material needs")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if number > _MOST_EVENTS or depth > _DEEPEST:
            raise ValueError(f"more than {_MOST_EVENTS} entries, or more than {_DEEPEST} levels")


def _index(blocks: dict[str, dict[str, Any]], path: Path) -> tuple[Formula | IndexTable, tuple[float, float]]:
    """The index, and the range (nm) in which it holds."""
    for kind, block in blocks.items():
        if kind.replace("formula", "rii") in NAMES:
            low, high = _numbers(block, "wavelength_range", path, 2)
            formula = Formula(kind.replace("formula", "rii"), tuple(_numbers(block, "coefficients", path, 1)))
            return formula, (1e3 * low, 1e3 * high)
        if kind in ("tabulated n", "tabulated nk"):
            table = _table(block, path, 3 if kind == "tabulated nk" else 2)
            waves = tuple((1e3 * table[:, 0]).tolist())
            return IndexTable(waves, tuple(table[:, 1].tolist())), (waves[0], waves[-1])
    only = ", only tabulated k" if "tabulated k" in blocks else ""
    raise InputError(f"{path}: has no index{only}; give a file with n or a formula")


def _absorption(blocks: dict[str, dict[str, Any]], path: Path) -> Float[np.ndarray, "k 2"] | None:
    """Wavelengths (nm) and absorption (1/mm); None where the file has no k."""
    for kind, columns in (("tabulated k", 2), ("tabulated nk", 3)):
        if kind in blocks:
            table = _table(blocks[kind], path, columns)
            return np.column_stack([1e3 * table[:, 0], 4.0 * pi * table[:, columns - 1] / (1e-3 * table[:, 0])])
    return None


def _table(block: dict[str, Any], path: Path, columns: int) -> Float[np.ndarray, "k c"]:
    """Numbers of a table, by rising wavelength, each wavelength once."""
    rows = [line.split() for line in str(block.get("data", "")).splitlines() if line.strip()]
    try:
        table = np.array([[float(word) for word in row[:columns]] for row in rows])
        if (
            table.ndim != 2
            or table.shape[1] != columns
            or not (np.abs(table) < HUGE).all()
            or table[:, 0].min() < _LEAST_UM
        ):
            raise ValueError
    except ValueError:
        raise InputError(f"{path}: its table is not {columns} columns of numbers; download it again") from None
    return table[np.unique(table[:, 0], return_index=True)[1]]


def _numbers(block: dict[str, Any], name: str, path: Path, least: int) -> list[float]:
    try:
        found = [float(word) for word in str(block[name]).split()]
    except (KeyError, ValueError):
        found = []
    if len(found) < least:
        raise InputError(f"{path}: {name} must be {least} numbers at least; download it again")
    return found
