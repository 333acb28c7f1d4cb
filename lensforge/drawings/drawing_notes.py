"""Notes on the drawing: what sizes are, datums, tolerances and their source, edges, polish, tools."""

from lensforge.drawings.datums import DatumScheme, clocking_flat
from lensforge.drawings.tolerance_table import ToleranceTable
from lensforge.geometry.cutter_room import base_with_room
from lensforge.lens import Lens
from lensforge.manufacturing.advice import advice
from lensforge.manufacturing.result import Check, FaceResult
from lensforge.spec import DrawingSection


def drawing_notes(
    lens: Lens, check: Check, datums: DatumScheme, tolerances: ToleranceTable, words: DrawingSection
) -> list[str]:
    """The notes, a paragraph each; ``words``: what the shop is told beside the design."""
    return [
        "Sizes in parentheses are auxiliary: of the whole part, and of the freeform faces OPTICAL_OUTER and "
        "OPTICAL_INNER"
        f"{', or of the base in its own file' if lens.spec.base.kind == 'step' else ''}. lens.step alone defines them. "
        "z = 0 is the plane in which the optical faces end.",
        *(f"{line}." for line in datums.lines),
        _sources(lens, tolerances),
        _general(words),
        _edges(words),
        "Optical faces polished, free of marks; all other faces as machined, no roughness stated.",
        *_mould(lens),
        *tool_notes(lens, check),
        "Notation as in ISO 10110 and ISO 1101; conformance is not claimed. A dash: nothing is stated.",
    ]


def tool_notes(lens: Lens, check: Check) -> list[str]:
    """Tools that the faces take, by the check, and how many of its findings do not hold."""
    faces = f"{_ball(check.inner)} for the inner face, {_ball(check.outer)} for the outer one{_base(check)}"
    steepest = max(check.inner.largest_tilt_deg, check.outer.largest_tilt_deg)
    found = [
        f"Largest ball that reaches all of a face: {faces}. Tool normal to the faces: tilted up to {steepest:.1f}°."
    ]
    missed = [finding for finding in check.verdicts if not finding.holds]
    if missed:
        found.append(
            f"Check: {len(missed)} of {len(check.verdicts)} findings on tools, base and wall do not hold; "
            "manufacturing.pdf says which, and what to change."
        )
    return found


def tool_advice(lens: Lens, check: Check) -> list[str]:
    """Changes of the spec for each finding that does not hold and has any, and a flat where nothing marks +x."""
    each = ((finding, advice(finding, lens.spec, check)) for finding in check.verdicts)
    found = [f"{finding.name}, {finding.surface}: {words}" for finding, words in each if words]
    flat = clocking_flat(lens, base_with_room(lens))
    return found if flat is None else [*found, f"azimuth, base: base.flat_mm = {flat:g}, a flat across +x"]


def _ball(face: FaceResult) -> str:
    largest = face.cutter.largest_radius_mm
    return "any" if largest is None else f"R {int(1e3 * largest) / 1e3:.3f}"  # rounded down: it still fits


def _base(check: Check) -> str:
    balls = [(face.cutter.largest_radius_mm, face.cutter.radius_mm) for face in (check.inner, check.outer)]
    return max(check.relief.beyond_shop(*ball) for ball in balls)  # once, where one of them is larger


def _sources(lens: Lens, tolerances: ToleranceTable) -> str:
    """Sources of the tolerances of the lens itself, and the share of parts that pass, where that is known."""
    given = [row.name for row in tolerances.lens if row.source == "specification"]
    preset = f"preset “{lens.spec.tolerances.preset}” of lensforge"
    if not tolerances.lens:
        words = "none; the specification sets all of them to 0"
    elif not given:
        words = preset
    elif len(given) == len(tolerances.lens):
        words = "the specification"
    else:
        words = f"the specification ({'; '.join(given)}), the others {preset}"
    passing = f" {tolerances.passing}." if tolerances.passing else ""
    return f"Tolerances on the axis, 3/, 4/, n and roughness: {words}.{passing}"


def _general(words: DrawingSection) -> str:
    stated = words.general_tolerances
    return (
        f"Sizes “general”: {stated}." if stated else "Sizes “general”: no tolerance stated; agree on one with the shop."
    )


def _edges(words: DrawingSection) -> str:
    largest = words.edge_break_mm
    rims = "rims of the optical faces: sharp, without burr or chamfer"
    if largest is None:
        return f"Edges as in lens.step, no break stated; {rims}."
    return f"Edges outside the optical faces: broken, {largest:g} mm at most; {rims}."


def _mould(lens: Lens) -> list[str]:
    shop = lens.spec.manufacture
    if shop.make == "part":
        return []
    return [f"The moulded lens; faces of the mould inserts are these times {shop.scale:.12g} about the origin."]
