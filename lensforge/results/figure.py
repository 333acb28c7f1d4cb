"""Figures of a record, each declared once, at its field: its label, its note, the limit that judges it, its remedy.

Facts and criteria are views of these declarations, and so are the screen, the pages, the JSON and the list of terms
that show them. A criterion that a file states is held against the one that the figures of the record make.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from string import Formatter
from typing import Any, Generic, NamedTuple, TypeVar

from pydantic.fields import FieldInfo

from lensforge.results.criteria import at_least, at_most, declare_words, named, state_of
from lensforge.results.fact import Fact
from lensforge.results.numerals import quantity, unit_of, unit_suffix
from lensforge.results.record import InCriterion, Metric, Record, Sense, marker, marks_of
from lensforge.results.registered_kinds import models_in

Words = str | Callable[[Any], str]  # a text, or the function that makes it of the whole result
Bound = float | Callable[[Any], float | None]  # a number, or the function that takes it of the whole result


@dataclass(frozen=True)
class Figure:
    """Declares that a field is told to people, as a :class:`Fact`.

    Attributes:
        label: its name in words. In a text, {chord_error_um:2} stands for another figure of the same record, with its
            unit and to so many digits; a function makes the text of the whole result.
        note: words behind the value.
        key: by which pages select it; by default the path of the field without its unit.
        of: the entry of the field that is told, dotted, such as "max".
        unit: "%" for a share; by default that of the field's name.
        digits: significant digits of a value without standard error.
        missing: text in place of a value of None; by default such a figure is not told.
        limit: the largest value that is asked for, where the criterion called ``judged_by`` judges it by another
            figure, such as the margin to that value.
        judged_by: the criterion whose state it has; without a ``limit`` its limit, too. By default the
            :class:`Criterion` of the same field.
    """

    label: Words
    note: Words = ""
    key: str = ""
    of: str = ""
    unit: str | None = None
    digits: int = 4
    missing: str | None = None
    limit: Bound | None = None
    judged_by: str = ""


@dataclass(frozen=True)
class Criterion:
    """Declares that a field is judged by a limit.

    Attributes:
        sense: side of the bound on which the value must be.
        bound: the limit; None where the result asks for none, and then there is no criterion.
        words: the criterion in words.
        remedy: what to change where it is missed.
        name: by which scripts know the criterion; by default the path of the field without its unit.
        of: the entry of the field that is judged, dotted.
        tolerance: by which the value may miss the bound.
        unit: by default that of the field's name.
    """

    sense: Sense
    bound: Bound
    words: str
    remedy: Words
    name: str = ""
    of: str = ""
    tolerance: Bound = 0.0
    unit: str | None = None


_Mark = TypeVar("_Mark", Figure, Criterion)

_Getter = TypeVar("_Getter", bound=Callable[..., Any])


def figure(*marks: Figure | Criterion) -> Callable[[_Getter], _Getter]:
    """Decorate the function of a property, which is then told or judged as a field with these ``marks`` is."""

    def with_marks(getter: _Getter) -> _Getter:
        vars(getter)[_MARKS] = marks
        return getter

    return with_marks


_MARKS = "figure_marks"


class _Declared(NamedTuple, Generic[_Mark]):
    """A mark, the record that holds its field, and the path of the field from the whole result."""

    mark: _Mark
    holder: Record
    path: tuple[str, ...]

    @property
    def name(self) -> str:
        """Its name by default."""
        return _name(self.path)

    @property
    def place(self) -> tuple[tuple[str, ...], str]:
        """The value that is declared: the field, and its entry."""
        return self.path, self.mark.of

    @property
    def value(self) -> Any:
        """The value that is declared; None where an entry on the way is."""
        return entry_at(self.holder, ".".join(filter(None, (self.path[-1], self.mark.of))))

    @property
    def unit(self) -> str:
        """Its unit, as declared or by the names on its path."""
        stated = self.mark.unit
        return unit_of([*self.path, *self.mark.of.split(".")]) if stated is None else stated


def facts_in(result: Record, held: Iterable[Fact] = ()) -> Iterator[Fact]:
    """The figures of ``result`` and of the records within it, as facts.

    ``held``: criteria of the result: a fact on the value of one has its limit and its state.
    """
    held = tuple(held)
    limits = {declared.place: declared.mark.name or declared.name for declared in _declared(result, Criterion)}
    for declared in _declared(result, Figure):
        fact = _fact(result, declared, held)
        if fact is not None:
            name = limits.get(declared.place) or (declared.mark.judged_by if fact.limit is None else "")
            judgement = named(held, name)
            yield fact.judged_as(judgement.in_percent if judgement and fact.unit == "%" else judgement)


def figures_of(kind: type[Record]) -> Iterator[tuple[str, Figure]]:
    """Key and declaration of each figure that a record of ``kind`` tells, and those of the records within it."""
    yield from ((declared.key or _name(path), declared) for declared, path in _declared_by(kind, Figure))


def criteria_in(result: Record) -> Iterator[Fact]:
    """The limits of ``result`` and of the records within it, as criteria on its figures; flags count as 1 and 0."""
    for declared in _declared(result, Criterion):
        limit = declared.mark
        bound = limit.bound(result) if callable(limit.bound) else limit.bound
        if bound is None:
            continue
        tolerance = limit.tolerance(result) if callable(limit.tolerance) else limit.tolerance
        value, error = _number(declared.value)
        judge = at_most if limit.sense == "<=" else at_least
        remedy = _text(limit.remedy, result, declared.holder)
        name = limit.name or declared.name
        yield judge(name, value, bound, declared.unit, remedy, tolerance or 0.0, error)


def declare_criteria(kind: type[Record]) -> None:
    """Make the words of the criteria of ``kind`` known wherever one is read by its name, as in a table of designs."""
    for declared, path in _declared_by(kind, Criterion):
        declare_words(declared.name or _name(path), declared.words)


def with_told_by_criteria(kind: type[Record], content: Mapping[str, Any]) -> dict[str, Any]:
    """``content`` of a file of ``kind`` with the fields that its criteria alone tell, also those of records within."""
    stated = content.get("criteria")
    listed = stated if isinstance(stated, Sequence) and not isinstance(stated, str) else ()
    by_name = {each.get("name"): each for each in listed if isinstance(each, Mapping)}
    return _with_told(kind, content, by_name, ()) if by_name else dict(content)


def _with_told(
    kind: type[Record], content: Mapping[str, Any], criteria: Mapping[Any, Mapping[str, Any]], path: tuple[str, ...]
) -> dict[str, Any]:
    read = dict(content)
    for name, info in kind.model_fields.items():
        judged, told = marker(info, Criterion), marker(info, InCriterion)
        if told is not None and name not in content:
            criterion = told.name or (judged and judged.name) or _name([*path, name])
            if criterion in criteria:
                read[name] = _as_declared(info, criteria[criterion].get(told.entry))
        within = next((each for each in models_in(info.annotation) if issubclass(each, Record)), None)
        if within is not None and isinstance(content.get(name), Mapping):
            read[name] = _with_told(within, content[name], criteria, (*path, name))
    return read


def entry_at(record: Any, place: str) -> Any:
    """The entry at the dotted ``place`` of ``record``; None where an entry on the way is."""
    for step in place.split("."):
        if record is not None:
            record = record[step] if isinstance(record, Mapping) else getattr(record, step)
    return record


def _name(path: Sequence[str]) -> str:
    """The path of a field as one name, without its unit."""
    return "_".join(path).removesuffix(unit_suffix(unit_of(path)))


def _as_declared(info: FieldInfo, value: Any) -> Any:
    """The value of a criterion as its field takes it: a flag of 1 or 0, a whole number."""
    if info.annotation is bool and value in (0.0, 1.0):
        return bool(value)
    return int(value) if info.annotation is int and isinstance(value, float) and value.is_integer() else value


def _number(value: Any) -> tuple[float, float | None]:
    """``value`` and its standard error; NaN for None."""
    if isinstance(value, Metric):
        return value.value, value.standard_error
    number = nan if value is None else float(value)
    return (number if isfinite(number) else nan), None


def _fact(result: Record, declared: _Declared[Figure], held: Sequence[Fact]) -> Fact | None:
    mark = declared.mark
    value: Any = mark.missing if declared.value is None else declared.value
    if value is None:
        return None
    label, note = (_text(words, result, declared.holder) for words in (mark.label, mark.note))
    key = mark.key or declared.name
    if mark.unit == "%":
        fact = Fact.share(key, label, value, note)
    elif isinstance(value, Metric):
        fact = Fact.measured(key, label, value, note)
    else:
        fact = Fact(key, label, value, "" if isinstance(value, str) else declared.unit, note=note)
    fact = replace(fact, digits=mark.digits)
    limit = mark.limit(result) if callable(mark.limit) else mark.limit
    if limit is None:
        return fact
    why = [each.note for each in held if each.key == mark.judged_by and each.value is None and each.state == "fail"]
    state = state_of(held, mark.judged_by)  # for another reason than this value where the judgement has none
    return replace(fact, limit=limit, state=state, note="; ".join(filter(None, [note, *why])))


def _declared(holder: Record, kind: type[_Mark], path: tuple[str, ...] = ()) -> Iterator[_Declared[_Mark]]:
    """Marks of ``kind`` at the fields and properties of ``holder``, those of records within at their field."""
    for name, info in type(holder).model_fields.items():
        yield from (_Declared(mark, holder, (*path, name)) for mark in marks_of(info, kind))
        within = getattr(holder, name)
        if isinstance(within, Record):
            yield from _declared(within, kind, (*path, name))
    for name, marks in _properties(type(holder)):
        yield from (_Declared(mark, holder, (*path, name)) for mark in marks if isinstance(mark, kind))


def _declared_by(
    kind: type[Record], mark: type[_Mark], path: tuple[str, ...] = ()
) -> Iterator[tuple[_Mark, tuple[str, ...]]]:
    for name, info in kind.model_fields.items():
        yield from ((declared, (*path, name)) for declared in marks_of(info, mark))
        within = (each for each in models_in(info.annotation) if issubclass(each, Record) and each is not kind)
        for record in within:
            yield from _declared_by(record, mark, (*path, name))
    for name, marks in _properties(kind):
        yield from ((declared, (*path, name)) for declared in marks if isinstance(declared, mark))


def _properties(kind: type[Record]) -> Iterator[tuple[str, tuple[Figure | Criterion, ...]]]:
    """Names and marks of the properties that ``kind`` and its bases declare, in the order in which they stand."""
    members = {name: member for base in reversed(kind.__mro__) for name, member in vars(base).items()}
    getters = {name: member.fget for name, member in members.items() if isinstance(member, property)}
    yield from ((name, vars(getter)[_MARKS]) for name, getter in getters.items() if _MARKS in vars(getter))


def _text(words: Words, result: Record, holder: Record) -> str:
    return words(result) if callable(words) else TEXTS.vformat(words, [holder], {})


class _Texts(Formatter):
    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        """The word of this name, or the figure at this place of the record, with its unit."""
        if field_name in kwargs:
            return kwargs[field_name], field_name
        return (entry_at(args[0], field_name), unit_of(field_name.split("."))), field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        """A word as it is, a figure to as many digits as ``format_spec`` says."""
        if isinstance(value, str):
            return value
        figure, unit = value
        return quantity(figure, unit, digits=int(format_spec or 6))


TEXTS = _Texts()  # with {words} and {figures} of a record
