"""Records for tests: filled where numbers do not matter, and with no two numbers alike where each has one source."""

from dataclasses import replace
from itertools import count
from types import UnionType
from typing import Annotated, Literal, Union, get_args, get_origin
from zlib import crc32

from lensforge.results import Fact, Metric, Record
from lensforge.results.record import values_of


def filled(record, /, **given):
    """A record of class ``record`` with the fields ``given``; the others that it requires have numbers by their names.

    Shares and lengths lie between 0.05 and 0.1, counts between 1000 and 2000. What may be None is None, a list is
    empty, and a choice is its first word. Arrays must be given.
    """
    left = {name: info.annotation for name, info in record.model_fields.items() if info.is_required()}
    return record(**{name: _value(kind, name) for name, kind in left.items() if name not in given}, **given)


def _value(annotation, name):
    part = crc32(name.encode()) % 1000
    simple = {bool: True, int: 1000 + part, float: 0.05 + 5e-5 * part, str: name, bytes: name.encode()}
    if annotation in simple:
        return simple[annotation]
    if annotation is Metric:
        return Metric(value=0.05 + 5e-5 * part, standard_error=1e-3 + 1e-6 * part)
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _value(inner[0], name)
    if origin in (Union, UnionType):
        return None
    if origin is Literal:
        return inner[0]
    if origin is dict:
        return {}
    if origin is tuple:
        return () if inner[-1] is Ellipsis else tuple(_value(element, f"{name}{k}") for k, element in enumerate(inner))
    return filled(annotation)


# Numbers that others are counted by, and those that decide what a sentence says.
_KEPT = {"level", "parts", "pass_rate", "genus", "disagreements", "c_deg", "part", "scale", "file", "files"}


def told_apart(record):
    """``record`` with every number changed by a part of its own, down to 0.8 of it; zeros, maps and texts are kept."""
    return _changed(record, count(1))


def _changed(value, numbers):
    if isinstance(value, Record):
        fields = {name: item for name, item in values_of(value).items() if name not in _KEPT}
        return value.model_copy(update={name: _changed(item, numbers) for name, item in fields.items()})
    if isinstance(value, Fact):
        numbers_of = {name: _changed(getattr(value, name), numbers) for name in ("value", "limit", "tolerance")}
        return replace(value, **numbers_of).judged()
    if isinstance(value, dict):
        return {key: _changed(item, numbers) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(_changed(item, numbers) for item in value)
    if isinstance(value, bool) or not isinstance(value, int | float) or value == 0:
        return value
    part = 0.8 + 0.2 * (next(numbers) * 0.6180339887498949 % 1.0)  # the golden ratio: no two alike
    return max(1, round(value * part)) if isinstance(value, int) else value * part
