"""Text on the sheet: its size in the typeface of the drawing, ruled cells, and paragraphs.

The typeface comes with matplotlib, so that no text is wider on any machine. CAD programs show the DXF in a typeface of
their own, of which the usual ones (ISO 3098, Arial) are narrower.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextToPath

from lensforge.shop.sheet import LETTERS, Box, Marks, PenName, Stroke, Words

TYPEFACE = "DejaVu Sans"
CAPITALS = 0.729  # height of its capitals as a share of its size
MM_PER_POINT = 25.4 / 72.0
_SIZE = 100.0  # points at which widths are measured
_ROOM = 1.35  # height of a line's box over that of its capitals: brackets, accents, letters that hang down


def width_of(text: str, height_mm: float) -> float:
    """Width (mm) of ``text`` with capitals of ``height_mm``."""
    return _width_points(text) / _SIZE * height_mm / CAPITALS


@cache  # the same text is tried at many heights
def _width_points(text: str) -> float:
    properties = FontProperties(family=TYPEFACE, size=_SIZE)
    width, _, _ = TextToPath().get_text_width_height_descent(text, properties, ismath=False)
    return float(width)


def points_of(height_mm: float) -> float:
    """Size of type in points whose capitals are ``height_mm`` high."""
    return height_mm / CAPITALS / MM_PER_POINT


def box_of(words: Words) -> Box:
    """The rectangle on paper (mm) that a text needs."""
    width, half = width_of(words.text, words.height_mm), 0.5 * _ROOM * words.height_mm
    start = {"left": 0.0, "center": -0.5 * width, "right": -width}[words.anchor]
    x, y = words.at
    if words.turned_deg == 0:
        return x + start, y - half, x + start + width, y + half
    return x - half, y + start, x + half, y + start + width


def wrapped(text: str, height_mm: float, width_mm: float) -> list[str]:
    """``text`` in lines that are no wider than ``width_mm``; a word that is wider is cut."""
    lines = [""]
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if width_of(longer, height_mm) <= width_mm:
            lines[-1] = longer
            continue
        *whole, last = _cut(word, height_mm, width_mm)
        lines += [*whole, last]
    return [line for line in lines if line]


def shortened(text: str, height_mm: float, width_mm: float) -> str:
    """``text``, its end replaced by an ellipsis where it is wider than ``width_mm``."""
    if width_of(text, height_mm) <= width_mm:
        return text
    kept = text
    while kept and width_of(kept + "…", height_mm) > width_mm:
        kept = kept[:-1]
    return kept.rstrip() + "…"


def _cut(word: str, height_mm: float, width_mm: float) -> list[str]:
    pieces = [""]
    for letter in word:
        if pieces[-1] and width_of(pieces[-1] + letter, height_mm) > width_mm:
            pieces.append("")
        pieces[-1] += letter
    return pieces


PITCH = 1.7  # of the lines of a paragraph, in heights of its letters
_MARGIN = 1.5  # mm on A3


def frame_of(box: Box, pen: PenName = "thin") -> Stroke:
    """The rectangle ``box``."""
    left, bottom, right, top = box
    return Stroke(np.array([(left, bottom), (right, bottom), (right, top), (left, top)]), pen, closed=True)


def cell(box: Box, text: str, unit: float) -> Marks:
    """A ruled cell with a line of text, which ends in an ellipsis where it does not fit."""
    left, bottom, right, top = box
    height, room = LETTERS * unit, right - left - 2.0 * _MARGIN * unit
    words = Words((left + _MARGIN * unit, 0.5 * (bottom + top)), shortened(text, height, room), height)
    return [frame_of(box)], [words]


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
    height, bottom = LETTERS * unit, top - row_height(texts, widths, unit)
    strokes: list[Stroke] = []
    words: list[Words] = []
    x = left
    for lines, width in zip(folded(texts, widths, unit), widths, strict=True):
        strokes.append(frame_of((x, bottom, x + width, top)))
        for number, line in enumerate(lines):
            words.append(Words((x + _MARGIN * unit, top - ((number + 0.5) * PITCH + 0.15) * height), line, height))
        x += width
    return strokes, words


def paragraph_lines(paragraphs: list[str], height: float, width: float) -> list[tuple[float, str]]:
    """Indent (mm) and text of each line of numbered paragraphs."""
    found, indent = [], width_of("00. ", height)
    for number, paragraph in enumerate(paragraphs, start=1):
        lines = wrapped(paragraph, height, width - indent)
        found += [(0.0, f"{number}. {lines[0]}"), *((indent, line) for line in lines[1:])]
    return found


def paragraphs_in(box: Box, paragraphs: list[str], unit: float) -> list[Words]:
    """Numbered paragraphs from the top of ``box``; what is too long is left out, and the last line says so."""
    left, bottom, right, top = box
    height = LETTERS * unit
    lines, most = paragraph_lines(paragraphs, height, right - left), int((top - bottom) / (PITCH * height))
    if len(lines) > most:
        lines = [*lines[: most - 1], (0.0, "More notes: on the following pages.")]
    return [
        Words((left + indent, top - (k + 0.6) * PITCH * height), text, height) for k, (indent, text) in enumerate(lines)
    ]
