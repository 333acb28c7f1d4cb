"""Facts of a part: the solid, and the errors of its files as read back."""

from collections.abc import Iterator

from lensforge.cad.part import STEP_FILE, SURFACES_FILE, Part
from lensforge.results import Bound, Fact, Group
from lensforge.results.criteria import kept
from lensforge.results.numerals import quantity


def part_facts(part: Part) -> list[Group]:
    """One group on solid and files."""
    return [Group("files", "Files as read back", (*_errors(part), *_solid(part), *_mould(part)))]


def _errors(part: Part) -> Iterator[Fact]:
    form, normal = part.form_error_nm, part.normal_error_mrad
    yield Fact(
        "form_error",
        "Form error",
        form.max,
        "nm",
        **kept(part.criteria, "form_error"),
        note=f"largest of the optical faces in the STEP file; {quantity(form.rms, 'nm', digits=2)} rms",
        digits=2,
    )
    yield Fact(
        "normal_error",
        "Error of the normals",
        normal.max,
        "mrad",
        **kept(part.criteria, "normal_error"),
        note=f"largest; {quantity(normal.rms, 'mrad', digits=2)} rms",
        digits=2,
    )
    if part.keep_out is not None:
        margin = Bound(">=", part.lens.spec.constraints.keep_out_margin_mm)
        state = kept(part.criteria, "keep_out_distance").get("state", "")
        yield Fact(
            "keep_out",
            "Keep-out distance",
            part.keep_out.distance_mm,
            "mm",
            limit=margin,
            state=state,
            note="of lens and base from the keep-out solid",
        )


def _solid(part: Part) -> Iterator[Fact]:
    yield Fact("volume", "Volume", part.volume_mm3, "mm³", note="of the solid, base included", digits=5)
    if part.mass_g is not None:
        yield Fact("mass", "Mass", part.mass_g, "g", note="by the density of the spec")
    facets = quantity(part.triangulation.triangles, "facets")
    yield Fact("mesh", "Mesh", "closed" if part.watertight else "not closed", note=f"{facets}, genus {part.genus}")
    yield Fact("schema", "STEP schema", part.step_schema)


def _mould(part: Part) -> Iterator[Fact]:
    """The scale that a mould insert asks for, and the untrimmed faces that have it."""
    scale, untrimmed = part.lens.spec.manufacture.scale, part.untrimmed_surfaces
    if untrimmed is not None:
        errors = f"form error {quantity(untrimmed.form_error_nm, 'nm', digits=2)}"
        normals = f"normals {quantity(untrimmed.normal_error_mrad, 'mrad', digits=2)}"
        beyond = f"{quantity(untrimmed.extension_deg, '°')} beyond the rim"
        yield Fact("surfaces", "Untrimmed faces", SURFACES_FILE, note=f"{beyond}; above it {errors}, {normals}")
    if scale != 1.0:
        carried = f"{SURFACES_FILE} has it" if untrimmed is not None else "`lensforge export --extension DEG` writes it"
        note = f"of the mould insert's faces; {STEP_FILE} is the moulded lens, {carried}"
        yield Fact("scale", "Scale of the mould", scale, note=note, digits=12)
