"""Fields of the library's pydantic classes for Sphinx: a name, a short type and a description for each."""

import inspect
import types
from dataclasses import is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel
from pydantic_core import PydanticUndefined
from sphinx.util.inspect import stringify_signature

from lensforge.spec.spec_fields import arguments_of, default_of, words_of
from lensforge.spec.spec_section import Section

# Methods with which a stage writes and reads its records: not part of the library's contract.
_OF_THE_RECORDS = {
    "again", "command", "contents", "made_from", "plain", "products", "read", "schema_name", "sha256", "stage",
    "stored_elsewhere", "unions", "write", "title", "stated_lm_per_w", "take", "find", "surfaces",
}  # fmt: skip


def short_type(annotation: Any) -> str:
    """A type in words: "float", "Metric or None", "tuple of Metric"."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if annotation is type(None):
        return "None"
    if origin is Annotated:
        return short_type(inner[0])
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(short_type(each) for each in inner))
    if origin is Literal:
        return " or ".join(repr(each) for each in inner)
    if origin in (tuple, list):
        kinds = dict.fromkeys(short_type(each) for each in inner if each is not Ellipsis)
        return f"{origin.__name__} of {' and '.join(kinds)}"
    if hasattr(annotation, "dim_str"):
        return f"array ({annotation.dim_str})"
    return str(getattr(annotation, "__name__", annotation)).split(".")[-1]


def _entry(name: str, words: str, kind: str) -> str:
    return " ".join(f":ivar {name}: {words} *({kind})*".split())


def field_lines(model: type) -> list[str]:
    """Entries of reStructuredText for the fields of ``model``, where it is of pydantic."""
    if issubclass(model, Section):
        return [
            _entry(
                name, words_of(model, name), "; ".join(filter(None, (_type_of(model, name), default_of(model, name))))
            )
            for name in arguments_of(model)
        ]
    lines = []
    for name, field in getattr(model, "model_fields", {}).items():
        if get_origin(field.annotation) is Literal and len(get_args(field.annotation)) == 1:
            continue  # the kind, which the class itself says
        default = "" if field.default in (PydanticUndefined, None, ()) else f", by default {field.default!r}"
        lines.append(_entry(name, field.description or "", short_type(field.annotation) + default))
    return lines


def _type_of(section: type[Section], name: str) -> str:
    return short_type(section.model_fields[name].annotation)


def property_lines(model: type) -> list[str]:
    """The same for its public properties, each with its docstring's first paragraph."""
    lines = []
    for name in dict.fromkeys(name for base in model.__mro__ for name in vars(base)):
        found = next(vars(base)[name] for base in model.__mro__ if name in vars(base))
        getter = getattr(found, "fget", None) or getattr(found, "func", None)
        if getter is None or name.startswith("_") or name in _OF_THE_RECORDS or hasattr(BaseModel, name):
            continue
        words = (getter.__doc__ or "").split("\n\n")[0]
        lines.append(_entry(name, words, short_type(getter.__annotations__.get("return", "read only"))))
    return lines


def add_fields(_app: Any, kind: str, _name: str, documented: Any, _options: Any, lines: list[str]) -> None:
    """Append fields and properties of a class to its docstring."""
    if kind == "class" and isinstance(documented, type):
        if issubclass(documented, Section):  # whose own words end with its arguments, as plain text
            lines[:] = inspect.cleandoc(vars(documented)["__doc__"]).splitlines()
        lines += ["", *field_lines(documented), *property_lines(documented), ""]


def short_signature(
    _app: Any, kind: str, _name: str, documented: Any, _options: Any, arguments: str | None, result: str | None
) -> tuple[str | None, str | None] | None:
    """No signature for models, whose fields stand below; in others only the type of an annotated argument."""
    if kind == "class" and isinstance(documented, type) and issubclass(documented, BaseModel):
        return "", ""
    if (isinstance(documented, type) and is_dataclass(documented)) or (arguments and "FieldInfo(" in arguments):
        return _plain_signature(documented), result
    return arguments, result


def _plain_signature(documented: Any) -> str:
    """Signature of a dataclass or a function whose types have no ranges: those stand in its docstring."""
    plain, signature = get_type_hints(documented), inspect.signature(documented)
    fields = [
        each.replace(annotation=plain.get(name, each.empty))
        for name, each in signature.parameters.items()
        if name != "self"
    ]
    return stringify_signature(signature.replace(parameters=fields, return_annotation=signature.empty))


def skip_member(_app: Any, _kind: str, name: str, member: Any, _skip: bool, _options: Any) -> bool | None:
    """True for all but methods of our own: fields and properties are in the list of the class."""
    foreign = name.startswith("_") or name in _OF_THE_RECORDS or hasattr(BaseModel, name)
    return True if foreign or not isinstance(member, types.FunctionType | types.MethodType) else None


def show_types_shortly(app: Any) -> None:
    """Connect all of this with Sphinx."""
    app.connect("autodoc-process-docstring", add_fields)
    app.connect("autodoc-process-signature", short_signature)
    app.connect("autodoc-skip-member", skip_member)
