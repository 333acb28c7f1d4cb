"""Light in an application, linear in the intensities of its lamps: what an add-on says of its entries of a spec."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, TypeVar

from pydantic import Field

from lensforge.addon import absent_tables, usable_addons
from lensforge.public import public
from lensforge.results import Fact, Group, Record, Text
from lensforge.results.criteria import JudgedLimits
from lensforge.results.registered_kinds import add_empty_list, add_list
from lensforge.results.stage_result import StageResult
from lensforge.scene.intensity_limit import Candela, IntensityLimit
from lensforge.spec.application import Application, name_before, names_of

_Entry = TypeVar("_Entry", bound=Application)
_Record = TypeVar("_Record", bound=StageResult)
# Tables that records have had from the first on, also where they are empty: hashes of stored results count them. A new
# table is left out where it is empty, so that what was stored before it keeps its hash.
_WRITTEN_WHERE_EMPTY = {"offices", "roads", "sports"}


@public
class ApplicationJudgement(Record):
    """Light of lamps in one application. ``limits``: what its ``lighting_class`` requires, each judged.

    ``reached``: the best class of the same kind that the light has, or all of them; "none" below all.
    """

    name: Text
    lighting_class: Text
    reached: Text
    limits: JudgedLimits


_Judgement = TypeVar("_Judgement", bound=ApplicationJudgement)


@dataclass(frozen=True)
class ApplicationLight(ABC, Generic[_Entry, _Judgement]):
    """The light of equal lamps in one application, an ``entry`` of a spec.

    ``remedies``: what keeps a limit that is missed, by the phrase of its quantity.
    """

    judgement: ClassVar[type[ApplicationJudgement]]
    remedies: ClassVar[Mapping[str, str]] = {}

    entry: _Entry

    @abstractmethod
    def limits(self) -> Iterator[IntensityLimit]:
        """All that its class requires. Raises :class:`InputError` for a file of the entry that cannot be read."""

    @abstractmethod
    def judged(self, candela: Candela, name: str) -> _Judgement:
        """The light of lamps of these intensities, judged. Raises :class:`InputError` as ``limits`` does."""

    def with_remedies(self, limits: Sequence[Fact]) -> Iterator[Fact]:
        """The judged limits of the entry; those that are missed with what would keep them, by their quantity."""
        for limit in limits:
            yield replace(limit, remedy=self.remedies.get(limit.note, "")) if limit.state == "fail" else limit

    @abstractmethod
    def facts(self, judgement: _Judgement) -> Group:
        """The group of the entry beside its limits, which the light states."""

    @classmethod
    def worst(cls, entries: Sequence[_Entry], limits: Sequence[Fact]) -> Group:
        """Group of all ``entries``: their classes, and each required figure where it is worst."""
        summaries = dict.fromkeys(entry.summary for entry in entries)
        head = Fact("classes", "Class", "; ".join(summaries))
        label = entries[0].table if len(entries) > 1 else entries[0].noun
        return Group("applications", label.capitalize(), (head, *cls._worst_figures(entries, limits)))

    @classmethod
    def _worst_figures(cls, entries: Sequence[_Entry], limits: Sequence[Fact]) -> Iterator[Fact]:
        worst: dict[tuple[str, str], Fact] = {}
        names = names_of(entries)
        for limit in limits:
            name = name_before(limit.label, names)
            if name is None:
                continue
            label = limit.label.removeprefix("" if len(names) > 1 else f"{name}: ")
            place, _, figure = cls.with_place(label).rpartition(": ")
            note = f"worst: {place}" if place else ""
            fact = replace(limit, key=f"of_{entries[0].noun}", label=figure[:1].upper() + figure[1:], note=note)
            worst[figure, limit.sense] = max(worst.get((figure, limit.sense), fact), fact, key=_strain)
        yield from worst.values()

    @staticmethod
    def with_place(label: str) -> str:
        """The ``label`` of a limit, such as ``lane 1: glare TI``, with all that tells its place before the colon."""
        return label


def _strain(limit: Fact) -> float:
    """Part of an upper bound that is reached, or of what a lower one asks, its inverse."""
    part = limit.metric.value / limit.bound
    return part if limit.sense == "<=" else 1.0 / max(part, 1e-9)


def light_in(entry: Application) -> ApplicationLight[Any, Any]:
    """The light in an application, by the add-on that brought its entry."""
    return _kinds()[type(entry)](entry)


def with_judgements(record: type[_Record]) -> type[_Record]:
    """A record with a field more for each table of applications that an add-on brings: its entries, judged."""
    for entry, kind in _kinds().items():
        judged = Field(default=(), description=f"Each of the spec's {entry.table}, judged.")
        add_list(record, entry.table, kind.judgement, judged)
    for table, fault in absent_tables().items():
        add_empty_list(record, table, fault)
    tables = {entry.table for entry in _kinds()} | set(absent_tables())
    record.omit_if_empty = (*record.omit_if_empty, *sorted(tables - _WRITTEN_WHERE_EMPTY))
    return record


def _kinds() -> dict[type[Application], type[ApplicationLight[Any, Any]]]:
    return {entry: kind for addon in usable_addons() for entry, kind in addon.light().items()}
