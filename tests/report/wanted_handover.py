"""Numbers that page, PDF and drawing for the shop must show, by their label, each from the records of the folder."""

import re
from dataclasses import dataclass
from math import ceil, floor, log10

from shown_numbers import shown
from wanted_dimensions import dimension_numbers, widest_of
from wanted_tolerances import tolerance_numbers

from lensforge.report.criterion_words import criterion_words
from lensforge.scene.tolerance_factors import factors_of


@dataclass(frozen=True)
class Fact:
    """A line of the page under ``page`` and of the PDF under ``pdf``: its name, and words on ``values``."""

    page: str
    pdf: str
    name: str
    words: str
    values: tuple = ()

    def entries(self):
        yield shown(" / ".join(filter(None, (self.page, self.name))), self.words, *self.values)
        table, _, column = self.pdf.partition(" / ")
        if column:
            yield shown(f"PDF / {table} / {self.name} / {column}", self.words, *self.values)
        else:
            yield shown(f"PDF / {table or 'Part'}", f"{self.name}: {self.words}", *self.values)


def handover_numbers(results, seen):
    """Entries of all three; ``seen``: the handover, whose dense tables have records of their own."""
    yield from dimension_numbers(results.lens)
    yield from tolerance_numbers(results)
    facts = [*_of_part(results), *_of_faces(results.check), *_of_grids(seen.handover), *_of_findings(results.check)]
    for fact in facts:
        yield from fact.entries()
    yield from _criteria(results)
    yield from _changes(results.check)
    yield from _flat(results.lens)
    yield from _drawn(results, seen.sheet)
    yield from _notes(results)
    yield shown("figcaption", f"Drawing, {seen.sheet.name}, scale {{}} : 1", seen.sheet.scale)
    for name, digest in seen.handover.sha256.items():
        yield shown(f"Files / {name}", digest)
        yield shown("PDF / SHA-256", f"{name}: {digest}")


def _of_part(results):
    part, check, lens = results.part, results.check, results.spec.lens
    shop = results.spec.manufacture
    yield Fact("", "", "Material", lens.material)
    yield Fact("", "", "Refractive index", "{}", (lens.refractive_index,))
    if lens.cavity_index != 1.0:
        yield Fact("", "", "Index in the cavity", "{}", (lens.cavity_index,))
    for name in ("inner", "outer"):
        coating = getattr(lens, f"{name}_coating")
        if coating is not None:
            reflected = (100.0 * coating.reflectance[0][0],)
            yield Fact("", "", f"Coating of the {name} face", "reflects {} %", reflected)
    if shop.make == "insert":
        words, scale = "{}; the tables of points, figures and pictures", 1.0 + shop.shrinkage
        yield Fact("", "", "Shrinkage", words, (shop.shrinkage,))
        yield Caption("Shrinkage", "the lens times {} about", (scale,))
        yield Caption("PDF / Part", "the lens times {} about", (scale,))
    if shop.form_tolerance_um is not None:
        name, words = "Form tolerance of the lens's optical faces", "{} µm, width of the zone"
        yield Fact("", "", name, words, (shop.form_tolerance_um,))
    yield Fact("", "", "Volume", "{} mm³", (part.volume_mm3,))
    if part.mass_g is not None:
        yield Fact("", "", "Mass", "{} g", (part.mass_g,))
    form, normal = part.form_error_nm.max, 1e3 * part.normal_error_mrad.max
    yield Fact("", "", "Form error of the STEP's faces against the design", "{} nm at most", (form,))
    yield Fact("", "", "Error of their normals", "{} µrad at most", (normal,))
    yield Fact("", "", "Thinnest wall", "{} mm", (check.min_wall_mm,))
    yield Fact("", "", "Thickest wall, along rays from the origin", "{} mm", (check.wall.thickest.thickness_mm,))
    yield Fact("", "", "lensforge", results.lens.version)


