"""The drawing of the plate: seen from above and from the front, one lens in a larger section, and its marks.

The pattern of the lenses is dimensioned once, as pitch times count along rows and columns, or as a ring; other places,
turns and kinds stand in a table. All sizes are of the design in the plate's own axes, from the middle of its outline.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.part import STEP_FILE, Part
from lensforge.cad.plan import rim_directions, rim_radius
from lensforge.cad.plate_layout import PlateLayout
from lensforge.cad.plate_result import PLATE_STEP_FILE
from lensforge.cad.section import profile
from lensforge.results.numerals import quantity
from lensforge.scene.lens import Lens
from lensforge.shop.datums import PLATE_SIZES, ROUND_PLATE, DatumScheme, labelled, plate_datums
from lensforge.shop.dimensions import highest_point_mm
from lensforge.shop.drawing import (
    HEIGHT,
    SIZES,
    WIDTH,
    SheetName,
    draw_title_block,
    general_tolerance_note,
    inside_of,
    mould_notes,
    plate_draft_note,
    scale_label,
    surface_notes,
    title_block,
    title_of,
    unit_of,
)
from lensforge.shop.sheet import (
    LETTERS,
    LinearDimension,
    Marks,
    PenName,
    Place,
    Points,
    Sheet,
    SheetText,
    Stroke,
    box_of,
    shown,
)
from lensforge.shop.sheet_marks import (
    arrow_head,
    axes_mark,
    datum_symbol,
    draw_rows,
    frame_of,
    hatch,
    paragraphs_in,
    row_height,
)
from lensforge.shop.view_drawing import FIRST, HATCH, PARTING_LINE, ROW, PaperView, add_centres, fitted, placed
from lensforge.shop.view_lines import dome_radius, front_line
from lensforge.spec import DrawingSection
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.plate_section import DrawnOutline, PlateBoss, PlateMark, PlatePin
from lensforge.surfaces.plane_loop import circle_at, points_on

_GAP = 28.0  # mm on A3, between views
_CHORD_MM = 5e-3
_TURN = np.linspace(0.0, 2.0 * np.pi, 181)
_SAME_MM = 1e-6
_SHOWN_MM = 1e-3
_INSIDE = 6.0  # mm on A3: the label of a larger circle stands inside
_MOST_ROWS = 12  # of the table on the sheet; the page has all
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
    """The pattern of ``lenses``; None if they are in neither rows of one pitch nor an even ring."""
    places = np.array(lenses.places_mm)
    levels = np.unique(np.round(places[:, 1], 6))
    rows = [np.sort(places[np.abs(places[:, 1] - level) < _SAME_MM, 0]) for level in levels]
    steps = np.concatenate([np.diff(row) for row in rows])
    if _alike(steps) and _alike(np.diff(levels)):
        longest = int(np.argmax([len(row) for row in rows]))
        pitch = tuple(float(gaps.mean()) if len(gaps) else 0.0 for gaps in (steps, np.diff(levels)))
        first = float(rows[longest][0]), float(levels[0])
        return Pattern((pitch[0], pitch[1]), (len(rows[longest]), len(levels)), first, float(levels[longest]))
    radius = np.hypot(*places.T)
    turns = np.sort(np.arctan2(places[:, 1], places[:, 0]))
    even = _alike(np.diff([*turns, turns[0] + 2.0 * np.pi]))
    return Pattern(ring_mm=2.0 * float(radius.mean())) if even and _alike(radius) else None


def _alike(values: Float[np.ndarray, " n"]) -> bool:
    return bool(np.ptp(values) < _SAME_MM) if len(values) else True


@dataclass(frozen=True, eq=False)
class LensLines:
    """Lines (mm) of one lens: ``dome`` and ``opening`` from above, ``fronts`` by its turn, and those of a section."""

    dome: Float[np.ndarray, "a 2"]
    opening: Float[np.ndarray, "b 2"]
    fronts: Mapping[float, Float[np.ndarray, "c 2"]]
    inner: Float[np.ndarray, "d 2"]
    outer: Float[np.ndarray, "e 2"]
    top_mm: float

    @property
    def reach_mm(self) -> float:
        """Distance from the axis to which the section of a single lens shows the plate."""
        return 1.25 * float(np.abs(self.outer[:, 0]).max())

    @staticmethod
    def of(lens: Lens, turns_deg: Iterable[float]) -> "LensLines":
        """Lines of ``lens``, and of its front at each of these turns."""
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


def _cross(view: PaperView, place: Place, reach_mm: float) -> list[Stroke]:
    half = view.scale * reach_mm + 1.5 * view.unit
    return [Stroke(view.at([place] * 2) + half * np.array([(-x, -y), (x, y)]), "axis") for x, y in ((1, 0), (0, 1))]


def _label(view: PaperView, text: str, place: Place, away_mm: float) -> SheetText:
    x, y = (view.at([place])[0] + view.scale * away_mm + 1.5 * view.unit).tolist()
    return SheetText((x, y), text, LETTERS * view.unit)


def plate_sheet(lens: Lens, part: Part, layout: PlateLayout, drawing: DrawingSection, name: SheetName = "A3") -> Sheet:
    """Draw the sheet. Raises :class:`InputError` for a plate that fits at no scale."""
    unit = unit_of(name)
    (left, bottom, right, top) = inside_of(name)
    rows = place_rows(layout)
    gap = 4.0 * unit
    widths = [share * WIDTH * unit for share in _COLUMNS]
    drawn = (
        rows
        if len(rows) <= _MOST_ROWS
        else [*rows[: _MOST_ROWS - 1], PlaceRow("…", feature="more on manufacturing.html")]
    )
    band = (HEIGHT + 4.0) * unit + sum(row_height(texts, widths, unit) for texts in drawn)
    lines = [LensLines.of(kind, layout.lenses.turns_deg) for kind in lens.kinds]
    middle = right - (WIDTH + 4.0) * unit
    notes = paragraphs_in((left + gap, bottom - top, middle, 0.0), plate_notes(lens, layout, drawing), unit)
    high = gap - min(box_of(note)[1] for note in notes)
    room = left + gap, bottom + high + gap, middle, top - gap
    beside = middle + 3.0 * gap, bottom + band + gap, right - gap, top - 4.0 * gap
    wide = [layout.box_mm[1][0] - layout.box_mm[0][0], 2.0 * lines[0].reach_mm]
    gate = gate_of(lens, layout)
    view = fitted(partial(_whole, lines, layout, gate), wide[0], room, unit)
    closer = fitted(partial(_one_lens, lines[0], layout), wide[1], beside, unit)
    block = title_block(lens, part, drawing, of_plate=True)
    marks = Marks([frame_of(inside_of(name), "outline")])
    marks.add(_whole(lines, layout, gate, view))
    marks.add(_one_lens(lines[0], layout, closer))
    marks.add(draw_title_block(block, (right, bottom), unit, view.scale, name))
    title = f"{layout.counted[0]}, its section along x, {scale_label(closer.scale)}; faces as in {STEP_FILE}"
    marks.texts.append(SheetText((0.5 * (beside[0] + beside[2]), top - 2.0 * gap), title, LETTERS * unit, "center"))
    marks.add(draw_rows(drawn, right - WIDTH * unit, bottom + band, widths, unit))
    marks.texts += [replace(note, at=(note.at[0], note.at[1] + bottom + high)) for note in notes]
    return Sheet(name, SIZES[name], unit, view.scale, f"{title_of(lens, drawing)}, plate", view.origin, marks)


def plate_notes(lens: Lens, layout: PlateLayout, drawing: DrawingSection) -> list[str]:
    """The notes, a paragraph each."""
    count = len(layout.lenses)
    drawn = layout.plate.outline
    origin = f"origin of {drawn.origin}" if isinstance(drawn, DrawnOutline) else "middle of the outline"
    lenses = f"{quantity(count, 'lenses')}, all equal" if count > 1 else "One lens"
    if layout.lenses.kinds:
        lenses = f"{', '.join(layout.counted)}, each kind with a folder of its own"
    return [
        f"{lenses}: their faces, with tolerances, tools and points, are those of drawing.dxf and manufacturing.html. "
        f"{PLATE_STEP_FILE} alone defines them; sizes in parentheses are auxiliary.",
        f"x and y count from the {origin}, z from the top of the plate, in which the lenses end.",
        *(f"{line}." for line in plate_datums(layout).lines),
        f"All other sizes of the plate are “general”. {general_tolerance_note(drawing)}",
        plate_draft_note(layout.plate),
        *gate_note(lens, layout),
        *surface_notes(lens, drawing),
        *mould_notes(lens),
    ]


class PlaceRow(NamedTuple):
    """A row of the table of places: label on the drawing, x and y as texts, and what is there."""

    label: str
    x: str = ""
    y: str = ""
    feature: str = ""

    @staticmethod
    def at(label: str, place_mm: Place, feature: str) -> "PlaceRow":
        """The row of a place."""
        x, y = (shown(round(value, 6) + 0.0) for value in place_mm)
        return PlaceRow(label, f"x {x}", f"y {y}", feature)


def place_rows(layout: PlateLayout) -> list[PlaceRow]:
    """Rows of the table; with lenses only if they form no pattern, or some are turned or of another kind."""
    rows = list[PlaceRow]()
    lenses = layout.lenses
    if _listed(layout):
        names = layout.of_each([f"lens {kind.name}" for kind in lenses.kinds] or ["lens"])
        for number, (name, (place, _, turn)) in enumerate(zip(names, lenses.lamps, strict=True), 1):
            rows.append(PlaceRow.at(f"L{number}", place[:2], f"{name}, turned by {turn:.3f}°" if turn else name))
    datums = plate_datums(layout)
    rows += [
        PlaceRow.at(label, mark.place_mm, f"{_mark_description(mark)}{_position_note(label, mark, datums)}")
        for label, mark in labelled(layout)
    ]
    gate = layout.plate.gate
    return rows if gate is None else [*rows, PlaceRow.at("G", gate.place_mm, f"gate, {shown(gate.width_mm)} wide")]


def _listed(layout: PlateLayout) -> bool:
    return pattern_of(layout.lenses) is None or any(layout.lenses.turns_deg) or layout.lenses.kinds != ()


def _mark_description(mark: PlateMark) -> str:
    width = f"⌀{shown(mark.diameter_mm)}{'' if mark.tolerance_mm is None else f' ±{shown(mark.tolerance_mm)}'}"
    if not isinstance(mark, PlatePin):
        return f"hole {width}, through"
    size = f"{width}, {shown(mark.height_mm)} below"
    if not isinstance(mark, PlateBoss):
        return f"pin {size}"
    return f"boss {size}; bore ⌀{shown(mark.bore_diameter_mm)}, {shown(mark.bore_depth_mm)} deep"


def _position_note(label: str, mark: PlateMark, datums: DatumScheme) -> str:
    """The tolerance of its place by ISO 1101 against the datums before it, and the datum that it is itself."""
    letters = [datum.letter for datum in datums.datums]
    letter = next((datum.letter for datum in datums.datums if datum.dimension == label), None)
    before = letters if letter is None else letters[: letters.index(letter)]
    zone = mark.place_tolerance_mm
    position = "" if zone is None else f"; position ⌀{zone:g} | {' | '.join(before)}"
    return position if letter is None else f"{position}; datum {letter}"


def gate_of(lens: Lens, layout: PlateLayout) -> Place | None:
    """Gate of a moulded plate: as in its spec, or the middle of its longest side; None for a plate that is cut."""
    if layout.plate.gate is not None:
        return layout.plate.gate.place_mm
    if lens.spec.manufacture.cuts != "inserts":
        return None
    longest = max(layout.outline, key=lambda edge: float(np.hypot(*np.subtract(edge.end, edge.start))))
    x, y = longest.at(np.array([0.5]))[0].tolist()
    return x, y


def gate_note(lens: Lens, layout: PlateLayout) -> Iterator[str]:
    """The note on a gate that the spec does not place."""
    if layout.plate.gate is None and gate_of(lens, layout) is not None:
        yield "G, gate: proposed at the side of the plate, away from the optical faces; agree on its place and width."


_WAYS = [(np.cos(turn), np.sin(turn)) for turn in np.pi * np.array([-0.5, 0.5, 0.0, 1.0, -0.25, -0.75, 0.25, 0.75])]
_FURTHER = np.arange(0.0, 121.0, 3.0)  # mm on A3


def _datum_at(mark: PlateMark, letter: str, lines: Sequence[LensLines], layout: PlateLayout, view: PaperView) -> Marks:
    """The symbol of a datum at a hole or pin, its letter as near as lenses and other marks permit."""
    centre = view.at([mark.place_mm])[0]
    radius = view.scale * mark.radius_mm
    domes = [view.scale * float(np.hypot(*lines_of_lens.dome.T).max()) for lines_of_lens in layout.of_each(lines)]
    neighbours = [neighbour for _, neighbour in labelled(layout) if neighbour is not mark]
    places = view.at([*layout.lenses.places_mm, *(neighbour.place_mm for neighbour in neighbours)])
    taken = np.array([*domes, *(view.scale * neighbour.radius_mm for neighbour in neighbours)])

    def symbol(way: Place, further_mm: float) -> Marks:
        foot = centre + radius * np.array(way)
        return datum_symbol((float(foot[0]), float(foot[1])), way, letter, view.unit, further_mm)

    for further_mm in _FURTHER * view.unit:
        for way in _WAYS:
            made = symbol(way, float(further_mm))
            box = made.strokes[-1].points
            apart = np.linalg.norm(places - box.mean(axis=0), axis=1) - taken
            if apart.min() > np.ptp(box, axis=0).max():
                return made
    return symbol(_WAYS[0], 0.0)


def _whole(lines: Sequence[LensLines], layout: PlateLayout, gate: Place | None, view: PaperView) -> Marks:
    """The plate from the front, and below it, in first angle, from above, where the view's origin is."""
    marks = Marks()
    low, high = layout.box_mm
    unit = view.unit
    loops = layout.outline, *layout.slots
    marks.strokes += [view.line(points_on(loop, _CHORD_MM), closed=True) for loop in loops]
    for number, (lens_lines, place) in enumerate(zip(layout.of_each(lines), layout.lenses.places_mm, strict=True)):
        lens_mm = float(np.hypot(*lens_lines.dome.T).max())
        marks.strokes += [
            view.line(layout.placed(lens_lines.dome, number), closed=True),
            view.line(layout.placed(lens_lines.opening, number), "hidden", closed=True),
            *_cross(view, place, lens_mm),
        ]
        if _listed(layout):
            marks.texts.append(_label(view, f"L{number + 1}", place, 0.75 * lens_mm))
    datums = plate_datums(layout)
    for label, mark in labelled(layout):
        circle = points_on(circle_at(mark.place_mm, mark.radius_mm), _CHORD_MM)
        pen: PenName = "hidden" if isinstance(mark, PlatePin) else "outline"
        marks.strokes += [view.line(circle, pen, closed=True), *_cross(view, mark.place_mm, mark.radius_mm)]
        inside = view.scale * mark.radius_mm > _INSIDE * unit
        marks.texts.append(_label(view, label, mark.place_mm, 0.0 if inside else 0.75 * mark.radius_mm))
        for datum in (datum for datum in datums.datums if datum.dimension == label):
            marks.add(_datum_at(mark, datum.letter, lines, layout, view))
    if gate is not None:
        (tip,) = view.at([gate])
        inwards = -np.array(min(layout.outline, key=lambda edge: edge.away_mm(gate)).right)
        marks.strokes.append(arrow_head(tip, inwards, 2.0 * LETTERS * unit))
        marks.texts.append(_label(view, "G", gate, 0.0))
    pattern = pattern_of(layout.lenses)
    radius = layout.plate.corner_radius_mm
    for axis in (0, 1):
        edge = float(view.at([low])[0, 1 - axis])
        sizes = list(_sizes_along(axis, layout, pattern, view))
        lines_beside = placed(sizes, edge - FIRST * unit, -ROW * unit)
        marks.dimensions += lines_beside
        add_centres(marks, datums, lines_beside, unit)
    if pattern is not None and pattern.ring_mm is not None:
        circle = points_on(circle_at((0.0, 0.0), pattern.ring_mm / 2.0), _CHORD_MM)
        marks.strokes.append(view.line(circle, "axis", closed=True))
    if radius:
        x, y = (size / 2.0 - radius * (1.0 - 0.5**0.5) for size in layout.size_mm)
        (tip,) = view.at([(x, y)])
        out = np.array([-1.0, -1.0]) * 0.5**0.5
        marks.strokes += [Stroke(np.array([tip, tip - 6.0 * unit * out])), arrow_head(tip, out, LETTERS * unit)]
        marks.texts.append(_label(view, f"4 × R {shown(radius)}", (x, y), 4.0 * unit / view.scale))
    (corner,) = view.at([(high[0], low[1])])
    marks.add(axes_mark((float(corner[0]) + 4.0 * unit, float(corner[1])), "x", "y", unit))
    up = view.scale * (high[1] + _below_mm(layout)) + _GAP * unit
    marks.add(_front(lines, layout, replace(view, origin=(view.origin[0], view.origin[1] + up))))
    return marks


