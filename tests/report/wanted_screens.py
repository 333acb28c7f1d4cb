"""Numbers that the screens of a run and of its stages must show, by their label, each from the records."""

from shown_numbers import shown, with_error
from wanted_frame import reasons
from wanted_light import watts_to_shown, window_of

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.proof.proof_result import Proof
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check


def summary_numbers(results):
    """Entries of the screen at the end of a run."""
    light, photometry, design = (results.find(kind) for kind in (Light, Photometry, Design))
    part, proof, check = (results.find(kind) for kind in (Part, Proof, Check))
    yield from _counted(results)
    if light is not None:
        yield from light_lines("Light", light, results.spec)
    if photometry is not None:
        yield from photometry_lines("Light", photometry)
    if design is not None:
        yield from _search(design, results.spec.constraints)
    if part is not None:
        yield from part_lines("Files", part)
    if proof is not None:
        yield from landing_lines("Files", proof)
    if check is not None:
        yield from _cutting(check)
    for name in ("Light", "Files"):
        first = [each for part, each in reasons(results) if part == name][:1]
        if not (name == "Light" and results.spec.limits):
            yield from (shown(f"{name} / Because", each.words, *each.values) for each in first)


def _counted(results):
    criteria = [each for _, each in results.criteria()]
    missed, name = sum(not each.passed for each in criteria), results.spec.name
    if missed:
        yield shown(name, "{} of {} criteria", missed, len(criteria))
    elif len(criteria) > 1:
        yield shown(name, "All {} criteria on light and files are met.", len(criteria))


def light_lines(title, light, spec):
    """Entries of the light: of the only receiver in full, of several a line each."""
    lit, bound = light.first, "" if light.limits else ", at most 0.1"
    if len(light.receivers) == 1:
        yield with_error(f"{title} / Error (NMSE)", lit.nmse).before(f" (0 is perfect{bound})")
        yield with_error(f"{title} / Efficiency", lit.efficiency, " %", 100.0).before(" within")
        words, sides = window_of(lit, spec.all_receivers[0])
        possible = f"within {words} (possible: {{}} %)"
        yield shown(f"{title} / Efficiency", possible, *sides, 100.0 * lit.possible.efficiency)
        yield with_error(f"{title} / In the target", lit.share_in_target, " %", 100.0).before(" (")
        yield shown(f"{title} / In the target", "(possible: {} %)", 100.0 * lit.possible.share_in_target)
        yield from _evenness(title, light)
    else:
        for each in light.receivers:
            label = f"{title} / {each.name}"
            yield with_error(label, each.nmse).after("NMSE ")
            yield with_error(label, each.efficiency, " %", 100.0).after("efficiency ")
            yield with_error(label, each.share_in_target, " %", 100.0).after("in the target ")
    yield from _limits(title, light)
    unused = "" if light.fitted is None else " that the search has not used"
    words = f"{{}} rays{unused}, {{}} pixels across, 3x3 Gaussian filter"
    yield shown(f"{title} / Simulated with", words, light.rays, light.pixels)
    if light.fitted is not None:
        label = f"{title} / fitted rays"
        yield with_error(label, light.fitted.nmse).after("NMSE ")
        yield with_error(label, light.fitted.efficiency, " %", 100.0).after("efficiency ")
        yield shown(label, "by the {} rays of the search", light.fitted.rays)


def _evenness(title, light):
    lit = light.first
    if lit.uniformity is not None:
        yield with_error(f"{title} / Uniformity", lit.uniformity).before(" least over mean")
        yield with_error(f"{title} / Uniformity", lit.rsd).after("RSD ")
    if lit.in_region is not None:
        unit, quantity, per_watt = watts_to_shown(light, lit)
        yield with_error(f"{title} / Mean {quantity}", lit.in_region.mean, f" {unit}", per_watt)
        even, left = f"{title} / Evenness", 100.0 * lit.in_region.inner_share
        yield with_error(even, lit.in_region.inner).before(" least over mean")
        yield shown(even, "in the inner {} % of that region", left)
        yield with_error(f"{title} / Peak to target", lit.in_region.peak).before(" (largest light over the target's")


