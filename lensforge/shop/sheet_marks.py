"""Pieces of a drawing: symbols, hatching, ruled cells with text, and dimensions as lines and words."""

from collections.abc import Sequence

import numpy as np

from lensforge.shop.sheet import (
    LETTERS,
    Box,
    LinearDimension,
    Marks,
    PenName,
    Place,
    Points,
    SheetText,
    Stroke,
    shortened,
    width_of,
    wrapped,
)

# mm on A3
_TRIANGLE = 2.6
_BOX = 5.0
_LEADER = 2.0


def datum_symbol(at: Place, towards: Place, letter: str, unit: float, further_mm: float = 0.0) -> Marks:
    """A filled triangle on a line at ``at``, its leader in the unit direction ``towards``, and the letter in a box.

    ``further_mm``: added to the usual length of the leader.
    """
    foot = np.array(at)
    out = np.array(towards)
    along = np.array([-out[1], out[0]])
    size = unit * _TRIANGLE
    half = 0.5 * unit * _BOX
    triangle = np.array([foot + 0.5 * size * along, foot - 0.5 * size * along, foot + 0.87 * size * out])
    start = foot + 0.87 * size * out
    end = foot + (0.87 * size + unit * _LEADER + further_mm) * out
    centre = end + half * out
    corners = centre + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    strokes = [Stroke(triangle, closed=True, filled=True), Stroke(np.array([start, end])), Stroke(corners, closed=True)]
    return Marks(strokes, [_letters(centre, letter, unit)])


def _letters(at: np.ndarray, text: str, unit: float) -> SheetText:
    return SheetText((float(at[0]), float(at[1])), text, LETTERS * unit, "center")


def axes_mark(at: Place, level: str, up: str, unit: float, towards: float = 1.0) -> Marks:
    """Two arrows that name the axes of a view, their corner at ``at``; the level one to the right, or left for -1."""
    corner = np.array(at)
    length = 7.0 * unit
    strokes = []
    letters = []
    for name, out in ((level, np.array([towards, 0.0])), (up, np.array([0.0, 1.0]))):
        tip = corner + length * out
        strokes += [Stroke(np.array([corner, tip])), arrow_head(tip, out, 2.0 * unit)]
        place = tip + 2.0 * unit * out
        letters.append(_letters(place, name, unit))
    return Marks(strokes, letters)


def arrow_head(tip: np.ndarray, out: np.ndarray, size: float) -> Stroke:
    """A filled head of ``size`` mm that points along the unit vector ``out``."""
    along = np.array([-out[1], out[0]])
    back = tip - size * out
    return Stroke(np.array([tip, back + size / 6.0 * along, back - size / 6.0 * along]), closed=True, filled=True)


def section_plane(centre: Place, azimuth_deg: float, half_mm: float, letter: str, unit: float) -> Marks:
    """The plane of a section in the view from the base: a chain line, thick at its ends, with arrows of viewing."""
    turn = np.radians(azimuth_deg)
    along = np.array([np.sin(turn), np.cos(turn)])
    sight = np.array([-np.cos(turn), np.sin(turn)])
    middle = np.array(centre)
    strokes = [Stroke(np.array([middle - half_mm * along, middle + half_mm * along]), "axis")]
    letters = []
    for way in (1.0, -1.0):
        end = middle + way * half_mm * along
        strokes.append(Stroke(np.array([end, end + way * 4.0 * unit * along]), "outline"))
        tail = end + way * 2.0 * unit * along
        tip = tail + 7.0 * unit * sight
        strokes += [Stroke(np.array([tail, tip])), arrow_head(tip, sight, LETTERS * unit)]
        place = tip + LETTERS * unit * sight
        letters.append(_letters(place, letter, unit))
    return Marks(strokes, letters)


_ALONG_HATCH = np.array([[1.0, 1.0], [-1.0, 1.0]]) / np.sqrt(2.0)  # rows: along the lines, and across them


def hatch(outlines: list[Points], spacing_mm: float) -> list[Stroke]:
    """Lines ``spacing_mm`` apart inside all ``outlines`` together, by the even-odd rule."""
    chains = [np.vstack([outline, outline[:1]]) @ _ALONG_HATCH.T for outline in outlines]
    across = np.concatenate([chain[:, 1] for chain in chains])
    first = np.ceil(across.min() / spacing_mm)
    last = np.floor(across.max() / spacing_mm)
    strokes = []
    for level in spacing_mm * (np.arange(first, last + 1.0) + 0.37):  # off the places where corners are likely
        cuts = np.sort(np.concatenate([_cuts(chain, level) for chain in chains]))
        for start, end in zip(cuts[0::2], cuts[1::2], strict=False):
            strokes.append(Stroke(np.array([(start, level), (end, level)]) @ _ALONG_HATCH, "hatch"))
    return strokes


def _cuts(chain: Points, level: float) -> np.ndarray:
    above = chain[:, 1] > level
    changes = np.flatnonzero(above[1:] != above[:-1])
    start = chain[changes]
    end = chain[changes + 1]
    share = (level - start[:, 1]) / (end[:, 1] - start[:, 1])
    return np.asarray(start[:, 0] + share * (end[:, 0] - start[:, 0]))


PITCH = 1.7  # of the lines of a paragraph, in heights of its letters
_MARGIN = 1.5  # mm on A3


def frame_of(box: Box, pen: PenName = "thin") -> Stroke:
    """The rectangle ``box``."""
    left, bottom, right, top = box
    return Stroke(np.array([(left, bottom), (right, bottom), (right, top), (left, top)]), pen, closed=True)


