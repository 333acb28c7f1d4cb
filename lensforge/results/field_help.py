"""Help of a class: its docstring, and a line for each field with type, unit and description.

A class describes a field in its docstring, as "``name``: description.".
"""

import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
from textwrap import fill
from types import UnionType
from typing import Annotated, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel

from lensforge.results.numerals import unit_in
from lensforge.results.registered_kinds import models_in

_NAMED = re.compile(r"(?:^|(?<=[.;] ))((?:``\w+``(?:, | and )?)+): ")  # "``a``, ``b``: description"


def class_help(cls: type) -> str:
    """Docstring of a record or a dataclass, and its fields."""
    model_fields = cls.model_fields if issubclass(cls, BaseModel) else {}
    types: dict[str, object] = {name: field.annotation for name, field in model_fields.items()}
    types = types or get_type_hints(cls, include_extras=True)
    descriptions = described_fields(cls)
    lines = []
    for name, annotation in types.items():
        type_name = short_type(annotation)
        unit = "" if type_name == "bool" else unit_in(name)
        lines.append(field_line(name, (type_name, unit), descriptions.get(name, ""), private_fields(annotation)))
    return "\n".join([*plain_paragraphs(cls), "Fields:", *lines])


def field_line(name: str, marks: Iterable[str], *sentences: str) -> str:
    """The line of a field: name, in brackets its type, unit and range, and sentences that begin with a capital."""
    text = " ".join(filter(None, sentences))
    line = f"{name} ({', '.join(filter(None, marks))}): {text[:1].upper()}{text[1:]}"
    return fill(line, 110, initial_indent=" " * 4, subsequent_indent=" " * 8, break_on_hyphens=False)


def private_fields(annotation: object) -> str:
    """Fields of a class that scripts do not name: a page shows them with the field that holds it."""
    private = [model for model in models_in(annotation) if model.__module__ != "lensforge"]
    return f"Has {', '.join(private[0].model_fields)}." if len(private) == 1 else ""


def short_type(annotation: object) -> str:
    """A type in a reader's terms: "float", "Metric or None", "tuple of Metric"."""
    origin = get_origin(annotation)
    inner = get_args(annotation)
    if annotation is type(None):
        return "None"
    if origin is Annotated:
        return short_type(inner[0])
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(short_type(part) for part in inner))
    if origin is Literal:
        return " or ".join(repr(choice) for choice in inner)
    if origin in (tuple, list, Mapping, dict):
        joint = " and " if origin in (tuple, list) else " to "
        kinds = dict.fromkeys(short_type(part) for part in inner if part is not Ellipsis)
        return f"{origin.__name__.lower()} of {joint.join(kinds)}"
    axes: str | None = getattr(annotation, "dim_str", None)  # of jaxtyping
    if axes is not None:
        return f"array [{axes.strip().replace(' ', ', ')}]"
    if isinstance(annotation, str):  # a class of the same module
        return annotation
    models = models_in(annotation) or (annotation,)  # of a base all of its kinds
    return " or ".join(str(getattr(model, "__name__", model)).split(".")[-1] for model in models)


def described_fields(cls: type) -> dict[str, str]:
    """Descriptions of fields: their own, and those in the docstrings of a class and of the classes that it extends."""
    fields = getattr(cls, "model_fields", {})
    descriptions: dict[str, str] = {name: field.description for name, field in fields.items() if field.description}
    for base in reversed(cls.__mro__):
        for paragraph in _paragraphs(base) if base.__module__.startswith("lensforge") else ():
            _, *parts = _NAMED.split(paragraph)
            for names, text in zip(parts[::2], parts[1::2], strict=True):
                sentence = text.strip().rstrip(".;").replace("``", "`") + "."
                descriptions |= dict.fromkeys(re.findall(r"\w+", names), sentence)
    return descriptions


def plain_paragraphs(cls: type) -> Iterator[str]:
    """The paragraphs of a docstring without descriptions of fields, each followed by an empty line."""
    for paragraph in _paragraphs(cls):
        if text := _NAMED.split(paragraph)[0].rstrip(" ;").replace("``", "`"):
            yield from (fill(text, 110), "")


def _paragraphs(cls: type) -> list[str]:
    docstring: str = vars(cls)["__doc__"] or ""  # the class's own: the attribute of a record is this help
    return [" ".join(paragraph.split()) for paragraph in inspect.cleandoc(docstring).split("\n\n")]
