"""Agreement of the results on request: far field, sensitivity, and measurements of the part."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lensforge.agreement.comparing import differing, judged
from lensforge.evaluation.light import LightMetrics
from lensforge.evaluation.metrics import relative_square
from lensforge.far_field.photometry import Photometry, photometry_criteria
from lensforge.measurement.comparison import (
    DeviationExtent,
    PhotoComparison,
    SurfaceComparison,
    photo_criteria,
    surface_criteria,
)
from lensforge.records import Metric
from lensforge.sources.intensity import TabulatedIntensity
from lensforge.sources.photometric.beam import BEAM_SHARE, FIELD_SHARE, plane_profile, width_above
from lensforge.tolerancing.sensitivity_table import Sensitivity

_TABLE = "its table of candela"


def photometry_contradictions(found: Photometry) -> Iterator[str]:
    """Contradictions of the record of the far field: its flux adds up, in W and in lm."""
    yield from judged("criteria", found.criteria, photometry_criteria(found.files))
    spent = found.exit_w.value + sum(found.lost_w.model_dump().values()) + found.reflected_w
    yield from differing("source_w", found.source_w, spent, "its shares of flux")
    ratio = found.exit_w.value / found.source_w
    yield from differing("light_output_ratio", found.light_output_ratio.value, ratio, "its fluxes")
    yield from differing("exit_lm", found.exit_lm.value, ratio * found.source_lm, "its fluxes")
    yield from _beams(found)
    if found.per_1000_lm:
        yield from differing("source_lm", found.source_lm, 1000.0, "candela per 1000 lm")


def _beams(found: Photometry) -> Iterator[str]:
    """Axis, peak direction and widths of the beam as its table has them."""
    table = TabulatedIntensity(found.c_deg, found.gamma_deg, found.candela)
    yield from differing("axis_cd", found.axis_cd.value, float(table.values[0, 0]), _TABLE)
    direction = found.peak_direction
    there = float(np.interp(direction.gamma_deg, table.gamma_deg, table.at(direction.c_deg)))
    yield from differing("peak_direction", there, float(table.values.max()), _TABLE)
    for name, beam in (("beam_c0", found.beam_c0), ("beam_c90", found.beam_c90)):
        for field, share in (("beam_angle_deg", BEAM_SHARE), ("field_angle_deg", FIELD_SHARE)):
            stated: Metric | None = getattr(beam, field)
            width = width_above(*plane_profile(table, beam.c_deg), share * beam.peak_cd.value)
            yield from differing(f"{name}.{field}", None if stated is None else stated.value, width, _TABLE)


def sensitivity_contradictions(found: Sensitivity) -> Iterator[str]:
    """Contradictions of the table of errors: a change is the difference from the lens as designed."""
    for row in found.rows:
        yield from change_contradictions(f"rows: {row.name}: change", row.change, row.metrics, found.nominal)


def change_contradictions(name: str, change: LightMetrics, after: LightMetrics, before: LightMetrics) -> Iterator[str]:
    """Contradictions of a stated change of the light: the difference of the metrics after and before it."""
    for metric in LightMetrics.model_fields:
        stated, one, other = (getattr(each, metric) for each in (change, after, before))
        value = None if stated is None else stated.value
        derived = None if one is None or other is None else float(one.value - other.value)
        yield from differing(f"{name}.{metric}", value, derived, "its lights")


def photo_contradictions(photo: PhotoComparison) -> Iterator[str]:
    """Contradictions of the comparison with a photograph."""
    yield from judged("criteria", photo.criteria, photo_criteria(photo.clipped))
    seen = relative_square(np.stack([photo.measured, photo.simulated]))
    yield from differing("nmse", photo.nmse, seen, "its pictures")


def surface_contradictions(found: SurfaceComparison) -> Iterator[str]:
    """Contradictions of the comparison with a measured surface."""
    yield from judged("criteria", found.criteria, surface_criteria(found.used_share, found.covered_share))
    yield from _extent("point_deviation_um", found.point_deviation_um, found.distance_um)
    inside = np.isfinite(found.deviation_um)
    if not np.array_equal(inside, found.area_mm2 > 0.0):
        yield "area_mm2: above 0 at other samples than those of deviation_um"
        return
    yield from _extent("form_deviation_um", found.form_deviation_um, found.deviation_um[inside], found.area_mm2[inside])
    yield from change_contradictions("change", found.change, found.measured, found.design)
    between = relative_square(np.stack([found.irradiance_measured, found.irradiance_design]))
    yield from differing("nmse_between", found.nmse_between, between, "its pictures")


def _extent(
    name: str, stated: DeviationExtent, values: Float[np.ndarray, " n"], areas: Float[np.ndarray, " n"] | None = None
) -> Iterator[str]:
    for field, derived in DeviationExtent.of(values, areas).model_dump().items():
        yield from differing(f"{name}.{field}", getattr(stated, field), derived, "its distances")