def cell(box: Box, text: str, unit: float) -> Marks:
    """A ruled cell with a line of text, shortened by an ellipsis if it does not fit."""
    left, bottom, right, top = box
    height = LETTERS * unit
    room = right - left - 2.0 * _MARGIN * unit
    cell_text = SheetText((left + _MARGIN * unit, 0.5 * (bottom + top)), shortened(text, height, room), height)
    return Marks([frame_of(box)], [cell_text])


def folded(texts: Sequence[str], widths: Sequence[float], unit: float) -> list[list[str]]:
    """Lines of the text of each cell of a row."""
    return [
        wrapped(text, LETTERS * unit, width - 2.0 * _MARGIN * unit) for text, width in zip(texts, widths, strict=True)
    ]


def row_height(texts: Sequence[str], widths: Sequence[float], unit: float) -> float:
    """Height of a row that holds all lines of its cells."""
    return (PITCH * max([1, *map(len, folded(texts, widths, unit))]) + 0.3) * LETTERS * unit


def row(left: float, top: float, texts: Sequence[str], widths: Sequence[float], unit: float) -> Marks:
    """A row of cells from left to right, as high as its longest text needs."""
    height = LETTERS * unit
    bottom = top - row_height(texts, widths, unit)
    strokes: list[Stroke] = []
    cell_texts: list[SheetText] = []
    x = left
    for lines, width in zip(folded(texts, widths, unit), widths, strict=True):
        strokes.append(frame_of((x, bottom, x + width, top)))
        for number, line in enumerate(lines):
            cell_texts.append(
                SheetText((x + _MARGIN * unit, top - ((number + 0.5) * PITCH + 0.15) * height), line, height)
            )
        x += width
    return Marks(strokes, cell_texts)


def draw_rows(rows: Sequence[Sequence[str]], left: float, top: float, widths: Sequence[float], unit: float) -> Marks:
    """A table of rows, its upper left corner given."""
    marks = Marks()
    for texts in rows:
        marks.add(row(left, top, texts, widths, unit))
        top -= row_height(texts, widths, unit)
    return marks


def paragraphs_in(box: Box, paragraphs: list[str], unit: float) -> list[SheetText]:
    """Numbered paragraphs from the top of ``box``; the last line tells of any that do not fit."""
    left, bottom, right, top = box
    height = LETTERS * unit
    lines = []
    indent = width_of("00. ", height)
    most = int((top - bottom) / (PITCH * height))
    for number, paragraph in enumerate(paragraphs, start=1):
        first, *continuation = wrapped(paragraph, height, right - left - indent)
        lines += [(0.0, f"{number}. {first}"), *((indent, line) for line in continuation)]
    if len(lines) > most:
        lines = [*lines[: most - 1], (0.0, "More notes: on manufacturing.html.")]
    return [
        SheetText((left + indent, top - (k + 0.6) * PITCH * height), text, height)
        for k, (indent, text) in enumerate(lines)
    ]


ARROW = 1.0  # in heights of the text: head
BEYOND = 0.6  # extension beyond
ABOVE = 0.85  # text above
TAIL = 2.0  # tail


def text_span(dimension: LinearDimension) -> tuple[float, float]:
    """Ends (mm) of the text along the dimension line."""
    half = 0.5 * width_of(dimension.text, dimension.height_mm)
    return dimension.text_mm - half, dimension.text_mm + half


def occupied(dimension: LinearDimension) -> tuple[float, float]:
    """Ends (mm) of everything drawn along the dimension line."""
    low, high = dimension.ends_mm
    tail = 0.0 if is_wide(high - low, dimension.height_mm) else (ARROW + TAIL) * dimension.height_mm
    first, last = text_span(dimension)
    return min(low - tail, first), max(high + tail, last)


def is_wide(length_mm: float, height_mm: float) -> bool:
    """True where both arrows fit between the ends."""
    return length_mm > 2.6 * ARROW * height_mm


def dimension_text(dimension: LinearDimension) -> SheetText:
    """The text above its line, or, read from the right, left of it."""
    away = ABOVE * dimension.height_mm * (1.0 if dimension.turned_deg == 0 else -1.0)
    place = dimension.at(dimension.text_mm, dimension.line_mm + away)
    return SheetText(place, dimension.text, dimension.height_mm, "center", dimension.turned_deg)


def strokes_of(dimension: LinearDimension) -> list[Stroke]:
    """Extension lines, dimension line and arrows."""
    size = dimension.height_mm
    line = dimension.line_mm
    low, high = dimension.ends_mm
    wide = is_wide(high - low, size)
    first, last = (low, high) if wide else occupied(dimension)
    text_low, text_high = text_span(dimension)
    # the line goes on below a text outside
    first = min(first, text_low)
    last = max(last, text_high)
    strokes = [_line(dimension, (first, line), (last, line))]
    for along, across in (dimension.at(*dimension.start), dimension.at(*dimension.end)):
        past = line + np.sign(line - across) * BEYOND * size
        strokes.append(_line(dimension, (along, across), (along, past)))
    outward = np.array(dimension.at(1.0 if wide else -1.0, 0.0))
    for tip, out in ((low, -outward), (high, outward)):
        strokes.append(arrow_head(np.array(dimension.at(tip, line)), out, ARROW * size))
    return strokes


def _line(dimension: LinearDimension, first: Place, last: Place) -> Stroke:
    return Stroke(np.array([dimension.at(*first), dimension.at(*last)]))
