"""Acceptance criteria: numbers of a result, each with its limit, and their labels."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import isfinite
from typing import Annotated

from lensforge.errors import CriterionMissed
from lensforge.results.fact import Fact, FactState, StoredAs
from lensforge.results.verdict import Reason, worst

_YES = " (1: yes)"  # ends the words of a question
_LABELS = {
    "cavity clearance": "cavity clearance over the LED",
    "wall margin": "wall thickness above its minimum",
    "radius margin": "outer radius below its maximum",
    "largest wall margin": "wall thickness below its maximum",
    "height margin": "height, below its maximum",
    "keep out clearance": "clearance to the keep-out solid",
}


# Of a face, after its name.
_OF_FACE = {
    "curvature margin": "concave radii of the {} face above that of the tool",
    "draft margin": "draft of the {} face, counted to 30° at most, above its minimum",
}


_Declared = Callable[[], Iterable[tuple[str, str]]]
_not_read: list[_Declared] = []  # names and labels, in the order of their declarations


def declare_labels(declared: _Declared) -> None:
    """Register names and labels of criteria, as ``declared`` by their fields; it is called for the first label."""
    _not_read.append(declared)


def label_of(name: str) -> str:
    """Label of a criterion by its name, which may begin with its face, its file or its receiver."""
    while _not_read:
        _LABELS.update(_not_read.pop(0)())
    receiver, colon, short = name.rpartition(": ")
    face, _, of_face = short.partition(" ")
    if of_face in _OF_FACE:
        return f"{receiver}{colon}{_OF_FACE[of_face].format(face)}"
    return f"{receiver}{colon}{_LABELS.get(short, short.replace('_', ' '))}"


def _completed(criterion: Fact) -> Fact:
    """The criterion with its label and its state; a value without standard error is exact."""
    if criterion.limit is None:
        raise ValueError("limit: must be a number")
    name = criterion.key
    return replace(criterion, label=label_of(name), note=name.replace("_", " ")).judged(criterion.standard_error or 0.0)


_NAMES = {name: name for name in ("value", "standard_error", "sense", "limit", "unit", "tolerance")}
_STORED = StoredAs(_NAMES | {"name": "key", "remedy": "remedy", "passed": "holds"}, _completed, ("standard_error",))
Criteria = tuple[Annotated[Fact, _STORED], ...]


def _judged(limit: Fact) -> Fact:
    """The limit with its state: undecided within two standard errors of its bound, and without a standard error."""
    if limit.limit is None or limit.value is None:
        raise ValueError("value and bound: must be numbers")
    return replace(limit, label=limit.key).judged(limit.standard_error)


_OF_LIMITS = {"name": "key", "receiver": "place", "quantity": "note", "value": "metric", "sense": "sense"}
_STORED_LIMIT = StoredAs(_OF_LIMITS | {"bound": "limit", "unit": "unit", "state": "outcome"}, _judged)
JudgedLimits = tuple[Annotated[Fact, _STORED_LIMIT], ...]


_OF_FIGURES = {"name": "key", "receiver": "place", "quantity": "note", "value": "metric", "unit": "unit"}
_STORED_FIGURE = StoredAs(_OF_FIGURES, lambda figure: replace(figure, label=figure.key))
StatedFigures = tuple[Annotated[Fact, _STORED_FIGURE], ...]


def at_most(
    name: str, value: float, limit: float, unit: str, remedy: str, tolerance: float = 0.0, error: float | None = None
) -> Fact:
    """The criterion ``value <= limit``, to ``tolerance``; a value that is not finite counts as not measured.

    ``error``: standard error of the value, None if it is exact; a value within two errors of the limit is undecided.
    """
    measured = float(value) if isfinite(value) else None
    criterion = Fact(name, "", measured, unit, error, limit=float(limit), remedy=remedy, tolerance=float(tolerance))
    return _completed(criterion)


def at_least(
    name: str, value: float, limit: float, unit: str, remedy: str, tolerance: float = 0.0, error: float | None = None
) -> Fact:
    """The criterion ``value >= limit``, otherwise as :func:`at_most`."""
    return _completed(replace(at_most(name, value, limit, unit, remedy, tolerance, error), sense=">="))


def under(start: str, criterion: Fact) -> Fact:
    """The ``criterion`` with its name prefixed by ``start``."""
    return _completed(replace(criterion, key=f"{start}: {criterion.key}"))


def shown(criterion: Fact) -> Fact:
    """The ``criterion`` for a page; a question is shown by its answer."""
    question = criterion.label.removesuffix(_YES)
    return criterion if question == criterion.label else replace(criterion, label=question).answered


def missed(criteria: Iterable[Fact]) -> Iterator[Reason]:
    """A reason for each of the ``criteria`` that is missed or undecided."""
    for criterion in criteria:
        if criterion.state in ("fail", "undecided"):
            yield criterion.state, str(criterion)


def named(criteria: Iterable[Fact], name: str) -> Fact | None:
    """The criterion ``name``; None if there is none."""
    return next((criterion for criterion in criteria if criterion.key == name), None)


def state_of(criteria: Iterable[Fact], *names: str) -> FactState:
    """The joint state of those ``criteria`` called ``names``; ``""`` if there are none."""
    states = [criterion.state for criterion in criteria if criterion.key in names and criterion.state != ""]
    return worst(states) if states else ""


def require(criteria: Iterable[Fact]) -> None:
    """Raise :class:`CriterionMissed` naming every missed criterion."""
    failed = [str(criterion) for criterion in criteria if criterion.state == "fail"]
    if failed:
        raise CriterionMissed("; ".join(failed))
