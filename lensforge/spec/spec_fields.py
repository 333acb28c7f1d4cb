"""Fields of sections and records: their words, types, units and ranges, as ``help``, pages and messages show them.

Words stand below a field, or in the docstring of its class as "``name``: words." pydantic can read the former
itself (``use_attribute_docstrings``), but reads all of them as the classes are made: a second of every start. Here they
are read when a page, a schema or a message asks for them.
"""

import ast
import inspect
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from itertools import pairwise
from textwrap import fill
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel

from lensforge.results import Record
from lensforge.results.arguments import ShownType
from lensforge.results.notebook_html import Shown
from lensforge.results.numerals import unit_in
from lensforge.results.registered_kinds import kind_of, models_in
from lensforge.spec.derived_values import WHY


def words_of(section: type[BaseModel], name: str) -> str:
    """Words and unit of a field: ``Side of the square; 0 for a point source. [mm]``.

    A length that has a field in mm and one in degrees has its words below the first.
    """
    below = _words(section) if name in section.model_fields else {}
    twin = below.get(f"{name.removesuffix('_deg')}_mm", "").replace("on a surface", "in the far field")
    words = below.get(name, "") or twin
    if name == "kind" and not words:
        first_line = summary_of(section).split("\n\n")[0].replace("\n", " ")
        words = f"Kind: {first_line}"
    unit = unit_in(name)
    return f"{words} [{unit}]" if unit and words else words


def summary_of(section: type[BaseModel]) -> str:
    """Docstring of a section as one paragraph after another."""
    return inspect.cleandoc(vars(section)["__doc__"] or "").replace("``", "`")


def default_of(section: type[BaseModel], name: str) -> str:
    """Words on a field that is left out: its default, or from what its value follows; "" for neither."""
    field = section.model_fields[name]
    if field.default_factory is not None:
        return f"Default {getattr(field.default_factory, '__name__', '')}()."
    if field.default is None:
        why = "; ".join(words for key, words in WHY.items() if key.rpartition(".")[2] == name)
        return f"Left out, derived: {why}." if why else ""
    made = f"{type(field.default).__name__}()" if isinstance(field.default, BaseModel) else repr(field.default)
    return "" if field.is_required() else f"Default {made}."


def arguments_of(section: type[BaseModel]) -> list[str]:
    """Names of a section's fields, the needed ones first, without the kind that the class itself says."""
    fields = section.model_fields
    names = [name for name in fields if name != "kind" or kind_of(section) is None]
    return sorted(names, key=lambda name: not fields[name].is_required())


def help_of(cls: type[Any]) -> str:
    """Docstring of a class, and its fields: of a section the arguments, of any other what it holds."""
    fields = cls.model_fields if issubclass(cls, BaseModel) else {}
    if fields and not issubclass(cls, Record):
        return "\n".join([*_without_entries(cls), "Args:", *(_argument(cls, name) for name in arguments_of(cls))])
    types = {name: field.annotation for name, field in fields.items()} or get_type_hints(cls, include_extras=True)
    said = _entries(cls)
    units = {name: unit_in(name) for name, each in types.items() if short_type(each) != "bool"}
    own = (
        _entry(name, (short_type(each), units.get(name, "")), said.get(name, ""), _has(each))
        for name, each in types.items()
    )
    return "\n".join([*_without_entries(cls), "Fields:", *own])


Shown.help_of = staticmethod(help_of)


def _argument(section: type[BaseModel], name: str) -> str:
    field = section.model_fields[name]
    unit = unit_in(name)
    words = words_of(section, name).removesuffix(f" [{unit}]") or _entries(section).get(name, "")
    needed = "needed" if field.is_required() else ""
    reach = range_words(_bounds(field.annotation, field.metadata))
    reach = re.sub(r"e\+?(-?)0*", r"e\1", re.sub(r"\d{9,}", lambda large: f"{int(large[0]):.3g}", reach))
    kind = (short_type(field.annotation), unit, reach, needed)
    return _entry(name, kind, words, _has(field.annotation), default_of(section, name))


def _has(annotation: Any) -> str:
    """The fields of a class that no script names, and that a page shows with the field that holds it."""
    private = [each for each in models_in(annotation) if each.__module__ != "lensforge"]
    return f"Has {', '.join(private[0].model_fields)}." if len(private) == 1 else ""


def short_type(annotation: Any) -> str:
    """A type in words: "float", "Metric or None", "tuple of Metric"."""
    origin = get_origin(annotation)
    inner = get_args(annotation)
    if annotation is type(None):
        return "None"
    if origin is Annotated:
        return short_type(inner[0])
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(short_type(each) for each in inner))
    if origin is Literal:
        return " or ".join(repr(each) for each in inner)
    if origin in (tuple, list, Mapping, dict):
        kinds = dict.fromkeys(short_type(each) for each in inner if each is not Ellipsis)
        return f"{origin.__name__.lower()} of {(' and ' if origin in (tuple, list) else ' to ').join(kinds)}"
    if hasattr(annotation, "dim_str"):
        return f"array [{annotation.dim_str.strip().replace(' ', ', ')}]"
    if isinstance(annotation, str):  # of a class of its own module
        return annotation
    named = models_in(annotation) or (annotation,)  # of a base all of its kinds
    return " or ".join(str(getattr(each, "__name__", each)).split(".")[-1] for each in named)


