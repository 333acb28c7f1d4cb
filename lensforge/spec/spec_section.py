"""The base of every section of a spec, the types of its values, and wrong fields as lines.

Each wrong field has one complete line: unknown names first, with the name that was meant. Arrays are given as arrays or
nested lists, and written as text without loss.
"""

import base64
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from difflib import get_close_matches
from inspect import Signature
from math import ceil, floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_args, get_origin

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
from pydantic_core import CoreSchema, ErrorDetails, core_schema

from lensforge.errors import InputError, WrongFields
from lensforge.results.numerals import unit_in
from lensforge.results.record import read_only, real_numbers
from lensforge.results.validation import given_words, same, shortened
from lensforge.spec.renamed import MOVED, with_new_names
from lensforge.spec.spec_fields import all_sections, help_of, kind_of, sections_in, signature_of, words_of
from lensforge.spec.spec_files import full_path

_MOST_LINES = 20  # of a message; a list of a thousand wrong numbers has one cause
_MOST_CHARACTERS = 480  # of what is wrong in a line
_LIKENESS = 0.77  # of two names: "diametre_mm" and "diameter_mm" have 0.9, "cone" and "none" 0.75
_NO_HINT = "known here: "
_KINDS = ("union_tag_invalid", "union_tag_not_found")


@dataclass(frozen=True)
class _FieldPlace:
    """Field of an error: its dotted name as the user wrote it, the sections that hold it, and its name in them."""

    name: str
    holders: tuple[type[BaseModel], ...]
    last: str

    @property
    def known(self) -> list[str]:
        """Names of the fields beside it."""
        return list(dict.fromkeys(name for each in self.holders for name in each.model_fields))


def spec_error(error: ValidationError, origin: str, root: type[BaseModel]) -> WrongFields:
    """All wrong fields of what ``origin`` names, a table that ``root`` describes."""
    errors = error.errors(include_url=False)
    entries = [each for each in errors if each["type"] != "too_short"] or errors  # a list whose only entry is wrong
    unknown = [each for each in entries if each["type"] == "extra_forbidden"]
    meant, lines = set[str](), list[str]()
    for entry in unknown:
        place = _place(entry["loc"], root)
        hint, instead = _hint(place, root)
        meant.add(instead)
        value = None if hint.startswith(_NO_HINT) else entry["input"]  # of another file's field: not for a message
        lines.append(_line(origin, place.name, value, f"unknown; {hint}"))
    for place, group in _by_place([entry for entry in entries if entry not in unknown], root):
        if not (group[0]["type"] == "missing" and place.name in meant):
            words = " or ".join(dict.fromkeys(_problem(each, place) for each in group))
            name = f"{place.name}.kind".lstrip(".") if group[0]["type"] == _KINDS[0] else place.name
            value = group[0]["ctx"]["tag"] if group[0]["type"] == _KINDS[0] else group[0]["input"]
            lines.append(_line(origin, name, None if group[0]["type"] == "missing" else value, words))
    more = [f"{origin}: {len(lines) - _MOST_LINES} more wrong fields"] if len(lines) > _MOST_LINES else []
    return WrongFields("\n".join([*lines[:_MOST_LINES], *more]))


def _line(origin: str, name: str, value: object, words: str) -> str:
    given = "" if value is None else given_words(value)
    parts = (origin, f"{shortened(name)}{given}" if name else "", shortened(" ".join(words.split()), _MOST_CHARACTERS))
    return " ".join(": ".join(part for part in parts if part).split())


def _by_place(entries: Iterable[ErrorDetails], root: type[BaseModel]) -> list[tuple[_FieldPlace, list[ErrorDetails]]]:
    """The errors of each field together: a field that takes a number or a list has one for either."""
    groups: dict[str, tuple[_FieldPlace, list[ErrorDetails]]] = {}
    for entry in entries:
        place = _place(entry["loc"], root)
        groups.setdefault(place.name, (place, []))[1].append(entry)
    return list(groups.values())


def _problem(error: ErrorDetails, place: _FieldPlace) -> str:
    """Words for what is wrong with a known field, with the value that was meant."""
    context = error.get("ctx", {})
    if error["type"] == "missing":
        words = next((words_of(each, place.last) for each in place.holders if place.last in each.model_fields), "")
        return f"missing: {words[0].lower()}{words[1:]}" if words else "missing"
    if error["type"] in _KINDS:
        kinds = re.findall(r"'([^']*)'", str(context.get("expected_tags", ""))) or _kinds_of(place)
        near = _nearest(str(context.get("tag", "")), kinds)
        either = f"must be one of {', '.join(kinds)}" + (f"; did you mean {near}?" if near else "")
        return either if error["type"] == _KINDS[0] else f"kind is missing; it {either}"
    words = error["msg"].removeprefix("Value error, ")
    given = error["input"] if isinstance(error["input"], str) else ""
    near = _nearest(given, re.findall(r"'([^']*)'", str(context.get("expected", ""))))
    return f"{words}; did you mean {near}?" if near and error["type"] == "literal_error" else words


def _kinds_of(place: _FieldPlace) -> list[str]:
    fields = [each.model_fields[place.last] for each in place.holders if place.last in each.model_fields]
    return [kind for field in fields for each in sections_in(field.annotation) if (kind := kind_of(each))]


