"""Wrong fields of a spec as lines: each has one complete line, unknown names first, with the name that was meant."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from lensforge.errors import WrongFields, shortened
from lensforge.optics.face_roles import DOUBLE
from lensforge.results.numerals import unit_in
from lensforge.results.registered_kinds import kind_of
from lensforge.results.validation import given_value, plain
from lensforge.spec.spec_fields import all_sections, field_description, sections_in
from lensforge.spec.toml_slips import cured_number

_MOST_LINES = 20  # of a message; a list of a thousand wrong numbers has one cause
_MOST_ERRORS = 1000  # that are looked at
_MOST_HINTS = 10  # names like another are searched among all of the spec's: 800 unknown ones took seconds
_MOST_CHARACTERS = 480  # of what is wrong in a line
_LIKENESS = 0.77  # of two names: "diametre_mm" and "diameter_mm" have 0.9, "cone" and "none" 0.75
_NO_HINT = "known here: "
_KINDS = ("union_tag_invalid", "union_tag_not_found")
_NUMBERS = ("float_parsing", "int_parsing")  # a text that is none
_OF_FACES = ("offset_mm", "coating", "concave_radius_mm", "draft_deg")
_ERRORS_OF_FACES = ("form_um", "waviness_um", "ripple_um", "roughness_mrad", "shift_mm", "tilt_deg")
# Names of earlier versions that no field has any more, each with its place now, or with what to write.
_MOVED = {
    "gap_mm": "lens.outer.gap_mm",
    **{f"fixed_{face}": f"lens.{face}.fixed" for face in DOUBLE},
    **{f"{face}_{name}": f"lens.{face}.{name}" for face in DOUBLE for name in (*_OF_FACES, *_ERRORS_OF_FACES)},
}
_GONE = {
    "make": 'it is process now: "moulded" in place of "insert", "milled" or "turned" in place of "part"',
    **dict.fromkeys(("half_width_mm", "half_width_deg"), "it is width now, the whole of it"),
    **{
        f"{name}_{unit}": f'it is {name} now, with unit = "{unit}"'
        for name in ("at_least", "at_most")
        for unit in ("w_per_m2", "lx", "w_per_sr", "cd", "relative")
    },
}
_LISTS = ("tuple_type", "list_type")
_TABLES = ("model_type", "model_attributes_type", "dict_type")
_SHAPES = (
    *_LISTS,
    *_TABLES,
    *_NUMBERS,
    "float_type",
    "int_type",
    "string_type",
)  # another kind of value than is wanted


@dataclass(frozen=True)
class _FieldPlace:
    """Field of an error: its dotted name as the user wrote it, the sections that hold it, and its name in them."""

    name: str
    holders: tuple[type[BaseModel], ...]
    last: str

    @property
    def known(self) -> list[str]:
        """Names of the fields beside it."""
        return list(dict.fromkeys(name for holder in self.holders for name in holder.model_fields))


def spec_error(error: ValidationError, origin: str, root: type[BaseModel]) -> WrongFields:
    """All wrong fields of what ``origin`` names, a table that ``root`` describes."""
    errors = error.errors(include_url=False)
    every = [error for error in errors if error["type"] != "too_short"] or errors  # a list whose only entry is wrong
    entries = every[:_MOST_ERRORS]
    unknown = [entry for entry in entries if entry["type"] == "extra_forbidden"]
    meant = set[str]()
    lines = list[str]()
    for number, entry in enumerate(unknown):
        place = _place(entry["loc"], root)
        hint, instead = _hint(place, root) if number < _MOST_HINTS else ("", "")
        meant.add(instead)
        told = hint and not hint.startswith(_NO_HINT)
        value = entry["input"] if told else None  # of another file's field: not for a message
        lines.append(_line(origin, place.name, value, "; ".join(filter(None, ("unknown", hint)))))
    groups = _by_place([entry for entry in entries if entry["type"] != "extra_forbidden"], root)
    within = {".".join(place.name.split(".")[:-1]) for place, _ in groups}  # of these a part is wrong, not the shape
    for place, group in groups:
        fitting = [error_entry for error_entry in group if error_entry["type"] not in _SHAPES]
        if place.name in within and not fitting:
            continue
        if not (group[0]["type"] == "missing" and place.name in meant):
            problem = " or ".join(dict.fromkeys(_problem(error_entry, place) for error_entry in fitting or group))
            name = f"{place.name}.kind".lstrip(".") if group[0]["type"] == _KINDS[0] else place.name
            value = group[0]["ctx"]["tag"] if group[0]["type"] == _KINDS[0] else group[0]["input"]
            lines.append(_line(origin, name, None if group[0]["type"] == "missing" else value, problem))
    left = len(lines) - _MOST_LINES + len(every) - len(entries)
    more = [f"{origin}: {left} more wrong fields"] if len(lines) > _MOST_LINES else []
    return WrongFields("\n".join([*lines[:_MOST_LINES], *more]))


def _line(origin: str, name: str, value: object, problem: str) -> str:
    given = "" if value is None else given_value(value)
    parts = (
        origin,
        f"{shortened(name)}{given}" if name else "",
        shortened(" ".join(problem.split()), _MOST_CHARACTERS),
    )
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
        holders = (holder for holder in place.holders if place.last in holder.model_fields)
        description = next((field_description(holder, place.last) for holder in holders), "")
        is_short_form = description[1:2].isupper()  # as PNG is
        begin = description[:1] if is_short_form else description[:1].lower()
        return f"missing: {begin}{description[1:]}" if description else "missing"
    if error["type"] in _KINDS:
        kinds = re.findall(r"'([^']*)'", str(context.get("expected_tags", ""))) or _kinds_of(place)
        near = _nearest(str(context.get("tag", "")), kinds)
        either = f"must be one of {', '.join(kinds)}" + (f"; did you mean {near}?" if near else "")
        return either if error["type"] == _KINDS[0] else f"kind is missing; it {either}"
    problem = _shape_wanted(error, place) or _length_wanted(error) or plain(error["msg"])
    given = error["input"] if isinstance(error["input"], str) else ""
    cure = cured_number(place.last, given.strip()) if error["type"] in _NUMBERS else None
    if cure is not None:
        return f"{problem}; {cure.fault}" + ("" if cure.told else f"; write {cure.meant}")
    if error["type"] in _NUMBERS and re.fullmatch(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?", given.strip()):
        return f"{problem}, without quotes; write {given.strip()}"
    near = _nearest(given, re.findall(r"'([^']*)'", str(context.get("expected", ""))))
    return f"did you mean {near}? It {problem}" if near and error["type"] == "literal_error" else problem


def _shape_wanted(error: ErrorDetails, place: _FieldPlace) -> str:
    """Words for one value where a list is wanted, or a list where one table is, as TOML writes them; "" for others."""
    given = error["input"]
    if error["type"] in _LISTS:
        if isinstance(given, dict):
            return f"must be a list of tables: write [[{place.name}]]"
        return "must be a list" + (f": write [{given}]" if type(given) in (int, float) and _takes_one(place) else "")
    if error["type"] in _TABLES:
        return f"must be one table: write [{place.name}]" if isinstance(given, list) else "must be a table"
    return ""


def _takes_one(place: _FieldPlace) -> bool:
    """True where a list of the field may have a single entry."""
    lists = [tuple_type for holder in place.holders for tuple_type in _tuples_in(holder.model_fields.get(place.last))]
    return any(Ellipsis in get_args(kind) for kind in lists)


def _tuples_in(annotation: Any) -> Iterator[Any]:
    annotation = getattr(annotation, "annotation", annotation)
    if get_origin(annotation) is tuple:
        yield annotation
    else:
        yield from (entry for part in get_args(annotation) for entry in _tuples_in(part))


def _length_wanted(error: ErrorDetails) -> str:
    """Words for a list with too many entries, or too few; "" for other errors."""
    context = error.get("ctx", {})
    if error["type"] == "too_long":
        return f"must have at most {_entries(context['max_length'])}, not {context['actual_length']}"
    if error["type"] == "too_short":
        return f"must have at least {_entries(context['min_length'])}, not {context['actual_length']}"
    return ""


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"


def _kinds_of(place: _FieldPlace) -> list[str]:
    fields = [holder.model_fields[place.last] for holder in place.holders if place.last in holder.model_fields]
    return [kind for field in fields for section in sections_in(field.annotation) if (kind := kind_of(section))]


def _hint(place: _FieldPlace, root: type[BaseModel]) -> tuple[str, str]:
    """Advice on an unknown name, and the whole name that was meant, "" where none is near."""
    before = place.name.rpartition(".")[0]
    if place.last in _MOVED:
        return f"it is {_MOVED[place.last]} now", _MOVED[place.last]
    if place.last in _GONE:
        return _GONE[place.last], ""
    near = _nearest(place.last, place.known)
    if near:
        return f"did you mean {near}?", f"{before}.{near}".lstrip(".")
    having = {
        name: [section for section in sections_in(field.annotation) if place.last in section.model_fields]
        for name, field in root.model_fields.items()
    }
    kinds = ", ".join(str(kind_of(section)) for section in having.pop(before.partition(".")[0], []))
    tables = " or ".join(f"[{name}]" for name, sections in having.items() if sections)
    if kinds or tables:
        ways = (f"goes with kind = {kinds}" if kinds else "", f"belongs to {tables}" if tables else "")
        return f"it {', or '.join(filter(None, ways))}", ""
    names = [name for section in all_sections(root) for name in section.model_fields]
    elsewhere = _nearest(place.last, names)
    known = f"{_NO_HINT}{', '.join(place.known)}"
    return (f"{known}; elsewhere there is {elsewhere}" if elsewhere and len(place.last) > 2 else known), ""


def _nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name that was meant: the same with its unit, or one that differs by a few letters."""
    with_unit = [
        candidate
        for candidate in known
        if unit_in(candidate) and candidate == f"{name}_{candidate.removeprefix(f'{name}_')}"
    ]
    return next(iter(with_unit or get_close_matches(name, known, n=1, cutoff=_LIKENESS)), None)


