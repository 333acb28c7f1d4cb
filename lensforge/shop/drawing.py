"""The drawing of a lens for the shop: views, dimensions, datums, notes and title block on one sheet, A3 or A4.

It has the largest of the scales of ISO 5455 at which the views fit.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Literal, get_args

import numpy as np

from lensforge.cad.cutter_room import lens_plan
from lensforge.cad.flange import ring_of
from lensforge.cad.part import STEP_FILE, Part
from lensforge.cad.plan import SIDE, base_corners
from lensforge.cad.plate_result import PLATE_STEP_FILE, Plate
from lensforge.cad.section import other_section_deg
from lensforge.errors import InputError
from lensforge.results.numerals import quantity
from lensforge.scene.lens import Lens
from lensforge.shop.check_measures import BASE
from lensforge.shop.check_result import Check
from lensforge.shop.datums import DatumScheme, datum_scheme
from lensforge.shop.dimensions import Dimension
from lensforge.shop.drawn_views import drawn_dome_lines, drawn_end_lines, section_of_drawn
from lensforge.shop.findings import BODY, OfLathe, OfMill
from lensforge.shop.handover import PDF_FILE, PLATE_PDF_FILE
from lensforge.shop.mould_facts import mould_line, thick_line, upright_phrase
from lensforge.shop.profile_table import ASPHERE_NOTE, DRAWN_NOTE, PROFILE_NOTE, equation, profile_rows, profile_widths
from lensforge.shop.sheet import Box, Marks, Place, Sheet, box_of
from lensforge.shop.sheet_marks import cell, draw_rows, frame_of, paragraphs_in, row_height
from lensforge.shop.sheet_tables import OpticalTable, ToleranceTable, is_general, optical_table
from lensforge.shop.view_drawing import GATE, PARTING_LINE, PaperView, ViewContent, draw_views, fitted
from lensforge.shop.view_lines import SectionView, dome_lines, end_lines, section_view
from lensforge.spec import DrawingSection
from lensforge.spec.plate_section import PlateSection


def drawing_notes(
    lens: Lens, check: Check, datums: DatumScheme, tolerances: ToleranceTable, drawing: DrawingSection
) -> list[str]:
    """The notes, a paragraph each; ``drawing``: what the spec tells the shop in addition."""
    base = "; that of the base is its own file" if lens.spec.base.kind == "step" else ""
    defined = f"{STEP_FILE} alone defines the part{base}"
    if lens.spec.plate is not None:
        defined = f"Faces of one lens of the plate, as in {STEP_FILE}; {PLATE_STEP_FILE} alone defines the part"
    return [
        f"{defined}; sizes in parentheses are auxiliary. The optical faces end in z = 0.",
        *([GENERAL_NOTE] if any(is_general(face, lens) for face in check.faces) else []),
        *(f"{line}." for line in datums.lines),
        *([_profile_note(lens)] if profile_rows(lens, tuple(check.faces)) else []),
        *([ASPHERE_NOTE] if any("asphere" in str(equation(face)) for face in lens.surfaces.values()) else []),
        _sources(lens, tolerances),
        *travel_notes(lens),
        general_tolerance_note(drawing),
        *surface_notes(lens, drawing),
        *mould_notes(lens),
        *_draft_notes(lens, check),
        *([] if check.mould is None else [mould_line(check.mould, lens.spec), thick_line(check.mould, check)]),
        *_other_process_notes(check),
        *_open_findings(lens, check),
        "Notation as in ISO 10110 and ISO 1101; conformance is not claimed. A dash: nothing is stated.",
    ]


def _profile_note(lens: Lens) -> str:
    return PROFILE_NOTE if lens.spec.lens.drawn_mm is None else DRAWN_NOTE


def _draft_notes(lens: Lens, check: Check) -> Iterator[str]:
    """Notes on the draft of base and flange, and on the cylinder beside the flange; none for a base without draft."""
    base = lens.spec.base_made
    flange = lens.spec.lens.rim_flange
    if base.draft_deg and base.kind in ("cylinder", "square"):
        yield f"Draft of the base: {base.draft_deg:g}°; sizes of side, flange and bore at their tops."
    if flange is not None and (draft_deg := lens.spec.manufacture.draft_deg(flange.draft_deg)):
        yield f"Draft of the rim's flange: {draft_deg:g}°; size at its top, narrower towards its underside."
    if check.mould is not None and check.mould.upright:
        yield f"Without draft: {upright_phrase(check.mould)}."


def plate_draft_note(plate: PlateSection) -> str:
    """The note on which features of a plate have draft."""
    if plate.draft_deg == 0.0:
        return "Lens bores, holes, pins, bosses and sides: without draft."
    sides = "without draft" if plate.kind == "step" else f"{plate.draft_deg:g}°, sizes at the top"
    return (
        f"Draft {plate.draft_deg:g}° of lens bores, holes, pins and bosses. Sizes: of holes at the plate’s top, of "
        f"pins at the root, of bores of bosses at the closed end. Sides: {sides}."
    )


def _other_process_notes(check: Check) -> Iterator[str]:
    """A note if the part is made by another process than the one it was designed for."""
    if check.conditions is not None:
        as_is = f"its body, drafts included, is that of {STEP_FILE}"
        yield f"This part is {check.process}, other than it was designed for; {as_is}."


def _is_moulded(lens: Lens) -> bool:
    return lens.spec.manufacture.cuts == "inserts"


def _open_findings(lens: Lens, check: Check) -> list[str]:
    """The failed findings; for a moulded part without those on tools."""
    missed = [
        verdict
        for verdict in check.verdicts
        if not verdict.holds and not (_is_moulded(lens) and verdict.key in _ON_TOOLS)
    ]
    named = [
        f"{'' if finding.place == BODY else f'{finding.place} face, '}{finding.label.lower()}: no, {finding.text} "
        f"(required {finding.required})"
        for finding in missed[:_MOST_FINDINGS]
    ]
    more = f"; {len(missed) - len(named)} more" if len(missed) > len(named) else ""
    return [f"Open, see manufacturing.html: {'; '.join(named)}{more}."] if missed else []


def _sources(lens: Lens, tolerances: ToleranceTable) -> str:
    """Sources of the lens's own tolerances, and the passing share of parts, if known."""
    given = [row.name for row in tolerances.lens if row.source == "specification"]
    preset = f"preset “{lens.spec.tolerances.preset}” of lensforge"
    if not tolerances.lens:
        source = "none; the specification sets all of them to 0"
    elif not given:
        source = preset
    elif len(given) == len(tolerances.lens):
        source = "the specification"
    else:
        source = f"the specification ({'; '.join(given)}), the others {preset}"
    passing = f" {tolerances.passing}." if tolerances.passing else ""
    return f"Tolerances on the axis, 3/, 4/, n and roughness: {source}.{passing}"


