"""The views on paper at a scale: outlines, hatching, axes, dimensions and datum symbols, and the room they need.

Dimension lines stand beside a view, the smallest nearest to the part, so that no text meets another or a line.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from lensforge.errors import InputError
from lensforge.shop.datums import DatumScheme
from lensforge.shop.dimensions import FLANGE_WIDTH, Dimension, ViewName
from lensforge.shop.sheet import (
    LETTERS,
    Anchor,
    Box,
    LinearDimension,
    Marks,
    PenName,
    Place,
    Points,
    SheetText,
    Stroke,
    box_of,
    shown,
    width_of,
)
from lensforge.shop.sheet_marks import (
    ARROW,
    TAIL,
    arrow_head,
    axes_mark,
    datum_symbol,
    dimension_text,
    hatch,
    occupied,
    section_plane,
    text_span,
)
from lensforge.shop.view_lines import SectionView, ViewLine

FIRST = 8.0  # to the first line of dimensions, mm on A3
ROW = 5.6  # between lines of dimensions, mm on A3
_GAP = 14.0  # between views, mm on A3
HATCH = 3.5
PARTING_LINE = "PL"
GATE = "G"
_ANCHORS: dict[str, Anchor] = {PARTING_LINE: "left", GATE: "right"}
# ISO 5455, and its further steps of ten.
SCALES = tuple(step * 10.0**power for power in (2, 1, 0, -1, -2, -3) for step in (5.0, 2.0, 1.0))
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 181)


@dataclass(frozen=True)
class ViewContent:
    """Lines (mm, of the part) of one or two sections, of the views from the base and of the dome; sizes and datums.

    ``mould``: places (z, across) in the first section of the parting line and the gate, by their labels.
    """

    sections: list[SectionView]
    base: list[ViewLine]
    dome: list[ViewLine]
    dimensions: list[Dimension]
    datums: DatumScheme
    mould: dict[str, Place]

    def section_box(self, section: SectionView) -> Box:
        """The box of the section in (z, across), with lines behind and before it."""
        return _box(np.concatenate([*section.outlines, *(line.points for line in section.lines)]))

    @property
    def base_box(self) -> Box:
        """The box of the view from the base in (y, x)."""
        return _box(np.concatenate([line.points for line in self.base]))

    @property
    def dome_box(self) -> Box:
        """The box of the view of the dome in (-y, x), its circles included."""
        half = max((circle.value_mm / 2.0 for circle in self.drawn("dome")), default=0.0)
        return _box(np.concatenate([*(line.points for line in self.dome), [(-half, -half), (half, half)]]))

    @property
    def boxes(self) -> list[Box]:
        """The boxes of all views."""
        return [self.dome_box, self.base_box, *map(self.section_box, self.sections)]

    @property
    def width(self) -> float:
        """Width (mm, of the part) of all views side by side."""
        return sum(box[2] - box[0] for box in self.boxes)

    @property
    def half_height(self) -> float:
        """Largest distance (mm, of the part) from the axis in any view."""
        return max(max(-box[1], box[3]) for box in self.boxes)

    def drawn(self, view: ViewName) -> list[Dimension]:
        """Dimensions that are drawn in ``view``."""
        return [dimension for dimension in self.dimensions if dimension.ends is not None and dimension.view == view]


def room_of(marks: Marks) -> Box:
    """The box on paper of all marks."""
    boxes = [_box(stroke.points) for stroke in marks.strokes]
    boxes += [box_of(word) for word in marks.texts]
    boxes += [box_of(dimension_text(dimension)) for dimension in marks.dimensions]
    for dimension in marks.dimensions:
        low, high = occupied(dimension)
        boxes.append((*dimension.at(low, dimension.line_mm), *dimension.at(high, dimension.line_mm)))
    low, high = np.array(boxes)[:, :2].min(axis=0), np.array(boxes)[:, 2:].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _box(points: Points) -> Box:
    left, bottom = points.min(axis=0)
    right, top = points.max(axis=0)
    return float(left), float(bottom), float(right), float(top)


@dataclass(frozen=True)
class PaperView:
    """A view at a ``scale``, its origin at a place on paper; ``unit``: size of a millimetre of the A3 layout."""

    scale: float
    unit: float
    origin: Place = (0.0, 0.0)

    def at(self, points: ArrayLike) -> Points:
        """Points on paper of points (mm) of the part."""
        return self.scale * np.asarray(points, dtype=np.float64) + np.array(self.origin)

    def line(self, points: ArrayLike, pen: PenName = "outline", *, closed: bool = False) -> Stroke:
        """A line through points (mm)."""
        return Stroke(self.at(points), pen, closed)

    def dimension(
        self, name: str, first: Place, last: Place, turned_deg: int, before: str = "", after: str = ""
    ) -> LinearDimension:
        """A dimension between two places (mm); its line and text are placed later."""
        (x, y), (u, v) = self.at([first, last]).tolist()
        axis = turned_deg // 90
        size = LETTERS * self.unit
        length_mm = abs(float(last[axis] - first[axis]))
        turned: Literal[0, 90] = 90 if axis else 0
        return LinearDimension(name, (x, y), (u, v), turned, 0.0, 0.0, size, length_mm, before, after)


def fitted(draw: Callable[[PaperView], Marks], least_mm: float, room: Box, unit: float) -> PaperView:
    """The view at the largest scale that fits, in the middle of its ``room`` (on paper).

    ``least_mm``: width of the part in it, without dimensions. Raises :class:`InputError` if it fits at no scale.
    """
    wide, high = room[2] - room[0], room[3] - room[1]
    for scale in SCALES:
        if scale * least_mm > wide:
            continue
        box = room_of(draw(PaperView(scale, unit)))
        if box[2] - box[0] <= wide and box[3] - box[1] <= high:
            x, y = (0.5 * (room[k] + room[k + 2] - box[k] - box[k + 2]) for k in (0, 1))
            return PaperView(scale, unit, (x, y))
    raise InputError("the part fits on the sheet at no scale; its drawing is left to a CAD program")


def draw_views(content: ViewContent, view: PaperView) -> Marks:
    """All views; the origin of the part in section S-S is that of ``view``."""
    views = Marks()
    gap, level = (_GAP * view.unit, view.origin[1])
    top = level + view.scale * content.half_height
    first, *other_sections = content.sections

    def at(x: float) -> PaperView:
        return replace(view, origin=(x, level))

    views.add(_section_marks(content, first, view, top))
    left, lowest, right, _ = room_of(views)
    views.add(_base_marks(content, at(right + gap - view.scale * content.base_box[0]), top, lowest))
    for section in other_sections:
        beside = room_of(views)[2] + gap - room_of(_section_marks(content, section, at(0.0), top))[0]
        views.add(_section_marks(content, section, at(beside), top))
    views.add(_dome_marks(content, at(left - gap - view.scale * content.dome_box[2]), top))
    return views


def _section_marks(content: ViewContent, section: SectionView, view: PaperView, above: float) -> Marks:
    x, y = view.origin
    unit = view.unit
    low, bottom, high, _ = (view.scale * value for value in content.section_box(section))
    outlines = [view.at(outline) for outline in section.outlines]
    marks = Marks([*hatch(outlines, HATCH * unit), *(Stroke(outline, "outline", closed=True) for outline in outlines)])
    marks.strokes += [view.line(line.points, line.pen) for line in section.lines]
    marks.strokes.append(Stroke(np.array([(x + low - 4.0 * unit, y), (x + high + 4.0 * unit, y)]), "axis"))
    name: ViewName = "S" if section is content.sections[0] else "T"
    drawn = content.drawn(name)
    upright = [dimension for dimension in drawn if dimension.upright]
    beyond = [dimension for dimension in upright if _rim_is_beside(dimension, section)]
    beside = [dimension for dimension in upright if dimension not in beyond]
    plane = content.datums.find("A") if name == "S" else None
    marked = () if plane is None or plane.z_mm is None else (x + view.scale * plane.z_mm,)
    columns = placed(_on_paper(beside, view), x + low - FIRST * unit, -ROW * unit)
    columns += placed(_on_paper(beyond, view), x + high + (FIRST + 2.0) * unit, ROW * unit)
    below = min([y + bottom, *(occupied(column)[0] for column in columns)])
    rows = placed(
        _on_paper([dimension for dimension in drawn if not dimension.upright], view),
        below - FIRST * unit,
        -ROW * unit,
        marked,
    )
    marks.dimensions += [*rows, *columns]
    if name == "S":
        lowest = min([row.line_mm for row in rows], default=y + bottom)
        _add_plane(marks, content.datums, view, y + bottom, lowest)
        add_centres(marks, content.datums, columns, unit)
        for text, place in content.mould.items():
            _add_mould_mark(marks, view, text, place)
    label = 0.5 * (low + high) + x, above + 14.0 * unit
    marks.texts.append(SheetText(label, f"{section.letter}–{section.letter}", LETTERS * unit, "center"))
    across = {0.0: "x", 90.0: "y"}.get(section.azimuth_deg, f"{section.azimuth_deg:g}°")
    marks.add(axes_mark((label[0] + 8.0 * unit, label[1] - 2.0 * unit), "z", across, unit))
    return marks


def _add_mould_mark(marks: Marks, view: PaperView, text: str, place: Place) -> None:
    """An arrow onto the place from above; the parting line has its label on the right, the gate on the left."""
    (tip,) = view.at([place])
    unit = view.unit
    anchor = _ANCHORS[text]
    x, y = tip.tolist()
    end = y + 6.0 * unit
    beside = x + (1.0 if anchor == "left" else -1.0) * unit
    marks.strokes += [Stroke(np.array([tip, (x, end)])), arrow_head(tip, np.array([0.0, -1.0]), LETTERS * unit)]
    marks.texts.append(SheetText((beside, end), text, LETTERS * unit, anchor))


def _rim_is_beside(dimension: Dimension, section: SectionView) -> bool:
    """True for the flange at the rim, and for the outer rim if the base is wider and its lines would cross."""
    if dimension.name == FLANGE_WIDTH:
        return True
    points = np.concatenate(section.outlines)
    below = np.abs(points[points[:, 0] < -1e-9, 1])
    return dimension.name.startswith("outer rim") and below.size > 0 and float(below.max()) > 0.5 * dimension.value_mm


def _base_marks(content: ViewContent, view: PaperView, above: float, lowest: float) -> Marks:
    marks, (left, bottom, right, top) = _line_marks(content.base, content.base_box, view)
    x, y = view.origin
    unit = view.unit
    for section in content.sections:
        half = max(-left, -bottom, right, top) + 4.0 * unit
        marks.add(section_plane(view.origin, section.azimuth_deg, half, section.letter, unit))
    below = min(y - max(-bottom, top) - 8.0 * unit, lowest + FIRST * unit) - FIRST * unit
    rows = placed(_on_paper(content.drawn("base"), view), below, -ROW * unit)
    marks.dimensions += rows
    add_centres(marks, content.datums, rows, unit)
    flat = content.datums.find("C")
    if flat is not None and not flat.dimension:
        flat_mm = next(
            dimension.value_mm for dimension in content.dimensions if dimension.name.startswith("clocking flat")
        )
        marks.add(datum_symbol((x + 0.25 * right, y + view.scale * flat_mm), (0.0, 1.0), "C", unit))
    marks.add(axes_mark((x + right - 6.0 * unit, above + 12.0 * unit), "y", "x", unit))
    return marks


def _dome_marks(content: ViewContent, view: PaperView, above: float) -> Marks:
    marks, (left, bottom, _, _) = _line_marks(content.dome, content.dome_box, view)
    x, y = view.origin
    unit = view.unit
    sizes = content.drawn("dome")
    for size in sizes:
        circle = 0.5 * view.scale * size.value_mm * np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
        marks.strokes.append(Stroke(circle + view.origin, "phantom"))
    marks.dimensions += placed(_on_paper(sizes, view), y + bottom - FIRST * unit, -ROW * unit)
    marks.add(axes_mark((x + left + 6.0 * unit, above + 12.0 * unit), "y", "x", unit, towards=-1.0))
    return marks


def _line_marks(lines: list[ViewLine], box: Box, view: PaperView) -> tuple[Marks, Box]:
    """Lines of a view along the axis with axes across it, and its box on paper about its origin."""
    left, bottom, right, top = (view.scale * value for value in box)
    x, y = view.origin
    more = 4.0 * view.unit
    marks = Marks([view.line(line.points, line.pen, closed=line.closed) for line in lines])
    marks.strokes.append(Stroke(np.array([(x + left - more, y), (x + right + more, y)]), "axis"))
    marks.strokes.append(Stroke(np.array([(x, y + bottom - more), (x, y + top + more)]), "axis"))
    return marks, (left, bottom, right, top)


def _on_paper(dimensions: list[Dimension], view: PaperView) -> list[LinearDimension]:
    lines = []
    for dimension in dimensions:
        assert dimension.ends is not None
        before, after = dimension.sign, " general"
        if dimension.is_auxiliary:
            before, after = f"({before}", ")"
        elif dimension.tolerance_mm is not None:
            after = f" ±{shown(dimension.tolerance_mm)}"
        made = view.dimension(dimension.name, *dimension.ends, 90 if dimension.upright else 0, before, after)
        lines.append(replace(made, length_mm=dimension.value_mm))
    return lines


def _add_plane(marks: Marks, datums: DatumScheme, view: PaperView, foot: float, lowest: float) -> None:
    """The symbol of a plane across the axis, on an extension line below the dimensions."""
    plane = datums.find("A")
    unit = view.unit
    if plane is None or plane.z_mm is None:
        return
    x = view.origin[0] + view.scale * plane.z_mm
    end = lowest - 9.0 * unit
    marks.strokes.append(Stroke(np.array([(x, foot - unit), (x, end)])))
    marks.add(datum_symbol((x, end + 3.0 * unit), (-1.0, 0.0), "A", unit))


def add_centres(marks: Marks, datums: DatumScheme, lines: list[LinearDimension], unit: float) -> None:
    """The symbols of axes and middle planes, in line with their features' dimensions, outside all others."""
    far = max((occupied(line)[1] for line in lines), default=0.0)
    for datum in datums.datums:
        for line in lines:
            if line.name == datum.dimension:
                end = line.ends_mm[1]
                marks.add(datum_symbol(line.at(end, line.line_mm), line.at(1.0, 0.0), datum.letter, unit, far - end))


