"""Types of a record's fields: numbers with ranges, strict (text is never taken for a number), and metrics."""

from typing import Annotated, Literal

from pydantic import Field

from lensforge.records.record import Record

_ROUNDING = 1e-9  # sums of shares may leave 0 to 1 by rounding

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_ROUNDING, le=1.0 + _ROUNDING)]
Count = Annotated[int, Field(strict=True, ge=0)]
Flag = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True)]
Sha256 = Annotated[str, Field(strict=True, pattern=r"^[0-9a-f]{64}$")]
Point = tuple[Number, Number, Number]  # x, y, z in mm


class Metric(Record):
    """``value`` in ``unit`` ("" for a ratio) and its standard error; None where there was only one sample."""

    value: Number
    unit: Text = ""
    standard_error: NotNegative | None = None

    def __float__(self) -> float:
        return self.value

    def __str__(self) -> str:
        error = "" if self.standard_error is None else f" ± {self.standard_error:.2g}"
        return f"{self.value:.6g}{error}{' ' if self.unit else ''}{self.unit}"


class Extent(Record):
    """Largest absolute value and root mean square of a quantity; the field's name states its unit."""

    max: NotNegative
    rms: NotNegative


State = Literal["pass", "fail", "undecided"]
