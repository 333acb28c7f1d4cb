"""The judgement of one limit on the light: held, missed, or undecided within its standard error."""

from typing import Literal

from lensforge.criteria import Sense
from lensforge.records import Metric, Number, Record, Text, stated

LimitState = Literal["held", "missed", "undecided"]
CERTAIN = 2.0  # standard errors; within them of a bound, a limit is undecided


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

    @stated
    def state(self) -> LimitState:
        """The judgement, by value, standard error and bound."""
        inside = (self.value.value - self.bound) * (1.0 if self.sense == ">=" else -1.0)
        error = self.value.standard_error
        if error is None or abs(inside) <= CERTAIN * error:
            return "undecided"
        return "held" if inside > 0.0 else "missed"

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit not in ("", "°") else self.unit
        return f"{self.name}: {self.quantity} {self.value}, must be {self.sense} {self.bound:g}{unit}"
