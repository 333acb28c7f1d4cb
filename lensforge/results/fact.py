"""Facts: what a result says, each with label, value, unit, standard error, limit, state and note.

Page, screen, notebook, drawing and ``--json`` show these, and nothing else shows a number of a result.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from lensforge.results.numerals import NOTHING, anything, quantity
from lensforge.results.record import Metric, State

Sense = Literal["<=", ">="]
FactState = State | Literal[""]  # "": nothing was asked, or nobody has judged it
_SIGNS: dict[Sense, str] = {"<=": "≤", ">=": "≥"}
_DIGITS = 4  # significant digits of a number without standard error


@dataclass(frozen=True)
class Bound:
    """A value must be, or by physics is, ``sense`` ``value``; ``note``: where that comes from."""

    sense: Sense
    value: float
    note: str = ""

    def text(self, unit: str, digits: int = _DIGITS) -> str:
        """The bound with its sign and ``unit``."""
        return f"{_SIGNS[self.sense]} {quantity(self.value, unit, digits=digits)}"


@dataclass(frozen=True)
class Fact:
    """One figure of a result.

    ``key``: name by which a page or a screen selects it. ``value``: in ``unit``, "%" for a share; None where it could
    not be measured; text where it is no number. ``limit``: what it must keep, ``possible``: what physics allows.
    ``state``: of the judgement by the limit, "" where there is none. ``remedy``: what to try where it fails.
    """

    key: str
    label: str
    value: float | str | None
    unit: str = ""
    standard_error: float | None = None
    limit: Bound | None = None
    possible: Bound | None = None
    state: FactState = ""
    note: str = ""
    remedy: str = ""
    digits: int = _DIGITS

    @staticmethod
    def measured(key: str, label: str, metric: Metric | None, note: str = "", **more: Any) -> "Fact":
        """The fact of a ``metric``; None where it has no meaning."""
        if metric is None:
            return Fact(key, label, None, note=note, **more)
        return Fact(key, label, metric.value, metric.unit, metric.standard_error, note=note, **more)

    @staticmethod
    def share(key: str, label: str, share: Metric | float | None, note: str = "", **more: Any) -> "Fact":
        """The fact of a share, in per cent."""
        if share is None:
            return Fact(key, label, None, "%", note=note, **more)
        metric = share if isinstance(share, Metric) else Metric(value=share)
        error = None if metric.standard_error is None else 100.0 * metric.standard_error
        return Fact(key, label, 100.0 * metric.value, "%", error, note=note, **more)

    @property
    def text(self) -> str:
        """Value with standard error and unit, as every page and screen shows it."""
        if self.value is None:
            return NOTHING if self.limit is None else "not measured"
        if isinstance(self.value, str | bool):
            return anything(self.value)
        return quantity(self.value, self.unit, self.standard_error, self.digits)

    @property
    def asked(self) -> str:
        """The limit as text."""
        return NOTHING if self.limit is None else self.limit.text(self.unit, self.digits)

    @property
    def bounded_by(self) -> str:
        """The bound that physics sets, as text."""
        return NOTHING if self.possible is None else self.possible.text(self.unit, self.digits)

    @property
    def sentence(self) -> str:
        """Value, limit, what is possible, and note in one line, as a screen shows them behind the label."""
        beside = [f"asked {self.asked}"] if self.limit is not None else []
        beside += [f"possible {self.bounded_by}"] if self.possible is not None else []
        words = f"{self.text} ({', '.join(beside)})" if beside else self.text
        return f"{words}; {self.note}" if self.note else words

    @property
    def reason(self) -> str:
        """Reason why it does not pass, with what to try; empty where it passes or nothing judges it."""
        if self.state in ("pass", ""):
            return ""
        doubt = ""
        if self.state == "undecided":
            doubt = ", too close to tell" if self.standard_error else ", without standard error: too few rays"
        ends = f": {self.remedy}" if self.remedy else ""
        return f"{self.label} = {self.text}, must be {self.asked}{doubt}{ends}"

    def plain(self) -> dict[str, object]:
        """The fact as JSON holds it, without what it lacks."""
        content = {
            "key": self.key,
            "label": self.label,
            "value": self.value,
            "unit": self.unit,
            "standard_error": self.standard_error,
            "limit": None if self.limit is None else f"{self.limit.sense} {self.limit.value!r}",
            "possible": None if self.possible is None else f"{self.possible.sense} {self.possible.value!r}",
            "state": self.state,
            "note": self.note,
        }
        needed = ("key", "label", "value", "unit")
        return {name: entry for name, entry in content.items() if name in needed or entry not in ("", None)}


@dataclass(frozen=True)
class Group:
    """Facts under a title: a block of a screen, a table of a page, or one row of a table whose columns are labels.

    ``key``: name by which it is selected. ``note``: beside the title. ``state``: of all of them, where they are judged.
    """

    key: str
    title: str
    facts: tuple[Fact, ...]
    note: str = ""
    state: FactState = ""

    def select(self, *keys: str) -> "Group":
        """The group with the facts called ``keys`` alone, in that order."""
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
        """The fact called ``key``, which it has."""
        return next(fact for fact in self.facts if fact.key == key)


def columns_of(groups: Iterable[Group]) -> dict[str, str]:
    """Labels of the columns of a table whose rows are ``groups``, by the keys of their facts."""
    return {fact.key: fact.label for group in groups for fact in group.facts}


def cells_of(group: Group, columns: Mapping[str, str]) -> Iterator[Fact]:
    """A fact of ``group`` for each of ``columns``, an empty one where it has none."""
    named = {fact.key: fact for fact in group.facts}
    for key, label in columns.items():
        yield named.get(key, Fact(key, label, ""))
