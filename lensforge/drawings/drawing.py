"""The drawing of a lens for the shop, drawn once: views, dimensions, datums, notes, title block on one sheet.

Of the scales of ISO 5455 it has the largest at which the views fit; the sheet is A3, unless the spec names A4.
"""

from dataclasses import dataclass
from typing import Literal

from lensforge.drawings.datums import datum_scheme
from lensforge.drawings.dimensions import Dimension
from lensforge.drawings.drawing_notes import drawing_notes
from lensforge.drawings.optical_table import Rows, draw_optical_table, optical_table, table_height
from lensforge.drawings.sheet import Box, Place, Sheet
from lensforge.drawings.text_cells import paragraphs_in
from lensforge.drawings.title_block import (
    HEIGHT,
    WIDTH,
    TitleBlock,
    draw_title_block,
    sheet_frame,
    title_block,
)
from lensforge.drawings.tolerance_table import ToleranceTable
from lensforge.drawings.view_drawing import ViewContent, Views, draw_views
from lensforge.drawings.views import dome_lines, end_lines, section_view
from lensforge.errors import InputError
from lensforge.geometry.part import Part
from lensforge.geometry.section import other_section_deg
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check
from lensforge.spec import DrawingSection

SheetName = Literal["A3", "A4"]
SIZES: dict[SheetName, tuple[float, float]] = {"A4": (297.0, 210.0), "A3": (420.0, 297.0)}
_UNITS: dict[SheetName, float] = {"A4": 0.5**0.5, "A3": 1.0}
# ISO 5455, and its further steps of ten.
SCALES = tuple(step * 10.0**power for power in (2, 1, 0, -1, -2, -3) for step in (5.0, 2.0, 1.0))
_BINDING, _BORDER, _GAP = 20.0, 10.0, 4.0  # ISO 5457: borders of every sheet (mm); between blocks, mm on A3


@dataclass(frozen=True)
class DrawingContent:
    """All that the drawing says."""

    views: ViewContent
    notes: list[str]
    table: Rows
    title: TitleBlock


def drawing_content(
    lens: Lens,
    part: Part,
    check: Check,
    dimensions: list[Dimension],
    tolerances: ToleranceTable,
    words: DrawingSection,
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
        title=title_block(lens, part, words),
    )


def make_sheet(content: DrawingContent, name: SheetName = "A3") -> Sheet:
    """Draw the sheet. Raises :class:`InputError` for a part that does not fit at any scale."""
    left, bottom, right, top = _views_box(content, name)
    for scale in SCALES:
        if scale * content.views.width > right - left:  # not even without dimensions
            continue
        box = draw_views(content.views, scale, _UNITS[name], (0.0, 0.0)).box
        if box[2] - box[0] <= right - left and box[3] - box[1] <= top - bottom:
            return _sheet(content, name, scale)
    raise InputError(f"the part fits on {name} at no scale; its drawing is left to a CAD program")


def _inside(name: SheetName) -> Box:
    width, height = SIZES[name]
    return _BINDING, _BORDER, width - _BORDER, height - _BORDER


def _band(content: DrawingContent, name: SheetName) -> float:
    """Height of notes, table and title block."""
    return (HEIGHT + _GAP) * _UNITS[name] + table_height(content.table, _UNITS[name])


def _views_box(content: DrawingContent, name: SheetName) -> Box:
    left, bottom, right, top = _inside(name)
    gap = _GAP * _UNITS[name]
    return left + gap, bottom + _band(content, name) + gap, right - gap, top - gap


def _notes_box(content: DrawingContent, name: SheetName) -> Box:
    left, bottom, right, _ = _inside(name)
    unit = _UNITS[name]
    return (
        left + _GAP * unit,
        bottom + 0.5 * _GAP * unit,
        right - (WIDTH + _GAP) * unit,
        bottom + _band(content, name),
    )


def _sheet(content: DrawingContent, name: SheetName, scale: float) -> Sheet:
    unit, inside = _UNITS[name], _inside(name)
    origin = _centred(draw_views(content.views, scale, unit, (0.0, 0.0)), _views_box(content, name))
    views = draw_views(content.views, scale, unit, origin)
    corner = inside[2], inside[1]
    title = draw_title_block(content.title, corner, unit, scale, name)
    top = inside[1] + _band(content, name)
    table = draw_optical_table(content.table, inside[2] - WIDTH * unit, top, unit)
    notes = paragraphs_in(_notes_box(content, name), content.notes, unit)
    return Sheet(
        name=name,
        size_mm=SIZES[name],
        unit_mm=unit,
        scale=scale,
        title=content.title.title,
        origin=origin,
        strokes=(*sheet_frame(SIZES[name], inside), *views.strokes, *title[0], *table[0]),
        words=(*views.words, *title[1], *table[1], *notes),
        dimensions=tuple(views.dimensions),
    )


def _centred(views: Views, room: Box) -> Place:
    """Place of the part's origin at which what is drawn about (0, 0) lies in the middle of ``room``."""
    box = views.box
    return tuple(0.5 * (room[k] + room[k + 2] - box[k] - box[k + 2]) for k in range(2))  # type: ignore[return-value]
