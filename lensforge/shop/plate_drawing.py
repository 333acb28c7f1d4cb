"""The drawing of the plate: seen from above and from the front, one lens in a larger section, and where its marks are.

The lenses are equal, so that their pattern is dimensioned once: as pitch times count along rows and columns, as a ring,
or else by a table of places. All sizes are of the design in the plate's own axes, from the middle of its outline.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.part import Part
from lensforge.cad.plan import rim_directions, rim_radius
from lensforge.cad.plate_layout import PlateLayout, circle_at, points_on
from lensforge.cad.plate_result import PLATE_STEP_FILE
from lensforge.cad.section import profile
from lensforge.errors import InputError
from lensforge.results.numerals import quantity
from lensforge.scene.lens import Lens
from lensforge.shop.dimensions import highest_point_mm
from lensforge.shop.drawing import (
    HEIGHT,
    SCALES,
    SIZES,
    WIDTH,
    SheetName,
    draw_title_block,
    general_words,
    inside_of,
    mould_words,
    scale_words,
    title_block,
    title_of,
    unit_of,
)
from lensforge.shop.sheet import LETTERS, Box, LinearDimension, Marks, Place, Points, Sheet, Stroke, Words, shown
from lensforge.shop.sheet_marks import arrow_head, axes_mark, frame_of, hatch, paragraphs_in, row, row_height
from lensforge.shop.sheet_tables import Rows
from lensforge.shop.view_drawing import placed, room_of
from lensforge.shop.view_lines import dome_radius, front_line
from lensforge.spec import DrawingSection
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.plate_section import PlateMark

_FIRST, _ROW, _GAP = 8.0, 7.0, 30.0  # mm on A3: to the first line, between lines, between views
_CHORD_MM, _HATCH = 5e-3, 3.5
_TURN = np.linspace(0.0, 2.0 * np.pi, 181)
_SAME_MM, _SHOWN_MM = 1e-6, 1e-3
_INSIDE = 6.0  # mm on A3: the label of a larger circle stands inside
_MOST_ROWS = 12  # of the table on the sheet; the page has all
_VIEWS = 0.6  # of the width, for the views of the whole plate
_COLUMNS = (0.16, 0.22, 0.22, 0.4)  # widths of the table's columns


@dataclass(frozen=True)
class Pattern:
    """Lenses in rows ``pitch_mm`` apart along x and y, ``count`` of them in the longest row, or in a column; or a ring.

    ``first``: x of the leftmost lens of the longest row, which is at ``row_mm``, and y of the lowest row. ``ring_mm``:
    diameter of the circle of the axes.
    """

    pitch_mm: tuple[float, float] = (0.0, 0.0)
    count: tuple[int, int] = (1, 1)
    first: Place = (0.0, 0.0)
    row_mm: float = 0.0
    ring_mm: float | None = None


def pattern_of(lenses: Lamps) -> Pattern | None:
    """The pattern of ``lenses``; None where they are in neither rows of one pitch nor an even ring."""
    places = np.array(lenses.places_mm)
    levels = np.unique(np.round(places[:, 1], 6))
    rows = [np.sort(places[np.abs(places[:, 1] - level) < _SAME_MM, 0]) for level in levels]
    steps = np.concatenate([np.diff(each) for each in rows])
    if _alike(steps) and _alike(np.diff(levels)):
        longest = int(np.argmax([len(each) for each in rows]))
        pitch = tuple(float(each.mean()) if len(each) else 0.0 for each in (steps, np.diff(levels)))
        first = float(rows[longest][0]), float(levels[0])
        return Pattern((pitch[0], pitch[1]), (len(rows[longest]), len(levels)), first, float(levels[longest]))
    radius, turns = np.hypot(*places.T), np.sort(np.arctan2(places[:, 1], places[:, 0]))
    even = _alike(np.diff([*turns, turns[0] + 2.0 * np.pi]))
    return Pattern(ring_mm=2.0 * float(radius.mean())) if even and _alike(radius) else None


def _alike(values: Float[np.ndarray, " n"]) -> bool:
    return bool(np.ptp(values) < _SAME_MM) if len(values) else True


@dataclass(frozen=True, eq=False)
class LensLines:
    """Lines (mm) of one lens: ``dome`` and ``opening`` from above, ``fronts`` by its turn, and those of a section."""

    dome: Points
    opening: Points
    fronts: Mapping[float, Points]
    inner: Points
    outer: Points
    top_mm: float

    @staticmethod
    def of(lens: Lens, turns_deg: Iterable[float]) -> "LensLines":
        """Lines of ``lens``, and of the front of one with each of these turns."""
        cavity, envelope = lens_boundaries(lens)
        around, across = rim_directions(_TURN)[:, :2], rim_directions(np.zeros(1))[0]
        return LensLines(
            dome=dome_radius(lens, _TURN)[:, None] * around,
            opening=rim_radius(cavity)(_TURN)[:, None] * around,
            fronts={turn: front_line(lens, turn) for turn in set(turns_deg)},
            inner=profile(cavity, across),
            outer=profile(envelope, across),
            top_mm=float(highest_point_mm(envelope)[2]),
        )


Drawn = Callable[[float, Place], Marks]  # at a scale, its origin at a place on paper


def plate_sheet(lens: Lens, part: Part, layout: PlateLayout, words: DrawingSection, name: SheetName = "A3") -> Sheet:
    """Draw the sheet. Raises :class:`InputError` for a plate that does not fit at any scale."""
    unit, (left, bottom, right, top) = unit_of(name), inside_of(name)
    rows, gap = place_rows(layout), 4.0 * unit
    drawn = rows if len(rows) <= _MOST_ROWS else [*rows[: _MOST_ROWS - 1], ["…", "", "", "more on manufacturing.html"]]
    band = (HEIGHT + 4.0) * unit + sum(row_height(each, _widths(unit), unit) for each in drawn)
    middle, lines = left + _VIEWS * (right - left), LensLines.of(lens, layout.lenses.turns_deg)
    scale, origin, whole = _fitting(
        lambda scale, at: _whole(lines, layout, scale, unit, at), (left + gap, bottom + band + gap, middle, top - gap)
    )
    beside = middle + gap, bottom + band + gap, right - gap, top - 4.0 * gap
    closer, _, section = _fitting(lambda scale, at: _one_lens(lines, layout, scale, unit, at), beside)
    marks = Marks([frame_of(inside_of(name), "outline")])
    for each in (whole, section, draw_title_block(_block(lens, part, words), (right, bottom), unit, scale, name)):
        marks.add(each)
    title = f"One lens in its section along x, {scale_words(closer)}"
    marks.words.append(Words((0.5 * (beside[0] + beside[2]), top - 2.0 * gap), title, LETTERS * unit, "center"))
    marks.add(_table(drawn, right - WIDTH * unit, bottom + band, unit))
    notes = left + gap, bottom + gap, right - (WIDTH + 4.0) * unit, bottom + band
    marks.words += paragraphs_in(notes, plate_notes(lens, layout, words), unit)
    return Sheet(name, SIZES[name], unit, scale, f"{title_of(lens, words)}, plate", origin, marks)


def _fitting(draw: Drawn, room: Box) -> tuple[float, Place, Marks]:
    """The largest scale at which it fits, the place of its origin on paper, and what is drawn there."""
    for scale in SCALES:
        box = room_of(draw(scale, (0.0, 0.0)))
        if box[2] - box[0] <= room[2] - room[0] and box[3] - box[1] <= room[3] - room[1]:
            at = 0.5 * (room[0] + room[2] - box[0] - box[2]), 0.5 * (room[1] + room[3] - box[1] - box[3])
            return scale, at, draw(scale, at)
    raise InputError("the plate fits on the sheet at no scale; its drawing is left to a CAD program")


def plate_notes(lens: Lens, layout: PlateLayout, words: DrawingSection) -> list[str]:
    """The notes, a paragraph each."""
    count = len(layout.lenses)
    equal = f"{quantity(count, 'lenses')}, all equal" if count > 1 else "One lens"
    return [
        f"{equal}: their faces, with tolerances, tools and points, are those of drawing.dxf and manufacturing.html. "
        f"{PLATE_STEP_FILE} alone defines them; sizes in parentheses are auxiliary.",
        "x and y count from the middle of the outline, z from the top of the plate, in which the lenses end.",
        f"All other sizes of the plate are “general”. {general_words(words)}",
        "Bores of the lenses, holes, pins and sides: as in the STEP, without draft.",
        *mould_words(lens),
    ]


def place_rows(layout: PlateLayout) -> Rows:
    """Rows of a table: number, x, y and what is there; lenses only where they have no pattern or are turned."""
    found, lenses = list[tuple[str, Place, str]](), layout.lenses
    if _listed(layout):
        for number, (place, turn) in enumerate(zip(lenses.places_mm, lenses.turns_deg, strict=True), 1):
            found.append((f"L{number}", place, f"lens, turned by {turn:.3f}°" if turn else "lens"))
    found += [(label, mark.place_mm, mark.words) for label, mark in labelled(layout)]
    return [
        [label, *(f"{name} {shown(round(at, 6) + 0.0)}" for name, at in zip("xy", place, strict=True)), words]
        for label, place, words in found
    ]


def _listed(layout: PlateLayout) -> bool:
    """True where the table has the lenses."""
    return pattern_of(layout.lenses) is None or any(layout.lenses.turns_deg)


def labelled(layout: PlateLayout) -> Iterator[tuple[str, PlateMark]]:
    """Holes, pins and the like with their labels on the drawing: a letter of each kind, and numbers."""
    counts: dict[str, int] = {}
    for _, mark in layout.plate.marks:
        counts[mark.letter] = counts.get(mark.letter, 0) + 1
        yield f"{mark.letter}{counts[mark.letter]}", mark


def _block(lens: Lens, part: Part, words: DrawingSection) -> Rows:
    """The title block with mass and file of the plate in the place of those of the lens."""
    plate, rows = part.plate, title_block(lens, part, words)
    assert plate is not None
    mass = f"Volume: {plate.volume_mm3:.1f} mm³" if plate.mass_g is None else f"Mass: {plate.mass_g:.3f} g"
    file = f"Defined by: {PLATE_STEP_FILE}, SHA-256 {part.files[PLATE_STEP_FILE].sha256[:16]}…"
    return [
        [f"{rows[0][0]}, plate of {quantity(plate.lenses, 'lenses')}"],
        rows[1],
        [rows[2][0], mass],
        *rows[3:-1],
        [file],
    ]


def _widths(unit: float) -> list[float]:
    return [share * WIDTH * unit for share in _COLUMNS]


def _table(rows: Rows, left: float, top: float, unit: float) -> Marks:
    """The table of places, its upper left corner given."""
    marks = Marks()
    for texts in rows:
        marks.add(row(left, top, texts, _widths(unit), unit))
        top -= row_height(texts, _widths(unit), unit)
    return marks


def _dimension(name: str, ends: tuple[Place, Place], length_mm: float, unit: float, **more: Any) -> LinearDimension:
    """A dimension between two places on paper, not placed yet."""
    return LinearDimension(name, *ends, more.pop("turned_deg", 0), 0.0, 0.0, LETTERS * unit, length_mm, **more)


def _whole(lines: LensLines, layout: PlateLayout, scale: float, unit: float, origin: Place) -> Marks:
    """The plate from the front, and below it, in first angle, from above; ``origin``: of the latter."""
    marks, (wide, high), at = Marks(), layout.size_mm, np.array(origin)
    marks.strokes.append(Stroke(at + scale * points_on(layout.outline, _CHORD_MM), "outline", closed=True))
    reach = scale * float(np.hypot(*lines.dome.T).max()) + 1.5 * unit
    for number, place in enumerate(layout.lenses.places_mm):
        marks.strokes += [
            Stroke(at + scale * layout.placed(lines.dome, number), "outline", closed=True),
            Stroke(at + scale * layout.placed(lines.opening, number), "hidden", closed=True),
            *_cross(at + scale * np.array(place), reach),
        ]
    for label, mark in labelled(layout):
        middle = at + scale * np.array(mark.place_mm)
        circle = at + scale * points_on(circle_at(mark.place_mm, mark.radius_mm), _CHORD_MM)
        marks.strokes += [Stroke(circle, mark.pen, closed=True), *_cross(middle, scale * mark.radius_mm + 1.5 * unit)]
        outside = 0.75 * scale * mark.radius_mm
        marks.words.append(_label(label, middle + (outside if outside < _INSIDE * unit else 0.0) + 1.5 * unit, unit))
    if _listed(layout):
        beside = at + 0.75 * reach
        marks.words += [
            _label(f"L{k}", beside + scale * np.array(place), unit)
            for k, place in enumerate(layout.lenses.places_mm, 1)
        ]
    rows, columns = _pattern_sizes(layout, scale, unit, origin)
    left, bottom = (origin[k] - 0.5 * scale * layout.size_mm[k] for k in (0, 1))
    marks.dimensions += placed(rows, bottom - _FIRST * unit, -_ROW * unit)
    marks.dimensions += placed(columns, left - _FIRST * unit, -_ROW * unit)
    _add_corner(marks, layout, scale, unit, origin)
    marks.add(axes_mark((origin[0] + 0.5 * scale * wide + 4.0 * unit, bottom), "x", "y", unit))
    front = origin[0], origin[1] + 0.5 * scale * high + _GAP * unit + scale * _below_mm(layout)
    marks.add(_front(lines, layout, scale, unit, front))
    return marks


def _label(text: str, at: Float[np.ndarray, " 2"], unit: float) -> Words:
    return Words((float(at[0]), float(at[1])), text, LETTERS * unit)


def _cross(middle: Float[np.ndarray, " 2"], half: float) -> list[Stroke]:
    return [Stroke(middle + half * np.array([(-x, -y), (x, y)]), "axis") for x, y in ((1.0, 0.0), (0.0, 1.0))]


def _pattern_sizes(
    layout: PlateLayout, scale: float, unit: float, origin: Place
) -> tuple[list[LinearDimension], list[LinearDimension]]:
    """Dimensions along x and along y: of the outline, the pattern, and from the edge to its first lens."""
    found, pattern = list[list[LinearDimension]](), pattern_of(layout.lenses)
    for axis, (way, across) in enumerate((("x", "width"), ("y", "height"))):
        half, turned = layout.size_mm[axis] / 2.0, 90 * axis
        sign = "⌀" if layout.plate.kind == "round" else ""

        def ends(*along: float, off: float, axis: int = axis) -> tuple[Place, Place]:
            pairs = [(each, off) if axis == 0 else (off, each) for each in along]
            first, last = ((origin[0] + scale * x, origin[1] + scale * y) for x, y in pairs)
            return first, last

        edge = -layout.size_mm[1 - axis] / 2.0 if layout.plate.kind == "rectangle" else 0.0
        each = list[LinearDimension]()
        if not (sign and axis):
            whole = ends(-half, half, off=edge)
            each.append(_dimension(f"{across} of the plate", whole, 2.0 * half, unit, turned_deg=turned, before=sign))
        if pattern is not None and pattern.ring_mm is None:
            first, steps, pitch = pattern.first[axis], pattern.count[axis] - 1, pattern.pitch_mm[axis]
            off = pattern.row_mm if axis == 0 else pattern.first[0]
            if steps:
                before = f"{steps} × {shown(pitch)} = " if steps > 1 else ""
                span, name = ends(first, first + steps * pitch, off=off), f"pitch of the lenses along {way}"
                each.append(_dimension(name, span, steps * pitch, unit, turned_deg=turned, before=before))
            if not sign:
                name, span = f"edge to the first lens along {way}", ends(-half, first, off=off)
                each.append(_dimension(name, span, first + half, unit, turned_deg=turned))
        elif pattern is not None and pattern.ring_mm is not None and axis == 0:
            count, ring = len(layout.lenses), pattern.ring_mm
            span, before = ends(-ring / 2.0, ring / 2.0, off=0.0), f"{count} × on ⌀"
            each.append(_dimension("circle of the axes", span, ring, unit, before=before))
        found.append(each)
    return found[0], found[1]


def _add_corner(marks: Marks, layout: PlateLayout, scale: float, unit: float, origin: Place) -> None:
    """The radius of the corners, at the end of an arrow, and the circle of a ring's axes."""
    radius, pattern = layout.plate.corner_radius_mm, pattern_of(layout.lenses)
    if radius:
        corner = np.array(layout.size_mm) / 2.0 - radius * (1.0 - 0.5**0.5)
        tip, out = np.array(origin) + scale * corner, np.array([-1.0, -1.0]) * 0.5**0.5
        end = tip - 6.0 * unit * out
        marks.strokes += [Stroke(np.array([tip, end])), arrow_head(tip, out, LETTERS * unit)]
        text = f"4 × R {shown(radius)}"
        marks.words.append(Words((float(end[0]) + unit, float(end[1])), text, LETTERS * unit))
    if pattern is not None and pattern.ring_mm is not None:
        circle = points_on(circle_at((0.0, 0.0), pattern.ring_mm / 2.0), _CHORD_MM)
        marks.strokes.append(Stroke(np.array(origin) + scale * circle, "axis", closed=True))


