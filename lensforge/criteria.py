"""Acceptance criteria: numbers of a result, each with the limit that it must keep."""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any, Literal

from pydantic import ModelWrapValidatorHandler, computed_field, model_validator

from lensforge.errors import CriterionMissed
from lensforge.records import Number, Record, Text


class Criterion(Record):
    """``value`` (None: not measured) must be ``sense`` ``limit``; ``remedy``: what to try where it is not."""

    name: Text
    value: Number | None
    sense: Literal["<=", ">="]
    limit: Number
    unit: Text
    remedy: Text

    @computed_field  # type: ignore[prop-decorator]  # mypy knows no decorated properties
    @property
    def passed(self) -> bool:
        """True where the criterion is met; False where the value could not be measured."""
        if self.value is None:
            return False
        return self.value <= self.limit if self.sense == "<=" else self.value >= self.limit

    @model_validator(mode="wrap")
    @classmethod
    def _passed_agrees(cls, content: Any, handler: ModelWrapValidatorHandler["Criterion"]) -> "Criterion":
        """Compare ``passed``, which a file also states, with value and limit."""
        if not isinstance(content, Mapping) or "passed" not in content:
            return handler(content)
        criterion = handler({key: value for key, value in content.items() if key != "passed"})
        if content["passed"] is not criterion.passed:
            raise ValueError(f"passed = {content['passed']!r}, but its value and limit say {criterion.passed}")
        return criterion

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
