"""The headline numbers of a lens, one card each: value, unit, and a line of context."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.made.measurement_result import PhotoComparison
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.report.asked_table import largest_mill
from lensforge.report.headline import criteria_state
from lensforge.report.numerals import number, percent
from lensforge.report.shown_receivers import shown_receivers
from lensforge.results import Metric
from lensforge.results.chart import light_unit
from lensforge.runs.results import Results
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check


@dataclass(frozen=True)
class Card:
    """One large number, its unit, and a line of context.

    ``state``: "pass" or "fail" where the number has a limit, "open" where the shop must decide, else "".
    """

    label: str
    value: str
    unit: str
    note: str
    state: str = ""


def cards(results: Results) -> list[Card]:
    """The headline numbers of the stages that have run."""
    return [
        *_light_cards(results),
        *_table_cards(results),
        *_level_cards(results),
        *_size_cards(results),
        *_file_cards(results),
        *_keep_out_cards(results),
        *_mill_cards(results),
        *_proof_cards(results),
        *_part_cards(results),
    ]


def further_cards(results: Results) -> list[Card]:
    """Headline numbers beside the table of what was asked for, which has the others."""
    return [
        *_level_cards(results),
        *_file_cards(results),
        *_proof_cards(results),
        *_table_cards(results),
        *_part_cards(results),
    ]


def _state(results: Results, *names: str) -> str:
    """``pass`` if all criteria called ``names`` are met, else ``fail``; ``""`` where none has been evaluated."""
    return criteria_state((criterion for _, criterion in results.criteria()), *names)


def _light_cards(results: Results) -> Iterator[Card]:
    """Cards of the light on the first receiver; among several with its name."""
    for shown in shown_receivers(results)[:1]:
        light, of_receiver = shown.light, f"on {shown.light.name}: " if shown.several else ""
        note = _light_note(light.nmse, light.raw.nmse, "error of the pattern, 0 is perfect")
        yield Card("NMSE", number(light.nmse.value, 3), "", f"{of_receiver}{note}")
        error = light.efficiency.standard_error
        spread = f"± {percent(error, 3)}; " if error else ""
        note = f"{spread}of the emitted flux {shown.window}"
        yield Card("Efficiency", percent(light.efficiency.value), "", f"{of_receiver}{note}")
        if light.uniformity is not None:
            quantity = light_unit(None, far_field=light.chart.far_field).quantity
            note = _light_note(light.uniformity, light.raw.uniformity, f"least over mean {quantity} in the mask")
            yield Card("Uniformity", number(light.uniformity.value, 3), "", f"{of_receiver}{note}")
        if light.rsd is not None:
            note = _light_note(light.rsd, light.raw.rsd, "standard deviation over mean in the mask")
            yield Card("RSD", number(light.rsd.value, 3), "", f"{of_receiver}{note}")


def _table_cards(results: Results) -> Iterator[Card]:
    """NMSE by the rays that the search has used, and error of the accuracy preset, where they have been measured."""
    light = results.find(Light)
    if light is not None and light.fitted is not None:
        rays, share = number(light.fitted.rays), percent(light.fitted.efficiency.value)
        note = f"{_error(light.fitted.nmse)}by the {rays} rays of the search, to which the lens is fitted; efficiency"
        yield Card("NMSE of fitted rays", number(light.fitted.nmse.value, 3), "", f"{note} {share}")
    if light is None or light.preset_error is None:
        return
    first, left = light.first, light.preset_error.evaluation
    noise = "" if first.nmse_of_noise is None else f"; ray noise {number(first.nmse_of_noise, 2)}"
    off, gap = first.chart.labelled(left.hit_mm.value), "" if first.chart.far_field else " "
    note = (
        f"{_error(left.irradiance_nmse)}NMSE that the tables of --accuracy {results.lens.accuracy} add "
        f"to the light of the exact surfaces; hits {number(off, 2)}{gap}{first.chart.unit} off (rms){noise}"
    )
    yield Card("Simulation error", number(left.irradiance_nmse.value, 2), "", note)


def _light_note(metric: Metric, raw: float | None, meaning: str) -> str:
    """Error and meaning of a metric of the light, and its value with ray noise where it has been taken off."""
    if metric.standard_error is None:
        return f"{meaning}; with ray noise, too few rays to take it off"
    return f"{_error(metric)}{meaning}; with ray noise {number(raw, 3)}"


def _error(metric: Metric) -> str:
    return f"± {number(metric.standard_error, 2)}; " if metric.standard_error else ""


def _level_cards(results: Results) -> Iterator[Card]:
    """Mean level of light in the first receiver's mask, or its peak where there is no mask."""
    for shown in shown_receivers(results)[:1]:
        light, unit = shown.light, shown.unit
        inside = shown.mask(light.pixels)
        if inside is None or inside.shape != light.map.shape or not inside.any():  # smaller than a pixel
            label, watts = f"Peak {unit.quantity}", float(light.map.max())
            where = shown.place if light.kind == "far_field" or shown.several else "on the receiver"
        else:
            label, watts = f"Mean {unit.quantity}", float(np.mean(light.map[inside]))
            where = f"in the mask {shown.mask_words}" + (f" on {light.name}" if shown.several else "")
        plain = light_unit(None, far_field=light.chart.far_field)
        note = where if unit == plain else f"{where}; {number(watts, 3)} {plain.symbol}"
        yield Card(label, number(unit.per_watt * watts, 3), unit.symbol, note)