def placed(
    dimensions: list[LinearDimension], first_mm: float, step_mm: float, through_mm: tuple[float, ...] = ()
) -> list[LinearDimension]:
    """``dimensions`` at a side of a view, each with its line and the place of its text, the shortest nearest to it.

    ``first_mm``: the first dimension line; ``step_mm``: from line to line, negative to the left and down.
    ``through_mm``: places along the dimension lines at which other lines cross all of them. Each takes the nearest row
    in which its text is clear of all lines, also of those to come if possible.
    """
    rows: list[list[LinearDimension]] = []
    waiting = sorted(dimensions, key=lambda dimension: dimension.length_mm)
    while waiting:
        dimension = waiting.pop(0)
        ends = [*through_mm, *(end for other in waiting for end in other.ends_mm)]  # they will come past it
        free = (
            (number, candidate)
            for coming in (ends, [])
            for number in range(len(rows) + 1)
            for candidate in _candidates(dimension, first_mm + number * step_mm, coming)
            if _is_free(candidate, number, rows, coming)
        )
        last = len(rows)
        number, candidate = next(free, (last, next(_candidates(dimension, first_mm + last * step_mm, []))))
        rows += [[]] if number == last else []
        rows[number].append(candidate)
    return [dimension for row in rows for dimension in row]


