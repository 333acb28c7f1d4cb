"""A gate: one number that a result must reach before the part may be called good."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

from lensforge.errors import GateFailed


@dataclass(frozen=True)
class Gate:
    """``value`` must be ``sense`` ``limit``; ``remedy`` says what to try when it is not."""

    name: str
    value: float
    sense: Literal["<=", ">="]
    limit: float
    unit: str
    remedy: str

    @property
    def passed(self) -> bool:
        """Whether the gate holds; NaN never does."""
        return self.value <= self.limit if self.sense == "<=" else self.value >= self.limit

    def __str__(self) -> str:
        verdict = "holds" if self.passed else f"fails by {abs(self.value - self.limit):.3g} {self.unit}; {self.remedy}"
        return f"{self.name} = {self.value:.6g} {self.unit} (must be {self.sense} {self.limit:g}): {verdict}"

    @staticmethod
    def from_json(entry: dict[str, Any]) -> "Gate":
        """The gate that :meth:`to_json` wrote; its verdict is derived anew."""
        return Gate(**{key: value for key, value in entry.items() if key != "passed"})

    def to_json(self) -> dict[str, Any]:
        """For the ``gates`` list of a stage's JSON file."""
        return {**asdict(self), "passed": self.passed}


def require(gates: Iterable[Gate]) -> None:
    """Raise :class:`GateFailed` naming every gate that does not hold."""
    failed = [str(gate) for gate in gates if not gate.passed]
    if failed:
        raise GateFailed("; ".join(failed))
