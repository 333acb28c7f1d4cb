"""Section on a face corrected for its second cut, as facts and pictures."""

import numpy as np

from lensforge.light.evaluation_result import LightMetrics
from lensforge.made.correction_result import Correction
from lensforge.report import surface_figures
from lensforge.report.numerals import number, number_with_error, percent
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.proof import Facts
from lensforge.results import Extent


def correction_facts(made: Correction) -> Facts:
    """Facts on the corrected face: errors before and after, filter, cutter, and the expected light."""
    chosen = "given" if made.wavelength_given else "by the noise of the points"
    cutter = made.cutter
    facts = [
        ("File", _file(made)),
        ("Deviation of the first cut", _extent(made.deviation_um)),
        ("Correction", f"{_extent(made.correction_um)}, gain {number(made.gain, 3)}"),
        ("Expected deviation of the second cut", _extent(made.expected_um)),
        ("Filter", f"waves longer than {number(made.wavelength_mm, 3)} mm, {chosen}"),
        (
            "Left out by the filter",
            f"{number(made.residual_rms_um, 2)} µm rms; noise of the points {number(made.noise_rms_um, 2)} µm",
        ),
        (
            "Registration, no part of the correction",
            {"none": "none, by datums"}.get(made.registration, made.registration),
        ),
        (
            "Smallest concave radius",
            f"{_radius(cutter.concave_radius_mm)}, designed {_radius(cutter.concave_radius_before_mm)}, "
            f"cutter {number(cutter.cutter_radius_mm, 3)} mm",
        ),
        (
            "NMSE expected",
            f"{number_with_error(made.second_cut.nmse, 3)}, designed {number(made.design.nmse.value, 3)}",
        ),
        (
            "Efficiency expected",
            f"{percent(made.second_cut.efficiency.value, 2)}, designed {percent(made.design.efficiency.value, 2)}",
        ),
    ]
    if cutter.smoothed_more_share > 0.0:
        # Before the two facts on the light.
        back = f"{_extent(cutter.cut_back_um)} on {percent(cutter.smoothed_more_share)} of the face"
        facts.insert(-2, ("Cut back for the cutter", back))
    return [*facts, *light_changes(made.change)]


def light_changes(change: LightMetrics) -> Facts:
    """Facts on the light's change from the design by the same rays, with the error of the difference."""
    return [
        ("NMSE, change from the design", number_with_error(change.nmse, 3)),
        ("Efficiency, change from the design", number_with_error(change.efficiency, 3)),
    ]


def correction_pictures(made: Correction) -> list[PagePicture]:
    """Maps of the deviation, the correction, and the deviation expected of the second cut."""
    maps = {
        "first": (made.deviation_map_um, "Deviation of the first cut"),
        "correction": (made.correction_map_um, "Correction"),
        "second": (made.expected_map_um, "Expected deviation of the second cut"),
    }
    return [
        picture(
            f"{name}-cut-{made.surface}", surface_figures.form_map(np.transpose(values)), title, "Along the normal."
        )
        for name, (values, title) in maps.items()
        if np.isfinite(values).any()
    ]


def _file(made: Correction) -> str:
    """The file's name and form error, and the scale that a mould insert asks for."""
    error = number(made.form_error_nm.max, 2)
    under = "" if made.conditions is None else f"_{made.conditions.name}"
    name = f"lens_corrected_{made.surface}{under}.step, {made.step_schema}, form error {error} nm as read back"
    return name if made.scale == 1.0 else f"{name}; it is the lens, to be scaled by {made.scale:.12g} for the mould"


def _extent(extent: Extent) -> str:
    return f"{number(extent.rms, 3)} µm rms, {number(extent.max, 3)} µm at most"


def _radius(radius_mm: float | None) -> str:
    return "none" if radius_mm is None else f"{number(radius_mm, 4)} mm"