def travel_notes(lens: Lens) -> Iterator[str]:
    """A note on the stops of an LED that moves between the states of a lens; none if it stays."""
    by_place = {name: spec.source.place_words for name, spec in lens.spec.by_state.items()}
    if lens.spec.states and len(set(by_place.values())) > 1:
        stops = "; ".join(f"{name}: {place or 'at the origin'}" for name, place in by_place.items())
        yield f"The LED moves against the lens; its stops are {stops}."


def general_tolerance_note(drawing: DrawingSection) -> str:
    """The tolerances of sizes without a tolerance of their own."""
    stated = drawing.general_tolerances
    return (
        f"Sizes “general”: {stated}." if stated else "Sizes “general”: no tolerance stated; agree on one with the shop."
    )


def surface_notes(lens: Lens, drawing: DrawingSection) -> list[str]:
    """Notes on edges, and on the finish of optical and other faces."""
    optical = drawing.optical_edge_mm
    break_mm = drawing.edge_break_mm
    rims = "largest radius not stated" if optical is None else f"R {optical:g} at most"
    _, burr, traces, _ = lens.spec.manufacture.making.terms
    other_edges = "largest break not stated" if break_mm is None else f"radius or chamfer {break_mm:g} at most"
    return [
        f"Rims and creases of the optical faces: {rims}. All other edges: {other_edges}; without {burr}.",
        f"Optical faces: polished, without {traces}. All other faces: {drawing.finish or f'finish {_NONE}'}.",
    ]


