"""Places of dimension lines beside a view, smallest nearest to the part, so that no text meets another or a line."""

from collections.abc import Iterator
from dataclasses import dataclass

from lensforge.drawings.dimension_lines import ARROW, TAIL, occupied, text_span
from lensforge.drawings.lettering import width_of
from lensforge.drawings.sheet import LinearDimension

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