def _of_faces(check):
    for name, face in (("outer", check.outer), ("inner", check.inner)):
        sphere, cutter = face.best_fit_sphere, face.cutter
        for words, text, value in (
            ("Best-fit sphere, radius", "{} mm", sphere.radius_mm),
            ("Departure from it, peak to valley", "{} µm", 1e3 * sphere.pv_mm),
            ("Departure, rms", "{} µm", 1e3 * sphere.rms_mm),
            ("Smallest concave radius", "{} mm", face.curvature.smallest_concave_radius_mm),
            ("Largest ball that reaches the whole face", "{} mm", cutter.largest_radius_mm),
            ("Largest tilt", "{}°", face.largest_tilt_deg),
            ("Least draft", "{}°", face.draft_deg.min),
        ):
            yield Fact(f"Optical faces / {name}", f"Optical faces / {name.capitalize()}", words, text, (value,))
        caption = f"{name}: smaller principal curvature; line: where a ball of {{}} mm just fits"
        yield Caption("Optical faces / figcaption", caption, (cutter.radius_mm,))


@dataclass(frozen=True)
class Caption:
    """A line of the page alone."""

    label: str
    words: str
    values: tuple

    def entries(self):
        yield shown(self.label, self.words, *self.values)


def rounded_up(value, digits=3):
    """``value`` rounded up to significant ``digits``, as an error is stated."""
    unit = 10.0 ** (floor(log10(value)) - digits + 1)
    return ceil(value / unit * (1.0 - 1e-9)) * unit


def _of_grids(handover):
    words = "{} points on the face, up to {} mm apart; complete cells over {} % of the face's area; "
    words += "bicubic interpolation errs by at most {} nm along the normal"
    page, pdf = "Dense tables of points", "Dense tables of points"
    for grid in handover.grids:
        numbers = (grid.points, grid.spacing_mm, 100.0 * grid.covered, rounded_up(grid.error_nm))
        yield Fact(page, pdf, grid.file, words, numbers)
    for name, content in handover.clouds.items():
        yield Fact(page, pdf, name, "{} points on the face", (len(content.splitlines()),))


def _of_findings(check):
    for each in check.verdicts:
        mark = "yes" if each.holds else "no"
        yield Caption(f"Can it be cut? / {each.name}, {each.surface}", f"{mark} {each.reason}", ())
        yield Caption(f"PDF / Can it be cut? / {each.name}, {each.surface} / Answer", each.reason, ())


def _criteria(results):
    for each in (*results.part.criteria, *results.check.criteria):
        words, sign = criterion_words(each.name), {"<=": "≤", ">=": "≥"}[each.sense]
        name = words.removesuffix(" (1: yes)")
        value, limit, numbers, limits = f"{{}} {each.unit}", f"{sign} {{}} {each.unit}", (each.value,), (each.limit,)
        if name != words:
            value, limit, numbers, limits = "yes" if each.value else "no", "yes", (), ()
        elif each.value is None:
            value, numbers = "not measured", ()
        for page in ("", "PDF / "):
            label = f"{page}Criteria on files and shape / {name}"
            yield shown(f"{label} / Value", value.rstrip(), *numbers)
            yield shown(f"{label} / Limit", limit.rstrip(), *limits)


def _changes(check):
    """The ball that just fits, rounded down: the only change for a mould that opens."""
    title = "Changes of the specification that would help"
    for each in check.verdicts:
        if not each.holds and each.name == "cutter":
            words, ball = f"cutter, {each.surface}: manufacture.cutter_radius_mm = {{}}", floor(1e3 * each.limit) / 1e3
            yield shown(f"Can it be cut? / {title} / li", words, ball)
            yield shown("PDF / Changes of the specification", words, ball)
        if not each.holds and each.name == "wall":
            words, least = "again, or constraints.min_thickness_mm = {} where", each.value
            yield shown(f"Can it be cut? / {title} / li", words, least)
            yield shown("PDF / Changes of the specification", words, least)


def _flat(lens):
    """The flat that would mark the azimuth: beyond three quarters of the way from the dome to the rim of the base."""
    base, inside = lens.spec.base, widest_of(lens.outer) / 2.0
    half = base.diameter_mm / 2.0
    if base.kind != "cylinder" or base.flat_mm is not None or inside >= half:
        return
    flat = floor(10.0 * (inside + 0.75 * (half - inside))) / 10.0
    words = "base.flat_mm = {} would, a flat across +x"
    for label in (
        "Datums and dimensions / p", "Datums and dimensions / Notes of the drawing / li", "PDF / Datums",
        "PDF / Notes of the drawing", "Drawing / notes",
    ):  # fmt: skip
        yield shown(label, words, flat)
    change = "azimuth, base: base.flat_mm = {}, a flat across +x"
    yield shown("Can it be cut? / Changes of the specification that would help / li", change, flat)
    yield shown("PDF / Changes of the specification", change, flat)