def mould_notes(lens: Lens) -> list[str]:
    """A note on the sizes of a moulded part and its shrinkage; none for parts that are cut."""
    scale = lens.spec.manufacture.scale
    if not _is_moulded(lens):
        return []
    if scale == 1.0:
        return ["Sizes are those of the moulded part. Shrinkage: not stated, and in no file."]
    return [
        "Sizes are those of the moulded part; the faces of the mould inserts are these times "
        f"{scale:.12g} about the origin."
    ]


GENERAL_NOTE = (
    f"GS: general surface, ISO 10110-19: the face of that name in {STEP_FILE}, in its x, y and z, by the SHA-256 of "
    "the title block; 3/, 4/ and 5/ are to that face."
)
TitleBlock = dict[str, tuple[str, ...]]  # cells of each row, by its key
WIDTH = 180.0  # mm on A3
ROW = 5.6  # mm on A3
HEIGHT = 8.0 * ROW
_NONE = "not stated"
_ON_TOOLS = (*get_args(OfMill), *get_args(OfLathe))  # findings that ask for a tool
_MOST_FINDINGS = 3
_SAME_MM = 1e-6


def title_of(lens: Lens, drawing: DrawingSection) -> str:
    """Name, number and revision in one line."""
    name_and_number = [drawing.part_name or lens.spec.name, drawing.part_number]
    return ", ".join([*filter(None, name_and_number), *([f"revision {drawing.revision}"] if drawing.revision else [])])


def title_block(lens: Lens, part: Part, drawing: DrawingSection, *, of_plate: bool = False) -> TitleBlock:
    """Rows for the shop, and from the record of the part or its plate: author and date are those of its files."""
    spec = lens.spec
    signature = part.signature
    general = drawing.general_tolerances or f"{_NONE}, to be agreed"
    body: Part | Plate = part
    file = STEP_FILE
    name = drawing.part_name or spec.name
    pages = "1 of 1"
    mass = ""
    kinds = [kind.kind for kind in lens.kinds]
    if part.plate is not None and of_plate:
        body = part.plate
        file = PLATE_STEP_FILE
        name = f"{name}, plate of {quantity(part.plate.lenses, 'lenses')}"
        pages = f"1 of {1 + len(kinds)}, {PLATE_PDF_FILE}"
    elif spec.plate is not None:
        lens_name = f"lens {lens.kind} of the plate" if lens.kind else "one lens of the plate"
        name = f"{name}, {lens_name}"
        mass = "Mass: that of the plate, sheet 1"
        pages = f"{2 + kinds.index(lens.kind)} of {1 + len(kinds)}, {PDF_FILE}"
    density = spec.lens.density
    volume = f"Volume: {body.volume_mm3:.1f} mm³"
    return {
        "name": (name,),
        "number": _cells(Number=drawing.part_number, Revision=drawing.revision, Date=signature.date),
        "material": _cells(Material=spec.lens.material, Grade=drawing.material_grade, Process=spec.manufacture.process),
        "mass": (
            *_cells(Density=None if density is None else f"{density.g_per_cm3:g} g/cm³"),
            mass or (volume if body.mass_g is None else f"Mass: {body.mass_g:.3f} g; {volume}"),
        ),
        "drawn": _cells(Drawn=signature.author, Checked=drawing.checked_by, Organisation=signature.organisation),
        "general": (f"Sizes “general”: {general}", "Units: mm, degrees"),
        "scale": (f"sheet {pages}",),
        "defined": (f"Defined by: {file}, SHA-256 {part.files[file].sha256[:16]}…",),
    }


def _cells(**values: str | None) -> tuple[str, ...]:
    return tuple(f"{name}: {stated or _NONE}" for name, stated in values.items())


def scale_label(scale: float) -> str:
    """The scale in the notation of ISO 5455."""
    return f"{scale:g} : 1" if scale >= 1.0 else f"1 : {1.0 / scale:g}"


