"""The base class of all records, and the types of their fields: strict numbers, text, metrics, read-only arrays.

A record is frozen, validated, compared bit for bit, and has one flat row for a table. All numbers are finite and
bounded: a page draws them, and a sum of them stays finite. Text is never taken for a number.
"""

import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args, get_origin

import numpy as np
from jaxtyping import Float
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ModelWrapValidatorHandler,
    computed_field,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic.main import IncEx
from pydantic_core import CoreSchema, core_schema

from lensforge.public import public
from lensforge.results.files import MIB
from lensforge.results.notebook_html import Brief, Shown, table_html
from lensforge.results.numerals import quantity
from lensforge.results.validation import same, with_changes

# Of any number in a record, in the unit of its field: products of three, and squares over products, stay within
# floating point. The largest that a sound result may hold are W/m^2 of a laser's focus, 1e20.
LARGEST = 1e30
LARGEST_COUNT = 2**53  # a float holds every whole number up to this one
MOST_PIXELS = 4096  # along an axis; a page draws all of them
_ROUNDING = 1e-9  # sums of shares may leave 0 to 1 by rounding
_LONGEST_TEXT = 10_000  # characters; the longest remedy of lensforge has 300, and a page shows all of a text

Scalar = float | int | bool | str | None
_Mark = TypeVar("_Mark")

MOST_FILE_BYTES = 384 * MIB  # of a CAD file or a mesh: eight million triangles, several times those of a reference run


@dataclass(frozen=True)
class Given:
    """Marks a field held by another file."""


@dataclass(frozen=True)
class InFile:
    """Marks a field of bytes stored as the file ``name`` of a result folder, of at most ``most_bytes``."""

    name: str
    most_bytes: int = MOST_FILE_BYTES

    def beside(self, stage: str, stem: str) -> str:
        """Name of the file that belongs to ``stem``.json: ``lens_x.ies`` to ``photometry_x.json``."""
        path = Path(self.name)
        end = stem.removeprefix(stage) if stem.startswith(f"{stage}_") else ""
        return f"{path.stem}{end}{path.suffix}"


@dataclass(frozen=True)
class InCriterion:
    """Marks a field that a file states only within a criterion, as its ``entry`` "value" or "limit".

    ``name``: of the criterion; by default that of the field's own :class:`~lensforge.results.figure.Criterion`.
    """

    name: str = ""
    entry: Literal["value", "limit"] = "value"


class Array:
    """Marks a field ``Annotated[Float[np.ndarray, "p p"], Array("p", "p")]`` that is stored in the stage's npz file.

    ``axes``: a name or a number for each axis; axes of the same name have the same size in all arrays of a record.
    ``gaps``: values may be NaN, as in maps of a face outside its rim; never infinite. ``least``: of all values.
    """

    def __init__(self, *axes: str | int, gaps: bool = False, least: float = -LARGEST) -> None:
        self.axes = axes
        self.gaps = gaps
        self.least = least

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        """Validate by :meth:`checked`; serialise to nested lists."""
        lists = core_schema.plain_serializer_function_ser_schema(lambda array: array.tolist())
        return core_schema.no_info_plain_validator_function(self.checked, serialization=lists)

    def checked(self, value: object) -> np.ndarray:
        """``value`` as a new read-only float64 array. Raises :class:`ValueError` if it cannot be one."""
        array = real_numbers(value)
        if array.ndim != len(self.axes) or array.size == 0:
            raise ValueError(f"shape {array.shape}, must be ({', '.join(map(str, self.axes))}), and not empty")
        self.bind(array.shape, {})
        array = read_only(array, self.gaps)
        if (array < self.least).any():
            raise ValueError(f"holds {np.nanmin(array):.3g}, must be at least {self.least:g}")
        return array

    def bind(self, shape: tuple[int, ...], sizes: dict[str, int]) -> None:
        """Compare ``shape`` with the axes and the known ``sizes``; add new ones. Raises :class:`ValueError`."""
        for axis, size in zip(self.axes, shape, strict=True):
            known = axis if isinstance(axis, int) else sizes.setdefault(axis, size)
            if size != known:
                raise ValueError(f"shape {shape}, must be ({', '.join(map(str, self.axes))}) with {axis} = {known}")


