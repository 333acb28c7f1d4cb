"""The base of every section of a spec, and the types of its values.

Arrays are given as arrays or nested lists, and written as text without loss.
"""

import base64
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date, datetime
from inspect import Signature
from math import ceil, floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar, get_args

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from lensforge.errors import InputError, refused
from lensforge.public import public
from lensforge.results.notebook_html import Shown
from lensforge.results.record import read_only, real_numbers
from lensforge.results.validation import same, with_changes
from lensforge.spec.number_fields import with_numbers_only
from lensforge.spec.spec_fields import section_help, signature_of
from lensforge.spec.spec_files import NamedFrom, full_path
from lensforge.spec.wrong_fields import spec_error


class _Checked(Shown):
    # Turns the validation error of a section that a script constructs into the lines of the command line.
    #
    # A class that names its field ``positional`` takes that one without its name. Words and signature of a class are
    # made when they are asked for: reading all of them takes a second. An ``__init__`` of the sections would not do:
    # for a table within a table pydantic calls it, too, and what it raises has lost its place. Nor would a hook for
    # new classes, where a signature must be there at once.

    @property
    def __doc__(cls: Any) -> str | None:  # type: ignore[override]  # noqa: N805
        return section_help(cls)

    def __call__(cls: Any, *args: Any, **kwargs: Any) -> Any:  # noqa: N805
        name: str | None = getattr(cls, "positional", None)
        if args and (name is None or len(args) > 1):
            raise InputError(f"{cls.__name__}: {len(args)} values without names; give its fields by name")
        if name is not None and args:
            if name in kwargs:
                raise InputError(f"{cls.__name__}: {name} is given twice, without its name and with it; leave out one")
            kwargs[name] = args[0]
        try:
            return super().__call__(**kwargs)
        except ValidationError as error:
            raise spec_error(error, cls.__name__, cls) from None

    @property
    def __signature__(cls: Any) -> Signature:  # noqa: N805
        return signature_of(cls)

    @__signature__.setter
    def __signature__(cls: Any, value: object) -> None:  # noqa: N805
        pass  # pydantic's own, which a class has only once it has been used

    def __dir__(cls: Any) -> list[str]:  # noqa: N805
        return [name for name in super().__dir__() if name in ("replace", "save", "to_toml")]


if TYPE_CHECKING:  # a type checker knows no metaclass without a name, and of this one it needs nothing
    _Model = BaseModel
else:
    _Model = public(_Checked("_Model", (BaseModel,), {"__module__": __name__}))


_Section = TypeVar("_Section", bound=BaseModel)


def check(method: Callable[[Any], None]) -> Any:
    """Make ``method`` a check of a whole section, once its fields are valid: it raises ``ValueError`` for its fault."""

    def checked(section: _Section) -> _Section:
        method(section)
        return section

    return model_validator(mode="after")(checked)


@contextmanager
def fault_of(field: str = "") -> Iterator[None]:
    """Raise what is wrong inside the block as the ``ValueError`` of a check, behind the name of the ``field``."""
    try:
        yield
    except (InputError, ValueError) as error:
        raise ValueError(": ".join(filter(None, (field, str(error))))) from None


