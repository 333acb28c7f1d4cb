"""The base class of all records: frozen, validated, compared bit for bit, with one flat row for a table.

Arrays of a record and of the records in its lists go to an npz file by their names, such as ``receivers.0.map``.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, computed_field, model_validator
from pydantic.fields import FieldInfo

from lensforge.results.array_fields import Array, bind
from lensforge.results.notebook_html import table_html
from lensforge.results.validation import same

# Of entries in a list or table: numbers are drawn as one line, records and texts each take a row of a page.
_MOST_NUMBERS, _MOST_ROWS = 1_000_000, 10_000

Scalar = float | int | bool | str | None
_Mark = TypeVar("_Mark")


class Record(BaseModel):
    """Base of all records: frozen, fields typed and within their ranges, unknown fields refused."""

    unions: ClassVar[tuple[str, ...]] = ()  # fields that hold one of several records, chosen by ``kind``

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
        ignored_types=(cached_property,),
        defer_build=True,  # validators are built on first use, not on import
    )

    def __eq__(self, other: object) -> bool:
        """True where ``other`` has the same class and the same bits in every field."""
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, name), getattr(other, name)) for name in type(self).model_fields)

    __hash__ = None  # type: ignore[assignment]  # arrays have no hash

    @model_validator(mode="wrap")
    @classmethod
    def _computed_fields_agree(cls, content: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Compare fields that follow from others, which a file also states, with what follows."""
        if not (isinstance(content, Mapping) and any(name in content for name in cls.model_computed_fields)):
            return handler(content)
        names = [name for name in cls.model_computed_fields if name in content]
        record = handler({key: value for key, value in content.items() if key not in names})
        for name in names:
            found = getattr(record, name)
            plain = found.model_dump(mode="json") if isinstance(found, Record) else found
            if content[name] != plain:
                raise ValueError(f"{name}: not what the fields say that it follows from")
        return record

    @model_validator(mode="after")
    def _axes_agree(self) -> "Record":
        sizes: dict[str, int] = {}
        for name, axes in _array_axes(type(self)):
            value = getattr(self, name)
            if value is not None:
                try:
                    bind(axes, value.shape, sizes)
                except ValueError as error:
                    raise ValueError(f"{name}: {error}") from None
        return self

    @model_validator(mode="after")
    def _lists_are_bounded(self) -> "Record":
        for name in type(self).model_fields:
            value = getattr(self, name)
            if isinstance(value, tuple | dict) and len(value) > _MOST_ROWS:
                most = _MOST_NUMBERS if isinstance(value, tuple) and isinstance(value[0], float | int) else _MOST_ROWS
                if len(value) > most:
                    raise ValueError(f"{name}: {len(value)} entries, must be at most {most}")
        return self

    def row(self) -> dict[str, Scalar]:
        """All numbers and texts, keys joined by dots: one row for a table. Lists and arrays are left out."""
        return dict(_flat(self, ""))

    def _repr_html_(self) -> str:
        """HTML for a notebook: the row as a table."""
        return table_html({key: _shown(value) for key, value in self.row().items()})


if TYPE_CHECKING:
    stated = property
else:

    def stated(getter: Callable[[Any], Any]) -> Any:
        """A property that follows from the fields, and that a file states too: it must be what follows from them."""
        return computed_field(property(getter))


def marker(field: FieldInfo, kind: type[_Mark]) -> _Mark | None:
    """The annotation of class ``kind`` on a field, also where the field may be None."""
    found = [each for each in field.metadata if isinstance(each, kind)]
    for part in get_args(field.annotation):
        if get_origin(part) is Annotated:
            found += [each for each in get_args(part)[1:] if isinstance(each, kind)]
    return found[0] if found else None


@cache
def _array_axes(record: type[Record]) -> tuple[tuple[str, tuple[str | int, ...]], ...]:
    """Names of the arrays among the fields, and the axes of each."""
    marks = ((name, marker(field, Array)) for name, field in record.model_fields.items())
    return tuple((name, mark.axes) for name, mark in marks if mark is not None)


def _flat(value: Any, prefix: str) -> Iterator[tuple[str, Scalar]]:
    items: Mapping[str, Any] | None = None
    if isinstance(value, Record):
        names = (*type(value).model_fields, *type(value).model_computed_fields)
        items = {name: getattr(value, name) for name in names}
    elif isinstance(value, Mapping):
        items = value
    if items is not None:
        for name, entry in items.items():
            yield from _flat(entry, f"{prefix}.{name}" if prefix else name)
    elif value is None or isinstance(value, float | int | bool | str):
        yield prefix, value
    elif isinstance(value, Sequence) and not isinstance(value, bytes) and len(value) <= 3:
        for axis, entry in zip("xyz", value, strict=False):
            if isinstance(entry, float | int):
                yield f"{prefix}.{axis}", entry


def _shown(value: Scalar) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


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
