"""Numbers around the sections of the report: the task, reasons of the verdict, files, times, and other conditions."""

from importlib.metadata import version

from shown_numbers import shown
from wanted_light import ASKED, transmitted, wanted_share

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.proof.proof_result import Proof
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check

_TIMED = {
    "design": "search", "evaluate": "simulated light", "export": "CAD and files", "check": "check for the shop",
    "verify": "verification", "photometry": "photometry",
}  # fmt: skip
_PURPOSES = {"lens.step": "solid for CAD and CAM", "lens.stl": "mesh", "lens.3mf": "mesh for printers"}
_PACKAGES = ("numpy", "scipy", "torch", "numba", "cadquery", "trimesh", "manifold3d", "matplotlib", "pyvista")


def frame_numbers(results):
    """Entries of what stands before and after the sections."""
    yield from task_numbers(results.spec)
    for part, each in reasons(results):
        if part == "Cutting":
            yield shown(f"{ASKED} / li", f"{each.words[:1].upper()}{each.words[1:]}", *each.values)
        else:
            yield shown("li", f"{part}: {each.words}", *each.values)
    yield from _files(results.find(Part))
    yield from _times(results)
    for azimuth in ("0", "90"):
        title = f"Section at φ = {azimuth}°"
        yield shown(f"Lens / {title} / title", title)
    design = results.find(Design)
    if design is not None:
        course = "Search / Course of the search, level by level / Constraints by level / figcaption"
        yield shown(course, "Below 0 (red) a constraint is violated.")
        for warning in design.source.warnings:
            yield shown("li", warning)


def task_numbers(spec):
    """Entries of the line on source, lens, and targets."""
    lens, source = spec.lens, spec.source
    yield (
        shown("p", getattr(source, "file", None).name)
        if hasattr(source, "file")
        else shown("p", "{} mm square Lambertian source", source.side_mm)
    )
    yield shown("p", f"{lens.material}, n = {{}}", lens.refractive_index)
    if lens.cavity_index != 1.0:
        yield shown("p", "n = {} in the cavity", lens.cavity_index)
    for receiver in spec.all_receivers:
        yield from _on_receiver(receiver)


def _on_receiver(receiver):
    target = receiver.targets[0]
    if target.kind == "text":
        yield shown("p", "{} mm wide at {} mm", target.width_mm, receiver.distance_mm)
    elif target.kind == "rectangle":
        words = "{} × {} mm centred at ({}, {}, {}) mm"
        yield shown("p", words, target.width_mm, target.height_mm, *receiver.centre_mm)
    else:
        words = "beam {}° × {}° in the far field, to {}°"
        yield shown("p", words, *target.fwhm_deg, receiver.half_angle_deg)


def reasons(results):
    """Part of the verdict and entry of each reason that has a number: first those of the light, of the files."""
    light, check = results.find(Light), results.find(Check)
    if light is not None:
        yield from (("Light", each) for each in _of_light(light, results))
    for kind in (Design, Part, Check, Proof):
        found = results.find(kind)
        for each in found.criteria if found is not None else ():
            if not each.passed:
                yield "Files", _missed(each)
    if check is not None:
        yield from (("Cutting", each) for each in _of_cutting(check, results.spec))


def _of_light(light, results):
    for each in light.limits:
        if each.state == "missed":
            value, words = each.value, f"{each.name}: {each.quantity} = {{}} ± {{}} {each.unit}, must be"
            numbers = (value.value, value.standard_error, each.bound)
            yield shown("", f"{words} {each.sense} {{}} {each.unit}", *numbers)
    if light.nmse.standard_error is None:
        alone = "has no standard error, because the rays are a single sample: {}, at"
        yield shown("", f"NMSE {alone} most 0.1", light.nmse.value)
        share, possible = light.share_in_target.value, light.possible.share_in_target
        assert possible < transmitted(results.lens) * wanted_share(light.first)
        words = f"share of the light in the target {alone} least 0.7 of the {{}} that is possible"
        yield shown("", words, share, possible)


def _missed(each):
    """Value and limit of a criterion; without a unit nothing stands after the number."""
    number = f"{{}} {each.unit}".rstrip()
    must = f"must be {each.sense} "
    if each.value is None:
        return shown("", f"{each.name} could not be measured ({must}{number})", each.limit)
    words = f"{each.name} = {number} ({must}{{}}): missed by {number};"
    return shown("", words, each.value, each.limit, abs(each.value - each.limit))


def _of_cutting(check, spec):
    for each in check.verdicts:
        if not each.holds and each.name != "draft":
            yield shown("", each.reason)
    for name, face in (("inner", check.inner), ("outer", check.outer)):
        least = getattr(spec.constraints, f"{name}_draft_deg")
        if least is not None and face.draft_deg.min < least:
            words = f"the {name} face has a draft of {{}} deg, the spec requires {{}}"
            yield shown("", words, face.draft_deg.min, least)


def _files(part):
    for name, stamp in part.files.items() if part is not None else ():
        size, unit = (stamp.bytes, "B") if stamp.bytes < 1000 else (stamp.bytes / 1e3, "kB")
        yield shown("Files / li / note", f"{_PURPOSES[name]}, {{}}\u2009{unit}", size)
        yield shown(f"Files / All files with their hashes / {name} / Size", f"{{}}\u2009{unit}", size)
        yield shown(f"Files / All files with their hashes / {name} / SHA-256", stamp.sha256)


def _times(results):
    for stem, words in _TIMED.items():
        if stem in results.found:
            yield shown("Search / p", f"{words} {{}} s", results.found[stem].seconds)
    if results.seconds is not None:
        yield shown("Search / p", "up to this page, {} s", results.seconds)
    lens, again = results.lens, "Reproduce this design"
    yield shown(f"{again} / pre", "--seed {}", lens.seed)
    yield shown(
        f"{again} / p", f"Designed with lensforge {lens.version}. This page was written by lensforge {lens.version}"
    )
    for name in _PACKAGES:
        yield shown(f"{again} / p", f"{name} {version(name)}")
