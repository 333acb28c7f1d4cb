"""A spec as nested tables: changed by dotted names, and made plain enough for TOML."""

from collections.abc import Mapping
from pathlib import Path

from lensforge.errors import InputError
from lensforge.records.validation import its_type


def short(value: object) -> str:
    """The first characters of ``value`` as a text for a message."""
    return repr(str(value)[:60])


def changed(content: dict[str, object], changes: Mapping[str, object]) -> dict[str, object]:
    """A copy of ``content`` in which dotted names have new values; a table of changes goes into a table."""
    result = dict(content)
    for name, value in changes.items():
        if not isinstance(name, str):
            raise InputError(
                f"replace: the name {short(name)} is {its_type(name)}, must be text such as 'target.distance_mm'"
            )
        section, _, rest = name.partition(".")
        before = result.get(section)
        if rest:
            result[section] = changed(dict(before) if isinstance(before, Mapping) else {}, {rest: value})
        elif isinstance(value, Mapping) and isinstance(before, Mapping):
            result[section] = changed(dict(before), value)
        else:
            result[section] = value
    return result


def name_kinds(given: object, everything: object) -> None:
    """Add each ``kind`` that was left to its class: without it a file could not be read again."""
    if isinstance(given, dict) and isinstance(everything, dict):
        if "kind" in everything:
            given["kind"] = everything["kind"]
        for key, value in given.items():
            name_kinds(value, everything.get(key))
    elif isinstance(given, list | tuple) and isinstance(everything, list | tuple):
        for one, whole in zip(given, everything, strict=True):
            name_kinds(one, whole)


def table_of(value: object) -> dict[str, object]:
    """Return ``value``, which is a table."""
    assert isinstance(value, dict)
    return value


def plain(value: object) -> object:
    """Convert to what TOML can hold: no None, paths as text."""
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items() if entry is not None}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return str(value) if isinstance(value, Path) else value
