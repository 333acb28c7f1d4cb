"""Numbers on the lens and its part that the report must show, by their label, each from the records of the folder."""

from shown_numbers import shown
from wanted_light import ASKED

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.proof.proof_result import Proof
from lensforge.report.criterion_words import criterion_words
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check

_MAPS = "Manufacture / Maps of both faces: departure from a sphere, curvature, what the mill leaves"
_READ = "Verification / The files as read back, and the light of the exported part"


def part_numbers(results):
    """Entries of the size, of the shop, of the files, of their verification and of the criteria."""
    design, part, check, proof = (results.find(kind) for kind in (Design, Part, Check, Proof))
    if design is not None:
        yield from _size(design, results.spec.constraints)
    if part is not None:
        yield from _part(part, results.spec.constraints)
    if check is not None:
        yield from _wall(check, results.spec.constraints)
        yield from _shop(check, results.spec.constraints)
        yield from _findings(check)
    if proof is not None:
        yield from _proof(proof, results.find(Light))
        yield from _referees(proof)
    yield from _criteria(results)


def _size(design, limits):
    far, high, room = (
        f"{ASKED} / {name}"
        for name in ("Lens, farthest point from the LED", "Height above the LED", "Free space over the LED")
    )
    yield shown(f"{far} / Asked", "≤ {} mm", limits.max_radius_mm)
    yield shown(f"{far} / Got", "{} mm", design.max_radius_mm)
    if limits.max_height_mm is not None:
        yield shown(f"{high} / Asked", "≤ {} mm", limits.max_height_mm)
    yield shown(f"{high} / Got", "{} mm", design.height_mm)
    yield shown(f"{room} / Got", "{} mm to spare", design.constraints.cavity_clearance_mm)
    dome = "a dome {} mm high, {} mm wide"
    yield shown(f"{room} / note", dome, limits.cavity_height_mm, 2.0 * limits.cavity_radius_mm)


def _part(part, limits):
    form, normal = part.form_error_nm, part.normal_error_mrad
    yield shown(f"{ASKED} / card / Form error", "{} nm", form.max)
    yield shown(f"{ASKED} / card / Form error / note", "normals within {} mrad", normal.max)
    yield shown(f"{ASKED} / card / Volume", "{} mm³", part.volume_mm3)
    if part.mass_g is not None:
        yield shown(f"{ASKED} / card / Volume / note", "{} g by the density", part.mass_g)
    if part.keep_out is not None:
        yield shown(f"{ASKED} / Distance from the keep-out solid / Asked", "≥ {} mm", limits.keep_out_margin_mm)
        yield shown(f"{ASKED} / Distance from the keep-out solid / Got", "{} mm", part.keep_out.distance_mm)
    title = f"{_READ} / The files as read back"
    yield shown(f"{title} / Form error of the optical faces", "{} nm largest, {} nm rms", form.max, form.rms)
    yield shown(f"{title} / Error of their normals", "{} mrad largest, {} mrad rms", normal.max, normal.rms)
    yield shown(f"{title} / Volume", "{} mm³", part.volume_mm3)
    yield shown(f"{title} / Mesh", "genus {}", part.genus)


def _wall(check, limits):
    thin, thick = f"{ASKED} / Thinnest wall", f"{ASKED} / Thickest wall"
    yield shown(f"{thin} / Asked", "≥ {} mm", limits.min_thickness_mm)
    yield shown(f"{thin} / Got", "{} mm", check.min_wall_mm)
    if limits.max_wall_mm is not None:
        yield shown(f"{thick} / Asked", "≤ {} mm", limits.max_wall_mm)
        yield shown(f"{thick} / Got", "{} mm", check.wall.thickest.thickness_mm)


def _shop(check, limits):
    faces = {"inner": check.inner, "outer": check.outer}
    tightest = min(faces.values(), key=lambda face: face.cutter.largest_radius_mm)
    mill = f"{ASKED} / Ball mill that reaches every hollow"
    yield shown(f"{mill} / Asked", "radius {} mm", tightest.cutter.radius_mm)
    yield shown(f"{mill} / Got", "radius ≤ {} mm", tightest.cutter.largest_radius_mm)
    for name, face in faces.items():
        least = getattr(limits, f"{name}_draft_deg")
        if least is not None:
            yield shown(f"{ASKED} / Draft of the {name} face / Asked", "≥ {}°", least)
            yield shown(f"{ASKED} / Draft of the {name} face / Got", "{}°", face.draft_deg.min)
        title, sphere = f"{_MAPS} / {name.capitalize()} face", face.best_fit_sphere
        words, radii = "R = {} mm; PV {} mm, rms {} mm", (sphere.radius_mm, sphere.pv_mm, sphere.rms_mm)
        yield shown(f"{title}: departure from a sphere / figcaption", words, *radii)
        yield shown(f"{title}: curvature / figcaption", "−1/R of the mill, R = {} mm", face.cutter.radius_mm)
        reached = 100.0 * face.cutter.reachable_fraction
        yield shown(f"{title}: left uncut by the mill / figcaption", "reaches {}\u2009% of the face", reached)
    yield shown(f"{_MAPS} / p", "circles at 30° and 60° from it, the rim at 90°")


def _findings(check):
    for each in check.verdicts:  # with the words that the record has
        yield shown(f"Manufacture / {each.name.capitalize()}, {each.surface}", each.reason)


