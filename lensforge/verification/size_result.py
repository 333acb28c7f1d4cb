"""Results on the files of the part: the size of the body in each, and the fault that was recognised in it."""

from lensforge.records import BodySize, NotNegative, Record, Text


class SizedFile(Record):
    """Size of the body in one file; what flat facets may change of it: a height (mm), volume and area, 0 for a STEP."""

    size: BodySize
    chord_mm: NotNegative = 0.0
    facets_mm3: NotNegative = 0.0
    facets_mm2: NotNegative = 0.0


class Sizes(Record):
    """Size of the part in its files, and as exported: the box of that within ``chord_mm`` of the solid's."""

    exported: BodySize
    chord_mm: NotNegative
    mesh: SizedFile
    step: SizedFile | None


class Faults(Record):
    """Fault that was recognised in each file where its light is not the design's; empty where none was."""

    mesh: Text = ""
    step: Text = ""
