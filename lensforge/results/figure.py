"""Figures of a record, each declared once, at its field: its label, its note, the limit that judges it, its remedy.

Facts and criteria are views of these declarations, and so are the screen, the pages, the JSON and the list of terms
that show them. A criterion stated in a file is checked against the one that follows from the record's figures.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from string import Formatter
from typing import Any, Generic, TypeVar, get_origin

from pydantic.fields import FieldInfo

from lensforge.results.criteria import at_least, at_most, declare_labels, state_of
from lensforge.results.fact import Fact
from lensforge.results.numerals import converted, quantity, unit_of, without_unit
from lensforge.results.record import InCriterion, Metric, Record, Sense, marker, marks_of
from lensforge.results.registered_kinds import models_in

# A text or a number, or the function that makes it of the whole result. At fields of a record among several of its
# kind, such as that of a face, functions get this record, too, and its name where it does not state that itself. The
# text of a bound is the place, dotted, where the record holds it.
Words = str | Callable[..., str]
Bound = float | str | Callable[..., float | None]


@dataclass(frozen=True)
class Figure:
    """Declares that a field is told to people, as a :class:`Fact`.

    Attributes:
        label: its name in words. In a text, {chord_error_um:2} stands for another figure of the same record, with its
            unit and to so many digits, {name} for the name of one record among several that does not state it; a
            function makes the text of the whole result.
        note: words behind the value.
        key: by which pages select it; by default the path of the field without its unit.
        of: the entry of the field that is told, dotted, such as "max".
        value: makes what is told where the field has a value, such as a text of several; by default that value.
        unit: in which it is told, "%" for a share; by default that of the field's name.
        digits: significant digits of a value without standard error.
        is_square: for a mean square, which less its noise may be below zero.
        missing: text in place of a value of None, "" for none; by default such a figure is not told.
        limit: the value that is asked for, of a share as a share. The criterion called ``judged_by`` judges it by
            another figure, such as the margin to that value; without one, the figure itself is judged.
        sense: side of that limit on which the value must be.
        limit_note: whose limit it is.
        judged_by: the criterion whose state it has; without a ``limit`` its limit, too. By default the
            :class:`Criterion` of the same field.
        possible: the best that physics allows; None for no bound, and then no note.
        possible_note: the law that says so.
        remedy: what to change where its own limit is missed.
        notice: what a reader must not miss.
        when: whether a result tells it at all; by default each does.
    """

    label: Words
    note: Words = ""
    key: Words = ""
    of: str = ""
    value: Callable[..., Any] | None = None
    unit: str | None = None
    digits: int = 4
    is_square: bool = False
    missing: str | None = None
    limit: Bound | None = None
    sense: Sense = "<="
    limit_note: Words = ""
    judged_by: str = ""
    possible: Bound | None = None
    possible_note: Words = ""
    remedy: Words = ""
    notice: Words = ""
    when: Callable[..., bool] | None = None


@dataclass(frozen=True)
class Criterion:
    """Declares that a field is judged by a limit.

    Attributes:
        sense: side of the bound on which the value must be.
        bound: the limit; None if the result asks for none, and then there is no criterion.
        phrase: the criterion, as a phrase.
        remedy: what to change where it is missed.
        name: by which scripts know the criterion; by default the path of the field without its unit. As in a
            ``remedy``, {faces} stands for a figure of the record.
        of: the entry of the field that is judged, dotted.
        tolerance: by which the value may miss the bound.
        unit: by default that of the field's name.
    """

    sense: Sense
    bound: Bound
    phrase: str
    remedy: Words
    name: str = ""
    of: str = ""
    tolerance: Bound = 0.0
    unit: str | None = None


@dataclass(frozen=True)
class Apart:
    """Marks a field whose record is told as a group of its own: its figures are not among those of the result."""


_Mark = TypeVar("_Mark", Figure, Criterion)

_Getter = TypeVar("_Getter", bound=Callable[..., Any])


def figure(*marks: Figure | Criterion) -> Callable[[_Getter], _Getter]:
    """Decorate the function of a property, which then is a figure or a criterion by ``marks``, as a field would be."""

    def with_marks(getter: _Getter) -> _Getter:
        vars(getter)[_MARKS] = marks
        return getter

    return with_marks


_MARKS = "figure_marks"


@dataclass(frozen=True)
class _Declared(Generic[_Mark]):
    """A mark, the record that holds its field, and the path to the field from the record passed to functions."""

    mark: _Mark
    holder: Record
    path: tuple[str, ...]
    given: tuple[Any, ...]  # to functions of the mark

    @property
    def name(self) -> str:
        """Its name by default."""
        return _name(self.path)

    @property
    def place(self) -> tuple[tuple[str, ...], str]:
        """The declared value: the field, or its entry."""
        return self.path, self.mark.of

    @property
    def value(self) -> Any:
        """The declared value; None if an entry on its path is."""
        return entry_at(self.holder, ".".join(filter(None, (self.path[-1], self.mark.of))))

    @property
    def field_unit(self) -> str:
        """Unit by the names on the path, else the declared one."""
        return unit_of([*self.path, *self.mark.of.split(".")]) or self.mark.unit or ""

    @property
    def unit(self) -> str:
        """Unit, as declared, else by the names on the path."""
        return self.field_unit if self.mark.unit is None else self.mark.unit

    def text(self, template: Words) -> str:
        """Evaluate ``template`` as a text."""
        if callable(template):
            return template(*self.given)
        return _TEXTS.vformat(template, [self.holder], dict(zip(("name",), self.given[2:], strict=False)))

    def number(self, bound: Bound | None) -> float | None:
        """Evaluate a ``bound`` as a number."""
        if isinstance(bound, str):
            return entry_at(self.holder, bound)
        return bound(*self.given) if callable(bound) else bound


def facts_in(result: Record, held: Iterable[Fact] = (), record: Record | None = None, *given: Any) -> Iterator[Fact]:
    """The figures of ``result`` and of the records within it, as facts.

    ``held``: criteria of the result: a fact on the value of one has its limit and its state. ``record``: the one of
    several within ``result`` whose figures are wanted. ``given``: further arguments of functions, such as the record's
    name if it does not state it.
    """
    held = tuple(held)
    judged: dict[tuple[tuple[str, ...], str], list[str]] = {}
    for limit in _all_declared(Criterion, result, record, *given):
        judged.setdefault(limit.place, []).append(_criterion_name(limit))
    for declared in _all_declared(Figure, result, record, *given):
        fact = _fact(declared, held)
        if fact is not None:
            judged_by = declared.text(declared.mark.judged_by) if declared.mark.limit is None else ""
            names = judged.get(declared.place, [judged_by])
            judgement = next((criterion for criterion in held if criterion.key in names), None)
            yield fact.judged_as(None if judgement is None else judgement.told_in(fact.unit))


def limits_in(result: Record, record: Record | None = None, *given: Any) -> Iterator[tuple[str, Sense, float]]:
    """Name, sense and bound of each figure that is judged by a limit of its own; arguments as of :func:`facts_in`."""
    for declared in _all_declared(Figure, result, record, *given):
        mark = declared.mark
        if not mark.judged_by and _is_told(declared) and (limit := declared.number(mark.limit)) is not None:
            yield declared.text(mark.key) or declared.name, mark.sense, limit


def figures_of(kind: type[Record]) -> Iterator[tuple[str, Figure]]:
    """Key and declaration of each figure of a record of ``kind``, including records within it."""
    for declared, path in _declared_by(kind, Figure):
        yield declared.key if isinstance(declared.key, str) and declared.key else _name(path), declared


def figures_at(kind: type[Record]) -> dict[str, Figure]:
    """Declaration of the figure at each dotted place of a record of ``kind``, including records within it."""
    return {".".join(filter(None, (*path, declared.of))): declared for declared, path in _declared_by(kind, Figure)}


def criteria_in(result: Record, record: Record | None = None, *given: Any) -> Iterator[Fact]:
    """The limits of ``result`` and of the records within it, as criteria on its figures; flags count as 1 and 0.

    ``record``, ``given``: as in :func:`facts_in`.
    """
    for declared in _all_declared(Criterion, result, record, *given):
        limit = declared.mark
        bound = declared.number(limit.bound)
        if bound is None:
            continue
        value, error = _number(declared.value)
        judge = at_most if limit.sense == "<=" else at_least
        remedy = declared.text(limit.remedy)
        tolerance = declared.number(limit.tolerance) or 0.0
        yield judge(_criterion_name(declared), value, bound, declared.unit, remedy, tolerance, error)


def _criterion_name(declared: _Declared[Criterion]) -> str:
    return declared.text(declared.mark.name) or declared.name


def declare_criteria(kind: type[Record]) -> None:
    """Register the labels of the criteria of ``kind`` for readers that know only their names, as a table of designs."""
    declare_labels(
        lambda: (
            (declared.name or _name(path), declared.phrase)
            for declared, path in _declared_by(kind, Criterion)
            if "{" not in declared.name
        )
    )


def with_told_by_criteria(kind: type[Record], content: Mapping[str, Any], fields: Iterable[str]) -> dict[str, Any]:
    """``content`` of a file of ``kind``, completed from its criteria, also in records within it.

    ``fields``: those that hold the criteria.
    """
    lists = [stated for field in fields if isinstance(stated := content.get(field), list | tuple)]
    by_name = {entry.get("name"): entry for stated in lists for entry in stated if isinstance(entry, Mapping)}
    return _with_told(kind, content, by_name, ()) if by_name else dict(content)


def _with_told(
    kind: type[Record], content: Mapping[str, Any], criteria: Mapping[Any, Mapping[str, Any]], path: tuple[str, ...]
) -> dict[str, Any]:
    read = dict(content)
    for name, info in kind.model_fields.items():
        criterion_mark = marker(info, Criterion)
        in_criterion = marker(info, InCriterion)
        if in_criterion is not None and name not in content:
            criterion = in_criterion.name or (criterion_mark and criterion_mark.name) or _name([*path, name])
            if criterion in criteria:
                read[name] = _as_declared(info, criteria[criterion].get(in_criterion.entry))
        within = next((model for model in models_in(info.annotation) if issubclass(model, Record)), None)
        if within is not None and isinstance(content.get(name), Mapping):
            read[name] = _with_told(within, content[name], criteria, (*path, name))
    return read


def entry_at(record: Any, place: str) -> Any:
    """The entry at the dotted ``place`` of ``record``; None if an entry on its path is."""
    for step in place.split("."):
        if record is not None:
            record = record[step] if isinstance(record, Mapping) else getattr(record, step)
    return record


def _name(path: Sequence[str]) -> str:
    """The path of a field as one name, without its unit."""
    return "_".join((*path[:-1], without_unit(path[-1])))


def _as_declared(info: FieldInfo, value: Any) -> Any:
    """The value of a criterion in the type of its field: a flag for 1 or 0, a whole number."""
    if info.annotation is bool and value in (0.0, 1.0):
        return bool(value)
    return int(value) if info.annotation is int and isinstance(value, float) and value.is_integer() else value


def _number(value: Any) -> tuple[float, float | None]:
    """``value`` and its standard error; NaN for None."""
    if isinstance(value, Metric):
        return value.value, value.standard_error
    number = nan if value is None else float(value)
    return (number if isfinite(number) else nan), None


def _is_told(declared: _Declared[Figure]) -> bool:
    when = declared.mark.when
    return when is None or when(*declared.given)


def _fact(declared: _Declared[Figure], held: Sequence[Fact]) -> Fact | None:
    mark = declared.mark
    if not _is_told(declared):
        return None
    value: Any = mark.missing
    if declared.value is not None:
        value = declared.value if mark.value is None else mark.value(*declared.given)
    if value is None:
        return None
    label = declared.text(mark.label)
    note = declared.text(mark.note)
    key = declared.text(mark.key) or declared.name
    if isinstance(value, Metric):
        fact = Fact.measured(key, label, value, note)
    else:
        if not isinstance(value, str):
            value = converted(value, declared.field_unit, declared.unit)
        fact = Fact(key, label, None if value == "" else value, declared.unit, note=note)
    possible = declared.number(mark.possible)
    fact = replace(
        fact,
        digits=mark.digits,
        is_square=mark.is_square,
        sense=mark.sense,
        possible=possible,
        possible_note="" if possible is None else declared.text(mark.possible_note),
        remedy=declared.text(mark.remedy),
        notice=declared.text(mark.notice),
    )
    limit = declared.number(mark.limit)
    if limit is not None:
        fact = _with_limit(declared, replace(fact, limit=limit, limit_note=declared.text(mark.limit_note)), held)
    return fact.in_percent if mark.unit == "%" else fact


def _with_limit(declared: _Declared[Figure], fact: Fact, held: Sequence[Fact]) -> Fact:
    """The ``fact``, which has a limit, with its state: by the criterion that judges it, else by its own value."""
    if not declared.mark.judged_by:
        measured = isinstance(declared.value, Metric)
        return fact.judged(fact.standard_error if measured else 0.0)
    judged_by = declared.text(declared.mark.judged_by)
    why = [
        criterion.note
        for criterion in held
        if criterion.key == judged_by and criterion.value is None and criterion.state == "fail"
    ]
    state = state_of(held, judged_by)  # for another reason than this value where the judgement has none
    return replace(fact, state=state, note="; ".join(filter(None, [fact.note, *why])))


def _all_declared(kind: type[_Mark], result: Record, record: Record | None, *given: Any) -> Iterator[_Declared[_Mark]]:
    """Marks of ``kind`` in ``result``, or in its ``record``; functions of these get both."""
    if record is None:
        return _declared(result, kind, (result, *given))
    return _declared(record, kind, (result, record, *given))


def _declared(
    holder: Record, kind: type[_Mark], given: tuple[Any, ...], path: tuple[str, ...] = ()
) -> Iterator[_Declared[_Mark]]:
    """Marks of ``kind`` at the fields and properties of ``holder``, those of inner records at their field."""
    for name, info in type(holder).model_fields.items():
        yield from (_Declared(mark, holder, (*path, name), given) for mark in marks_of(info, kind))
        within = getattr(holder, name)
        if isinstance(within, Record) and (kind is Criterion or marker(info, Apart) is None):
            yield from _declared(within, kind, given, (*path, name))
    for name, marks in _properties(type(holder)):
        yield from (_Declared(mark, holder, (*path, name), given) for mark in marks if isinstance(mark, kind))


def _declared_by(
    kind: type[Record], mark: type[_Mark], path: tuple[str, ...] = ()
) -> Iterator[tuple[_Mark, tuple[str, ...]]]:
    for name, info in kind.model_fields.items():
        yield from ((declared, (*path, name)) for declared in marks_of(info, mark))
        within = (model for model in models_in(info.annotation) if issubclass(model, Record) and model is not kind)
        alone = get_origin(info.annotation) is tuple or marker(info, Apart) is not None
        for record in within:  # names of figures of one among several, or of one that is told apart, begin with it
            yield from _declared_by(record, mark, () if alone else (*path, name))
    for name, marks in _properties(kind):
        yield from ((declared, (*path, name)) for declared in marks if isinstance(declared, mark))
    for named_record in models_in(vars(kind).get("__annotations__", {}).get("__pydantic_extra__")):
        yield from _declared_by(named_record, mark) if issubclass(named_record, Record) else ()


def _properties(kind: type[Record]) -> Iterator[tuple[str, tuple[Figure | Criterion, ...]]]:
    """Names and marks of the properties that ``kind`` and its bases declare, in the order in which they stand."""
    members = {name: member for base in reversed(kind.__mro__) for name, member in vars(base).items()}
    getters = {name: member.fget for name, member in members.items() if isinstance(member, property)}
    yield from ((name, vars(getter)[_MARKS]) for name, getter in getters.items() if _MARKS in vars(getter))


class _Texts(Formatter):
    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        """The figure at this place of the record, with its unit; the name of the record if given."""
        if field_name in kwargs:
            return (kwargs[field_name], ""), field_name
        return (entry_at(args[0], field_name), unit_of(field_name.split("."))), field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        """Text unchanged, a figure to the digits in ``format_spec``."""
        figure, unit = value
        return figure if isinstance(figure, str) else quantity(figure, unit, digits=int(format_spec or 6))


_TEXTS = _Texts()  # with {figures} of a record