def _candidates(dimension: LinearDimension, line_mm: float, lines: list[float]) -> Iterator[LinearDimension]:
    """The dimension with its text in the middle, near an end, outside, or just beyond one of ``lines``."""
    low, high = dimension.ends_mm
    size = dimension.height_mm
    text = width_of(dimension.text, dimension.height_mm)
    room = high - low - text - 2.4 * ARROW * size
    middle = 0.5 * (low + high)
    outside = 0.5 * text + (ARROW + TAIL) * size
    places = [middle, middle + 0.45 * room, middle - 0.45 * room] if room > 0.0 else []
    places += [high + outside, low - outside]
    past = 0.5 * text + 0.7 * size
    beyond = [line + past for line in lines if line + past > high + outside]
    beyond += [line - past for line in lines if line - past < low - outside]
    for place in (*places, *sorted(beyond, key=lambda place_mm: abs(place_mm - middle))):
        yield replace(dimension, line_mm=line_mm, text_mm=place)


def _is_free(candidate: LinearDimension, number: int, rows: list[list[LinearDimension]], coming: list[float]) -> bool:
    gap = 0.6 * candidate.height_mm
    ends = candidate.ends_mm
    if any(_within(end, text_span(candidate), gap) for end in coming if end not in ends):
        return False
    low, high = occupied(candidate)
    beside = [occupied(row) for row in rows[number]] if number < len(rows) else []
    if any(low < end + gap and start < high + gap for start, end in beside):
        return False
    for k, row in enumerate(rows):
        for other in row:
            if k < number and any(_within(end, text_span(other), gap) for end in candidate.ends_mm):
                return False
            if k > number and any(_within(end, text_span(candidate), gap) for end in other.ends_mm):
                return False
    return True


def _within(place: float, span: tuple[float, float], gap: float) -> bool:
    return span[0] - gap < place < span[1] + gap
