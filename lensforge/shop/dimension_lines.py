"""Dimensions as strokes and words, and their places beside a view, so that no text meets another or a line.

A dimension has extension lines, a dimension line with arrows, and its text. The smallest stands nearest to the part. A
DXF has them as dimensions of its own, with the text at the same place.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lensforge.shop.sheet import LinearDimension, Place, Points, Stroke, Words
from lensforge.shop.sheet_text import width_of

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


Row = list[LinearDimension]


@dataclass(frozen=True)
class Side:
    """A side of a view: the first dimension line there, and from each to the next (mm, negative to left and down).

    ``through_mm``: places along the dimension lines at which other lines cross all of them.
    """

    first_mm: float
    step_mm: float
    through_mm: tuple[float, ...] = ()


def placed(dimensions: list[LinearDimension], side: Side) -> list[LinearDimension]:
    """``dimensions`` at a ``side``, each with its line and the place of its text."""
    rows: list[Row] = []
    waiting = sorted(dimensions, key=lambda each: each.length_mm)
    while waiting:
        dimension = waiting.pop(0)
        ends = [*side.through_mm, *(end for other in waiting for end in other.ends_mm)]  # they will come past it
        number, found = _best(dimension, rows, side, ends)
        if number == len(rows):
            rows.append([])
        rows[number].append(found)
    return [dimension for row in rows for dimension in row]


def _best(dimension: LinearDimension, rows: list[Row], side: Side, ends: list[float]) -> tuple[int, LinearDimension]:
    """Row and place: the nearest row in which the text is clear of all lines, also of those to come if possible."""
    for coming in (ends, []):
        for number in range(len(rows) + 1):
            for candidate in _candidates(dimension, side.first_mm + number * side.step_mm, coming):
                if _is_free(candidate, number, rows, coming):
                    return number, candidate
    last = len(rows)
    return last, next(_candidates(dimension, side.first_mm + last * side.step_mm, []))


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
        yield _at(dimension, line_mm, place)


def _at(dimension: LinearDimension, line_mm: float, text_mm: float) -> LinearDimension:
    return LinearDimension(**{**vars(dimension), "line_mm": line_mm, "text_mm": text_mm})


def _is_free(candidate: LinearDimension, number: int, rows: list[Row], coming: list[float]) -> bool:
    gap = 0.6 * candidate.height_mm
    own = candidate.ends_mm
    if any(_within(end, text_span(candidate), gap) for end in coming if end not in own):
        return False
    if number < len(rows) and any(_meet(occupied(candidate), occupied(other), gap) for other in rows[number]):
        return False
    for k, row in enumerate(rows):
        for other in row:
            if k < number and any(_within(end, text_span(other), gap) for end in candidate.ends_mm):
                return False
            if k > number and any(_within(end, text_span(candidate), gap) for end in other.ends_mm):
                return False
    return True


def _meet(one: tuple[float, float], other: tuple[float, float], gap: float) -> bool:
    return one[0] < other[1] + gap and other[0] < one[1] + gap


def _within(place: float, span: tuple[float, float], gap: float) -> bool:
    return span[0] - gap < place < span[1] + gap