def range_words(schema: Mapping[str, Any]) -> str:
    """Numbers that a JSON schema allows: ``0 to 4``, ``above 0``, ``at least 1``; "" for any."""
    low, high = (schema.get(name) for name in ("minimum", "maximum"))
    above, below = (schema.get(name) for name in ("exclusiveMinimum", "exclusiveMaximum"))
    start = f"above {above:g}" if above is not None else _short(low)
    end = f"below {below:g}" if below is not None else _short(high)
    return f"{start} to {end}" if start and end else f"at least {start}" if low is not None else start or end


def _short(value: float | None) -> str:
    return "" if value is None else str(value) if isinstance(value, int) else f"{value:g}"


_BOUNDS = {"ge": "minimum", "le": "maximum", "gt": "exclusiveMinimum", "lt": "exclusiveMaximum"}


def _bounds(annotation: Any, marks: Iterable[Any]) -> dict[str, float]:
    """Bounds of a number among the marks of its field, or of the first type in it that has some, as JSON says them."""
    marks = [part for mark in marks for part in (mark, *getattr(mark, "metadata", ()))]
    found = {name: getattr(mark, key) for mark in marks for key, name in _BOUNDS.items() if hasattr(mark, key)}
    inner = get_args(annotation)
    within = [(inner[0], inner[1:])] if get_origin(annotation) is Annotated else [(each, ()) for each in inner]
    return found or next(filter(None, (_bounds(each, others) for each, others in within)), {})


def _entry(name: str, kind: Iterable[str], *words: str) -> str:
    """The line of a field: name, type, unit and range, and words; those of a docstring begin with a capital."""
    text = " ".join(filter(None, words))
    line = f"{name} ({', '.join(filter(None, kind))}): {text[:1].upper()}{text[1:]}"
    return fill(line, 110, initial_indent=" " * 4, subsequent_indent=" " * 8, break_on_hyphens=False)


_NAMED = re.compile(r"(?:^|(?<=[.;] ))((?:``\w+``(?:, | and )?)+): ")  # "``a``, ``b``: words"


def _paragraphs(cls: type[Any]) -> list[str]:
    return [" ".join(each.split()) for each in inspect.cleandoc(vars(cls)["__doc__"] or "").split("\n\n")]


def _entries(cls: type[Any]) -> dict[str, str]:
    """Words on fields in the docstrings of a class and of those that it extends."""
    entries: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        for paragraph in _paragraphs(base) if base.__module__.startswith("lensforge") else ():
            _, *parts = _NAMED.split(paragraph)
            for names, words in zip(parts[::2], parts[1::2], strict=True):
                sentence = words.strip().rstrip(".;").replace("``", "`") + "."
                entries |= dict.fromkeys(re.findall(r"\w+", names), sentence)
    return entries


def _without_entries(cls: type[Any]) -> Iterator[str]:
    """The other sentences of a docstring, each paragraph and an empty line."""
    for paragraph in _paragraphs(cls):
        if words := _NAMED.split(paragraph)[0].rstrip(" ;").replace("``", "`"):
            yield from (fill(words, 110), "")


def signature_of(section: type[BaseModel]) -> inspect.Signature:
    """Fields of a section as arguments by name, without the bounds of their types."""
    first = getattr(section, "positional", None)
    types = get_type_hints(section)
    arguments = []
    for name in arguments_of(section):
        field = section.model_fields[name]
        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD if name == first else inspect.Parameter.KEYWORD_ONLY
        made = ... if field.default_factory is not None else field.default
        default = inspect.Parameter.empty if field.is_required() else made
        arguments.append(inspect.Parameter(name, kind, default=default, annotation=ShownType.of(types[name])))
    return inspect.Signature(sorted(arguments, key=lambda each: each.kind))


def sections_in(annotation: Any) -> tuple[type[BaseModel], ...]:
    """The sections that a field may hold, one or several."""
    return tuple(each for each in models_in(annotation) if not issubclass(each, Record))


def all_sections(root: type[BaseModel]) -> tuple[type[BaseModel], ...]:
    """``root`` and every section within it, however deep."""
    sections = [root]
    for section in sections:  # grows
        for field in section.model_fields.values():
            sections += [each for each in sections_in(field.annotation) if each not in sections]
    return tuple(sections)


@cache
def _words(section: type[BaseModel]) -> dict[str, str]:
    """Words below the fields of a class and of those that it extends."""
    words: dict[str, str] = {}
    for base in reversed(section.__mro__):
        if issubclass(base, BaseModel) and base.model_fields:
            words |= _module_words(vars(base).get("_written_in", base.__module__)).get(base.__name__, {})
    return words


@cache
def _module_words(module: str) -> dict[str, dict[str, str]]:
    """Texts that stand directly below a field, by class and field; none of classes typed into a console."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError, KeyError):
        return {}
    classes = (node for node in tree.body if isinstance(node, ast.ClassDef))
    return {each.name: dict(_below_fields(each.body)) for each in classes}


def _below_fields(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    for field, text in pairwise(body):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr):
            words = text.value.value if isinstance(text.value, ast.Constant) else ""
            yield field.target.id, " ".join(str(words).split()).replace("``", "`")
