"""Results and the files that keep them: records, criteria, facts, plots; and the sandbox that reads foreign files."""

from lensforge.results.array_fields import Array, Image, Irradiance, Line, PixelCentres, SquareImage
from lensforge.results.conditions import Conditions
from lensforge.results.fact import Bound, Fact, FactState, Group, Sense
from lensforge.results.record import Record, Scalar, stated
from lensforge.results.record_fields import (
    BodySize,
    Box,
    Count,
    Extent,
    Flag,
    Metric,
    NotNegative,
    Number,
    Point,
    Positive,
    Sha256,
    Share,
    State,
    Text,
)
from lensforge.results.stage_result import Given, InFile, SimulatedResult, StageResult

__all__ = [
    "Array",
    "BodySize",
    "Bound",
    "Box",
    "Conditions",
    "Count",
    "Extent",
    "Fact",
    "FactState",
    "Flag",
    "Given",
    "Group",
    "Image",
    "InFile",
    "Irradiance",
    "Line",
    "Metric",
    "NotNegative",
    "Number",
    "PixelCentres",
    "Point",
    "Positive",
    "Record",
    "Scalar",
    "Sense",
    "Sha256",
    "Share",
    "SimulatedResult",
    "SquareImage",
    "StageResult",
    "State",
    "Text",
    "stated",
]