def real_numbers(value: Any, converted: Callable[[Any], np.ndarray] = np.array) -> np.ndarray:
    """``value``, an array or nested lists, as a new float64 array of any shape.

    ``converted``: makes an array of it. Raises :class:`ValueError` for text, booleans, complex numbers and anything
    else that is no array.
    """
    try:
        if _has_boolean(value):
            raise ValueError("true and false are no numbers")
        array = converted(value)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"of type {array.dtype}, must be real")
        return array.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        # RuntimeError: a tensor on another device, or one that requires its gradient
        raise ValueError(f"not an array of numbers ({error})") from None


def _has_boolean(value: Any) -> bool:
    """True if nested lists hold a boolean, which NumPy would turn into 1 or 0 among numbers."""
    if isinstance(value, list | tuple):
        return any(map(_has_boolean, value))
    return isinstance(value, bool | np.bool_)


def read_only(array: np.ndarray, gaps: bool = False) -> np.ndarray:
    """``array`` itself, made read-only.

    Raises :class:`ValueError` for infinity, for NaN without ``gaps``, for numbers beyond :data:`LARGEST`, and if all
    but 0 are below its inverse.
    """
    if np.isinf(array).any() or (not gaps and np.isnan(array).any()):
        raise ValueError("holds numbers that are not finite")
    peak = float(np.fmax.reduce(np.abs(array), axis=None, initial=0.0))
    if peak > LARGEST or 0.0 < peak < 1.0 / LARGEST:
        raise ValueError(f"has {peak:.3g} as its largest number; must be from {1.0 / LARGEST:g} to {LARGEST:g}, or 0")
    array.flags.writeable = False
    return array


