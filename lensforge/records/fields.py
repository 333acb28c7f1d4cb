"""Types of a record's fields: strict, so that a text is never taken for a number, and each with its range."""

from typing import Annotated

from pydantic import Field

_ROUNDING = 1e-9  # sums of shares may leave 0 to 1 by that much

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-_ROUNDING, le=1.0 + _ROUNDING)]
Count = Annotated[int, Field(strict=True, ge=0)]
Flag = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True)]
Sha256 = Annotated[str, Field(strict=True, pattern=r"^[0-9a-f]{64}$")]
Point = tuple[Number, Number, Number]  # x, y, z in mm
