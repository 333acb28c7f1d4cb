"""What a result is made of: frozen records whose every field is typed, finite and within its range, and their files."""

from lensforge.records.arrays import Array
from lensforge.records.fields import (
    Count,
    Flag,
    NotNegative,
    Number,
    Point,
    Positive,
    Sha256,
    Share,
    Text,
)
from lensforge.records.metric import Extent, Metric, State
from lensforge.records.record import Record, Scalar
from lensforge.records.result import Given, InFile, StageResult

__all__ = [
    "Array",
    "Count",
    "Extent",
    "Flag",
    "Given",
    "InFile",
    "Metric",
    "NotNegative",
    "Number",
    "Point",
    "Positive",
    "Record",
    "Scalar",
    "Sha256",
    "Share",
    "StageResult",
    "State",
    "Text",
]