@public
class Record(BaseModel, metaclass=Shown):
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
        """True if ``other`` has the same class and the same bits in every stored field."""
        if type(self) is not type(other):
            return NotImplemented
        return same(self._stored, other._stored)

    __hash__ = None  # type: ignore[assignment]  # arrays have no hash

    @property
    def _stored(self) -> dict[str, object]:
        """Stored values by the names of their fields."""
        left_out = {name for name, info in type(self).model_fields.items() if info.exclude}
        return {name: value for name, value in values_of(self).items() if name not in left_out}

    @model_validator(mode="wrap")
    @classmethod
    def _stated_fields_follow(cls, content: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Compute fields that follow from others anew; entries of a file for them must agree."""
        if not isinstance(content, Mapping):
            return handler(content)
        stated_fields = {name: content[name] for name in cls.model_computed_fields if name in content}
        record = handler({key: value for key, value in content.items() if key not in stated_fields})
        follow = record.model_dump(mode="json", include=set(stated_fields)) if stated_fields else {}
        for name, stated in stated_fields.items():
            if not agree(stated, follow[name]):
                raise ValueError(f"{name}: not as it follows from the other entries")
        return record

    @model_validator(mode="after")
    def _axes_agree(self) -> "Record":
        sizes: dict[str, int] = {}
        for name, info in type(self).model_fields.items():
            mark = marker(info, Array)
            value = getattr(self, name)
            if mark is not None and value is not None:
                try:
                    mark.bind(value.shape, sizes)
                except ValueError as error:
                    raise ValueError(f"{name}: {error}") from None
        return self

    def changed(self, **fields: Any) -> Self:
        """A copy with other values in some ``fields``. Raises pydantic's ``ValidationError`` for one out of range."""
        return with_changes(self, fields)

    def follows(self) -> Iterator[tuple[str, float, float]]:
        """Figures that follow from others of the record, if both are stored: name, stated value, and derived value."""
        return iter(())

    def row(self) -> dict[str, Scalar]:
        """All numbers and texts under dotted keys: one row for a table. Lists and arrays are left out."""
        return dict(self._entries())

    def _entries(self, whole: bool = False) -> Iterator[tuple[str, Scalar]]:
        return _flat(self, "", whole)

    def __repr_args__(self) -> Iterator[tuple[str | None, object]]:
        """Fields for display in a terminal: arrays, files and long lists by their size."""
        yield from ((name, Brief.of(value)) for name, value in super().__repr_args__())

    def shown_row(self) -> dict[str, str]:
        """The row as text, a metric in one entry."""
        return {key: _shown(value) for key, value in self._entries(whole=True)}

    def _repr_html_(self) -> str:
        return table_html(self.shown_row())


def agree(first: Any, second: Any) -> bool:
    """True if two values are the same in JSON, numbers within the rounding of another machine."""
    first, second = (value.model_dump(mode="json") if isinstance(value, Record) else value for value in (first, second))
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return first.keys() == second.keys() and all(agree(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        return len(first) == len(second) and all(map(agree, first, second))
    if all(isinstance(value, float | int) and not isinstance(value, bool) for value in (first, second)):
        largest = max(abs(first), abs(second))
        return bool(largest <= LARGEST and abs(first - second) <= _ROUNDING * largest)
    return type(first) is type(second) and bool(first == second)


def require_what_follows(record: Record, place: str = "") -> None:
    """Raise :class:`ValueError` if a figure of ``record``, or of one within, contradicts those it follows from."""
    for name, stated, derived in record.follows():
        if not agree(stated, derived):
            raise ValueError(f"{place}{name} = {stated:.9g}: the other entries make it {derived:.9g}")
    for field, value in values_of(record).items():
        within = value if isinstance(value, tuple) else (value,)
        for number, entry in enumerate(within):
            if isinstance(entry, Record):
                require_what_follows(entry, f"{place}{field}{f'.{number}' if within is value else ''}.")


if TYPE_CHECKING:
    stated = property
else:

    def stated(getter: Callable[[Any], Any]) -> Any:
        """A property that follows from the fields, and that a file states too."""
        return computed_field(property(getter))


def marker(field: FieldInfo, kind: type[_Mark]) -> _Mark | None:
    """The annotation of class ``kind`` on a field, also if the field may be None."""
    marks = [mark for mark in field.metadata if isinstance(mark, kind)]
    for part in get_args(field.annotation):
        if get_origin(part) is Annotated:
            marks += [argument for argument in get_args(part)[1:] if isinstance(argument, kind)]
    return marks[0] if marks else None


def marks_of(field: FieldInfo, *kinds: type[_Mark]) -> list[_Mark]:
    """All annotations of these ``kinds`` on a field, in their order."""
    return [mark for mark in field.metadata if isinstance(mark, kinds)]


def values_of(record: Record) -> dict[str, object]:
    """Value of each field, then further entries of a class that takes any name, such as one for each face."""
    fields_ = {name: getattr(record, name) for name in type(record).model_fields}
    return fields_ | (record.model_extra or {})


def arrays_of(record: Record) -> Iterator[tuple[str, np.ndarray]]:
    """Name and value of each array; those of inner records, such as ``receivers.0.map``, come last."""
    values = values_of(record)
    yield from ((name, value) for name, value in values.items() if isinstance(value, np.ndarray))
    for field, value in values.items():
        within = (
            {f"{field}.{k}": entry for k, entry in enumerate(value)} if isinstance(value, tuple) else {field: value}
        )
        for place, entry in within.items():
            if isinstance(entry, Record):
                yield from ((f"{place}.{name}", array) for name, array in arrays_of(entry))


def put_arrays(content: dict[str, object], arrays: Mapping[str, np.ndarray]) -> None:
    """Put each of ``arrays`` into the record within ``content`` named by its key. Raises :class:`ValueError`."""
    for name, array in arrays.items():
        *path, field = name.split(".")
        place: Any = content
        try:
            for step in path:
                place = place[int(step)] if isinstance(place, list) else place[step]
            place[field] = array
        except (KeyError, IndexError, TypeError, ValueError):
            raise ValueError(f"there is no place for the array {name[:60]!r}") from None


def stored_beside(record: Record) -> dict[str, IncEx | bool]:
    """Fields stored beside a record or in its criteria, in the form of pydantic's ``exclude``."""
    fields = type(record).model_fields.items()
    marks = (Array, InFile, InCriterion)
    excluded: dict[str, IncEx | bool] = {
        name: True for name, info in fields if any(marker(info, mark) is not None for mark in marks)
    }
    for name, value in values_of(record).items():
        entry = value[0] if isinstance(value, tuple) and value else value  # the entries of a list are of one class
        if isinstance(entry, Record) and (nested := stored_beside(entry)):
            excluded[name] = nested if entry is value else {"__all__": nested}
    return excluded


def _flat(value: Any, prefix: str, whole: bool) -> Iterator[tuple[str, Scalar]]:
    items: Mapping[str, Any] | None = None
    if whole and isinstance(value, Metric):
        yield prefix, str(value)
    elif isinstance(value, Record):
        items = values_of(value) | {name: getattr(value, name) for name in type(value).model_computed_fields}
    elif isinstance(value, Mapping):
        items = value
    if items is not None:
        for name, entry in items.items():
            yield from _flat(entry, f"{prefix}.{name}" if prefix else name, whole)
    elif value is None or isinstance(value, float | int | bool | str):
        yield prefix, value
    elif isinstance(value, Sequence) and not isinstance(value, bytes) and len(value) <= 3:
        for axis, entry in zip("xyz", value, strict=False):
            if isinstance(entry, float | int):
                yield f"{prefix}.{axis}", entry


def _shown(value: Scalar) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def printable(text: Any) -> Any:
    """``text`` with spaces for line ends and U+FFFD for control characters and those that no file can hold.

    Names of files and of their headers, from which texts are made, may have any characters and any length: what exceeds
    10,000 characters ends in an ellipsis.
    """
    if not isinstance(text, str):
        return text
    if len(text) > _LONGEST_TEXT:
        text = f"{text[: _LONGEST_TEXT - 1]}…"
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(character: str) -> str:
    if character.isprintable() or unicodedata.category(character) == "Zs":  # a thin space
        return character
    return " " if character.isspace() else "\N{REPLACEMENT CHARACTER}"


Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1.0 / LARGEST, le=LARGEST)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_ROUNDING, le=1.0 + _ROUNDING)]
Count = Annotated[int, Field(strict=True, ge=0, le=LARGEST_COUNT)]
Flag = Annotated[bool, Field(strict=True)]
Text = Annotated[str, BeforeValidator(printable), Field(strict=True)]
Sha256 = Annotated[str, Field(strict=True, pattern=r"^[0-9a-f]{64}$")]
State = Literal["pass", "fail", "undecided", "none"]  # none: not asked
Sense = Literal["<=", ">="]
Point = tuple[Number, Number, Number]  # x, y, z in mm
Box = tuple[Point, Point]  # least and largest corner, in mm

# An image [row y, column x], and one of light.
Image = Annotated[Float[np.ndarray, "h w"], Array("h", "w")]
Irradiance = Annotated[Float[np.ndarray, "h w"], Array("h", "w", least=0.0)]


@public
class Metric(Record):
    """A number with its unit and its standard error.

    ``value``: the number. ``unit``: its unit, "" for a ratio. ``standard_error``: of one standard deviation; None if
    there was only one sample.
    """

    value: Number
    unit: Text = ""
    standard_error: NotNegative | None = None

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        """Value, standard error and unit, with the digits that the error carries."""
        return quantity(self.value, self.unit, self.standard_error)


class Extent(Record):
    """Largest absolute value and root mean square of a quantity; the field's name states its unit."""

    max: NotNegative
    rms: NotNegative


class BodySize(Record):
    """Volume, negative where the surface faces inwards; area of the surface; least and largest corner of the box."""

    volume_mm3: Number
    area_mm2: NotNegative
    bounds_mm: Box
