"""Acceptance criteria: numbers of a result, each with the limit that it must keep."""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any, ClassVar, Literal, Self

from pydantic import ModelWrapValidatorHandler, computed_field, model_validator

from lensforge.errors import CriterionMissed
from lensforge.results import Number, Record, Text

Sense = Literal["<=", ">="]
CERTAIN = 2.0  # standard errors; within them of a bound, nothing is decided


def within(value: float | None, sense: Sense, limit: float | None) -> bool:
    """True where ``value`` is ``sense`` ``limit``: the one judgement behind every verdict.

    ``value``: None, not measured, is never within. ``limit``: None, there is none.
    """
    if value is None:
        return False
    if limit is None:
        return True
    return value <= limit if sense == "<=" else value >= limit


def beyond_doubt(excess: float, error: float | None) -> bool | None:
    """True where a value is above its bound by ``excess``, False where below it; None where that is not certain.

    It is not within two standard errors of the bound, nor without a standard ``error``.
    """
    if error is None or abs(excess) <= CERTAIN * error:
        return None
    return excess > 0.0


class Judged(Record):
    """A ``value`` that must be ``sense`` ``limit``. A file also states the outcome; it must be that of the two."""

    outcome: ClassVar[str]  # name of the computed field that is True where the value is within the limit

    value: Number | None
    sense: Sense
    limit: Number | None
    unit: Text

    @model_validator(mode="wrap")
    @classmethod
    def _outcome_agrees(cls, content: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Compare the outcome, which a file also states, with value and limit."""
        if not isinstance(content, Mapping) or cls.outcome not in content:
            return handler(content)
        judged = handler({key: value for key, value in content.items() if key != cls.outcome})
        found, stated = within(judged.value, judged.sense, judged.limit), content[cls.outcome]
        if stated is not found:
            raise ValueError(f"{cls.outcome} = {stated!r}, but its value and limit say {found}")
        return judged


class Criterion(Judged):
    """``value`` (None: not measured) must be ``sense`` ``limit``; ``remedy``: what to try where it is not."""

    outcome: ClassVar[str] = "passed"

    name: Text
    limit: Number
    remedy: Text

    @computed_field  # type: ignore[prop-decorator]  # mypy knows no decorated properties
    @property
    def passed(self) -> bool:
        """True where the criterion is met; False where the value could not be measured."""
        return within(self.value, self.sense, self.limit)

    def __str__(self) -> str:
        if self.value is None:
            return f"{self.name} could not be measured (must be {self.sense} {self.limit:g} {self.unit}); {self.remedy}"
        verdict = "met" if self.passed else f"missed by {abs(self.value - self.limit):.3g} {self.unit}; {self.remedy}"
        return f"{self.name} = {self.value:.6g} {self.unit} (must be {self.sense} {self.limit:g}): {verdict}"


def at_most(name: str, value: float, limit: float, unit: str, remedy: str) -> Criterion:
    """The criterion ``value <= limit``; a value that is not finite counts as not measured."""
    return Criterion(name=name, value=_measured(value), sense="<=", limit=limit, unit=unit, remedy=remedy)


def at_least(name: str, value: float, limit: float, unit: str, remedy: str) -> Criterion:
    """The criterion ``value >= limit``; a value that is not finite counts as not measured."""
    return Criterion(name=name, value=_measured(value), sense=">=", limit=limit, unit=unit, remedy=remedy)


def _measured(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def require(criteria: Iterable[Criterion]) -> None:
    """Raise :class:`CriterionMissed` naming every criterion that is missed."""
    failed = [str(criterion) for criterion in criteria if not criterion.passed]
    if failed:
        raise CriterionMissed("; ".join(failed))
