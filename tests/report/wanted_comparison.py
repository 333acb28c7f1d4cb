"""Numbers that the page of compared designs must show, by their label, each from the records of its own design."""

from shown_numbers import shown, with_error
from wanted_frame import task_numbers
from wanted_light import level_of, watts_to_shown
from wanted_records import entries_of

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.made.measurement_result import PhotoComparison
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check

_NUMBERS, _DIFFERENCES = "Numbers", "Differences of the specifications"
_BEST = {
    "nmse": ("NMSE", min), "efficiency": ("Efficiency", max), "uniformity": ("Uniformity", max), "rsd": ("RSD", min),
}  # fmt: skip


def comparison_numbers(designs):
    """Entries of the page on ``designs``, results by their names."""
    for name, results in designs.items():
        yield from (shown(f"{name} / p", each.words, *each.values) for each in task_numbers(results.spec))
        found = [*_of_light(results), *_of_body(results), *_of_part(results)]
        yield from (shown(f"{_NUMBERS} / {row} / {name}", words, value) for row, words, value in found)
        light, photo = results.find(Light), results.find(PhotoComparison)
        for each in light.receivers[1:] if light else ():
            yield with_error(f"{_NUMBERS} / NMSE on {each.name} / {name}", each.nmse)
            yield with_error(f"{_NUMBERS} / Efficiency on {each.name} / {name}", each.efficiency)
        for each, section in zip(light.receivers, results.spec.all_receivers, strict=True) if light else ():
            title = f"{name}, {each.name}" if len(light.receivers) > 1 else name
            yield place_of(f"Light / {title} / figcaption", section)
        if photo is not None:
            caption = f"Photographs of the parts / {name} / figcaption"
            yield shown(caption, "SSIM to the simulation {}, NMSE {}.", photo.ssim, photo.nmse)
            yield shown("Photographs of the parts / p", "each photograph is scaled to a mean of 1.")
    yield from _differences(designs)
    lit = [results.find(Light) for results in designs.values() if results.find(Light)]
    kinds = {each.kind == "far_field" for light in lit for each in light.receivers}
    where = [", in the far field", ", at a distance"] if len(kinds) > 1 else [""] if lit else []
    for title in (f"Along {axis} = 0{each}" for axis in "xy" for each in where):
        yield shown(f"Light / {title} / title", title)
    yield shown("Sections / p", "Sections at φ = 0°, all to one scale.")
    yield shown(f"{_DIFFERENCES} / footer", f"Written by lensforge {results.lens.version}.")


def place_of(label, section):
    """Entry of a caption that says where a receiver is."""
    if section.kind == "far_field":
        return shown(label, "In the far field, to {}°.", section.half_angle_deg)
    if getattr(section, "centre_mm", (0.0, 0.0))[:2] != (0.0, 0.0):
        return shown(label, "Centred at ({}, {}, {}) mm.", *section.centre_mm)
    return shown(label, "At {} mm.", section.distance_mm)


def best_of(designs):
    """Labels of the best values of the first receivers, where designs for one target differ."""
    first, *others = (results.spec for results in designs.values())
    if any((each.target, each.receivers) != (first.target, first.receivers) for each in others):
        return
    lit = {name: results.find(Light).first for name, results in designs.items() if results.find(Light)}
    for metric, (row, better) in _BEST.items():
        values = {name: getattr(each, metric).value for name, each in lit.items() if getattr(each, metric) is not None}
        if len(values) > 0 and (len(set(values.values())) > 1 or len(values) < len(designs)):
            yield f"{_NUMBERS} / {row} / {better(values, key=values.get)} / note"


def _of_light(results):
    """Row, words and value of each number of the light."""
    light, stray, photo = (results.find(kind) for kind in (Light, StrayLight, PhotoComparison))
    if light is not None:
        first, (name, watts) = light.first, level_of(light, results.spec)
        unit, _, per_watt = watts_to_shown(light, first)
        yield "NMSE", "{}", first.nmse.value
        yield "Efficiency", "{}\u2009%", 100.0 * first.efficiency.value
        even = (("Uniformity", first.uniformity), ("RSD", first.rsd))
        yield from ((row, "{}", each.value) for row, each in even if each is not None)
        yield name, f"{{}} {unit}", per_watt * watts
        if light.fitted is not None:
            yield "NMSE of fitted rays", "{}", light.fitted.nmse.value
        if light.preset_error is not None:
            yield "Simulation error", "{}", light.preset_error.evaluation.irradiance_nmse.value
    if stray is not None:
        yield "Stray light", "{}\u2009%", 100.0 * stray.first.flux.detected_stray
    if photo is not None:
        yield "Photograph", "{}", photo.ssim


def _of_body(results):
    """The same of the body and its faces."""
    design, check = results.find(Design), results.find(Check)
    if design is not None:
        yield "Farthest from the LED", "{} mm", design.max_radius_mm
        yield "Lens height", "{} mm", design.height_mm
        yield "Cavity clearance", "{} mm", design.constraints.cavity_clearance_mm
    if check is not None:
        yield "Ball mill", "{} mm", min(face.cutter.largest_radius_mm for face in (check.inner, check.outer))
        yield "Thinnest wall", "{} mm", check.min_wall_mm
        if results.spec.constraints.max_wall_mm is not None:
            yield "Thickest wall", "{} mm", check.wall.thickest.thickness_mm
    for side, surface in results.surfaces.items():
        yield f"{side.capitalize()} form", "{} µm", surface.form_deviation_um.pv


def _of_part(results):
    """The same of the exported part."""
    part, proof = results.find(Part), results.find(Proof)
    if part is not None:
        yield "Form error", "{} nm", part.form_error_nm.max
        yield "Volume", "{} mm³", part.volume_mm3
        if part.keep_out is not None:
            yield "Keep-out distance", "{} mm", part.keep_out.distance_mm
    if proof is not None:
        yield "Exported part", "{}", proof.first.nmse_vs_design


def _differences(designs):
    tables = {}
    for name, results in designs.items():
        content = {"accuracy": results.lens.accuracy, "seed": results.lens.seed, **results.spec.model_dump()}
        tables[name] = {path: (words, numbers, unit) for path, words, numbers, unit, _ in entries_of(content)}
    for path in {path: None for table in tables.values() for path in table}:
        values = {name: table.get(path, ("–", [], "")) for name, table in tables.items()}
        if len({str(value) for value in values.values()}) > 1:
            for name, (words, numbers, unit) in values.items():
                yield shown(f"{_DIFFERENCES} / {path} / {name}", f"{words} {unit}".rstrip(), *numbers)
