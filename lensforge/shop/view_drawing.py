"""The views on paper at a scale: outlines, hatching, axes, dimensions and datum symbols, and the room they need.

Dimension lines stand beside a view, the smallest nearest to the part, so that no text meets another or a line.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lensforge.shop.dimensions import DatumScheme, Dimension, View
from lensforge.shop.sheet import (
    LETTERS,
    Box,
    LinearDimension,
    Marks,
    Place,
    Points,
    Stroke,
    Words,
    box_of,
    shown,
    width_of,
)
from lensforge.shop.sheet_marks import (
    ARROW,
    TAIL,
    axes_mark,
    datum_symbol,
    hatch,
    occupied,
    section_plane,
    text_span,
    words_of_dimension,
)
from lensforge.shop.view_lines import SectionView, ViewLine

_FIRST, _ROW, _GAP = 8.0, 7.0, 14.0  # mm on A3: to the first line, between lines, between views
_HATCH = 3.5
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 181)


@dataclass(frozen=True)
class ViewContent:
    """Lines (mm, of the part) of one section or two, of the views from the base and of the dome; sizes and datums."""

    sections: list[SectionView]
    base: list[ViewLine]
    dome: list[ViewLine]
    dimensions: list[Dimension]
    datums: DatumScheme

    def section_box(self, section: SectionView) -> Box:
        """The box of a section in (z, across), with what lies behind and before it."""
        return _box(np.concatenate([*section.outlines, *(line.points for line in section.lines)]))

    @property
    def base_box(self) -> Box:
        """The box of the view from the base in (y, x)."""
        return _box(np.concatenate([line.points for line in self.base]))

    @property
    def dome_box(self) -> Box:
        """The box of the view of the dome in (-y, x), its circles included."""
        half = max((each.value_mm / 2.0 for each in self.drawn("dome")), default=0.0)
        return _box(np.concatenate([*(line.points for line in self.dome), [(-half, -half), (half, half)]]))

    @property
    def boxes(self) -> list[Box]:
        """The boxes of all views."""
        return [self.dome_box, self.base_box, *map(self.section_box, self.sections)]

    @property
    def width(self) -> float:
        """Width (mm, of the part) of all views beside each other."""
        return sum(box[2] - box[0] for box in self.boxes)

    @property
    def half_height(self) -> float:
        """Largest distance (mm, of the part) from the axis in any view."""
        return max(max(-box[1], box[3]) for box in self.boxes)

    def drawn(self, view: View) -> list[Dimension]:
        """Dimensions that are drawn in ``view``."""
        return [each for each in self.dimensions if each.ends is not None and each.view == view]


def room_of(marks: Marks) -> Box:
    """The room on paper that all of it needs."""
    boxes = [_box(stroke.points) for stroke in marks.strokes]
    boxes += [box_of(words) for words in marks.words]
    boxes += [box_of(words_of_dimension(each)) for each in marks.dimensions]
    for each in marks.dimensions:
        low, high = occupied(each)
        boxes.append((*each.at(low, each.line_mm), *each.at(high, each.line_mm)))
    low, high = np.array(boxes)[:, :2].min(axis=0), np.array(boxes)[:, 2:].max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _box(points: Points) -> Box:
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    return float(left), float(bottom), float(right), float(top)


def draw_views(content: ViewContent, scale: float, unit: float, origin: Place) -> Marks:
    """All views, the origin of the part in the section S-S at ``origin`` on paper."""
    views = Marks()
    top = origin[1] + scale * content.half_height
    _draw_section(views, content, content.sections[0], scale, unit, origin, top)
    lowest = room_of(views)[1]
    left = room_of(views)[0] - _GAP * unit - scale * content.dome_box[2]
    right = room_of(views)[2] + _GAP * unit - scale * content.base_box[0]
    _draw_base(views, content, scale, unit, (right, origin[1]), top, lowest)
    for section in content.sections[1:]:
        drawn = Marks()
        _draw_section(drawn, content, section, scale, unit, (0.0, origin[1]), top)
        at = room_of(views)[2] + _GAP * unit - room_of(drawn)[0]
        _draw_section(views, content, section, scale, unit, (at, origin[1]), top)
    _draw_dome(views, content, scale, unit, (left, origin[1]), top)
    return views


def _draw_section(
    views: Marks, content: ViewContent, section: SectionView, scale: float, unit: float, origin: Place, above: float
) -> None:
    outlines = [scale * outline + origin for outline in section.outlines]
    low, bottom, high, _ = (scale * value for value in content.section_box(section))
    x, y = origin
    views.strokes += hatch(outlines, _HATCH * unit)
    views.strokes += [Stroke(outline, "outline", closed=True) for outline in outlines]
    views.strokes += [Stroke(scale * line.points + origin, line.pen) for line in section.lines]
    views.strokes.append(Stroke(np.array([(x + low - 4.0 * unit, y), (x + high + 4.0 * unit, y)]), "axis"))
    view: View = "S" if section is content.sections[0] else "T"
    mine = content.drawn(view)
    beyond = [each for each in mine if each.upright and _rim_is_beside(each, section)]
    beside = [each for each in mine if each.upright and each not in beyond]

    def at(found: list[Dimension], first: float, step: float, *through: float) -> list[LinearDimension]:
        return placed([_on_paper(each, scale, unit, origin) for each in found], first, step, through)

    plane = content.datums.find("A") if view == "S" else None
    marked = () if plane is None or plane.z_mm is None else (x + scale * plane.z_mm,)
    columns = at(beside, x + low - _FIRST * unit, -_ROW * unit)
    columns += at(beyond, x + high + (_FIRST + 2.0) * unit, _ROW * unit)
    below = min([y + bottom, *(occupied(each)[0] for each in columns)])
    rows = at([each for each in mine if not each.upright], below - _FIRST * unit, -_ROW * unit, *marked)
    views.dimensions += [*rows, *columns]
    if view == "S":
        lowest = min([each.line_mm for each in rows], default=y + bottom)
        _add_plane(views, content.datums, scale, unit, (x, y + bottom), lowest)
        _add_centre(views, content.datums, columns, unit)
    label = 0.5 * (low + high) + x, above + 14.0 * unit
    views.words.append(Words(label, f"{section.letter}–{section.letter}", LETTERS * unit, "center"))
    across = {0.0: "x", 90.0: "y"}.get(section.azimuth_deg, f"{section.azimuth_deg:g}°")
    views.add(axes_mark((label[0] + 8.0 * unit, label[1] - 2.0 * unit), "z", across, unit))


def _rim_is_beside(dimension: Dimension, section: SectionView) -> bool:
    """True for the outer rim where the base is wider: its lines then run to the right, not through the base."""
    points = np.concatenate(section.outlines)
    below = np.abs(points[points[:, 0] < -1e-9, 1])
    return dimension.name.startswith("outer rim") and below.size > 0 and float(below.max()) > 0.5 * dimension.value_mm


def _draw_base(
    views: Marks, content: ViewContent, scale: float, unit: float, centre: Place, above: float, lowest: float
) -> None:
    left, bottom, right, top = _draw_lines(views, content.base, content.base_box, scale, unit, centre)
    x, y = centre
    for section in content.sections:
        half = max(-left, -bottom, right, top) + 4.0 * unit
        views.add(section_plane(centre, section.azimuth_deg, half, section.letter, unit))
    below = min(y - max(-bottom, top) - 8.0 * unit, lowest + _FIRST * unit) - _FIRST * unit
    rows = placed([_on_paper(each, scale, unit, centre) for each in content.drawn("base")], below, -_ROW * unit)
    views.dimensions += rows
    _add_centre(views, content.datums, rows, unit)
    flat = content.datums.find("C")
    if flat is not None and not flat.dimension:
        flat_mm = next(each.value_mm for each in content.dimensions if each.name.startswith("clocking flat"))
        views.add(datum_symbol((x + 0.25 * right, y + scale * flat_mm), (0.0, 1.0), "C", unit))
    views.add(axes_mark((x + right - 6.0 * unit, above + 12.0 * unit), "y", "x", unit))


def _draw_dome(views: Marks, content: ViewContent, scale: float, unit: float, centre: Place, above: float) -> None:
    left, bottom, _, _ = _draw_lines(views, content.dome, content.dome_box, scale, unit, centre)
    x, y = centre
    sizes = content.drawn("dome")
    for each in sizes:
        circle = 0.5 * scale * each.value_mm * np.column_stack([np.cos(_CIRCLE), np.sin(_CIRCLE)])
        views.strokes.append(Stroke(circle + centre, "phantom"))
    lines = [_on_paper(each, scale, unit, centre) for each in sizes]
    views.dimensions += placed(lines, y + bottom - _FIRST * unit, -_ROW * unit)
    views.add(axes_mark((x + left + 6.0 * unit, above + 12.0 * unit), "y", "x", unit, towards=-1.0))


def _draw_lines(views: Marks, lines: list[ViewLine], box: Box, scale: float, unit: float, centre: Place) -> Box:
    """Lines of a view along the axis, and its axes across all of it; returns its box on paper, about ``centre``."""
    left, bottom, right, top = (scale * value for value in box)
    (x, y), more = centre, 4.0 * unit
    views.strokes += [Stroke(scale * line.points + centre, line.pen, closed=line.closed) for line in lines]
    views.strokes.append(Stroke(np.array([(x + left - more, y), (x + right + more, y)]), "axis"))
    views.strokes.append(Stroke(np.array([(x, y + bottom - more), (x, y + top + more)]), "axis"))
    return left, bottom, right, top


def _on_paper(dimension: Dimension, scale: float, unit: float, origin: Place) -> LinearDimension:
    """The dimension with its ends on paper, its line and its text not placed yet."""
    assert dimension.ends is not None
    (a, b), (c, d) = dimension.ends
    before, after = dimension.sign, ""
    if dimension.is_auxiliary:
        before, after = f"({before}", ")"
    elif dimension.tolerance_mm is not None:
        after = f" ±{shown(dimension.tolerance_mm)}"
    else:
        after = " general"
    return LinearDimension(
        name=dimension.name,
        start=(scale * a + origin[0], scale * b + origin[1]),
        end=(scale * c + origin[0], scale * d + origin[1]),
        turned_deg=90 if dimension.upright else 0,
        line_mm=0.0,
        text_mm=0.0,
        height_mm=LETTERS * unit,
        length_mm=dimension.value_mm,
        before=before,
        after=after,
    )


def _add_plane(views: Marks, datums: DatumScheme, scale: float, unit: float, foot: Place, lowest: float) -> None:
    """The symbol of a plane across the axis, on a line that extends it below the dimensions."""
    plane = datums.find("A")
    if plane is None or plane.z_mm is None:
        return
    x, end = foot[0] + scale * plane.z_mm, lowest - 9.0 * unit
    views.strokes.append(Stroke(np.array([(x, foot[1] - unit), (x, end)])))
    views.add(datum_symbol((x, end + 3.0 * unit), (-1.0, 0.0), "A", unit))


def _add_centre(views: Marks, datums: DatumScheme, lines: list[LinearDimension], unit: float) -> None:
    """The symbols of axes and middle planes, in line with the dimensions of their features, beyond all others."""
    far = max((occupied(line)[1] for line in lines), default=0.0)
    for datum in datums.datums:
        for line in lines:
            if line.name != datum.dimension:
                continue
            end = line.ends_mm[1]
            views.add(datum_symbol(line.at(end, line.line_mm), line.at(1.0, 0.0), datum.letter, unit, far - end))


def placed(
    dimensions: list[LinearDimension], first_mm: float, step_mm: float, through_mm: tuple[float, ...] = ()
) -> list[LinearDimension]:
    """``dimensions`` at a side of a view, each with its line and the place of its text, the shortest nearest to it.

    ``first_mm``: the first dimension line; ``step_mm``: from each to the next, negative to left and down.
    ``through_mm``: places along the dimension lines at which other lines cross all of them. Each takes the nearest row
    in which its text is clear of all lines, also of those to come if possible.
    """
    rows: list[list[LinearDimension]] = []
    waiting = sorted(dimensions, key=lambda each: each.length_mm)
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
        number, found = next(free, (last, next(_candidates(dimension, first_mm + last * step_mm, []))))
        rows += [[]] if number == last else []
        rows[number].append(found)
    return [dimension for row in rows for dimension in row]


def _candidates(dimension: LinearDimension, line_mm: float, lines: list[float]) -> Iterator[LinearDimension]:
    """The dimension with its text in the middle, near an end, outside, or just beyond one of ``lines`` outside."""
    low, high = dimension.ends_mm
    size, text = dimension.height_mm, width_of(dimension.text, dimension.height_mm)
    room = high - low - text - 2.4 * ARROW * size
    middle, outside = 0.5 * (low + high), 0.5 * text + (ARROW + TAIL) * size
    places = [middle, middle + 0.45 * room, middle - 0.45 * room] if room > 0.0 else []
    places += [high + outside, low - outside]
    past = 0.5 * text + 0.7 * size
    beyond = [line + past for line in lines if line + past > high + outside]
    beyond += [line - past for line in lines if line - past < low - outside]
    for place in (*places, *sorted(beyond, key=lambda each: abs(each - middle))):
        yield replace(dimension, line_mm=line_mm, text_mm=place)


def _is_free(candidate: LinearDimension, number: int, rows: list[list[LinearDimension]], coming: list[float]) -> bool:
    gap = 0.6 * candidate.height_mm
    own = candidate.ends_mm
    if any(_within(end, text_span(candidate), gap) for end in coming if end not in own):
        return False
    low, high = occupied(candidate)
    beside = [occupied(other) for other in rows[number]] if number < len(rows) else []
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