def _sizes_along(axis: int, layout: PlateLayout, pattern: Pattern | None, view: PaperView) -> Iterator[LinearDimension]:
    """Dimensions along x or y: the outline, the pattern, and from the edge to the first lens."""
    way = "xy"[axis]
    turned = 90 * axis
    low, high = (corner[axis] for corner in layout.box_mm)
    is_round = layout.plate.kind == "round"

    def size(name: str, first: float, last: float, off: float, before: str = "") -> LinearDimension:
        start, end = ((at, off) if axis == 0 else (off, at) for at in (first, last))
        return view.dimension(name, start, end, turned, before)

    if not is_round:
        yield size(PLATE_SIZES[axis], low, high, layout.box_mm[0][1 - axis])
    elif axis == 0:
        yield size(ROUND_PLATE, low, high, 0.0, "⌀")
    if pattern is not None and pattern.ring_mm is not None:
        if axis == 0:
            ring = pattern.ring_mm / 2.0
            count = len(layout.lenses)
            yield size("circle of the axes", -ring, ring, 0.0, f"{count} × on ⌀")
    elif pattern is not None:
        first = pattern.first[axis]
        steps = pattern.count[axis] - 1
        pitch = pattern.pitch_mm[axis]
        off = (pattern.row_mm, pattern.first[0])[axis]
        if steps:
            before = f"{steps} × {shown(pitch)} = " if steps > 1 else ""
            yield size(f"pitch of the lenses along {way}", first, first + steps * pitch, off, before)
        if not is_round:
            yield size(f"edge to the first lens along {way}", low, first, off)


