"""Ruled cells with text on the drawing, and paragraphs, in letters that fit."""

import numpy as np

from lensforge.drawings.lettering import shortened, width_of, wrapped
from lensforge.drawings.marks import Marks
from lensforge.drawings.sheet import Box, Stroke, Words

LETTERS, SMALLEST, PITCH = 2.5, 1.8, 1.7  # mm on A3; lines of a paragraph, in heights of its letters
_MARGIN = 1.5


def frame_of(box: Box, pen: str = "thin") -> Stroke:
    """The rectangle ``box``."""
    left, bottom, right, top = box
    corners = np.array([(left, bottom), (right, bottom), (right, top), (left, top)])
    return Stroke(corners, "outline" if pen == "outline" else "thin", closed=True)


def cell(box: Box, text: str, unit: float, letters: float = LETTERS) -> Marks:
    """A ruled cell; its text is made smaller where it does not fit, and then ends in an ellipsis."""
    left, bottom, right, top = box
    room = right - left - 2.0 * _MARGIN * unit
    height = letters * unit
    while height > SMALLEST * unit and width_of(text, height) > room:
        height -= 0.1 * unit
    words = Words((left + _MARGIN * unit, 0.5 * (bottom + top)), shortened(text, height, room), height)
    return [frame_of(box)], [words]


def row(left: float, top: float, height: float, texts: list[str], widths: list[float], unit: float) -> Marks:
    """A row of cells from left to right."""
    strokes: list[Stroke] = []
    words: list[Words] = []
    x = left
    for text, width in zip(texts, widths, strict=True):
        more = cell((x, top - height, x + width, top), text, unit)
        strokes, words, x = [*strokes, *more[0]], [*words, *more[1]], x + width
    return strokes, words


def paragraph_lines(paragraphs: list[str], height: float, width: float) -> list[tuple[float, str]]:
    """Indent (mm) and text of each line of numbered paragraphs."""
    found, indent = [], width_of("00. ", height)
    for number, paragraph in enumerate(paragraphs, start=1):
        lines = wrapped(paragraph, height, width - indent)
        found += [(0.0, f"{number}. {lines[0]}"), *((indent, line) for line in lines[1:])]
    return found


def paragraphs_in(box: Box, paragraphs: list[str], unit: float) -> tuple[list[Words], bool]:
    """Numbered paragraphs from the top of ``box``, and True where they fit in letters of the usual height.

    Where they do not fit, letters are smaller, down to the smallest; what is too long even so is left out, and the last
    line says so.
    """
    left, bottom, right, top = box
    for letters in np.arange(LETTERS, SMALLEST - 0.05, -0.1).tolist():
        height = letters * unit
        lines, most = paragraph_lines(paragraphs, height, right - left), int((top - bottom) / (PITCH * height))
        if len(lines) <= most:
            break
    else:
        lines = [*lines[: most - 1], (0.0, "More notes: on the following pages.")]
    words = [
        Words((left + indent, top - (k + 0.6) * PITCH * height), text, height) for k, (indent, text) in enumerate(lines)
    ]
    return words, letters == LETTERS