def _drawn(results, sheet):
    """Title block, and the table of the two faces."""
    part, spec = results.part, results.spec
    size = ("Volume: {} mm³", part.volume_mm3) if part.mass_g is None else ("Mass: {} g", part.mass_g)
    yield shown("Drawing", *size)
    yield shown("Drawing", "Scale: {} : 1", sheet.scale)
    yield shown("Drawing", f"Material: {spec.lens.material}")
    yield shown("Drawing", f"First angle; {sheet.name}, sheet 1 of 1")
    amounts = {factor.name: factor.amount for factor in factors_of(spec.tolerances)}
    yield shown("Drawing / Material", f"Material {spec.lens.material} n =")
    wave = float(re.search(r"([0-9.]+) nm", spec.lens.material)[1])
    yield shown("Drawing / Material", "n = {} ±{} at {} nm", spec.lens.refractive_index, amounts["index"], wave)
    for level in ("0/ –", "1/ –", "2/ –"):
        yield shown("Drawing / Material", level)
    for name in ("outer", "inner"):
        yield from _of_face(name, getattr(results.check, name), spec, amounts)
        face, wide = f"Drawing / {name.capitalize()} face", widest_of(getattr(results.lens, name))
        yield shown(face, "Effective aperture: ⌀{}, whole face", wide)
    centring = (amounts["outer_tilt_deg"], amounts["outer_shift_mm"])
    yield shown("Drawing / Outer face", "4/ ±{}°, ±{} mm to the inner face", *centring)
    yield shown("Drawing / Inner face", "4/ reference of the outer face")


def _of_face(name, face, spec, amounts):
    column, sphere = f"Drawing / {name.capitalize()} face", face.best_fit_sphere
    yield shown(column, "freeform; best-fit R {}, PV {}", sphere.radius_mm, sphere.pv_mm)
    form = (amounts[f"{name}_form_um"], amounts[f"{name}_waviness_um"])
    yield shown(column, "3/ RMS form {} µm; waviness {} µm", *form)
    texture = (amounts[f"{name}_roughness_mrad"], 1e3 * amounts[f"{name}_ripple_um"])
    yield shown(column, "RΔq {} mrad, rings {} nm PV", *texture)
    coating = getattr(spec.lens, f"{name}_coating")
    reflected = () if coating is None else (100.0 * coating.reflectance[0][0],)
    words = "Coating: {}; {{}} mm²".format("–" if coating is None else "reflects {} %")
    yield shown(column, words, *reflected, face.area_mm2)
    yield shown(column, "5/ –")
    width_um = spec.manufacture.form_tolerance_um
    if width_um is not None:
        yield shown(column, "Profile of the surface: {}", 1e-3 * width_um)


def _notes(results):
    check, shop = results.check, results.spec.manufacture
    steepest = max(check.inner.largest_tilt_deg, check.outer.largest_tilt_deg)
    balls = [floor(1e3 * face.cutter.largest_radius_mm) / 1e3 for face in (check.inner, check.outer)]
    missed = sum(not each.holds for each in check.verdicts)
    for label in ("Datums and dimensions / Notes of the drawing / li", "PDF / Notes of the drawing", "Drawing / notes"):
        yield shown(label, "z = 0 is the plane in which the optical faces end.")
        yield shown(label, "Tolerances on the axis, 3/, 4/, n and roughness")
        yield shown(label, "R {} for the inner face, R {} for the outer one", *balls)
        yield shown(label, "tilted up to {}°", steepest)
        yield shown(label, "Notation as in ISO 10110 and ISO 1101;")
        if missed:
            yield shown(label, "Check: {} of {} findings", missed, len(check.verdicts))
        if shop.make == "insert":
            yield shown(label, "are these times {} about the origin", 1.0 + shop.shrinkage)
        if "yield" in results.found:
            found = results.found["yield"]
            yield shown(label, "{}\u2009% of {} parts drawn", 100.0 * found.pass_rate.value, found.parts)
    for label in ("Datums and dimensions / p", "PDF / Datums"):
        yield shown(label, "z = 0 is the plane in which both optical faces end")
