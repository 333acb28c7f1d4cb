"""Arrays of a record and of the records in its lists, by their names in an npz file: ``receivers.0.map``."""

from collections.abc import Iterator, Mapping
from typing import Any, get_args, get_origin

import numpy as np

from lensforge.records.arrays import Array
from lensforge.records.record import Record, marker


def arrays_of(record: Record) -> Iterator[tuple[str, np.ndarray]]:
    """Name and value of each array that is there."""
    for field in own_arrays(type(record)):
        if (value := getattr(record, field)) is not None:
            yield field, value
    for field in lists_with_arrays(type(record)):
        for k, entry in enumerate(getattr(record, field)):
            yield from ((f"{field}.{k}.{name}", value) for name, value in arrays_of(entry))


def excluded_arrays(kind: type[Record]) -> dict[str, Any]:
    """The arrays, as pydantic takes fields to leave out of a dump."""
    nested = {field: {"__all__": excluded_arrays(entry)} for field, entry in lists_with_arrays(kind).items()}
    return {**dict.fromkeys(own_arrays(kind), True), **nested}


def names_in(kind: type[Record], content: Mapping[str, Any]) -> list[str]:
    """Names of all arrays that a record with this JSON content may have."""
    names = list(own_arrays(kind))
    for field, entry_kind in lists_with_arrays(kind).items():
        for k, entry in enumerate(_entries(content, field)):
            names += [f"{field}.{k}.{name}" for name in names_in(entry_kind, entry)]
    return names


def with_arrays(kind: type[Record], content: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """JSON content with its arrays, each in its record. Raises :class:`ValueError` for an array in the JSON itself."""
    result = dict(content)
    for name in own_arrays(kind):
        if name in content:
            raise ValueError(f"{name}: does not belong in the JSON file")
    for name in own_arrays(kind):
        if name in arrays or not kind.model_fields[name].is_required():
            result[name] = arrays.get(name)
    for field, entry_kind in lists_with_arrays(kind).items():
        entries = _entries(content, field)
        if not entries:
            continue
        filled = []
        for k, entry in enumerate(entries):
            prefix = f"{field}.{k}."
            own = {name.removeprefix(prefix): value for name, value in arrays.items() if name.startswith(prefix)}
            filled.append(with_arrays(entry_kind, entry, own))
        result[field] = filled
    return result


def own_arrays(kind: type[Record]) -> list[str]:
    """Names of the fields that are arrays."""
    return [name for name, info in kind.model_fields.items() if marker(info, Array) is not None]


def lists_with_arrays(kind: type[Record]) -> dict[str, type[Record]]:
    """Fields that are lists of records which hold arrays, and the class of those."""
    found = {}
    for name, info in kind.model_fields.items():
        if get_origin(info.annotation) is tuple:
            entry = get_args(info.annotation)[0]
            holds = isinstance(entry, type) and issubclass(entry, Record)
            if holds and (own_arrays(entry) or lists_with_arrays(entry)):
                found[name] = entry
    return found


def _entries(content: Mapping[str, Any], field: str) -> list[Mapping[str, Any]]:
    """Records of a list in JSON; none where it is damaged, which the validation reports."""
    entries = content.get(field)
    return entries if isinstance(entries, list) and all(isinstance(each, Mapping) for each in entries) else []
