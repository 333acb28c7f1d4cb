"""Tables of facts: a row says where in a record the value of a fact stands, what limits it, and how it is told."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from lensforge.results.criteria import named, state_of
from lensforge.results.fact import Fact
from lensforge.results.figure import TEXTS, entry_at
from lensforge.results.numerals import unit_of
from lensforge.results.record import Metric, Sense


@dataclass(frozen=True)
class Row:
    """One row: the fact called ``key`` on what stands at ``source`` in a record, dotted.

    Texts may have {words}, and figures of the record in its units, to so many digits: {form_error_nm.rms:2}. ``unit``:
    by default that of the source's name; a share is shown in "%". ``limit``: where in the spec its limit stands, and
    ``by`` the name of the criterion that has its state; ``like``: of a criterion on the same value, which has
    both. ``factor``: from the unit of the source to ``unit``. ``none``: shown where nothing stands there; without it
    the row is left out.
    """

    key: str
    label: str
    source: str
    note: str = ""
    unit: str | None = None
    digits: int = 4
    like: str = ""
    limit: str = ""
    sense: Sense = "<="
    by: str = ""
    factor: float = 1.0
    none: str | None = None

    def fact(self, record: object, spec: object, judged: Sequence[Fact], words: Mapping[str, str]) -> Fact | None:
        """The fact of ``record``; None where the row is left out."""
        value: Any = entry_at(record, self.source)
        value = self.none if value is None else value
        if value is None:
            return None
        key, label, note = (TEXTS.vformat(text, [record], words) for text in (self.key, self.label, self.note))
        if self.unit == "%":
            fact = Fact.share(key, label, value, note)
        elif isinstance(value, Metric):
            fact = Fact.measured(key, label, value, note)
        else:
            unit = unit_of(self.source.split(".")) if self.unit is None else self.unit
            fact = Fact(key, label, value if self.factor == 1.0 else self.factor * value, unit, note=note)
        fact = replace(fact, digits=self.digits)
        if self.like:
            return fact.judged_as(named(judged, self.like))
        limit = entry_at(spec, self.limit.format_map(words)) if self.limit else None
        if limit is None and self.limit:
            return replace(fact, sense=self.sense)
        why = [
            criterion.note
            for criterion in judged
            if criterion.key == self.by and criterion.value is None and criterion.state == "fail"
        ]
        state = state_of(judged, self.by)  # for another reason than this value where the judgement has none
        return replace(fact, sense=self.sense, limit=limit, state=state, note="; ".join(filter(None, [note, *why])))


def facts_of(
    record: object, rows: Iterable[Row], *, spec: object = None, judged: Iterable[Fact] = (), **words: str
) -> Iterator[Fact]:
    """The facts of ``record`` by its table; ``judged``: criteria or findings on it, ``words``: for its texts."""
    judged = tuple(judged)
    return (fact for row in rows if (fact := row.fact(record, spec, judged, words)) is not None)
