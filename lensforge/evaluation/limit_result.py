"""The judgement of one limit on the light: held, missed, or undecided within its standard error."""

from typing import Literal

from lensforge.criteria import Sense, beyond_doubt
from lensforge.records import Metric, Number, Record, Text, stated

LimitState = Literal["held", "missed", "undecided"]


class LimitResult(Record):
    """A limit of the spec: the ``value`` that decides must be ``sense`` ``bound``, in ``unit`` ("" for a ratio).

    ``value``: of the place with the least light, or the most. ``state``: "undecided" within two standard errors of the
    bound, and without a standard error.
    """

    name: Text
    receiver: Text
    quantity: Text
    value: Metric
    sense: Sense
    bound: Number
    unit: Text

    @property
    def excess(self) -> float:
        """Distance of the value from the bound, on the wrong side of it; below 0 on the right one."""
        above = self.value.value - self.bound
        return above if self.sense == "<=" else -above

    @stated
    def state(self) -> LimitState:
        """The judgement, by value, standard error and bound."""
        missed = beyond_doubt(self.excess, self.value.standard_error)
        return "undecided" if missed is None else "missed" if missed else "held"

    @property
    def words(self) -> str:
        """The value, and what it must be."""
        unit = f" {self.unit}" if self.unit not in ("", "°") else self.unit
        return f"{self.value}, must be {self.sense} {self.bound:g}{unit}"

    def __str__(self) -> str:
        return f"{self.name}: {self.quantity} {self.words}"
