"""Fields of the sections of a spec: their words, which stand below each field, their units, and the sections in them.

pydantic can read such words itself (``use_attribute_docstrings``), but reads all of them as the classes are made: a
second of every start. Here they are read when a page, a schema or a message asks for them.
"""

import ast
import inspect
import sys
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any, get_type_hints

from pydantic import BaseModel

from lensforge.results import Record
from lensforge.results.arguments import ShownType
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
    """Value of a field that is left out: ``needed``, ``derived: ...``, a value, or "" for nothing."""
    field = section.model_fields[name]
    if field.is_required():
        return "needed"
    if field.default_factory is not None:
        return f"default: {getattr(field.default_factory, '__name__', '')}()"
    if field.default is None:
        why = "; ".join(words for key, words in WHY.items() if key.rpartition(".")[2] == name)
        return f"derived: {why}" if why else ""
    return f"default: {field.default!r}"


def arguments_of(section: type[BaseModel]) -> list[str]:
    """Names of a section's fields, the needed ones first, without the kind that the class itself says."""
    fields = section.model_fields
    names = [name for name in fields if name != "kind" or kind_of(section) is None]
    return sorted(names, key=lambda name: not fields[name].is_required())


def help_of(section: type[BaseModel]) -> str:
    """Summary of a section and all of its arguments, with words, unit and default, as ``help`` shows them."""
    lines = [summary_of(section), "", "Arguments, by name:"]
    for name in arguments_of(section):
        default = default_of(section, name)
        words = words_of(section, name)
        lines.append(f"    {name}: {words} ({default})" if default else f"    {name}: {words}")
    return "\n".join(lines)


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
            words |= _module_words(base.__module__).get(base.__name__, {})
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
