"""Records: frozen, every field typed, finite and within its range; a stage's result is a record with files."""

from lensforge.records.arrays import Array, Image, Irradiance, Line, PixelCentres, SquareImage
from lensforge.records.body import BodySize, Box
from lensforge.records.conditions import Conditions
from lensforge.records.fields import (
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
from lensforge.records.record import Record, Scalar, stated
from lensforge.records.result import Given, InFile, SimulatedResult, StageResult

__all__ = [
    "Array",
    "BodySize",
    "Box",
    "Conditions",
    "Count",
    "Extent",
    "Flag",
    "Given",
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
    "Sha256",
    "Share",
    "SimulatedResult",
    "SquareImage",
    "StageResult",
    "State",
    "Text",
    "stated",
]