def _limits(title, light):
    if not light.limits:
        return
    held = [each for each in light.limits if each.state == "held"]
    yield shown(f"{title} / Limits", "{} of {} held", len(held), len(light.limits))
    for each in light.limits:
        if each.state == "missed":
            value, words = (
                each.value,
                f"{each.name}: {each.quantity} {{}} ± {{}} {each.unit}, must be {each.sense} {{}}",
            )
            numbers = (value.value, value.standard_error, each.bound)
            yield shown(f"{title} / missed", f"{words} {each.unit}", *numbers)


def photometry_lines(title, found):
    """Entries of the far field."""
    yield with_error(f"{title} / Luminous flux", found.exit_lm, " lm").before(" of ")
    yield shown(f"{title} / Luminous flux", "of {} lm", found.source_lm)
    yield with_error(f"{title} / Intensity", found.peak_cd, " cd").before(" at the peak")
    yield with_error(f"{title} / Intensity", found.axis_cd, " cd").before(" on the axis")
    for name, beam in (("C0", found.beam_c0), ("C90", found.beam_c90)):
        yield with_error(f"{title} / Beam angle", beam.beam_angle_deg, "°").before(f" in {name}")
    if found.road is not None:
        rating = found.road.bug
        numbers = (rating.backlight, rating.uplight, rating.glare)
        yield shown(f"{title} / Road", "BUG B{} U{} G{}", *numbers)


def _search(design, limits):
    yield shown("Lens", "{} steps in {} levels", design.steps, len(design.history))
    words, highest = "radius {} mm (at most {}), height {} mm", limits.max_height_mm
    numbers = (design.max_radius_mm, limits.max_radius_mm, design.height_mm)
    if highest is not None:
        words, numbers = f"{words} (at most {{}})", (*numbers, highest)
    yield shown("Lens / Size", words, *numbers)


def part_lines(title, part):
    """Entries of the solid and its errors."""
    words = "{} nm at most, normals {} mrad (STEP as read back)"
    yield shown(f"{title} / Form error", words, part.form_error_nm.max, part.normal_error_mrad.max)
    mass, numbers = ("", ()) if part.mass_g is None else (", {} g", (part.mass_g,))
    solid = f"{{}} mm³{mass}; mesh closed, {{}} facets"
    yield shown(f"{title} / Solid", solid, part.volume_mm3, *numbers, part.triangulation.triangles)
    scale = part.lens.spec.manufacture.scale
    if part.untrimmed_surfaces is None and scale != 1.0:
        told = "lens.step is the moulded lens; `lensforge export --runout DEG` writes the faces times {}"
        yield shown(f"{title} / Insert", told, scale)
    if part.keep_out is not None:
        yield shown(f"{title} / Keep-out", "{} mm away", part.keep_out.distance_mm)


def landing_lines(title, proof):
    """Entries of the distances between landings; below 0.1 mm in micrometres."""
    for number, each in enumerate(proof.receivers, start=1):
        on = f" on {each.name}" if len(proof.receivers) > 1 else ""
        label = f"{title} / Ray by ray" + (f" ({number})" if number > 1 else "")
        (rms, one), (most, two) = (
            (1e3 * mm, "µm") if mm < 0.1 else (mm, "mm") for mm in (each.deviation_mm.rms, each.deviation_mm.max)
        )
        far = ", at 1 m" if each.far_field else ""
        yield shown(label, f"part and design land {{}} {one} apart{on} (rms), at most {{}} {two}{far}", rms, most)


def _cutting(check):
    for title, face in (("Inner face", check.inner), ("Outer face", check.outer)):
        cutter, words = face.cutter, "a ball of {} mm radius reaches {} %, one of {} mm all"
        numbers = (cutter.radius_mm, 100.0 * cutter.reachable_fraction, cutter.largest_radius_mm)
        yield shown(f"Cutting / {title}", words, *numbers)
    yield shown("Cutting / Thinnest wall", "{} mm", check.min_wall_mm)