def _below_mm(layout: PlateLayout) -> float:
    return layout.plate.thickness_mm + max((pin.height_mm for pin in layout.plate.standing), default=0.0)


def _front(lines: Sequence[LensLines], layout: PlateLayout, view: PaperView) -> Marks:
    """The plate seen along +y, its top at the view's origin: thickness, heights of pins, and height over all."""
    (start, _), (end, _), low, lenses = *layout.box_mm, -layout.plate.thickness_mm, layout.lenses
    inset = layout.inset_mm
    marks = Marks([view.line([(start, 0.0), (end, 0.0), (end - inset, low), (start + inset, low)], closed=True)])
    marks.texts.append(_label(view, PARTING_LINE, (end, 0.0), 0.0))
    (corner,) = view.at([(start, 0.0)])
    marks.strokes.append(Stroke(np.array([corner, corner - (8.0 * view.unit, 0.0)])))
    marks.add(datum_symbol((float(corner[0]) - 5.0 * view.unit, float(corner[1])), (0.0, 1.0), "A", view.unit))
    every = zip(lenses.places_mm, lenses.turns_deg, lenses.kind_of_each, strict=True)
    seen = {(round(x, 6), turn, kind) for (x, _), turn, kind in every}
    marks.strokes += [view.line(lines[kind].fronts[turn] + np.array([x, 0.0])) for x, turn, kind in sorted(seen)]
    columns = [view.dimension("thickness of the plate", (end, low), (end, 0.0), 90)]
    heights = dict[float, float]()
    for pin, bore in layout.standing:
        marks.strokes.append(view.line(pin.corners))
        foot = low - pin.length_mm
        right = pin.place[0] + pin.foot_mm
        heights[foot] = max(right, heights.get(foot, right))
        if bore is not None:
            marks.strokes.append(view.line(bore.corners[[1, 0, 3, 2]], "hidden"))
    for hole in layout.holes:
        marks.strokes += [view.line(side, "hidden") for side in np.split(hole.corners, 2)]
    columns += [
        view.dimension("height below the plate", (x, foot), (x, low), 90) for foot, x in sorted(heights.items())
    ]
    over_all = (end, -_below_mm(layout)), (end, max(line.top_mm for line in lines))
    columns.append(view.dimension("height over all", *over_all, 90, "(", ")"))
    marks.dimensions += placed(columns, float(view.at([(end, 0.0)])[0, 0]) + FIRST * view.unit, ROW * view.unit)
    return marks