def _below_mm(layout: PlateLayout) -> float:
    """Depth of the lowest point below z = 0."""
    return layout.plate.thickness_mm + max((mark.below_mm for _, mark in layout.plate.marks), default=0.0)


def _front(lines: LensLines, layout: PlateLayout, scale: float, unit: float, origin: Place) -> Marks:
    """The plate seen along +y, its top at ``origin``: thickness, heights of pins, and height over all."""
    marks, at, thickness = Marks(), np.array(origin), layout.plate.thickness_mm
    half, top = layout.size_mm[0] / 2.0, lines.top_mm
    bar = np.array([(-half, 0.0), (half, 0.0), (half, -thickness), (-half, -thickness)])
    marks.strokes.append(Stroke(at + scale * bar, "outline", closed=True))
    seen = {(round(x, 6), turn) for (x, _), turn in zip(layout.lenses.places_mm, layout.lenses.turns_deg, strict=True)}
    marks.strokes += [
        Stroke(at + scale * (lines.fronts[turn] + np.array([x, 0.0])), "outline") for x, turn in sorted(seen)
    ]
    columns, heights = [], dict[float, Place]()
    for _, mark in layout.plate.marks:
        x, radius, z = mark.place_mm[0], mark.radius_mm, -thickness
        if mark.below_mm:
            sides = np.array([(-radius, z), (-radius, z - mark.below_mm), (radius, z - mark.below_mm), (radius, z)])
            marks.strokes.append(Stroke(at + scale * (sides + np.array([x, 0.0])), "outline"))
            heights[mark.below_mm] = max((x + radius, z), heights.get(mark.below_mm, (x, z)))
        else:
            walls = [np.array([(x + side, 0.0), (x + side, z)]) for side in (-radius, radius)]
            marks.strokes += [Stroke(at + scale * each, "hidden") for each in walls]

    def upright(name: str, x: float, low: float, high: float, before: str = "", after: str = "") -> LinearDimension:
        ends = tuple((origin[0] + scale * x, origin[1] + scale * z) for z in (low, high))
        more = {"turned_deg": 90, "before": before, "after": after}
        return _dimension(name, (ends[0], ends[1]), high - low, unit, **more)

    columns.append(upright("thickness of the plate", half, -thickness, 0.0))
    columns += [upright("height below the plate", x, z - length, z) for length, (x, z) in sorted(heights.items())]
    columns.append(upright("height over all", half, -_below_mm(layout), top, "(", ")"))
    marks.dimensions += placed(columns, origin[0] + scale * half + _FIRST * unit, _ROW * unit)
    return marks


