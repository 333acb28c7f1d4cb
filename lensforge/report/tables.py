"""Every number of a JSON file as a row: where it is, what it is, its unit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from lensforge.report.numerals import anything
from lensforge.report.units import unit_of

_SHORT = 6  # as many numbers share a cell; more are a block of their own


@dataclass(frozen=True)
class Row:
    """One line of a table; ``block`` for many numbers, which need the full width."""

    path: str
    value: str
    unit: str
    block: bool = False


def rows(content: Any, without: Sequence[str] = ()) -> list[Row]:
    """All values in ``content`` in the order of the file, less the top-level keys in ``without``."""
    kept = {key: value for key, value in content.items() if key not in without}
    return list(_walk(kept, ()))


def _walk(content: Any, names: tuple[str, ...]) -> Iterator[Row]:
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _walk(value, (*names, str(key)))
    elif isinstance(content, list | tuple) and any(isinstance(item, dict | list | tuple) for item in content):
        for index, item in enumerate(content):
            yield from _walk(item, (*names, f"[{index}]"))
    elif isinstance(content, list | tuple):
        yield Row(_path(names), "  ".join(map(anything, content)), _unit(content, names), len(content) > _SHORT)
    else:
        yield Row(_path(names), anything(content), _unit([content], names))


def _unit(values: Sequence[Any], names: tuple[str, ...]) -> str:
    """Text, truth and absence have no unit."""
    numeric = any(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    return unit_of(names) if numeric else ""


def _path(names: tuple[str, ...]) -> str:
    return ".".join(names).replace(".[", "[")
