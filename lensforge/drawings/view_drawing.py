"""The two views on paper at a scale: outlines, hatching, axes, dimensions and datum symbols, and the room they need."""

from dataclasses import dataclass, field

import numpy as np

from lensforge.drawings.datums import DatumScheme
from lensforge.drawings.dimension_lines import occupied, words_of_dimension
from lensforge.drawings.dimensions import Dimension
from lensforge.drawings.hatching import hatch
from lensforge.drawings.lettering import box_of
from lensforge.drawings.marks import Marks, axes_mark, datum_symbol, section_plane
from lensforge.drawings.placing import Side, placed
from lensforge.drawings.sheet import Box, LinearDimension, PenName, Place, Points, Stroke, Words, shown
from lensforge.drawings.views import ViewLine

_FIRST, _ROW, _TEXT, _GAP = 8.0, 7.0, 2.5, 14.0  # mm on A3: to the first line, between lines, letters, between views
_HATCH = 3.5


@dataclass(frozen=True)
class ViewContent:
    """Lines (mm, of the part) of the section, edges behind it, the view of the end, dimensions and datums."""

    section: list[Points]
    edges: list[Points]
    end: list[ViewLine]
    dimensions: list[Dimension]
    datums: DatumScheme

    @property
    def section_box(self) -> Box:
        """The section's box in (z, x)."""
        return _box(np.concatenate(self.section))

    @property
    def end_box(self) -> Box:
        """The view's box in (y, x)."""
        return _box(np.concatenate([line.points for line in self.end]))


@dataclass
class Views:
    """The views as drawn; grows while they are."""

    strokes: list[Stroke] = field(default_factory=list)
    words: list[Words] = field(default_factory=list)
    dimensions: list[LinearDimension] = field(default_factory=list)

    def add(self, marks: Marks) -> None:
        """Add strokes and words."""
        self.strokes += marks[0]
        self.words += marks[1]

    @property
    def box(self) -> Box:
        """The room on paper that all of it needs."""
        boxes = [_box(stroke.points) for stroke in self.strokes]
        boxes += [box_of(words) for words in self.words]
        boxes += [box_of(words_of_dimension(each)) for each in self.dimensions]
        for each in self.dimensions:
            low, high = occupied(each)
            horizontal = each.turned_deg == 0
            boxes.append(
                (low, each.line_mm, high, each.line_mm) if horizontal else (each.line_mm, low, each.line_mm, high)
            )
        low, high = np.array(boxes)[:, :2].min(axis=0), np.array(boxes)[:, 2:].max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _box(points: Points) -> Box:
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    return float(left), float(bottom), float(right), float(top)


def draw_views(content: ViewContent, scale: float, unit: float, origin: Place) -> Views:
    """Both views, the origin of the part in the section at ``origin`` on paper."""
    views = Views()
    _draw_section(views, content, scale, unit, origin)
    right = views.box[2]
    left, bottom, _, _ = content.end_box
    lowest = min(bottom, content.section_box[1])
    centre = right + _GAP * unit - scale * left, origin[1]
    _draw_end(views, content, scale, unit, centre, origin[1] + scale * lowest)
    return views


def _draw_section(views: Views, content: ViewContent, scale: float, unit: float, origin: Place) -> None:
    outlines = [scale * outline + origin for outline in content.section]
    low, bottom, high, top = (scale * value for value in content.section_box)
    x, y = origin
    views.strokes += hatch(outlines, _HATCH * unit)
    views.strokes += [Stroke(outline, "outline", closed=True) for outline in outlines]
    views.strokes += [Stroke(scale * edge + origin, "outline") for edge in content.edges]
    views.strokes.append(Stroke(np.array([(x + low - 4.0 * unit, y), (x + high + 4.0 * unit, y)]), "axis"))
    mine = [each for each in content.dimensions if each.ends is not None and each.view == "section"]
    beyond = [each for each in mine if each.along == "x" and _rim_is_beside(each, content)]
    beside = [each for each in mine if each.along == "x" and each not in beyond]
    along = [each for each in mine if each.along == "z"]

    def at(found: list[Dimension], first: float, step: float, *through: float) -> list[LinearDimension]:
        return placed([_on_paper(each, scale, unit, origin) for each in found], Side(first, step, through))

    plane = content.datums.find("A")
    marked = () if plane is None or plane.z_mm is None else (x + scale * plane.z_mm,)
    rows = at(along, y + bottom - _FIRST * unit, -_ROW * unit, *marked)
    columns = at(beside, x + low - _FIRST * unit, -_ROW * unit)
    columns += at(beyond, x + high + (_FIRST + 2.0) * unit, _ROW * unit)
    views.dimensions += [*rows, *columns]
    lowest = min([each.line_mm for each in rows], default=y + bottom)
    _add_plane(views, content.datums, scale, unit, (x, y + bottom), lowest)
    _add_centre(views, content.datums, columns, unit)
    label = 0.5 * (low + high) + x, max(views.box[3], y + top + 2.0 * unit) + 4.0 * unit
    views.words.append(Words(label, "S–S", 3.5 * unit, "center"))
    views.add(axes_mark((label[0] + 14.0 * unit, label[1] - 2.0 * unit), "z", "x", unit))


