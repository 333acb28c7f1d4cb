"""Facts: values of a result, judged or not, each with label, unit, standard error, limit, state, note and remedy.

Page, screen, notebook, drawing and ``--json`` show these, and nothing else shows a number of a result. A record keeps
those that are judged: criteria, findings of the check, limits of the spec.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from lensforge.public import public
from lensforge.results.numerals import NOTHING, anything, converted, limit_text, quantity, square
from lensforge.results.record import Metric, NotNegative, Number, Sense, State, Text, agree
from lensforge.results.verdict import judge

FactState = State | Literal[""]  # "": nothing is required, or it is not judged yet
_OPPOSITE: dict[Sense, Sense] = {"<=": ">=", ">=": "<="}
_BOUNDS: dict[Sense, str] = {"<=": "lower bound", ">=": "upper bound"}  # that physics sets on the other side
_DIGITS = 4  # significant digits of a number without standard error
_ANSWERS = {"pass": "yes", "fail": "no", "undecided": "undecided", "none": "not judged"}
_OUTCOMES = {"pass": "held", "fail": "missed", "undecided": "undecided", "none": "not judged"}


@public
@dataclass(frozen=True)
class Change:
    """A field of the spec, dotted, and the ``value`` that would help; ``then``: phrase after it in a sentence."""

    field: str
    value: str
    then: str = ""

    def __str__(self) -> str:
        return f"{self.field} = {self.value}{self.then}"


@public
@dataclass(frozen=True)
class Fact:
    """One value of a result, and the judgement on it.

    Fields:
        key (str): Name by which a page or a screen selects it.
        label (str): Name that is shown.
        value (float or str or None): In ``unit``; None if it could not be measured; text where it is no number.
        unit (str): "%" for a share, "" for a pure number.
        standard_error (float or None): Standard error of the value; None for an exact one.
        sense ('<=' or '>='): Side of the limit on which the value must be.
        limit (float or None): Bound of the value; None if it is not judged.
        possible (float or None): The best that physics allows.
        state ('pass' or 'fail' or 'undecided' or ''): Result of the judgement, "" if there is no limit.
        note (str): Text shown beside the value.
        remedy (str): Advice if the value misses its limit.
        digits (int): Significant digits that are shown.
        tolerance (float): Amount by which the measured value may miss the limit.
        place (str): Face or receiver of the value.
        limit_note (str): Text shown beside the limit.
        possible_note (str): Text shown beside the bound.
        notice (str): Reason why the value deserves a look though no limit judges it, shown in amber.
        is_square (bool): True for a mean square; the noise that is taken off may leave it below zero.
        changes (tuple of Change): Fields of the spec that would help, with values; the remedy says them in a sentence.
    """

    key: Text
    label: Text
    value: Number | Text | None
    unit: Text = ""
    standard_error: NotNegative | None = None
    sense: Sense = "<="
    limit: Number | None = None
    possible: Number | None = None
    state: FactState = ""
    note: Text = ""
    remedy: Text = ""
    digits: int = _DIGITS
    tolerance: NotNegative = 0.0
    place: Text = ""
    limit_note: Text = ""
    possible_note: Text = ""
    notice: Text = ""
    is_square: bool = False
    changes: tuple[Change, ...] = field(default=(), compare=False)

    @staticmethod
    def measured(key: str, label: str, metric: Metric | None, note: str = "", **more: Any) -> "Fact":
        """Make the fact of a ``metric``, judged if ``more`` has a limit; None if it has no meaning."""
        if metric is None:
            return Fact(key, label, None, note=note, **more)
        fact = Fact(key, label, metric.value, metric.unit, metric.standard_error, note=note, **more)
        return fact if fact.limit is None else fact.judged(metric.standard_error)

    @staticmethod
    def share(key: str, label: str, share: Metric | float | None, note: str = "", **more: Any) -> "Fact":
        """Make the fact of a share, in per cent; limits in ``more`` are shares, too."""
        metric = share if isinstance(share, Metric | None) else Metric(value=share)
        return Fact.measured(key, label, metric, note, **more).in_percent

    def judged(self, error: float | None = 0.0) -> "Fact":
        """Judge the fact by its limit; ``error``: standard error, 0 for an exact value, None if it is not known."""
        value = None if isinstance(self.value, str) else self.value
        return replace(self, state=judge(value, self.sense, self.limit, error, self.tolerance))

    def judged_as(self, other: "Fact | None") -> "Fact":
        """Take limit and state of ``other``, a fact on the same value; unchanged without one."""
        return self if other is None else replace(self, sense=other.sense, limit=other.limit, state=other.state)

    @property
    def in_percent(self) -> "Fact":
        """Fact of a share, all its numbers in per cent."""
        numbers = ("value", "standard_error", "limit", "possible", "tolerance")
        shares = {name: share for name in numbers if (share := getattr(self, name)) is not None}
        return replace(self, unit="%", **{name: 100.0 * share for name, share in shares.items()})

    def told_in(self, unit: str) -> "Fact":
        """The fact in another unit of length, or in per cent."""
        if unit == "%" or self.limit is None:
            return self.in_percent if unit == "%" else self
        return replace(self, limit=converted(self.limit, self.unit, unit))

    @property
    def answered(self) -> "Fact":
        """The fact with the answer to its question for a value: yes if it passes, no if it fails."""
        answer = _ANSWERS.get(self.state, NOTHING)
        return Fact(self.key, self.label, answer, state=self.state, note=self.note, remedy=self.remedy)

    @property
    def holds(self) -> bool:
        """True if its limit is kept."""
        return self.state == "pass"

    @property
    def bound(self) -> float:
        """Limit of a fact that has one."""
        if self.limit is None:
            raise ValueError(f"{self.key} has no limit")
        return self.limit

    @property
    def outcome(self) -> str:
        """State as limits name it: held, missed or undecided."""
        return _OUTCOMES.get(self.state, "")

    @property
    def metric(self) -> Metric:
        """Value, a number, with its unit and its standard error."""
        return Metric(value=float(self.value or 0.0), unit=self.unit, standard_error=self.standard_error)

    @property
    def text(self) -> str:
        """Value with standard error and unit, as every page and screen shows it."""
        if self.value is None:
            return NOTHING if self.limit is None else "not measured"
        if isinstance(self.value, str | bool):
            return anything(self.value)
        if self.is_square:
            return square(self.value, self.standard_error, self.digits)
        return quantity(self.value, self.unit, self.standard_error, self.digits)

    @property
    def required(self) -> str:
        """Limit as text, with the tolerance if the value needs it."""
        if self.limit is None:
            return NOTHING
        bare = replace(self, tolerance=0.0).judged(self.standard_error or 0.0)
        exact = self.tolerance == 0.0 or not self.holds or bare.holds
        within = "" if exact else f", within {quantity(self.tolerance, self.unit, digits=2)}"
        return f"{limit_text(self.sense, self.limit, self.unit, self.digits)}{within}"

    @property
    def bounded_by(self) -> str:
        """Bound that physics sets, as text."""
        return NOTHING if self.possible is None else limit_text(self._opposite, self.possible, self.unit, self.digits)

    @property
    def sentence(self) -> str:
        """Value, limit, bound of physics, and note in one line, for a screen."""
        beside = [f"required {self.required}"] if self.limit is not None else []
        beside += (
            [f"{_BOUNDS[self.sense]} {quantity(self.possible, self.unit, digits=self.digits)}"]
            if self.possible is not None
            else []
        )
        value_text = f"{self.text} ({', '.join(beside)})" if beside else self.text
        return "; ".join(filter(None, (value_text, self.note, self.notice)))

    @property
    def reason(self) -> str:
        """Reason why it does not pass, with a remedy; empty if it passes or has no limit."""
        if self.state in ("pass", ""):
            return ""
        ends = f": {self.advice}" if self.advice else ""
        return f"{self.label} = {self.text}, must be {self.required}{self._undecided_reason}{ends}"

    @property
    def advice(self) -> str:
        """Remedy; for an undecided fact the way to decide it."""
        return "take more rays" if self.state == "undecided" else self.remedy

    def __str__(self) -> str:
        """The judgement in one line, under the name for scripts: by how much a limit is missed, and the remedy."""
        required = f"(must be {self.required})"
        if self.value is None or self.limit is None or isinstance(self.value, str):
            return f"{self.key} could not be measured {required}; {self.remedy}"
        missed = f"missed by {quantity(abs(self.value - self.limit), self.unit, digits=3)}"
        judgement = {"pass": "met", "fail": f"{missed}; {self.remedy}"}.get(
            self.state, f"undecided{self._undecided_reason}"
        )
        return f"{self.key} = {quantity(self.value, self.unit, self.standard_error)} {required}: {judgement}"

    def plain(self) -> dict[str, object]:
        """The fact as in JSON, without empty entries."""
        content = {
            "key": self.key,
            "label": self.label,
            "value": self.value,
            "unit": self.unit,
            "standard_error": self.standard_error,
            "limit": None if self.limit is None else f"{self.sense} {self.limit!r}",
            "possible": None if self.possible is None else f"{self._opposite} {self.possible!r}",
            "state": self.state,
            "note": self.note,
            "notice": self.notice,
        }
        needed = ("key", "label", "value", "unit")
        return {name: entry for name, entry in content.items() if name in needed or entry not in ("", None)}

    @property
    def _opposite(self) -> Sense:
        return _OPPOSITE[self.sense]

    @property
    def _undecided_reason(self) -> str:
        """Reason why the fact is undecided; empty if it is not."""
        if self.state != "undecided":
            return ""
        return ", too close to tell" if self.standard_error else ", without standard error: too few rays"


_FIELDS = tuple(field.name for field in fields(Fact))
_NEEDED = ("key", "label", "value", "metric", "sense", "limit", "unit", "place", "note")  # that a file must state


@dataclass(frozen=True, eq=False)
class StoredAs:
    """Marks a fact in a record: the field of the fact for each of its ``names`` in JSON, in order.

    A name of a property, such as ``holds``, is not read but follows, and a file's entry must agree. ``completed``: adds
    to the fact what no file states, such as label and state. ``if_any``: names that a file leaves out if empty.
    """

    names: Mapping[str, str]
    completed: Callable[[Fact], Fact]
    if_any: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Validate by :meth:`read`; serialise by :meth:`plain`."""
        written = core_schema.plain_serializer_function_ser_schema(self.plain)
        return core_schema.no_info_wrap_validator_function(self.read, handler(source), serialization=written)

    def plain(self, fact: Fact) -> dict[str, object]:
        """The fact as its record's file holds it."""
        entries = {name: getattr(fact, field) for name, field in self.names.items()}
        return {
            name: entry.model_dump(mode="json") if isinstance(entry, Metric) else entry
            for name, entry in entries.items()
            if entry is not None or name not in self.if_any
        }

    def read(self, content: Any, validated: Callable[[Any], Fact]) -> Fact:
        """The fact in ``content``. Raises :class:`ValueError` for a missing, unknown or contradicting entry."""
        if not isinstance(content, Mapping):
            return validated(content)
        odd = [f"{str(name)[:60]}: no such entry" for name in content if name not in self.names]
        odd += [f"{name}: missing" for name, field in self.names.items() if field in _NEEDED and name not in content]
        if odd:
            raise ValueError(odd[0])
        entries = {"key": "", "label": "", **{self.names[name]: entry for name, entry in content.items()}}
        if isinstance(metric := entries.get("metric"), Mapping):
            entries |= {name: metric.get(name) for name in ("value", "standard_error")}
        if isinstance(entries.get("value"), str):
            raise ValueError("value: must be a number")
        fact = self.completed(validated({field: entry for field, entry in entries.items() if field in _FIELDS}))
        follows = self.plain(fact)
        for name, stated in content.items():
            if self.names[name] not in _FIELDS and not agree(stated, follows[name]):
                raise ValueError(f"{name}: not as it follows from the other entries")
        return fact


