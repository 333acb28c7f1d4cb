"""Facts of the machined part: a photograph of its light, its measured faces, a face corrected for a second cut."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from lensforge.addons.measure.inference_result import Inference
from lensforge.addons.measure.measurement_result import (
    Correction,
    MeasuredLight,
    PhotoComparison,
    SurfaceComparison,
)
from lensforge.addons.measure.part_series import PartSeries
from lensforge.light.evaluation_result import LightMetrics
from lensforge.light.light_facts import change_facts
from lensforge.report.results import facts_of
from lensforge.results import Fact, Group
from lensforge.results.criteria import state_of
from lensforge.results.figure import facts_in
from lensforge.results.numerals import percent, quantity


@facts_of.register
def photo_facts(photo: PhotoComparison) -> list[Group]:
    """Facts from the photograph of the part's light."""
    return [Group("photo", "A photograph of its light", tuple(_photo(photo)))]


@facts_of.register
def surface_facts(surface: SurfaceComparison) -> list[Group]:
    """Facts from measured points on one face, and the light with it."""
    alone = MeasuredLight(design=surface.design, measured=surface.measured, change=surface.change)
    facts = (*_points(surface), *_parts(surface.series), *_lights(surface.by_led or {"": alone}, "with this face"))
    return [Group("measured", f"The {surface.surface} face, measured", facts)]


@facts_of.register
def correction_facts(made: Correction) -> list[Group]:
    """Facts on a corrected face: errors before and after, filter, cutter, and the expected light."""
    alone = MeasuredLight(design=made.design, measured=made.second_cut, change=made.change)
    facts = (*_cut(made), *_parts(made.series), *_lights(made.by_led or {"": alone}, "expected"))
    return [Group("corrected", f"The {made.surface} face, corrected for a second cut", facts)]


@facts_of.register
def inference_facts(made: Inference) -> list[Group]:
    """Facts on a made lens by pictures of its light."""
    return [Group("inferred", "The made lens by pictures of its light", tuple(_inferred(made)))]


def _inferred(made: Inference) -> Iterator[Fact]:
    yield from facts_in(made, made.criteria)
    for error in made.errors:
        note = "" if error.is_seen else "not seen"
        yield Fact.measured(error.name.replace(" ", "_"), error.name, error.value, note)


def _photo(photo: PhotoComparison) -> Iterator[Fact]:
    files = photo.on if photo.off is None else f"{photo.on} minus {photo.off}"
    yield Fact("photographs", "Photographs", files, note=f"with the LED {photo.led}" if photo.led else "")
    yield from facts_in(photo, photo.criteria)
    if photo.likely_cause:
        yield Fact("cause", "Likely cause", photo.likely_cause)
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


def _parts(series: PartSeries | None) -> Iterator[Fact]:
    if series is None:
        return
    several = f"of {len(series.cavities)} cavities" if len(series.cavities) > 1 else "of one cavity"
    yield Fact("parts", "Parts", len(series.parts), note=several)
    yield from facts_in(series)
    for record in (*series.places, *series.cavities):
        yield from facts_in(series, (), record)


def _cut(made: Correction) -> Iterator[Fact]:
    yield _file(made)
    yield from facts_in(made, made.criteria)
    yield Fact("registration", "Registration", _registration(made.registration), note="not included in the correction")


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
    designed = {fact.key: fact.text for fact in facts_in(design)}
    for fact in facts_in(light):
        if fact.key != "rsd":
            yield replace(fact, note=f"{how}; designed {designed[fact.key]}")