def _one_lens(lines: LensLines, layout: PlateLayout, scale: float, unit: float, origin: Place) -> Marks:
    """A lens with the plate around it, cut along its x: heights, and its widths in z = 0 and at its widest."""
    inner, outer = lines.inner, lines.outer
    thickness, wide = layout.plate.thickness_mm, 1.25 * float(np.abs(outer[:, 0]).max())
    hollow = np.array([(inner[-1, 0], -thickness), *inner[::-1], (inner[0, 0], -thickness)])
    cut = np.concatenate([[(-wide, -thickness), (-wide, 0.0)], outer, [(wide, 0.0), (wide, -thickness)], hollow])
    at = np.array(origin)
    marks = Marks([*hatch([at + scale * cut], _HATCH * unit), Stroke(at + scale * cut, "outline", closed=True)])
    top = float(outer[:, 1].max())
    marks.strokes.append(
        Stroke(at + np.array([(0.0, -scale * thickness - 4.0 * unit), (0.0, scale * top + 4.0 * unit)]), "axis")
    )

    def between(
        name: str, first: Float[np.ndarray, " 2"], last: Float[np.ndarray, " 2"], turned_deg: int
    ) -> LinearDimension:
        length = float(abs(last[turned_deg // 90] - first[turned_deg // 90]))
        ends = tuple((float(x), float(y)) for x, y in (at + scale * first, at + scale * last))
        return _dimension(name, (ends[0], ends[1]), length, unit, turned_deg=turned_deg, before="(", after=")")

    floor = np.array([-wide, 0.0])
    low, high = outer[np.argmin(outer[:, 0])], outer[np.argmax(outer[:, 0])]
    widths = [("rim of a lens in z = 0", outer[0], outer[-1]), ("opening of a lens in z = 0", inner[0], inner[-1])]
    if high[0] - low[0] > outer[-1, 0] - outer[0, 0] + _SHOWN_MM:
        widths.append(("width of a lens", low, high))
    rows = [between(*each, 0) for each in widths]
    columns = [between("height of a lens", floor, outer[np.argmax(outer[:, 1])], 90)]
    columns.append(between("height of a cavity", floor, inner[np.argmax(inner[:, 1])], 90))
    marks.dimensions += placed(rows, origin[1] - scale * thickness - _FIRST * unit, -_ROW * unit)
    marks.dimensions += placed(columns, origin[0] - scale * wide - _FIRST * unit, -_ROW * unit)
    return marks
