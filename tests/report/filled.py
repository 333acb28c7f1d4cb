"""Records whose numbers do not matter: a builder states the fields that a test reads, and the others are filled."""

from types import UnionType
from typing import Annotated, Literal, Union, get_args, get_origin
from zlib import crc32

from lensforge.results import Metric


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
        return () if inner[-1] is Ellipsis else tuple(_value(each, f"{name}{k}") for k, each in enumerate(inner))
    return filled(annotation)
