"""A correction of the inner face for its second cut, with numbers that are easy to recognise."""

from filled import filled
from part_files import make_surface

from lensforge.cad.part import stamp_of
from lensforge.made.measurement_result import Correction


def make_correction(lens):
    """The record of a correction of ``lens``."""
    surface = make_surface(lens)
    maps = {f"{name}_map_um": surface.deviation_um for name in ("deviation", "correction", "expected")}
    return filled(
        Correction,
        **{name: getattr(surface, name) for name in ("inputs", "pose", "chart", "area_mm2")},
        **maps,
        surface="inner",
        scale=1.0,
        wavelength_given=False,
        nodes={"inner": 33, "outer": 65},
        file=stamp_of(b"a STEP"),
        step=b"a STEP",
    )
