"""Size of a body by which two files of it are compared: volume, area of its surface, and the box around it."""

from lensforge.records.fields import NotNegative, Number, Point
from lensforge.records.record import Record

Box = tuple[Point, Point]  # least and largest corner, in mm


class BodySize(Record):
    """Volume, negative where the surface faces inwards; area of the surface; least and largest corner of the box."""

    volume_mm3: Number
    area_mm2: NotNegative
    bounds_mm: Box
