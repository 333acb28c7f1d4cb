"""Validation shared by records and specs: pydantic errors as one line, and equality bit for bit."""

from collections.abc import Callable, Collection, Mapping
from functools import cache, reduce
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError, create_model
from pydantic_core import CoreSchema

from lensforge.errors import InputError, shortened
from lensforge.results.registered_kinds import models_in

_MOST_OF_MESSAGE = 600  # of what is wrong with it, which may name what is allowed
_MOST_BITS = 256  # of a whole number in a message; Python refuses to print more than 4300 digits

_Model = TypeVar("_Model", bound=BaseModel)


def with_changes(model: _Model, fields: Mapping[str, Any]) -> _Model:
    """A copy of ``model`` with other values in some ``fields``, each validated by itself.

    pydantic's own way to validate one field refuses a frozen model. Raises :class:`ValidationError` for a value that a
    field does not take, and :class:`TypeError` for an unknown field.
    """
    valid = {name: _validated(type(model), name, value) for name, value in fields.items()}
    return model.model_copy(update=valid)


def _validated(kind: type[BaseModel], name: str, value: object) -> object:
    field = kind.model_fields.get(name)
    if field is None:
        raise TypeError(f"{kind.__name__} has no field {name}")
    if isinstance(value, models_in(field.annotation)):  # they are valid; to build what says so takes 50 ms for a lens
        return value
    return getattr(_alone(kind, name).model_validate({name: value}), name)


@cache
def _alone(kind: type[BaseModel], name: str) -> type[BaseModel]:
    field = kind.model_fields[name]
    config = ConfigDict(**{**kind.model_config, "frozen": False})
    definition: Any = (field.annotation, field)
    return create_model(kind.__name__, __base__=_base_of(kind, config), **{name: definition})


def _base_of(kind: type[BaseModel], config: ConfigDict) -> type[BaseModel]:
    """A model without fields that is validated as ``kind`` is."""
    finished: Callable[[CoreSchema], CoreSchema] = getattr(kind, "finished_schema", _unchanged)

    class Base(BaseModel):
        model_config = config

        @classmethod
        def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
            return finished(handler(source))

    return Base


def _unchanged(schema: CoreSchema) -> CoreSchema:
    return schema


def input_error(error: ValidationError, origin: str, *, remedy: str = "", unions: Collection[str] = ()) -> InputError:
    """One line on the first invalid field in ``origin``: its value, what is allowed, and ``remedy``.

    ``unions``: fields that hold one of several records by ``kind``; pydantic adds the kind to the path of a field.
    """
    errors = error.errors(include_url=False)
    causes = [error for error in errors if error["type"] != "too_short"] or errors  # a list whose only entry is wrong
    first = causes[0]
    location = first["loc"]
    before = zip((None, None, *location), (None, *location), location, strict=False)
    field = ".".join(str(part) for two, part_before, part in before if not _is_kind(two, part_before, part, unions))
    field = shortened(field)
    message = shortened(" ".join(plain(first["msg"]).split()), _MOST_OF_MESSAGE)
    more = f" (and {len(causes) - 1} more)" if len(causes) > 1 else ""
    parts = [
        part for part in (origin, f"{field}{given_value(first['input'])}" if field else "", f"{message}{more}") if part
    ]
    return InputError(" ".join((": ".join(parts) + (f"; {remedy}" if remedy else "")).split()))


def _is_kind(two_before: object, before: object, part: object, unions: Collection[str]) -> bool:
    """True for the kind of a record that pydantic adds to the path of a field, after the field or its number."""
    return isinstance(part, str) and (before in unions or (isinstance(before, int) and two_before in unions))


def given_value(value: object) -> str:
    """`` = value``, or the type of a list; empty for tables and arrays, whose message is sufficient."""
    if isinstance(value, Mapping | BaseModel | np.ndarray):
        return ""
    if isinstance(value, int) and value.bit_length() > _MOST_BITS:
        return f" = a whole number of {value.bit_length()} bits"
    simple = value is None or isinstance(value, str | int | float | Path)
    return f" = {shortened(repr(value) if simple else type(value).__name__)}"


_PLAIN = (
    ("Input should be", "must be"),
    ("greater than or equal to", "at least"),
    ("less than or equal to", "at most"),
    ("greater than", "above"),
    ("less than", "below"),
    (", unable to parse string as a number", ""),
    (", unable to parse string as an integer", ""),
    ("a valid number", "a number"),
    ("a valid integer", "a whole number"),
    ("a valid string", "text"),
    ("Input is not a valid path for <class 'pathlib.Path'>", "must be the name of a file, in quotes"),
    *(
        (f"String should match pattern '{pattern}'", f"must be {rule}")
        for pattern, rule in (
            (r"^[A-Za-z0-9_-]{1,64}$", "up to 64 letters, digits, _ and -"),
            (r"^[A-Za-z0-9_-]{1,32}$", "up to 32 letters, digits, _ and -"),
            (r"^[a-z][a-z0-9_]{0,15}$", "a small letter and up to 15 more, digits and _"),
            (r"^\w[\w.-]{0,39}$", "a letter or digit and up to 39 more, _ . and -"),
        )
    ),
)


def plain(message: str) -> str:
    """A message of pydantic in the terms of lensforge: "must be at least 0"."""
    text = message.removeprefix("Value error, ")
    return text if text != message else reduce(lambda text, pair: text.replace(*pair), _PLAIN, message)


def its_type(value: object) -> str:
    """The type of ``value`` with its article: ``a str``, ``an int``."""
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"


def same(first: Any, second: Any) -> bool:
    """True if two values are equal, arrays bit for bit; NaN equals NaN in an array."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        return (
            isinstance(first, np.ndarray)
            and isinstance(second, np.ndarray)
            and first.dtype == second.dtype
            and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
        )
    if isinstance(first, tuple) and isinstance(second, tuple):
        return len(first) == len(second) and all(map(same, first, second))
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return list(first) == list(second) and all(same(first[key], second[key]) for key in first)
    return bool(first == second)
