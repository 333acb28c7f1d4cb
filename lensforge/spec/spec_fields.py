"""Fields of sections: description, unit, range and default, as ``help``, pages and messages show them."""

import inspect
import re
from collections.abc import Iterable, Mapping
from typing import Annotated, get_args, get_origin, get_type_hints

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from lensforge.public import ShownType
from lensforge.results.field_help import described_fields, field_line, plain_paragraphs, private_fields, short_type
from lensforge.results.numerals import unit_in
from lensforge.results.record import Record
from lensforge.results.registered_kinds import kind_of, models_in
from lensforge.spec.derived_values import WHY


def field_description(section: type[BaseModel], name: str) -> str:
    """Description and unit of a field: ``Side of the square; 0 for a point source. [mm]``.

    A length that has a field in mm and one in degrees is described at the first.
    """
    twin = _declared(section, f"{name.removesuffix('_deg')}_mm").replace("on a surface", "in the far field")
    description = _declared(section, name) or twin
    if name == "kind" and not description:
        first_line = summary_of(section).split("\n\n")[0].replace("\n", " ")
        description = f"Kind: {first_line}"
    unit = unit_in(name)
    return f"{description} [{unit}]" if unit and description else description


def _declared(section: type[BaseModel], name: str) -> str:
    """Description at the field, or at that of the same name in a class that the section extends; "" if none has one."""
    for base in section.__mro__:
        field = base.model_fields.get(name) if issubclass(base, BaseModel) else None
        if field is not None and field.description:
            return field.description
    return ""


def summary_of(section: type[BaseModel]) -> str:
    """Docstring of a section as one paragraph after another."""
    return inspect.cleandoc(vars(section)["__doc__"] or "").replace("``", "`")


def default_of(section: type[BaseModel], name: str) -> str:
    """Sentence on a field that is left out: its default, or from what its value follows; "" for neither."""
    field = section.model_fields[name]
    if field.default_factory is not None:
        return f"Default {getattr(field.default_factory, '__name__', '')}()."
    if field.default is None:
        why = "; ".join(reason for key, reason in WHY.items() if key.rpartition(".")[2] == name)
        return f"Left out, derived: {why}." if why else ""
    default = f"{type(field.default).__name__}()" if isinstance(field.default, BaseModel) else repr(field.default)
    return "" if field.is_required() else f"Default {default}."


def arguments_of(section: type[BaseModel]) -> list[str]:
    """Names of a section's fields, the needed ones first, without the kind that the class itself says."""
    fields = section.model_fields
    names = [name for name in fields if name != "kind" or kind_of(section) is None]
    return sorted(names, key=lambda name: not fields[name].is_required())


def section_help(section: type[BaseModel]) -> str:
    """Docstring of a section, and its fields as arguments; of a base without fields the docstring alone."""
    lines = [_argument(section, name) for name in arguments_of(section)]
    return "\n".join([*plain_paragraphs(section), "Args:" if section.model_fields else "Fields:", *lines])


def _argument(section: type[BaseModel], name: str) -> str:
    field = section.model_fields[name]
    unit = unit_in(name)
    description = field_description(section, name).removesuffix(f" [{unit}]") or described_fields(section).get(name, "")
    marks = (short_type(field.annotation), unit, _short_range(field), "needed" if field.is_required() else "")
    return field_line(name, marks, description, private_fields(field.annotation), default_of(section, name))


def _short_range(field: FieldInfo) -> str:
    """Range of a number, large bounds by their powers of ten."""
    text = range_words(_bounds(field.annotation, field.metadata))
    text = re.sub(r"\d{9,}", lambda large: f"{int(large[0]):.3g}", text)
    return re.sub(r"e\+?(-?)0*", r"e\1", text)


def range_words(schema: Mapping[str, float]) -> str:
    """Numbers that a JSON schema allows: ``0 to 4``, ``above 0``, ``at least 1``; "" for any."""
    low = schema.get("minimum")
    high = schema.get("maximum")
    above = schema.get("exclusiveMinimum")
    below = schema.get("exclusiveMaximum")
    start = f"above {above:g}" if above is not None else _short(low)
    end = f"below {below:g}" if below is not None else _short(high)
    return f"{start} to {end}" if start and end else f"at least {start}" if low is not None else start or end


def _short(value: float | None) -> str:
    return "" if value is None else str(value) if isinstance(value, int) else f"{value:g}"


def _bounds(annotation: object, marks: Iterable[object]) -> dict[str, float]:
    """Bounds of a number among the marks of its field, or of the first type in it that has some, as JSON says them."""
    bounds = _bounds_in(marks)
    if bounds:
        return bounds
    inner = get_args(annotation)
    within = [(inner[0], inner[1:])] if get_origin(annotation) is Annotated else [(part, ()) for part in inner]
    return next(filter(None, (_bounds(part, part_marks) for part, part_marks in within)), {})


def _bounds_in(marks: Iterable[object]) -> dict[str, float]:
    bounds: dict[str, object] = {}
    for mark in marks:
        for part in (mark, *getattr(mark, "metadata", ())):
            match part:
                case Ge(ge=bound):
                    bounds["minimum"] = bound
                case Le(le=bound):
                    bounds["maximum"] = bound
                case Gt(gt=bound):
                    bounds["exclusiveMinimum"] = bound
                case Lt(lt=bound):
                    bounds["exclusiveMaximum"] = bound
    return {name: bound for name, bound in bounds.items() if isinstance(bound, int | float)}


def signature_of(section: type[BaseModel]) -> inspect.Signature:
    """Fields of a section as arguments by name, without the bounds of their types."""
    first = getattr(section, "positional", None)
    types = get_type_hints(section)
    arguments = []
    for name in arguments_of(section):
        field = section.model_fields[name]
        kind = inspect.Parameter.POSITIONAL_OR_KEYWORD if name == first else inspect.Parameter.KEYWORD_ONLY
        shown = ... if field.default_factory is not None else field.default
        default = inspect.Parameter.empty if field.is_required() else shown
        arguments.append(inspect.Parameter(name, kind, default=default, annotation=ShownType.of(types[name])))
    return inspect.Signature(sorted(arguments, key=lambda argument: argument.kind))


def sections_in(annotation: object) -> tuple[type[BaseModel], ...]:
    """The sections that a field may hold, one or several."""
    return tuple(model for model in models_in(annotation) if not issubclass(model, Record))


def all_sections(root: type[BaseModel]) -> tuple[type[BaseModel], ...]:
    """``root`` and every section within it, however deep."""
    sections = [root]
    for section in sections:  # grows
        for field in section.model_fields.values():
            sections += [inner for inner in sections_in(field.annotation) if inner not in sections]
    return tuple(sections)
