"""A gate: one number that a result must reach before the part may be called good."""

from collections.abc import Iterable, Mapping
from math import isfinite
from typing import Any, Literal

from pydantic import ModelWrapValidatorHandler, computed_field, model_validator

from lensforge.errors import GateFailed
from lensforge.records import Number, Record, Text


class Gate(Record):
    """``value`` must be ``sense`` ``limit``; None: it could not be measured. ``remedy`` says what to try then."""

    name: Text
    value: Number | None
    sense: Literal["<=", ">="]
    limit: Number
    unit: Text
    remedy: Text

    @computed_field  # type: ignore[prop-decorator]  # mypy knows no decorated properties
    @property
    def passed(self) -> bool:
        """Whether the gate holds; what could not be measured never does."""
        if self.value is None:
            return False
        return self.value <= self.limit if self.sense == "<=" else self.value >= self.limit

    @model_validator(mode="wrap")
    @classmethod
    def _verdict_follows(cls, content: Any, handler: ModelWrapValidatorHandler["Gate"]) -> "Gate":
        """A file states the verdict as well: it must be the one that value and limit give."""
        if not isinstance(content, Mapping) or "passed" not in content:
            return handler(content)
        gate = handler({key: value for key, value in content.items() if key != "passed"})
        if content["passed"] is not gate.passed:
            raise ValueError(f"passed = {content['passed']!r}, but its value and limit say {gate.passed}")
        return gate

    def __str__(self) -> str:
        if self.value is None:
            return f"{self.name} could not be measured (must be {self.sense} {self.limit:g} {self.unit}); {self.remedy}"
        verdict = "holds" if self.passed else f"fails by {abs(self.value - self.limit):.3g} {self.unit}; {self.remedy}"
        return f"{self.name} = {self.value:.6g} {self.unit} (must be {self.sense} {self.limit:g}): {verdict}"


def at_most(name: str, value: float, limit: float, unit: str, remedy: str) -> Gate:
    """The gate ``value <= limit``; a value that is not finite counts as not measured."""
    return Gate(name=name, value=_measured(value), sense="<=", limit=limit, unit=unit, remedy=remedy)


def at_least(name: str, value: float, limit: float, unit: str, remedy: str) -> Gate:
    """The gate ``value >= limit``; a value that is not finite counts as not measured."""
    return Gate(name=name, value=_measured(value), sense=">=", limit=limit, unit=unit, remedy=remedy)


def _measured(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def require(gates: Iterable[Gate]) -> None:
    """Raise :class:`GateFailed` naming every gate that does not hold."""
    failed = [str(gate) for gate in gates if not gate.passed]
    if failed:
        raise GateFailed("; ".join(failed))
