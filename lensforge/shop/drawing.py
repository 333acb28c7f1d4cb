"""The drawing of a lens for the shop: views, dimensions, datums, notes and title block on one sheet, A3 or A4.

It has the largest of the scales of ISO 5455 at which the views fit.
"""

from dataclasses import dataclass
from functools import partial
from typing import Literal

from lensforge.cad.boundary import optical_name
from lensforge.cad.part import STEP_FILE, Part
from lensforge.cad.plate_result import PLATE_STEP_FILE, Plate
from lensforge.cad.section import other_section_deg
from lensforge.results.numerals import quantity
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check, FaceResult
from lensforge.shop.dimensions import DatumScheme, Dimension, datum_scheme
from lensforge.shop.sheet import Box, Marks, Sheet, box_of
from lensforge.shop.sheet_marks import cell, frame_of, paragraphs_in
from lensforge.shop.sheet_tables import OpticalTable, ToleranceTable, optical_table
from lensforge.shop.view_drawing import ViewContent, draw_views, fitted
from lensforge.shop.view_lines import dome_lines, end_lines, section_view
from lensforge.spec import DrawingSection


def drawing_notes(
    lens: Lens, check: Check, datums: DatumScheme, tolerances: ToleranceTable, words: DrawingSection
) -> list[str]:
    """The notes, a paragraph each; ``words``: what the shop is told beside the design."""
    return [
        "Sizes in parentheses are auxiliary: of the whole part, and of the freeform faces "
        f"{' and '.join(optical_name(name) for name in reversed(check.faces))}"
        f"{', or of the base in its own file' if lens.spec.base.kind == 'step' else ''}. lens.step alone defines them. "
        "z = 0 is the plane in which the optical faces end.",
        *(f"{line}." for line in datums.lines),
        _sources(lens, tolerances),
        general_words(words),
        _edges(words),
        "Optical faces polished, free of marks; all other faces as machined, no roughness stated.",
        *mould_words(lens),
        *tool_notes(check),
        "Notation as in ISO 10110 and ISO 1101; conformance is not claimed. A dash: nothing is stated.",
    ]


def tool_notes(check: Check) -> list[str]:
    """Tools that the faces take, by the check, and how many of its findings do not hold."""
    faces = ", ".join(f"{_ball(face)} for the {name} face" for name, face in check.faces.items()) + _base(check)
    steepest = max(face.largest_tilt_deg for face in check.faces.values())
    found = [
        f"Largest ball that reaches all of a face: {faces}. Tool normal to the faces: tilted up to {steepest:.1f}°."
    ]
    missed = [finding for finding in check.verdicts if not finding.holds]
    if missed:
        found.append(
            f"Check: {len(missed)} of {len(check.verdicts)} findings on tools, base and wall do not hold; "
            "manufacturing.html says which, and what to change."
        )
    return found


def _ball(face: FaceResult) -> str:
    largest = face.cutter.largest_radius_mm
    return "any" if largest is None else f"R {int(1e3 * largest) / 1e3:.3f}"  # rounded down: it still fits


def _base(check: Check) -> str:
    balls = [(face.cutter.largest_radius_mm, face.cutter.radius_mm) for face in check.faces.values()]
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


def general_words(words: DrawingSection) -> str:
    """The tolerances of sizes that have none of their own."""
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


def mould_words(lens: Lens) -> list[str]:
    """A note on the faces of the mould, by how much they are larger; none for parts that are cut."""
    shop = lens.spec.manufacture
    if shop.cuts != "inserts":
        return []
    return [f"The moulded lens; faces of the mould inserts are these times {shop.scale:.12g} about the origin."]


TitleBlock = dict[str, tuple[str, ...]]  # cells of each row, by its key
WIDTH, ROW = 180.0, 5.6  # mm on A3
HEIGHT = 8.0 * ROW
_NONE = "not stated"


def title_of(lens: Lens, words: DrawingSection) -> str:
    """Name, number and revision in one line."""
    named = [words.part_name or lens.spec.name, words.part_number]
    return ", ".join([*filter(None, named), *([f"revision {words.revision}"] if words.revision else [])])


def title_block(lens: Lens, part: Part, words: DrawingSection, *, of_plate: bool = False) -> TitleBlock:
    """Rows for the shop, and from the record of the part or its plate: author and date are those of its files."""
    spec, signature, general = lens.spec, part.signature, words.general_tolerances or f"{_NONE}, to be agreed"
    body: Part | Plate = part
    file, name = STEP_FILE, words.part_name or spec.name
    if of_plate and part.plate is not None:
        body, file, name = part.plate, PLATE_STEP_FILE, f"{name}, plate of {quantity(part.plate.lenses, 'lenses')}"
    mass = f"Volume: {body.volume_mm3:.1f} mm³" if body.mass_g is None else f"Mass: {body.mass_g:.3f} g"
    return {
        "name": (name,),
        "number": (f"Number: {words.part_number or _NONE}", f"Revision: {words.revision or _NONE}"),
        "material": (f"Material: {spec.lens.material or _NONE}", mass),
        "drawn": (f"Drawn: {signature.author or _NONE}", f"Date: {signature.date or _NONE}"),
        "checked": (f"Checked: {words.checked_by or _NONE}", f"Organisation: {signature.organisation or _NONE}"),
        "general": (f"Sizes “general”: {general}", "Units: mm, degrees"),
        "scale": (),  # of the sheet on which it stands
        "defined": (f"Defined by: {file}, SHA-256 {part.files[file].sha256[:16]}…",),
    }