def _hint(place: _FieldPlace, root: type[BaseModel]) -> tuple[str, str]:
    """Advice on an unknown name, and the whole name that was meant, "" where none is near."""
    before = place.name.rpartition(".")[0]
    for old, new in MOVED.items():
        if old.endswith(f".{place.last}"):
            return f"it is {new} now", new
    near = _nearest(place.last, place.known)
    if near:
        return f"did you mean {near}?", f"{before}.{near}".lstrip(".")
    for name, field in root.model_fields.items():
        having = [each for each in sections_in(field.annotation) if place.last in each.model_fields]
        if having and name == before.partition(".")[0]:
            return f"it goes with kind = {', '.join(str(kind_of(each)) for each in having)}", ""
        if having:
            return f"it belongs to [{name}]", ""
    names = [name for each in all_sections(root) for name in each.model_fields]
    elsewhere = _nearest(place.last, names)
    known = f"{_NO_HINT}{', '.join(place.known)}"
    return (f"{known}; elsewhere there is {elsewhere}" if elsewhere and len(place.last) > 2 else known), ""


def _nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name that was meant: the same with its unit, or one that differs by a few letters."""
    with_unit = [each for each in known if unit_in(each) and each == f"{name}_{each.removeprefix(f'{name}_')}"]
    return next(iter(with_unit or get_close_matches(name, known, n=1, cutoff=_LIKENESS)), None)


def _place(location: tuple[int | str, ...], root: type[BaseModel]) -> _FieldPlace:
    """The field at ``location``, without what pydantic adds: the kind of a section, and the branch of a choice."""
    holders: tuple[type[BaseModel], ...] = (root,)
    inside, parts = holders, list[str]()
    annotation: Any = None
    for number, part in enumerate(location):
        tagged = tuple(each for each in inside if kind_of(each) == part)
        fields = [each.model_fields[part] for each in inside if part in each.model_fields]
        if isinstance(part, int):
            parts.append(str(part))
        elif len(inside) > 1 and tagged:
            inside = tagged
        elif fields:
            holders, annotation = inside, fields[0].annotation
            inside = tuple(dict.fromkeys(each for field in fields for each in sections_in(field.annotation)))
            parts.append(part)
        elif tagged:
            inside = tagged
        elif not _is_branch(part) and ((inside and number == len(location) - 1) or _holds_names(annotation)):
            holders = inside
            parts.append(part)
    return _FieldPlace(".".join(parts), holders, next((each for each in reversed(parts) if not each.isdigit()), ""))


def _is_branch(part: str) -> bool:
    """True for what pydantic calls a branch of a choice: ``constrained-float``, ``tuple[...]``, ``[key]``."""
    return bool(re.fullmatch(r"[a-z]+(-[a-z]+)+|[a-z-]*\[.*\]|float|int|str|bool|list|dict", part))


def _holds_names(annotation: Any) -> bool:
    return get_origin(annotation) is dict or any(get_origin(each) is dict for each in get_args(annotation))


class _Checked(type(BaseModel)):  # type: ignore[misc]  # pydantic's own metaclass, which has no public name
    """Turns the validation error of a section that a script constructs into the lines of the command line.

    A class that names its field ``positional`` takes that one without its name. Words and signature of a class are
    made when they are asked for: reading all of them takes a second.
    """

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
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
    def __signature__(cls) -> Signature:
        return signature_of(cls)

    @__signature__.setter
    def __signature__(cls, value: object) -> None:
        """Leave out pydantic's own, which a class has only once it has been used."""

    @property
    def __doc__(cls) -> str:  # type: ignore[override]
        return help_of(cls)


if TYPE_CHECKING:  # a type checker knows no metaclass without a name, and of this one it needs nothing
    _Model = BaseModel
else:
    _Model = _Checked("_Model", (BaseModel,), {"__module__": __name__})


_Section = TypeVar("_Section", bound=BaseModel)


def check(method: Callable[[Any], None]) -> Any:
    """Make ``method`` a check of a whole section, once its fields are valid: it raises ``ValueError`` for its fault."""

    def checked(section: _Section) -> _Section:
        method(section)
        return section

    return model_validator(mode="after")(checked)


class Section(_Model):
    """Immutable; a field that is not known, or a number that is not finite, is refused: :class:`InputError`."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True, defer_build=True
    )

    @model_validator(mode="before")
    @classmethod
    def _old_names(cls, content: Any) -> Any:
        for base in cls.__mro__:
            content = with_new_names(base.__name__, content)
        return content

    @check
    def _kind_is_given(self) -> None:
        """Count the kind as given where it was left to the class: without it a file could not be read again."""
        if "kind" in type(self).model_fields:
            self.model_fields_set.add("kind")

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


def section_of(kind: type[_Section], content: object, origin: str, folder: Path | None = None) -> _Section:
    """A section of ``kind`` from a table; the files that it names count from ``folder``, else from the current one.

    ``origin`` names the table in :class:`InputError`, which has a line for each wrong field.
    """
    try:
        return kind.model_validate(content, context=folder)
    except ValidationError as error:
        raise spec_error(error, origin, kind) from None


def rounded_up(value: float, digits: int = 4) -> str:
    """``value`` > 0 to ``digits`` significant digits, rounded up: a least value in a message must itself be allowed."""
    unit = 10.0 ** (floor(log10(value)) + 1 - digits)
    return f"{ceil(value / unit * (1.0 - 1e-12)) * unit:.{digits}g}"


def _printable(words: str) -> str:
    if not words.isprintable():
        raise ValueError("holds a character that cannot be printed, such as a line break; leave it out")
    return words


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
    try:
        return None if value is None else iso_date(value)
    except ValueError as error:
        raise InputError(f"{name} = {str(value)[:60]!r}: {error}") from None


# From a nanometre to a kilometre, with room to spare: squares and ratios of lengths stay within floating point.
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9)]
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