def _one_lens(lines: LensLines, layout: PlateLayout, view: PaperView) -> Marks:
    """A lens with the plate around it, cut along its x: heights, and its widths in z = 0 and at its widest point."""
    inner = lines.inner
    outer = lines.outer
    low = -layout.plate.thickness_mm
    wide = lines.reach_mm
    top = float(outer[:, 1].max())
    lens_name = next((f"lens {kind.name}" for kind in layout.lenses.kinds), "a lens")
    foot = layout.bore_scale(lines.opening[:-1]) * inner[[0, -1], 0]
    hollow = np.array([(foot[1], low), *inner[::-1], (foot[0], low)])
    cut = view.at(np.concatenate([[(-wide, low), (-wide, 0.0)], outer, [(wide, 0.0), (wide, low)], hollow]))
    marks = Marks([*hatch([cut], HATCH * view.unit), Stroke(cut, "outline", closed=True)])
    marks.strokes.append(view.line([(0.0, 1.3 * low), (0.0, 1.1 * top)], "axis"))
    left, right = outer[np.argmin(outer[:, 0])], outer[np.argmax(outer[:, 0])]
    widths: list[tuple[str, Points, Points]] = [
        (f"rim of {lens_name} in z = 0", outer[0], outer[-1]),
        (f"opening of {lens_name} in z = 0", inner[0], inner[-1]),
    ]
    if right[0] - left[0] > outer[-1, 0] - outer[0, 0] + _SHOWN_MM:
        widths.append((f"width of {lens_name}", left, right))
    heights = [(f"height of {lens_name}", outer), ("height of a cavity", inner)]
    rows = [view.dimension(name, (a[0], a[1]), (b[0], b[1]), 0, "(", ")") for name, a, b in widths]
    tops = [(name, line[np.argmax(line[:, 1])]) for name, line in heights]
    columns = [view.dimension(name, (-wide, 0.0), (at[0], at[1]), 90, "(", ")") for name, at in tops]
    x, y = view.at([(-wide, low)])[0].tolist()
    marks.dimensions += placed(rows, y - FIRST * view.unit, -ROW * view.unit)
    marks.dimensions += placed(columns, x - FIRST * view.unit, -ROW * view.unit)
    return marks
