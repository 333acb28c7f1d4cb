"""Facts of the machined part: a photograph of its light, its measured faces, a face corrected for a second cut."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from lensforge.cad.face_tolerance import FINEST_MRAD, FINEST_NM
from lensforge.cad.part_limits import ROUND_TRIP_LIMIT
from lensforge.light.evaluation_result import LightMetrics
from lensforge.light.light_facts import change_facts, metric_facts
from lensforge.light.receiver_light import METRICS
from lensforge.made.measurement_result import (
    KEPT,
    Correction,
    CutterLimit,
    MeasuredLight,
    PhotoComparison,
    SurfaceComparison,
    surface_criteria,
)
from lensforge.results import Fact, Group
from lensforge.results.criteria import Criteria, at_least, at_most, state_of
from lensforge.results.fact_table import Row, facts_of
from lensforge.results.numerals import percent, quantity

FIRST = 4  # facts of a group that a page shows at once


def photo_facts(photo: PhotoComparison) -> Group:
    """Facts from the photograph of the part's light."""
    return Group("photo", "A photograph of its light", tuple(_photo(photo)))


def surface_facts(surface: SurfaceComparison) -> Group:
    """Facts from measured points on one face, and the light with it."""
    alone = MeasuredLight(design=surface.design, measured=surface.measured, change=surface.change)
    facts = (*_points(surface), *_lights(surface.by_led or {"": alone}, "with this face"))
    return Group("measured", f"The {surface.surface} face, measured", facts)


def correction_facts(made: Correction) -> Group:
    """Facts on a corrected face: errors before and after, filter, cutter, and the expected light."""
    alone = MeasuredLight(design=made.design, measured=made.second_cut, change=made.change)
    facts = (*_cut(made), *_lights(made.by_led or {"": alone}, "expected"))
    return Group("corrected", f"The {made.surface} face, corrected for a second cut", facts)


_PHOTO = (
    Row("ssim", "Similarity (SSIM)", "ssim", "to the simulation; 1 is equal", digits=3),
    Row("photo_nmse", "NMSE against simulation", "nmse", digits=3),
    Row("displacement_x_mm", "Shift in x", "alignment.displacement_x_mm"),
    Row("displacement_y_mm", "Shift in y", "alignment.displacement_y_mm"),
    Row("scale", "Scale", "alignment.scale", "measured/simulated"),
    Row("rotation_deg", "Rotation", "alignment.rotation_deg", "counter-clockwise"),
    Row("aligned_ssim", "SSIM after alignment", "aligned.ssim", digits=3),
    Row("aligned_nmse", "NMSE after alignment", "aligned.nmse", digits=3),
    Row("photo_uniformity", "Uniformity, measured", "measured_evenness.uniformity", "simulated {simulated}", digits=3),
)
_CLIPPED = Row("clipped", "Saturated pixels", "clipped", "of the target", "%", by="photo_clipped", digits=3)


def _photo(photo: PhotoComparison) -> Iterator[Fact]:
    files = photo.on if photo.off is None else f"{photo.on} minus {photo.off}"
    yield Fact("photographs", "Photographs", files, note=f"with the LED {photo.led}" if photo.led else "")
    yield from facts_of(photo, _PHOTO, simulated=quantity(photo.simulated_evenness.uniformity, digits=3))
    if photo.likely_cause:
        yield Fact("cause", "Likely cause", photo.likely_cause)
    yield from facts_of(photo, [_CLIPPED], judged=photo.criteria)
    yield Fact("corners", "Target’s corners", _corners(photo))


def _corners(photo: PhotoComparison) -> str:
    located = photo.corners_located
    if located is None:
        return "given"
    where = {"on": "the photograph with the LED on", "off": "the photograph with the LED off"}
    straight = quantity(located.edge_rms_px, "pixels rms", digits=2)
    return f"found in {where.get(located.seen_in, located.seen_in)}, edges straight to {straight}"


def _points(surface: SurfaceComparison) -> Iterator[Fact]:
    form = surface.form_deviation_um
    state = state_of(surface.criteria, "points_used", "surface_covered")
    yield Fact("points", "Points", surface.point_count, note=f"{percent(surface.used_share)} of them on the face")
    yield Fact.share("covered", "Face measured", surface.covered_share, digits=3)
    rms = quantity(form.rms, "µm", digits=3)
    yield Fact("form", "Form deviation", form.pv, "µm", state=state, note=f"PV of the smooth form; {rms} rms", digits=3)
    yield Fact("residual", "Residual of the points", surface.residual_rms_um, "µm", note="rms", digits=2)
    yield Fact("registration", "Registration", _registration(surface.registration))