@public
@dataclass(frozen=True)
class Group:
    """Facts under a title: a block of a screen, a table of a page, or one row of a table whose columns are labels.

    ``key``: name by which it is selected. ``note``: beside the title. ``state``: of all judged facts.
    """

    key: str
    title: str
    facts: tuple[Fact, ...]
    note: str = ""
    state: FactState = ""

    def select(self, *keys: str) -> "Group":
        """The group with only the facts ``keys``, in that order."""
        named = {fact.key: fact for fact in self.facts}
        return replace(self, facts=tuple(named[key] for key in keys if key in named))

    def plain(self) -> dict[str, object]:
        """The group as JSON holds it."""
        return {"key": self.key, "title": self.title, "facts": [fact.plain() for fact in self.facts]}

    @property
    def line(self) -> str:
        """All facts in one line, each behind its label."""
        return ", ".join(f"{fact.label} {fact.text}" for fact in self.facts)

    def fact(self, key: str) -> Fact:
        """The fact ``key``, which must exist."""
        return next(fact for fact in self.facts if fact.key == key)


def columns_of(groups: Iterable[Group]) -> dict[str, str]:
    """Labels of the columns of a table with a row for each of ``groups``, by the keys of their facts."""
    return {fact.key: fact.label for group in groups for fact in group.facts}


def cells_of(group: Group, columns: Mapping[str, str]) -> Iterator[Fact]:
    """A fact of ``group`` for each of ``columns``, an empty one if it has none."""
    named = {fact.key: fact for fact in group.facts}
    for key, label in columns.items():
        yield named.get(key, Fact(key, label, ""))