def draw_title_block(block: TitleBlock, corner: tuple[float, float], unit: float, scale: float, sheet: str) -> Marks:
    """The block, its lower right corner at ``corner``, with the scale and the size of the sheet."""
    left, bottom = corner[0] - WIDTH * unit, corner[1]
    height = ROW * unit
    rows = {**block, "scale": (f"Scale: {scale_label(scale)}", f"First angle; {sheet}, {block['scale'][0]}")}
    top = bottom + HEIGHT * unit
    marks = Marks()
    for number, row in enumerate(rows.values()):
        low = top - (number + 1) * height
        wide = WIDTH * unit / len(row)
        for k, text in enumerate(row):
            marks.add(cell((left + k * wide, low, left + (k + 1) * wide, low + height), text, unit))
    marks.strokes.append(frame_of((left, bottom, corner[0], top), "outline"))
    return marks


SheetName = Literal["A3", "A4"]
SIZES: dict[SheetName, tuple[float, float]] = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
_UNITS: dict[SheetName, float] = {"A4": 0.5**0.5, "A3": 1.0}
_PROFILE = 18.0  # width of a column of the profiles beside the views, mm on A3
_NARROW = 3  # columns of a table that is as wide as the title block
_BINDING = 20.0  # border of every sheet (mm) on its left: ISO 5457
_BORDER = 10.0  # its other borders (mm)
_GAP = 4.0  # between blocks, mm on A3


@dataclass(frozen=True)
class DrawingContent:
    """All that the drawing says."""

    views: ViewContent
    notes: list[str]
    profiles: list[list[str]]
    table: OpticalTable
    block: TitleBlock
    title: str


def drawing_content(
    lens: Lens,
    part: Part,
    check: Check,
    dimensions: list[Dimension],
    tolerances: ToleranceTable,
    drawing: DrawingSection,
) -> DrawingContent:
    """Collect the content from the results of the lens and, for the title block, from ``drawing`` of the spec."""
    datums = datum_scheme(lens, part)
    return DrawingContent(
        views=_views(lens, check, dimensions, datums),
        notes=drawing_notes(lens, check, datums, tolerances, drawing),
        profiles=profile_rows(lens, tuple(reversed(check.faces))),
        table=optical_table(lens, part, check, drawing),
        block=title_block(lens, part, drawing),
        title=title_of(lens, drawing),
    )


def _views(lens: Lens, check: Check, dimensions: list[Dimension], datums: DatumScheme) -> ViewContent:
    if lens.spec.lens.drawn_mm is not None:
        sides = drawn_end_lines(lens), drawn_dome_lines(lens)
        return ViewContent([section_of_drawn(lens)], *sides, dimensions, datums, {})
    second_deg = other_section_deg(lens)
    sections = [section_view(lens, "S", 0.0)]
    if second_deg is not None:
        sections.append(section_view(lens, "T", second_deg))
    marks = _mould_marks(lens, check, sections[0])
    return ViewContent(sections, end_lines(lens), dome_lines(lens), dimensions, datums, marks)


def _mould_marks(lens: Lens, check: Check, section: SectionView) -> dict[str, Place]:
    """Places of parting line and gate in a section; none for a plate, whose own drawing has them."""
    if check.mould is None or lens.spec.plate is not None:
        return {}
    points = np.concatenate(section.outlines)
    widest = points[points[:, 1] > points[:, 1].max() - _SAME_MM]
    marks = {PARTING_LINE: (float(widest[:, 0].mean()), float(widest[0, 1]))}
    ring = ring_of(lens)
    if ring is not None:
        marks[GATE] = 0.5 * (ring.low_mm + ring.high_mm), 0.5 * (ring.foot_mm + ring.outer_mm)
    elif check.mould.gate == BASE:
        top, foot = next(ends for ends in pairwise(base_corners(lens_plan(lens))) if ends[0].face == SIDE)
        across = [float(end.radius(np.zeros(1))[0]) for end in (top, foot)]
        marks[GATE] = -0.5 * (top.depth_mm + foot.depth_mm), 0.5 * sum(across)
    return marks


