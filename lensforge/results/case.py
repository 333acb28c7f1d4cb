"""A case: a result in one state and on one receiver, and its names in titles, criteria and files."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from lensforge.results.criteria import under
from lensforge.results.fact import Fact
from lensforge.results.figure import facts_in
from lensforge.results.record import Record

_Result = TypeVar("_Result", bound=Record)


@dataclass(frozen=True, eq=False)
class Case(Generic[_Result]):
    """Result in one state, alone or with one of its records, such as that of a receiver.

    Attributes:
        result: in this state; that in the first state has the others, too.
        record: of the receiver; None for the whole result.
        led: name of the state, which may be that of an LED; empty where there is one alone.
        name: of the record; empty where there is one alone.
        number: of the record or, for the whole result, of the state; figures of the whole are told beside the first, 0.
    """

    result: _Result
    record: Any = None
    led: str = ""
    name: str = ""
    number: int = 0

    def among(self, field: str) -> "Iterator[Case[_Result]]":
        """One case for each record in a ``field`` of the result, such as "receivers"."""
        records = getattr(self.result, field)
        for number, record in enumerate(records):
            yield replace(self, record=record, name=record.name if len(records) > 1 else "", number=number)

    @property
    def key(self) -> str:
        """Name of the case for criteria and files; empty for the first case."""
        return (self.name or self.led) if self.number else ""

    @property
    def suffix(self) -> str:
        """End of the names of its files."""
        return f"_{self.key}" if self.key else ""

    def title(self, text: str) -> str:
        """Title ``text`` with the names of state and record."""
        return ", ".join(filter(None, (text, self.led, self.name)))

    def named(self, criterion: Fact) -> Fact:
        """A criterion of the case under the name that it has among all criteria."""
        return under(self.key, criterion) if self.key else criterion

    @property
    def criteria(self) -> list[Fact]:
        """Criteria of the case without its name; for the first case also those of the whole result."""
        criteria = list[Fact](getattr(self.result, "criteria", ()))
        if self.record is None:
            return criteria
        start = f"{self.record.name}: "
        named = (criterion for criterion in criteria if criterion.key.startswith(start))
        alone = [replace(criterion, key=criterion.key.removeprefix(start)) for criterion in named]
        return alone if self.number else [*alone, *criteria]

    def facts(self, *given: Any) -> Iterator[Fact]:
        """The figures of the case, as facts; ``given``: further arguments of functions at their declarations."""
        return facts_in(self.result, self.criteria, self.record, *given)
