"""What every section of a spec has in common."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class Section(BaseModel):
    """Immutable; a field that is not known, or a number that is not finite, is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


# From a nanometre to a kilometre, with room: squares and ratios of lengths stay within floating point.
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9)]
MillimetresOrZero = Annotated[float, Field(ge=0.0, le=1e9)]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]  # mm
