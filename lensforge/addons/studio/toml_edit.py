"""Edits of a TOML text that keep its comments: one value, by its place, is set, added, or left out."""

import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from lensforge.errors import InputError
from lensforge.spec.toml_bounds import bounded_tables

Place = tuple[str | int, ...]  # names of tables and of a field; of an entry of a list its number, from 0


def edited(text: str, place: Place, value: object) -> str:
    """``text`` with ``value`` at ``place``, None to leave it out. Raises :class:`InputError` for no such place.

    A value that stands there as a comment, as ``lensforge new`` writes those that are derived, takes its line.
    """
    try:
        wanted = bounded_tables(text)
        document = tomlkit.parse(_uncommented(text, place) if value is not None else text)
        _set(document, place, value, tomlkit.table, tomlkit.aot)
        after = tomlkit.dumps(document)
        _set(wanted, place, value, dict, list)
        if bounded_tables(after) == wanted:
            return after
    except (TOMLKitError, KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError):
        pass
    raise InputError(f"{'.'.join(map(str, place))}: cannot be changed beside what stands there; change the text")


def _set(tables: Any, place: Place, value: object, table: Callable[[], Any], entries: Callable[[], Any]) -> None:
    """Set a value; tables on the way to it are made."""
    for step, following in pairwise(place):
        if isinstance(step, int) and step == len(tables):
            tables.append(table())
        elif isinstance(step, str) and step not in tables:
            tables[step] = entries() if isinstance(following, int) else table()
        tables = tables[step]
    if value is None:
        del tables[place[-1]]
    elif place[-1] == len(tables) and isinstance(place[-1], int):
        tables.append(value)
    else:
        tables[place[-1]] = value


def _uncommented(text: str, place: Place) -> str:
    """The text with the commented value of ``place``, if there is one, in force."""
    header = rf"(?:^|\n)\[{re.escape('.'.join(map(str, place[:-1])))}\][^\n]*\n"
    line = rf"({header}(?:(?!\[)[^\n]*\n)*?)#\s*({re.escape(str(place[-1]))}\s*=)"
    changed = re.sub(line, r"\1\2", text, count=1)
    try:
        bounded_tables(changed)
    except ValueError:
        return text
    return changed
