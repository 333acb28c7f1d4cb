"""Types of a record's fields: strict numbers with ranges, text, points, and metrics.

All numbers are finite and bounded: a page draws them, and a sum of them stays finite. Text is never taken for a number.
"""

import unicodedata
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from lensforge.results.array_fields import LARGEST
from lensforge.results.numerals import quantity
from lensforge.results.record import Record

_ROUNDING = 1e-9  # sums of shares may leave 0 to 1 by rounding
LARGEST_COUNT = 2**53  # a float holds every whole number up to this one
_LONGEST_TEXT = 10_000  # characters; the longest remedy of lensforge has 300, and a page shows all of a text

Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=1.0 / LARGEST, le=LARGEST)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_ROUNDING, le=1.0 + _ROUNDING)]
Count = Annotated[int, Field(strict=True, ge=0, le=LARGEST_COUNT)]
Flag = Annotated[bool, Field(strict=True)]


def printable(text: Any) -> Any:
    """``text`` with spaces for line ends and U+FFFD for what a terminal obeys or no file can hold; others as they are.

    Names of files and of their headers, from which texts are made, may have any characters and any length: what exceeds
    10,000 characters ends in an ellipsis.
    """
    if not isinstance(text, str):
        return text
    if len(text) > _LONGEST_TEXT:
        text = f"{text[: _LONGEST_TEXT - 1]}…"
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(character: str) -> str:
    if character.isprintable() or unicodedata.category(character) == "Zs":  # a thin space
        return character
    return " " if character.isspace() else "\N{REPLACEMENT CHARACTER}"


Text = Annotated[str, BeforeValidator(printable), Field(strict=True)]
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
        """Value, standard error and unit, with the digits that the error carries."""
        return quantity(self.value, self.unit, self.standard_error)


class Extent(Record):
    """Largest absolute value and root mean square of a quantity; the field's name states its unit."""

    max: NotNegative
    rms: NotNegative


State = Literal["pass", "fail", "undecided"]


Box = tuple[Point, Point]  # least and largest corner, in mm


class BodySize(Record):
    """Volume, negative where the surface faces inwards; area of the surface; least and largest corner of the box."""

    volume_mm3: Number
    area_mm2: NotNegative
    bounds_mm: Box
