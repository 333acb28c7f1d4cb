"""The base of all records: frozen, validated, equal to the bit, and one flat row for a table."""

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from html import escape
from typing import Annotated, Any, TypeVar, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic.fields import FieldInfo

from lensforge.errors import InputError
from lensforge.records.arrays import Array, bind

Scalar = float | int | bool | str | None
_Mark = TypeVar("_Mark")


class Record(BaseModel):
    """Frozen; every field has a type and a range, and a field that is not known is refused."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        arbitrary_types_allowed=True,
        ignored_types=(cached_property,),
        defer_build=True,  # a validator is made when it is first needed: importing the library makes none
    )

    def __eq__(self, other: object) -> bool:
        """Whether ``other`` has the same class and the same bits in every field."""
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, name), getattr(other, name)) for name in type(self).model_fields)

    __hash__ = None  # type: ignore[assignment]  # arrays have no hash

    @model_validator(mode="after")
    def _axes_agree(self) -> "Record":
        sizes: dict[str, int] = {}
        for name, field in type(self).model_fields.items():
            mark, value = marker(field, Array), getattr(self, name)
            if mark is not None and value is not None:
                try:
                    bind(mark.axes, value.shape, sizes)
                except ValueError as error:
                    raise ValueError(f"{name}: {error}") from None
        return self

    def row(self) -> dict[str, Scalar]:
        """All numbers and texts, keys joined by dots: one row for a table. Lists and arrays are left out."""
        return dict(_flat(self, ""))

    def _repr_html_(self) -> str:
        """For a notebook: the row as a table."""
        cells = (
            f"<tr><th>{escape(key)}</th><td>{escape(_shown(value))}</td></tr>" for key, value in self.row().items()
        )
        return f"<table>{''.join(cells)}</table>"


def marker(field: FieldInfo, kind: type[_Mark]) -> _Mark | None:
    """The annotation of class ``kind`` on a field, also where the field may be None."""
    found = [each for each in field.metadata if isinstance(each, kind)]
    for part in get_args(field.annotation):
        if get_origin(part) is Annotated:
            found += [each for each in get_args(part)[1:] if isinstance(each, kind)]
    return found[0] if found else None


def same(one: Any, other: Any) -> bool:
    """Whether two values are the same, arrays to the bit."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return (
            isinstance(one, np.ndarray)
            and isinstance(other, np.ndarray)
            and one.dtype == other.dtype
            and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
        )
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    return bool(one == other)


def refused(error: ValidationError, origin: str, remedy: str = "") -> InputError:
    """The one line for the first wrong field of what ``origin`` names."""
    first = error.errors(include_url=False)[0]
    field = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    value = json.dumps(first["input"]) if isinstance(first["input"], str | int | float | bool) else ""
    shown = f" = {value if len(value) <= 60 else value[:57] + '...'}" if value else ""
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    parts = [part for part in (origin, f"{field}{shown}" if field else "", f"{message}{more}") if part]
    return InputError(": ".join(parts) + (f"; {remedy}" if remedy else ""))


def _flat(value: Any, prefix: str) -> Iterator[tuple[str, Scalar]]:
    items: Mapping[str, Any] | None = None
    if isinstance(value, Record):
        items = {name: getattr(value, name) for name in type(value).model_fields}
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