def _size_cards(results: Results) -> Iterator[Card]:
    record, limits = results.find(Design), results.spec.constraints
    if record is None:
        return
    within, clear = (_state(results, name) for name in ("radius margin", "cavity clearance"))
    largest = f"the lens without its base; at most {limits.max_radius_mm:g} mm allowed"
    yield Card("Farthest from the LED", number(record.max_radius_mm, 4), "mm", largest, within)
    most = "" if limits.max_height_mm is None else f"; at most {limits.max_height_mm:g} mm allowed"
    low = _state(results, "height margin")
    yield Card("Lens height", number(record.height_mm, 4), "mm", f"above the source plane, without the base{most}", low)
    keep_out = f"to the {limits.cavity_height_mm:g} mm high, {2.0 * limits.cavity_radius_mm:g} mm wide keep-out space"
    yield Card("Cavity clearance", number(record.constraints.cavity_clearance_mm, 3), "mm", keep_out, clear)


def _file_cards(results: Results) -> Iterator[Card]:
    record = results.find(Part)
    if record is not None:
        note = f"of the STEP file as read back; normals within {number(record.normal_error_mrad.max, 2)} mrad"
        state = _state(results, "form_error", "normal_error")
        yield Card("Form error", number(record.form_error_nm.max, 2), "nm", note, state)
        weight = "" if record.mass_g is None else f"; {number(record.mass_g, 4)} g by the density of the spec"
        yield Card("Volume", number(record.volume_mm3, 5), "mm³", f"of the solid, base included{weight}")


def _keep_out_cards(results: Results) -> Iterator[Card]:
    record = results.find(Part)
    if record is not None and record.keep_out is not None:
        margin = f"from lens and base; required: {results.spec.constraints.keep_out_margin_mm:g} mm"
        clear = _state(results, "keep_out_distance")
        yield Card("Keep-out distance", number(record.keep_out.distance_mm, 4), "mm", margin, clear)


def _mill_cards(results: Results) -> Iterator[Card]:
    record = results.find(Check)
    if record is None:
        return
    tightest = min((record.inner, record.outer), key=largest_mill)
    largest = tightest.cutter.largest_radius_mm
    base = record.relief.beyond_shop(largest, tightest.cutter.radius_mm)
    fits = largest is None or largest >= tightest.cutter.radius_mm
    note = f"largest radius that reaches all of both faces; the shop has {tightest.cutter.radius_mm:g} mm{base}"
    value, unit = ("any", "") if largest is None else (number(largest, 3), "mm")
    yield Card("Ball mill", value, unit, note, "pass" if fits else "open")
    wall = f"along the normal; required: {results.spec.constraints.min_thickness_mm:g} mm"
    yield Card("Thinnest wall", number(record.min_wall_mm, 4), "mm", wall, _state(results, "thinnest wall"))
    most = results.spec.constraints.max_wall_mm
    if most is not None:
        thickest = f"along the ray from the origin; at most {most:g} mm allowed"
        state = _state(results, "largest radial wall")
        yield Card("Thickest wall", number(record.wall.thickest.thickness_mm, 4), "mm", thickest, state)


def _proof_cards(results: Results) -> Iterator[Card]:
    record = results.find(Proof)
    if record is not None:
        floor = number(record.noise_floor_nmse, 2)
        note = f"NMSE against the design, by {number(record.rays)} rays through it; ray noise alone: {floor}"
        yield Card("Exported part", number(record.nmse_vs_design, 3), "", note, _state(results, "nmse_vs_design"))


def _part_cards(results: Results) -> Iterator[Card]:
    """Cards of optional results: stray light, a photograph, measured surfaces."""
    stray, photo = results.find(StrayLight), results.find(PhotoComparison)
    if stray is not None:
        base = f"of the emitted flux within the window, by reflections; the base is {stray.base}"
        yield Card("Stray light", percent(stray.flux.detected_stray, 2), "", base)
    if photo is not None:
        note = f"SSIM, 1 is equal; NMSE {number(photo.nmse, 3)} between the part's light and the simulation"
        yield Card("Photograph", number(photo.ssim, 3), "", note, _state(results, "photo_clipped"))
    for side, surface in results.surfaces.items():
        form = surface.form_deviation_um
        note = f"PV of the measured form, rms {number(form.rms, 2)} µm, by {number(surface.point_count)} points"
        state = _state(results, "points_used", "surface_covered")
        yield Card(f"{side.capitalize()} form", number(form.pv, 3), "µm", note, state)
