"""The handful of numbers that say how good the lens is, each with the line that puts it into place."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lensforge.receivers.plane import Receiver
from lensforge.figures.light_unit import WATTS, light_unit
from lensforge.report.numerals import number, percent
from lensforge.report.records import FaceRecord
from lensforge.report.results import Results


@dataclass(frozen=True)
class Card:
    """One large number, its unit, and a line that puts it into place.

    ``state``: "pass" or "fail" where the number is held against a limit, "open" where the shop must decide, else "".
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
        *_level_cards(results),
        *_size_cards(results),
        *_file_cards(results),
        *_mill_cards(results),
        *_proof_cards(results),
        *_part_cards(results),
    ]


def _state(results: Results, *names: str) -> str:
    """What the gates called ``names`` say together; ``""`` where none of them has been judged."""
    judged = [gate.passed for _, gate in results.gates() if gate.name in names]
    return ("pass" if all(judged) else "fail") if judged else ""


def _light_cards(results: Results) -> Iterator[Card]:
    record = results.evaluate
    if record is None:
        return
    yield Card(
        "NMSE", number(record.nmse, 3), "", f"{_error(record.nmse_standard_error)}error of the pattern, 0 is perfect"
    )
    window = f"of the emitted flux within {record.window_mm:g} × {record.window_mm:g} mm"
    error = record.efficiency_standard_error
    yield Card("Efficiency", percent(record.efficiency), "", f"{f'± {percent(error, 3)}; ' if error else ''}{window}")
    if record.uniformity is not None:
        note = f"{_error(record.uniformity_standard_error)}least over mean irradiance in the mask"
        yield Card("Uniformity", number(record.uniformity, 3), "", note)
    if record.rsd is not None:
        note = f"{_error(record.rsd_standard_error)}standard deviation over mean in the mask"
        yield Card("RSD", number(record.rsd, 3), "", note)
    if record.preset_error is not None:
        left = record.preset_error.evaluation
        noise = "" if record.nmse_of_noise is None else f"; ray noise {number(record.nmse_of_noise, 2)}"
        spread = _error(left.irradiance_nmse_standard_error)
        note = (
            f"{spread}NMSE that the tables of --accuracy {results.lens.accuracy} add "
            f"to the light of the exact surfaces; hits {number(left.hit_mm, 2)} mm off (rms){noise}"
        )
        yield Card("Simulation error", number(left.irradiance_nmse, 2), "", note)


def _error(standard_error: float | None) -> str:
    return f"± {number(standard_error, 2)}; " if standard_error else ""


def _level_cards(results: Results) -> Iterator[Card]:
    """How bright: the mean in the mask, or the peak where the spec names no mask."""
    if results.evaluate is None or results.images is None:
        return
    image, side, mask_mm = (
        results.images["irradiance"],
        results.evaluate.receiver_mm,
        results.lens.spec.target.uniform_mm,
    )
    unit = light_unit(results.lens.spec)
    if mask_mm is None:
        label, watts, where = f"Peak {unit.quantity}", float(image.max()), "on the receiver"
    else:
        mask = Receiver(side, len(image)).square_mask(mask_mm)
        label, watts, where = f"Mean {unit.quantity}", float(np.mean(image[mask])), f"in the mask of {mask_mm:g} mm"
    note = where if unit == WATTS else f"{where}; {number(watts, 3)} {WATTS.symbol}"
    yield Card(label, number(unit.per_w_m2 * watts, 3), unit.symbol, note)


def _size_cards(results: Results) -> Iterator[Card]:
    record, asked = results.design, results.lens.spec.constraints
    if record is not None:
        limit = f"the largest; asked: at most {asked.max_radius_mm:g} mm"
        yield Card("Lens radius", number(record.max_radius_mm, 4), "mm", limit, _state(results, "constraint g3"))
        yield Card("Lens height", number(record.height_mm, 4), "mm", "above the source plane, without the base")
        room = (
            f"beyond the {asked.cavity_height_mm:g} mm high, {2.0 * asked.cavity_radius_mm:g} mm wide space asked for"
        )
        yield Card("Cavity room", number(record.constraints["g1_mm"], 3), "mm", room, _state(results, "constraint g1"))


def _file_cards(results: Results) -> Iterator[Card]:
    record = results.export
    if record is not None:
        note = f"of the STEP file as read back; normals within {number(record.normal_error_mrad.max, 2)} mrad"
        state = _state(results, "form_error", "normal_error")
        yield Card("Form error", number(record.form_error_nm.max, 3), "nm", note, state)


def _mill_cards(results: Results) -> Iterator[Card]:
    record = results.check
    if record is None:
        return
    tightest = min((record.inner, record.outer), key=_largest_mill)
    largest = tightest.cutter.largest_radius_mm
    fits = largest is None or largest >= tightest.cutter.radius_mm
    asked = f"largest radius that reaches all of both faces; the shop has {tightest.cutter.radius_mm:g} mm"
    value, unit = ("any", "") if largest is None else (number(largest, 3), "mm")
    yield Card("Ball mill", value, unit, asked, "pass" if fits else "open")
    wall = f"along the cavity's normal; asked: {results.lens.spec.constraints.min_thickness_mm:g} mm radially"
    yield Card("Thinnest wall", number(record.min_wall_mm, 4), "mm", wall, _state(results, "radial wall"))


def _largest_mill(face: FaceRecord) -> float:
    largest = face.cutter.largest_radius_mm
    return float("inf") if largest is None else largest


def _proof_cards(results: Results) -> Iterator[Card]:
    record = results.verify
    if record is not None:
        floor = number(record.noise_floor_nmse, 2)
        note = f"NMSE against the design, by {number(record.rays)} rays through it; noise makes {floor}"
        yield Card("Exported part", number(record.nmse_vs_design, 3), "", note, _state(results, "nmse_vs_design"))


def _part_cards(results: Results) -> Iterator[Card]:
    """Of what not every design has: stray light followed, a photograph, measured surfaces."""
    if results.stray is not None:
        base = f"of the emitted flux within the window, by reflections; the base is {results.stray.base}"
        yield Card("Stray light", percent(results.stray.flux.get("detected_stray"), 2), "", base)
    if results.photo is not None:
        note = f"SSIM, 1 is equal; NMSE {number(results.photo.nmse, 3)} between the part's light and the simulation"
        yield Card("Photograph", number(results.photo.ssim, 3), "", note, _state(results, "photo_clipped"))
    for side, surface in results.surfaces.items():
        form = surface.record.form_deviation_um
        note = f"PV of the measured form, rms {number(form.rms, 2)} µm, by {number(surface.record.points)} points"
        state = _state(results, "points_used", "surface_covered")
        yield Card(f"{side.capitalize()} form", number(form.pv, 3), "µm", note, state)
