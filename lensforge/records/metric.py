"""A measured number and how well it is known."""

from typing import Literal

from lensforge.records.fields import NotNegative, Number, Text
from lensforge.records.record import Record


class Metric(Record):
    """``value`` in ``unit`` ("" for a ratio) and its standard error; None where one sample alone was taken."""

    value: Number
    unit: Text = ""
    standard_error: NotNegative | None = None

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        error = "" if self.standard_error is None else f" ± {self.standard_error:.2g}"
        return f"{self.value:.6g}{error}{' ' if self.unit else ''}{self.unit}"


class Extent(Record):
    """Largest absolute value and root mean square of a quantity; its unit stands in the name of the field."""

    max: NotNegative
    rms: NotNegative


State = Literal["pass", "fail", "undecided"]
