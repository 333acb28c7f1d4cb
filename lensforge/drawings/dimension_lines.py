"""Dimensions as strokes and words, for pictures: extension lines, dimension line with arrows, text.

A DXF has them as dimensions of its own, with the text at the same place.
"""

import numpy as np

from lensforge.drawings.lettering import width_of
from lensforge.drawings.sheet import LinearDimension, Place, Points, Stroke, Words

ARROW, BEYOND, ABOVE, TAIL = 1.0, 0.6, 0.85, 2.0  # in heights of the text: head, extension beyond, text above, tail


def text_span(dimension: LinearDimension) -> tuple[float, float]:
    """Ends (mm) of the text along the dimension line."""
    half = 0.5 * width_of(dimension.text, dimension.height_mm)
    return dimension.text_mm - half, dimension.text_mm + half


def occupied(dimension: LinearDimension) -> tuple[float, float]:
    """Ends (mm) of all that is drawn along the dimension line."""
    low, high = dimension.ends_mm
    tail = 0.0 if is_wide(high - low, dimension.height_mm) else (ARROW + TAIL) * dimension.height_mm
    first, last = text_span(dimension)
    return min(low - tail, first), max(high + tail, last)


def is_wide(length_mm: float, height_mm: float) -> bool:
    """True where both arrows fit between the ends."""
    return length_mm > 2.6 * ARROW * height_mm


def words_of_dimension(dimension: LinearDimension) -> Words:
    """The text, above its line, or left of it where it is read from the right."""
    away = ABOVE * dimension.height_mm
    if dimension.turned_deg == 0:
        return Words(
            (dimension.text_mm, dimension.line_mm + away), dimension.text, dimension.height_mm, "center", turned_deg=0
        )
    return Words(
        (dimension.line_mm - away, dimension.text_mm), dimension.text, dimension.height_mm, "center", turned_deg=90
    )


def strokes_of(dimension: LinearDimension) -> list[Stroke]:
    """Extension lines, dimension line and arrows."""
    size, line = dimension.height_mm, dimension.line_mm
    low, high = dimension.ends_mm
    wide = is_wide(high - low, size)
    first, last = (low, high) if wide else occupied(dimension)
    text_low, text_high = text_span(dimension)
    first, last = min(first, text_low), max(last, text_high)  # the line goes on below a text outside
    found = [_stroke(dimension, (first, line), (last, line))]
    for along, across in (_places(dimension, dimension.start), _places(dimension, dimension.end)):
        past = line + np.sign(line - across) * BEYOND * size
        found.append(_stroke(dimension, (along, across), (along, past)))
    inward = 1.0 if wide else -1.0
    found.append(_arrow(dimension, low, inward))
    found.append(_arrow(dimension, high, -inward))
    return found


def _places(dimension: LinearDimension, place: Place) -> Place:
    """Along and across the dimension line."""
    return place if dimension.turned_deg == 0 else (place[1], place[0])


def _stroke(dimension: LinearDimension, first: Place, last: Place) -> Stroke:
    return Stroke(_on_paper(dimension, np.array([first, last])))


def _arrow(dimension: LinearDimension, tip: float, direction: float) -> Stroke:
    size, line = ARROW * dimension.height_mm, dimension.line_mm
    base, half = tip + direction * size, size / 6.0
    points = np.array([(tip, line), (base, line - half), (base, line + half)])
    return Stroke(_on_paper(dimension, points), closed=True, filled=True)


def _on_paper(dimension: LinearDimension, points: Points) -> Points:
    turned: Points = points if dimension.turned_deg == 0 else points[:, ::-1]
    return turned