def make_sheet(content: DrawingContent, name: SheetName = "A3") -> Sheet:
    """Draw the sheet. Raises :class:`InputError` for a part that fits at no scale."""
    unit = unit_of(name)
    inside = inside_of(name)
    fit = partial(fitted, partial(draw_views, content.views), content.views.width, unit=unit)
    tried = list[tuple[PaperView, ProfilePlace]]()
    (under, *beside) = _profile_places(content, name)
    for place in beside:
        with suppress(InputError):  # below the views there may be more room
            tried.append((fit(room=place.room), place))
    with suppress(*([InputError] if tried else [])):
        tried.append((fit(room=under.room), under))
    view, profiles = max(tried, key=lambda view_and_profiles: view_and_profiles[0].scale)
    right, bottom = inside[2], inside[1]
    marks = Marks([frame_of(inside, "outline")])
    marks.add(draw_views(content.views, view))
    marks.add(draw_title_block(content.block, (right, bottom), unit, view.scale, name))
    top = bottom + _table_top(content, name)
    width = _table_width(content, name)
    marks.add(content.table.drawn(right, top, width, unit))
    marks.add(draw_rows(profiles.rows, *profiles.corner, profiles.widths, unit))
    marks.texts += paragraphs_in(_notes_box(content, name), content.notes, unit)
    return Sheet(name, SIZES[name], unit, view.scale, content.title, view.origin, marks)


def unit_of(name: SheetName) -> float:
    """Size of a millimetre of the A3 layout."""
    return _UNITS[name]


def inside_of(name: SheetName) -> Box:
    """The frame of a sheet, within its borders."""
    width, height = SIZES[name]
    return _BINDING, _BORDER, width - _BORDER, height - _BORDER


def _is_wide(content: DrawingContent) -> bool:
    """True for a table with too many faces to stand above the title block: it takes the full width, above the notes."""
    return len(content.table.columns) > _NARROW


def _table_width(content: DrawingContent, name: SheetName) -> float:
    left, _, right, _ = inside_of(name)
    return (right - left) / unit_of(name) if _is_wide(content) else WIDTH


def _block_height(content: DrawingContent, name: SheetName) -> float:
    """Height of the title block and of the notes beside it, where the table stands above both."""
    left, _, right, _ = inside_of(name)
    unit = unit_of(name)
    box = left + _GAP * unit, -SIZES[name][1], right - (WIDTH + _GAP) * unit, 0.0
    lowest = min(box_of(paragraph)[1] for paragraph in paragraphs_in(box, content.notes, unit))
    return max(HEIGHT * unit, _GAP * unit - lowest)


def _table_top(content: DrawingContent, name: SheetName) -> float:
    """Height of the title block and of the table of the optical faces over it."""
    unit = unit_of(name)
    table = content.table.height(_table_width(content, name), unit)
    return _block_height(content, name) + _GAP * unit + table if _is_wide(content) else (HEIGHT + _GAP) * unit + table


@dataclass(frozen=True)
class ProfilePlace:
    """The table of profiles at one place: its upper left ``corner``, and the ``room`` that it leaves to the views."""

    rows: Sequence[Sequence[str]]
    widths: Sequence[float]
    corner: Place
    room: Box


def _profile_places(content: DrawingContent, name: SheetName) -> list[ProfilePlace]:
    """Candidate places of the profile table: below the views over the full width, and to their right."""
    (left, bottom, right, top) = inside_of(name)
    unit = unit_of(name)
    gap = _GAP * unit
    below = bottom + _table_top(content, name)
    rows = content.profiles
    widths = profile_widths(right - left)
    narrow = [_PROFILE * unit] * len(rows)
    over = below + (gap + _height(rows, widths, unit) if rows else 0.0)
    under = ProfilePlace(rows, widths, (left, over), (left + gap, over + gap, right - gap, top - gap))
    columns = list(zip(*rows, strict=True))
    start = right - sum(narrow)
    beside = ProfilePlace(columns, narrow, (start, top), (left + gap, below + gap, start - gap, top - gap))
    return [under, beside] if rows and _height(columns, narrow, unit) < top - below - gap else [under]


def _height(rows: Sequence[Sequence[str]], widths: Sequence[float], unit: float) -> float:
    return sum(row_height(texts, widths, unit) for texts in rows)


def _notes_box(content: DrawingContent, name: SheetName) -> Box:
    left, bottom, right, _ = inside_of(name)
    unit = unit_of(name)
    top = _block_height(content, name) + 0.5 * _GAP * unit if _is_wide(content) else _table_top(content, name)
    return left + _GAP * unit, bottom + 0.5 * _GAP * unit, right - (WIDTH + _GAP) * unit, bottom + top