@public
class Section(_Model):
    """Immutable; a field that is not known, or a number that is not finite, is refused: :class:`InputError`."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True, defer_build=True
    )

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return cls.finished_schema(handler(source))

    @classmethod
    def finished_schema(cls, schema: CoreSchema) -> CoreSchema:
        """The schema that refuses true, false and texts where numbers belong; of a section of several kinds, too."""
        return with_numbers_only(schema)

    @check
    def _kind_is_given(self) -> None:
        """Count the kind as given where it was left to the class: without it a file could not be read again."""
        field = type(self).model_fields.get("kind")
        if field is not None and len(get_args(field.annotation)) == 1:  # more: a choice within one class
            self.model_fields_set.add("kind")

    def changed(self, **fields: Any) -> Self:
        """A copy with other values in some ``fields``, each checked by itself: what they make together is not.

        Raises :class:`InputError` for a value that is not allowed.
        """
        try:
            return with_changes(self, fields)
        except ValidationError as error:
            raise spec_error(error, type(self).__name__, type(self)) from None

    def __setattr__(self, name: str, value: Any) -> None:
        raise InputError(f"{type(self).__name__}.{name}: a spec does not change; make another with replace(...)")

    def __delattr__(self, name: str) -> None:
        raise InputError(f"{type(self).__name__}.{name}: a spec does not change; make another with replace(...)")

    def __eq__(self, other: object) -> bool:
        """True where all fields are equal, arrays to the bit."""
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, name), getattr(other, name)) for name in type(self).model_fields)

    def __hash__(self) -> int:
        return hash(self.model_dump_json())


def section_of(kind: type[_Section], content: object, origin: str, files: NamedFrom | None = None) -> _Section:
    """A section of ``kind`` from a table; ``files``: from where those that it names count, else the current folder.

    ``origin`` names the table in :class:`InputError`, which has a line for each wrong field.
    """
    try:
        return kind.model_validate(content, context=files)
    except ValidationError as error:
        raise spec_error(error, origin, kind) from None


def rounded_up(value: float, digits: int = 4) -> str:
    """``value`` > 0 to ``digits`` significant digits, rounded up: a least value in a message must itself be allowed."""
    unit = 10.0 ** (floor(log10(value)) + 1 - digits)
    return f"{ceil(value / unit * (1.0 - 1e-12)) * unit:.{digits}g}"


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("holds a character that cannot be printed, such as a line break; leave it out")
    return text


def iso_date(value: Any) -> str:
    """The ISO 8601 text of a date, or of its text. Raises ``ValueError`` for anything else, a time of day included."""
    try:
        if isinstance(value, date) and not isinstance(value, datetime):
            return value.isoformat()
        if isinstance(value, str) and len(value) == len("2026-01-31"):
            return date.fromisoformat(value).isoformat()
    except ValueError:
        pass
    raise ValueError("a date is written as year-month-day, such as 2026-01-31")


def date_of(name: str, value: object) -> str | None:
    """The argument ``name`` as the text of a date; None stays None. Raises :class:`InputError` for anything else."""
    with refused(f"{name} = {str(value)[:60]!r}", "…", ValueError):
        return None if value is None else iso_date(value)


# From a nanometre to a kilometre, with room to spare: squares and ratios of lengths stay within floating point.
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9)]
DraftOrNone = Annotated[float, Field(ge=0.0, le=10.0)] | None  # degrees
MillimetresOrZero = Annotated[float, Field(ge=0.0, le=1e9)]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]  # mm
if TYPE_CHECKING:  # in a spec it is there, derived or given; only a section by itself may still be without it
    DerivedMillimetres = float
    DerivedMillimetresOrZero = float
else:
    DerivedMillimetres = Millimetres | None
    DerivedMillimetresOrZero = MillimetresOrZero | None
LEFT_OUT: Any = None  # of such a size
# Powers, intensities and weights: no light has less or more, and squares of any share of it stay within floating point.
Watts = Annotated[float, Field(ge=1e-30, le=1e12)]
Lumens = Annotated[float, Field(ge=1e-30, le=1e12)]
Weight = Annotated[float, Field(ge=0.0, le=1e12)]
# A relative name counts from the folder of the file that has it, in a script from the folder in which it runs.
FilePath = Annotated[Path, AfterValidator(full_path)]
RelativeWeight = Annotated[float, Field(ge=1e-6, le=1e6)]
ShortName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]  # also of files
Label = Annotated[str, Field(max_length=200), AfterValidator(_printable)]  # words of the user, shown on pages
CalendarDate = Annotated[str, BeforeValidator(iso_date)]  # 2026-01-31; a date of TOML, too


_MOST_NUMBERS = 2**31


@dataclass(frozen=True)
class Numbers:
    """Marks a field that is a float64 array of ``ndim`` axes, the last of size ``last`` if that is given.

    In TOML and JSON it is a table ``{shape = [...], float64 = "..."}``, the bytes of the numbers (little-endian, row by
    row) in base64; nested lists are read as well.
    """

    ndim: int
    last: int | None = None

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate by :meth:`checked`, write by :func:`packed`."""
        text = core_schema.plain_serializer_function_ser_schema(packed)
        return core_schema.no_info_plain_validator_function(self.checked, serialization=text)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """The table, or nested lists of as many axes."""
        lists: JsonSchemaValue = {"type": "number"}
        for _ in range(self.ndim):
            lists = {"type": "array", "items": lists}
        shape = {"type": "array", "items": {"type": "integer"}}
        table = {
            "type": "object",
            "properties": {"shape": shape, "float64": {"type": "string"}},
            "required": ["shape", "float64"],
            "additionalProperties": False,
        }
        return {"anyOf": [lists, table]}

    def checked(self, value: Any) -> np.ndarray:
        """Convert ``value`` to a new, read-only float64 array. Raises :class:`ValueError` for a wrong shape or type."""
        array = numbers_of(value)
        if array.ndim != self.ndim or array.size == 0 or (self.last is not None and array.shape[-1] != self.last):
            wanted = ", ".join([*("n" * (self.ndim - 1)), str(self.last or "n")])
            raise ValueError(f"shape {array.shape}, must be ({wanted}), not empty")
        return read_only(array)


def numbers_of(value: Any) -> np.ndarray:
    """Convert an array, nested lists, or what :func:`packed` makes to a new float64 array of any shape.

    Raises :class:`ValueError` for anything else.
    """
    return real_numbers(value, _unpacked if isinstance(value, Mapping) else np.array)


def packed(array: np.ndarray) -> dict[str, Any]:
    """The table that :class:`Numbers` reads."""
    little = np.ascontiguousarray(array, dtype="<f8")
    return {"shape": list(array.shape), "float64": base64.b64encode(little.tobytes()).decode("ascii")}


def _unpacked(table: Mapping[str, Any]) -> np.ndarray:
    if set(table) != {"shape", "float64"}:
        raise ValueError("must be a table of shape and float64")
    shape = tuple(int(size) for size in table["shape"])
    if any(size < 0 for size in shape) or np.prod(shape, dtype=float) > _MOST_NUMBERS:
        raise ValueError(f"shape = {shape}")
    numbers = np.frombuffer(base64.b64decode(table["float64"], validate=True), dtype="<f8")
    return numbers.reshape(shape).astype(np.float64)
