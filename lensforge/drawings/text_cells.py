"""Ruled cells with text, and paragraphs, in letters of one height."""

from collections.abc import Sequence

import numpy as np

from lensforge.drawings.lettering import shortened, width_of, wrapped
from lensforge.drawings.marks import Marks
from lensforge.drawings.sheet import LETTERS, Box, PenName, Stroke, Words

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