def _place(location: tuple[int | str, ...], root: type[BaseModel]) -> _FieldPlace:
    """The field at ``location``, without what pydantic adds: the kind of a section, and the branch of a choice."""
    holders: tuple[type[BaseModel], ...] = (root,)
    inside = holders
    parts = list[str]()
    annotation: Any = None
    for number, part in enumerate(location):
        tagged = tuple(section for section in inside if kind_of(section) == part)
        fields = [section.model_fields[part] for section in inside if part in section.model_fields]
        if isinstance(part, int):
            parts.append(str(part))
        elif len(inside) > 1 and tagged:
            inside = tagged
        elif fields:
            holders = inside
            annotation = fields[0].annotation
            inside = tuple(dict.fromkeys(section for field in fields for section in sections_in(field.annotation)))
            parts.append(part)
        elif tagged:
            inside = tagged
        elif not _is_branch(part) and ((inside and number == len(location) - 1) or _holds_names(annotation)):
            holders = inside
            parts.append(part)
    return _FieldPlace(".".join(parts), holders, next((part for part in reversed(parts) if not part.isdigit()), ""))


def _is_branch(part: str) -> bool:
    """True for what pydantic calls a branch of a choice: ``constrained-float``, ``tuple[...]``, ``[key]``."""
    return bool(re.fullmatch(r"[a-z]+(-[a-z]+)+|[a-z-]*\[.*\]|float|int|str|bool|list|dict", part))


def _holds_names(annotation: Any) -> bool:
    return get_origin(annotation) is dict or any(get_origin(argument) is dict for argument in get_args(annotation))
