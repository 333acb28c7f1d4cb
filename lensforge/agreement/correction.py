"""Agreement of a correction for a second cut with its maps, its file, and the spec of its lens."""

from collections.abc import Iterator

from lensforge.agreement.comparing import differing, judged, unlike
from lensforge.agreement.studies import change_contradictions
from lensforge.geometry.part import stamp_of
from lensforge.lens import Lens
from lensforge.measurement.comparison import area_extent
from lensforge.measurement.correction_result import Correction, correction_criteria


def correction_contradictions(found: Correction, lens: Lens) -> Iterator[str]:
    """Contradictions of the record of a correction."""
    form, normal = found.form_error_nm.max, found.normal_error_mrad.max
    change = found.step_volume_change
    criteria = correction_criteria(found.used_share, found.covered_share, form, normal, change, found.cutter)
    yield from judged("criteria", found.criteria, criteria)
    yield from unlike("make", found.make, lens.spec.manufacture.make, "the spec says")
    yield from unlike("scale", found.scale, lens.spec.manufacture.scale, "the spec says")
    cutter_mm = lens.spec.manufacture.cutter_radius_mm
    yield from unlike("cutter.cutter_radius_mm", found.cutter.cutter_radius_mm, cutter_mm, "the spec says")
    if found.file != stamp_of(found.step):
        yield "file: the STEP file beside it is another one"
    for name in ("deviation", "correction", "expected"):
        stated, derived = getattr(found, f"{name}_um"), area_extent(getattr(found, f"{name}_map_um"), found.area_mm2)
        for field in ("max", "rms"):
            yield from differing(
                f"{name}_um.{field}", getattr(stated, field), getattr(derived, field), "its map and area"
            )
    yield from change_contradictions("change", found.change, found.second_cut, found.design)