_CUT = (
    Row("first_cut", "Deviation, first cut", "deviation_um.rms", "rms, {deviation_um.max:3} at most", digits=3),
    Row("correction", "Correction", "correction_um.rms", "rms, {correction_um.max:3} at most; gain {gain:3}", digits=3),
    Row("second_cut", "Expected, second cut", "expected_um.rms", "rms, {expected_um.max:3} at most", digits=3),
    Row("filter", "Filter", "wavelength_mm", "longer waves pass; {chosen}", digits=3),
    Row("left_out", "Left out by the filter", "residual_rms_um", "rms; noise of the points {noise_rms_um:2}", digits=2),
)
_OF_CUTTER = (
    Row(
        "concave",
        "Min. concave radius",
        "concave_radius_mm",
        "designed {before}, cutter {cutter_radius_mm:3}",
        none="none",
    ),
    Row("cut_back", "Cut back for the ball", "cut_back_um.rms", "rms, {cut_back_um.max:3} at most; {on}", digits=3),
)


def _cut(made: Correction) -> Iterator[Fact]:
    cutter, chosen = made.cutter, "given" if made.wavelength_given else "from the noise of the points"
    yield _file(made)
    yield from facts_of(made, _CUT, chosen=chosen)
    yield Fact("registration", "Registration", _registration(made.registration), note="not included in the correction")
    before, on = cutter.concave_radius_before_mm, f"on {percent(cutter.smoothed_more_share)} of the face"
    designed = "none" if before is None else quantity(before, "mm", digits=4)
    rows = _OF_CUTTER if cutter.smoothed_more_share > 0.0 else _OF_CUTTER[:1]
    yield from facts_of(cutter, rows, before=designed, on=on)


def _file(made: Correction) -> Fact:
    """The file's name and form error, and the scale that a mould insert needs."""
    under = "" if made.conditions is None else f"_{made.conditions.name}"
    error = f"{made.step_schema}, form error {quantity(made.form_error_nm.max, 'nm', digits=2)} as read back"
    scaled = f"; it is the lens, to be scaled by {quantity(made.scale, digits=12)} for the mould"
    note = error if made.scale == 1.0 else f"{error}{scaled}"
    return Fact("file", "File", f"lens_corrected_{made.surface}{under}.step", note=note)


def _registration(kind: str) -> str:
    return {"none": "none, by datums"}.get(kind, kind)


def _lights(by_led: Mapping[str, MeasuredLight], how: str) -> Iterator[Fact]:
    """Metrics of the last light with each LED, and their changes; its name ends keys and labels."""
    for led, light in by_led.items():
        last = light.corrected or light.measured
        for fact in (*_against(last, light.design, how), *change_facts(light.change)):
            yield replace(fact, key=f"{fact.key}_{led}", label=f"{fact.label}, {led}") if led else fact


def _against(light: LightMetrics, design: LightMetrics, how: str) -> Iterator[Fact]:
    designed = {fact.key: fact.text for fact in metric_facts(design)}
    for fact in metric_facts(light):
        if fact.key != "rsd":
            note = f"{how}; designed {designed[fact.key]}"
            yield replace(fact, label=METRICS[fact.key], note=note)


def correction_criteria(
    used: float, covered: float, form_nm: float, normal_mrad: float, volume_change: float, cutter: CutterLimit
) -> Criteria:
    """Criteria on a correction: its points, the written STEP as read back, and the reach of the cutter.

    Where the design is concave more tightly than the cutter already, the correction must not make it tighter.
    """
    longer = "take a longer wavelength_mm"
    criteria = (
        *surface_criteria(used, covered),
        at_most("form_error", form_nm, FINEST_NM, "nm", longer),
        at_most("normal_error", normal_mrad, FINEST_MRAD, "mrad", longer),
        at_most("step_volume_change", volume_change, ROUND_TRIP_LIMIT, "", longer),
    )
    if cutter.concave_radius_mm is None:
        return criteria
    before = cutter.concave_radius_before_mm
    least = min(cutter.cutter_radius_mm, np.inf if before is None else before) * (1.0 - 2.0 * KEPT)
    return (*criteria, at_least("concave_radius", cutter.concave_radius_mm, least, "mm", longer))
