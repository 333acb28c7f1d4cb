"""How much of each error a sensitivity study takes: the sizes that shops know."""

from lensforge.records import NotNegative, Number, Record


class Amounts(Record):
    """How much of each error; lengths in mm, angles in rad."""

    low_order_rms_mm: NotNegative = 1e-3
    fine_rms_mm: NotNegative = 1e-4
    decentre_mm: Number = 0.02
    tilt_rad: Number = 1e-3
    gap_mm: Number = 0.02
    source_mm: Number = 0.05
    index: Number = 1e-3
