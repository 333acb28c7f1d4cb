"""Numbers that the screen of each stage must show, by their label, each from the result that it is on."""

from functools import singledispatch
from math import ceil, floor

from shown_numbers import shown, with_error
from wanted_frame import reasons
from wanted_measured import correction_numbers, photo_numbers, surface_numbers
from wanted_screens import landing_lines, light_lines, part_lines, photometry_lines

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import PhotoComparison, SurfaceComparison
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.proof.proof_result import Proof
from lensforge.proof.stray_result import StrayLight
from lensforge.shop.check_result import Check


@singledispatch
def stage_numbers(result, results):
    """Entries of the screen of ``result``, one of ``results``."""
    raise TypeError(type(result))


def _because(results, name, title):
    for part, each in reasons(results):
        if part == name:
            yield shown(f"{title} / Because", each.words, *each.values)


@stage_numbers.register
def _(result: Light, results):
    title = "Light" if result.conditions is None else "Light under other conditions"
    yield from light_lines(title, result, results.spec)
    if result.conditions is None:
        yield from _because(results, "Light", "Light")


@stage_numbers.register
def _(result: Part, results):
    yield from part_lines("Files", result)
    yield from _because(results, "Files", "Files")


@stage_numbers.register
def _(result: Check, results):
    for title, face in (("Inner face", result.inner), ("Outer face", result.outer)):
        words, sphere = "Best fit {} mm in radius, departure {} mm (peak to valley).", face.best_fit_sphere
        yield shown(f"{title} / sphere", words, sphere.radius_mm, sphere.pv_mm)
    yield shown("Wall / thickest", "{} mm along the ray", result.wall.thickest.thickness_mm)
    named = {"cutter": "ball", "tilt": "tilt", "draft": "draft", "wall": "wall"}
    titles = {"inner": "Inner face", "outer": "Outer face", "body": "Wall"}
    for each in result.verdicts:
        label = f"{titles[each.surface]} / {named[each.name]}"
        reason = each.reason[:1].upper() + each.reason[1:]
        yield shown(f"{label}: {'yes' if each.holds else 'no'}", reason)
        if not each.holds:
            yield from (change(f"{label}: no", each, results.spec) or [])


def change(label, finding, spec):
    """Entries of the field of the spec that makes a finding hold; a ball is rounded down, an angle up."""
    if finding.name == "wall":
        yield shown(label, "again, or constraints.min_thickness_mm = {} where", finding.value)
    if finding.name == "cutter":
        yield shown(label, "manufacture.cutter_radius_mm = {}", floor(1e3 * finding.limit) / 1e3)
    if finding.name == "tilt":
        yield shown(label, "manufacture.max_tilt_deg = {}", ceil(10.0 * finding.value) / 10.0)


@stage_numbers.register
def _(result: Proof, results):
    light = results.find(Light)
    designed = {} if light is None else {each.name: each.efficiency.value for each in light.receivers}
    title = "Files" if result.conditions is None else "Files under other conditions"
    yield from landing_lines(title, result)
    counted = {}
    for each in result.receivers:
        quantity = "intensity" if each.far_field else "irradiance"
        efficiency, shares = "{} %", [100.0 * each.efficiency]
        if each.name in designed:
            efficiency, shares = "{} %; the design has {} %", [*shares, 100.0 * designed[each.name]]
        for name, words, *values in (
            (f"NMSE against the design's {quantity}", "{}", each.nmse_vs_design),
            ("NMSE of the ray noise alone", "{}", each.noise_floor_nmse),
            ("NMSE against the design with the same rays", "{}", each.nmse_same_rays),
            ("Efficiency", efficiency, *shares),
        ):
            counted[name] = counted.get(name, 0) + 1
            again = f" ({counted[name]})" if counted[name] > 1 else ""
            yield shown(f"{title} / {name}{again}", words, *values)


@stage_numbers.register
def _(result: StrayLight, results):
    yield shown("Stray light / In the window", "{} % of the flux", 100.0 * result.first.flux.detected_stray)
    yield shown("Stray light / Followed", "{} rays", result.rays)


@stage_numbers.register
def _(result: Photometry, results):
    yield from photometry_lines("Photometry", result)


@stage_numbers.register
def _(result: Sensitivity, results):
    title = "Change of the light by each tolerance at its end"
    yield shown(title, "{} rays each", result.rays)
    yield with_error(f"{title} / As designed", result.nominal.nmse).after("NMSE ")
    yield with_error(f"{title} / As designed", result.nominal.efficiency, " %", 100.0).after("efficiency ")
    for row in result.rows:
        label = f"{title} / {row.amount:g} {row.unit}"
        yield with_error(label, row.change.nmse).after(f"{row.name}: NMSE ")
        yield with_error(label, row.change.efficiency, " %", 100.0).after("efficiency ")
        yield with_error(label, row.change.uniformity).after("uniformity ")


@stage_numbers.register
def _(result: Yield, results):
    rate = result.pass_rate
    yield shown("Yield", "Yield: {} % of {} parts pass", 100.0 * rate.value, result.parts)
    words = "95 % that it is {} % to {} %; {} rays a part"
    yield shown("Yield / Confidence", words, 100.0 * rate.low, 100.0 * rate.high, result.rays)
    for number, bound in enumerate(result.bounds, start=1):
        label = "Yield / Must keep" + (f" ({number})" if number > 1 else "")
        yield shown(label, f"{bound.metric} {bound.sense} {{}}", bound.bound)
    for number, (name, spread) in enumerate(result.metrics.items(), start=1):
        words = "designed {}; of the parts 5 % below {}, half below {}, 95 % below {}"
        yield shown(f"Yield / {name}", words, spread.designed.value, spread.p5, spread.p50, spread.p95)
        causes = result.variance[name].causes[:3]
        label = "Yield / by" + (f" ({number})" if number > 1 else "")
        for each in causes:
            yield shown(label, f"{{}} ± {{}} % {each.words}", 100.0 * each.share, 100.0 * each.standard_error)
    yield from _budget(result.budget)


def _budget(budget):
    """The five tolerances that leave the least room first."""
    tightest = sorted((row for row in budget.alone if not row.unlimited), key=lambda row: row.at_most / row.specified)
    for number, row in enumerate(tightest[:5], start=1):
        label = "Yield / At most" + (f" ({number})" if number > 1 else "")
        unit = f" {row.unit}" if row.unit else ""
        words = f"{row.words}: {{}}{unit}, {{}} to {{}} (specified {{}}{unit})"
        yield shown(label, words, row.at_most, row.low, row.high, row.specified)
    whole, words = budget.together, "by the factor {}, {} to {} (specified {})"
    yield shown("Yield / All together", words, whole.at_most, whole.low, whole.high, whole.specified)


def _facts(title, rows):
    for each in rows:
        yield shown(f"{title} / ", f"{each.label}: {each.words}".replace("\u2009", " "), *each.values)


@stage_numbers.register
def _(result: PhotoComparison, results):
    yield from _facts(
        "Photograph of the light", (each for each in photo_numbers(result) if each.label != "Likely cause")
    )
    yield from _likely(result)


def _likely(photo):
    found = photo.alignment
    yield with_error("Photograph of the light / ", found.scale).after("Likely cause: scale ")
    yield with_error("Photograph of the light / ", found.displacement_x_mm, " mm").after("displacement along x ")


@stage_numbers.register
def _(result: SurfaceComparison, results):
    yield from _facts("Outer surface, measured", surface_numbers(result))


@stage_numbers.register
def _(result: Correction, results):
    yield from _facts("Inner surface, corrected for a second cut", correction_numbers(result))