def scale_words(scale: float) -> str:
    """The scale as ISO 5455 writes it."""
    return f"{scale:g} : 1" if scale >= 1.0 else f"1 : {1.0 / scale:g}"


def draw_title_block(block: TitleBlock, corner: tuple[float, float], unit: float, scale: float, sheet: str) -> Marks:
    """The block, its lower right corner at ``corner``, with the scale and the size of the sheet."""
    left, bottom = corner[0] - WIDTH * unit, corner[1]
    height = ROW * unit
    rows = {**block, "scale": (f"Scale: {scale_words(scale)}", f"First angle; {sheet}, sheet 1 of 1")}
    top = bottom + HEIGHT * unit
    marks = Marks()
    for number, each in enumerate(rows.values()):
        low, wide = top - (number + 1) * height, WIDTH * unit / len(each)
        for k, text in enumerate(each):
            marks.add(cell((left + k * wide, low, left + (k + 1) * wide, low + height), text, unit))
    marks.strokes.append(frame_of((left, bottom, corner[0], top), "outline"))
    return marks


SheetName = Literal["A3", "A4"]
SIZES: dict[SheetName, tuple[float, float]] = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
_UNITS: dict[SheetName, float] = {"A4": 0.5**0.5, "A3": 1.0}
_NARROW = 3  # columns of a table that is as wide as the title block
_BINDING, _BORDER, _GAP = 20.0, 10.0, 4.0  # ISO 5457: borders of every sheet (mm); between blocks, mm on A3


@dataclass(frozen=True)
class DrawingContent:
    """All that the drawing says."""

    views: ViewContent
    notes: list[str]
    table: OpticalTable
    block: TitleBlock
    title: str


def drawing_content(
    lens: Lens, part: Part, check: Check, dimensions: list[Dimension], tolerances: ToleranceTable, words: DrawingSection
) -> DrawingContent:
    """Collect what the drawing says, from the results of the lens and from ``words``, those of its title block."""
    datums, second_deg = datum_scheme(lens, part), other_section_deg(lens)
    sections = [section_view(lens, "S", 0.0)]
    if second_deg is not None:
        sections.append(section_view(lens, "T", second_deg))
    return DrawingContent(
        views=ViewContent(sections, end_lines(lens), dome_lines(lens), dimensions, datums),
        notes=drawing_notes(lens, check, datums, tolerances, words),
        table=optical_table(lens, part, check, words),
        block=title_block(lens, part, words),
        title=title_of(lens, words),
    )


def make_sheet(content: DrawingContent, name: SheetName = "A3") -> Sheet:
    """Draw the sheet. Raises :class:`InputError` for a part that does not fit at any scale."""
    unit, inside = unit_of(name), inside_of(name)
    view = fitted(partial(draw_views, content.views), content.views.width, _views_box(content, name), unit)
    right, bottom = inside[2], inside[1]
    marks = Marks([frame_of(inside, "outline")])
    marks.add(draw_views(content.views, view))
    marks.add(draw_title_block(content.block, (right, bottom), unit, view.scale, name))
    top, width = bottom + _band(content, name), _table_width(content, name)
    marks.add(content.table.drawn(right, top, width, unit))
    marks.words += paragraphs_in(_notes_box(content, name), content.notes, unit)
    return Sheet(name, SIZES[name], unit, view.scale, content.title, view.origin, marks)


def unit_of(name: SheetName) -> float:
    """Size of a millimetre of the A3 layout."""
    return _UNITS[name]


def inside_of(name: SheetName) -> Box:
    """The frame of a sheet, within its borders."""
    width, height = SIZES[name]
    return _BINDING, _BORDER, width - _BORDER, height - _BORDER


def _is_wide(content: DrawingContent) -> bool:
    """True for a table of more faces than stand above the title block: it has all the width, above the notes too."""
    return len(content.table.columns) > _NARROW


def _table_width(content: DrawingContent, name: SheetName) -> float:
    """Width of the table, mm on A3."""
    left, _, right, _ = inside_of(name)
    return (right - left) / unit_of(name) if _is_wide(content) else WIDTH


def _block_height(content: DrawingContent, name: SheetName) -> float:
    """Height of the title block and of the notes beside it, where the table stands above both."""
    left, _, right, _ = inside_of(name)
    unit = unit_of(name)
    box = left + _GAP * unit, -SIZES[name][1], right - (WIDTH + _GAP) * unit, 0.0
    lowest = min(box_of(words)[1] for words in paragraphs_in(box, content.notes, unit))
    return max(HEIGHT * unit, _GAP * unit - lowest)


def _band(content: DrawingContent, name: SheetName) -> float:
    """Height of notes, table and title block."""
    unit = unit_of(name)
    table = content.table.height(_table_width(content, name), unit)
    return _block_height(content, name) + _GAP * unit + table if _is_wide(content) else (HEIGHT + _GAP) * unit + table


def _views_box(content: DrawingContent, name: SheetName) -> Box:
    left, bottom, right, top = inside_of(name)
    gap = _GAP * unit_of(name)
    return left + gap, bottom + _band(content, name) + gap, right - gap, top - gap


def _notes_box(content: DrawingContent, name: SheetName) -> Box:
    left, bottom, right, _ = inside_of(name)
    unit = unit_of(name)
    top = _block_height(content, name) + 0.5 * _GAP * unit if _is_wide(content) else _band(content, name)
    return left + _GAP * unit, bottom + 0.5 * _GAP * unit, right - (WIDTH + _GAP) * unit, bottom + top