def _rim_is_beside(dimension: Dimension, content: ViewContent) -> bool:
    """True for the outer rim where the base is wider: its lines then run to the right, not through the base."""
    points = np.concatenate(content.section)
    below = np.abs(points[points[:, 0] < -1e-9, 1])
    return dimension.name.startswith("outer rim") and below.size > 0 and float(below.max()) > 0.5 * dimension.value_mm


def _draw_end(views: Views, content: ViewContent, scale: float, unit: float, centre: Place, lowest: float) -> None:
    for line in content.end:
        pen: PenName = "hidden" if line.hidden else "outline"
        views.strokes.append(Stroke(scale * line.points + centre, pen, closed=line.closed))
    left, bottom, right, top = (scale * value for value in content.end_box)
    x, y = centre
    views.strokes.append(Stroke(np.array([(x + left - 4.0 * unit, y), (x + right + 4.0 * unit, y)]), "axis"))
    views.add(section_plane(centre, max(-bottom, top) + 4.0 * unit, "S", unit))
    mine = [each for each in content.dimensions if each.ends is not None and each.view == "end"]
    below = min(y - max(-bottom, top) - 8.0 * unit, lowest) - _FIRST * unit
    rows = placed([_on_paper(each, scale, unit, centre) for each in mine], Side(below, -_ROW * unit))
    views.dimensions += rows
    _add_centre(views, content.datums, rows, unit)
    flat = content.datums.find("C")
    if flat is not None and not flat.dimension:
        views.add(datum_symbol((x + 0.25 * right, y + scale * _flat_mm(content)), (0.0, 1.0), "C", unit))
    views.add(axes_mark((x + right - 6.0 * unit, y + max(-bottom, top) + 7.0 * unit), "y", "x", unit))


def _flat_mm(content: ViewContent) -> float:
    return next(each.value_mm for each in content.dimensions if each.name.startswith("clocking flat"))


def _on_paper(dimension: Dimension, scale: float, unit: float, origin: Place) -> LinearDimension:
    """The dimension with its ends on paper, its line and its text not placed yet."""
    assert dimension.ends is not None
    (a, b), (c, d) = dimension.ends
    before, after = dimension.sign, ""
    if dimension.is_auxiliary:
        before, after = f"({before}", ")"
    elif dimension.tolerance_mm is not None:
        after = f" ±{shown(dimension.tolerance_mm)}"
    return LinearDimension(
        name=dimension.name,
        start=(scale * a + origin[0], scale * b + origin[1]),
        end=(scale * c + origin[0], scale * d + origin[1]),
        turned_deg=90 if dimension.along == "x" else 0,
        line_mm=0.0,
        text_mm=0.0,
        height_mm=_TEXT * unit,
        length_mm=dimension.value_mm,
        before=before,
        after=after,
    )


def _add_plane(views: Views, datums: DatumScheme, scale: float, unit: float, foot: Place, lowest: float) -> None:
    """The symbol of a plane across the axis, on a line that extends it below the dimensions."""
    plane = datums.find("A")
    if plane is None or plane.z_mm is None:
        return
    x, end = foot[0] + scale * plane.z_mm, lowest - 9.0 * unit
    views.strokes.append(Stroke(np.array([(x, foot[1] - unit), (x, end)])))
    views.add(datum_symbol((x, end + 3.0 * unit), (-1.0, 0.0), "A", unit))


def _add_centre(views: Views, datums: DatumScheme, lines: list[LinearDimension], unit: float) -> None:
    """The symbols of axes and middle planes, in line with the dimensions of their features, beyond all others."""
    far = max((line.ends_mm[1] for line in lines), default=0.0)
    for datum in datums.datums:
        for line in lines:
            if line.name != datum.dimension:
                continue
            leader = far - line.ends_mm[1]
            if line.turned_deg == 90:
                at, towards = (line.line_mm, line.ends_mm[1]), (0.0, 1.0)
            else:
                at, towards = (line.ends_mm[1], line.line_mm), (1.0, 0.0)
            views.add(datum_symbol(at, towards, datum.letter, unit, leader))