def _proof(proof, light):
    card = f"{ASKED} / card / Exported part"
    yield shown(card, "{}", proof.first.nmse_vs_design)
    yield shown(f"{card} / note", "by {} rays through it", proof.rays)
    yield shown(f"{card} / note", "ray noise alone: {}", proof.first.noise_floor_nmse)
    designed = {} if light is None else {each.name: each.efficiency.value for each in light.receivers}
    for each in proof.receivers:
        on = f", {each.name}" if len(proof.receivers) > 1 else ""
        title, far = f"{_READ} / Rays through the exported mesh{on}", each.far_field
        yield shown(f"{title} / Rays", "{}", proof.rays)
        landing, gap = f"{title} / Landing, part against design", each.deviation_mm
        yield shown(landing, f"{{}} mm rms, {{}} mm largest{', at 1 m' if far else ''}", gap.rms, gap.max)
        quantity = "intensity" if far else "irradiance"
        yield shown(f"{title} / NMSE against the design's {quantity}", "{}", each.nmse_vs_design)
        yield shown(f"{title} / NMSE of the ray noise alone", "{}", each.noise_floor_nmse)
        yield shown(f"{title} / NMSE against the design with the same rays", "{}", each.nmse_same_rays)
        words, shares = "{}\u2009%", [100.0 * each.efficiency]
        if each.name in designed:
            words, shares = "{}\u2009%; the design has {}\u2009%", [*shares, 100.0 * designed[each.name]]
        yield shown(f"{title} / Efficiency", words, *shares)
        yield shown(f"{_READ} / Exported part{on} / figcaption", "{} rays cast", proof.rays)


def _referees(proof):
    table = "Verification"
    yield shown(f"{table} / columns", "rms, 99 %, largest")
    if any(each.far_field for each in proof.receivers):
        yield shown(f"{table} / p", "those of directions at 1 m,")
    plain = proof.plain_cast
    row = f"{table} / Plain ray cast by trimesh"
    yield shown(f"{row} / Rays", "{}", plain.rays)
    yield shown(f"{row} / note", "{} of {} first hits differ", plain.disagreements, plain.casts)
    for each in proof.receivers:
        on = f", {each.name}" if len(proof.receivers) > 1 else ""
        row = f"{table} / Mesh with smooth normals{on}"
        words, noise = "NMSE {}, ray noise alone {}", (each.nmse_vs_design, each.noise_floor_nmse)
        yield shown(f"{row} / note", words, *noise)
        yield from _gaps(row, proof.rays, each.deviation_mm)
        if each.brep is not None:
            row = f"{table} / CAD kernel, face by face{on}"
            yield shown(f"{row} / note", "lens.step; {} mm rms from the mesh", each.brep.against_mesh.rms)
            yield from _gaps(row, each.brep.rays, each.brep.against_design)
        if each.mitsuba is not None:
            yield from _mitsuba(f"{table} / Mitsuba {each.mitsuba.version}, flat facets{on}", each.mitsuba)
        if each.own_rays is not None:
            yield from _own_rays(f"{table} / Freshly drawn rays of the LED{on}", each.own_rays)


def _gaps(row, rays, gap):
    yield shown(f"{row} / Rays", "{}", rays)
    yield shown(f"{row} / rms", "{}", gap.rms)
    yield shown(f"{row} / 99 %", "{}", gap.p99)
    yield shown(f"{row} / largest", "{}", gap.max)


def _mitsuba(row, cast):
    relation = "within" if cast.nmse_vs_design <= cast.noise_floor_nmse else "above"
    words = f"NMSE {{}}, {relation} the {{}} of ray noise alone"
    yield shown(f"{row} / note", words, cast.nmse_vs_design, cast.noise_floor_nmse)
    yield from _gaps(row, cast.rays, cast.against_design)


def _own_rays(row, own):
    yield shown(f"{row} / Rays", "{}", own.rays)
    for words, metric in (("; efficiency", own.efficiency), ("the design’s light", own.efficiency_design)):
        yield shown(
            f"{row} / note", f"{words} {{}}\u2009% ± {{}}\u2009%", 100.0 * metric.value, 100.0 * metric.standard_error
        )
    less = own.nmse_less_noise
    yield shown(f"{row} / note", "NMSE less noise {} ± {}", less.value, less.standard_error)


def _criteria(results):
    """Value and limit of each criterion, in the table of all; those that are missed stand at the top, too."""
    criteria = [each for _, each in results.criteria()]
    missed = [each for each in criteria if not each.passed]
    tables = [("Verification / All criteria / ", criteria), ("", missed)]
    for table, rows in tables:
        for each in rows:
            label = f"{table}{criterion_words(each.name)}"
            if each.value is not None:
                yield shown(f"{label} / Value", "{}", each.value)
            yield shown(f"{label} / Limit", f"{'≤' if each.sense == '<=' else '≥'} {{}}", each.limit)
            yield shown(f"{label} / Unit", each.unit)
    if missed:
        noun = "criterion" if len(criteria) == 1 else "criteria"
        yield shown("Verification / p", f"{{}} of {{}} {noun}", len(missed), len(criteria))
    elif len(criteria) > 1:
        yield shown("Verification / p", "All {} criteria on light and files are met", len(criteria))
