"""The sheet as a figure of matplotlib, true to scale, from which SVG and PDF are made; both are vectors."""

from collections import defaultdict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from lensforge.drawings.dimension_lines import strokes_of, words_of_dimension
from lensforge.drawings.lettering import MM_PER_POINT, TYPEFACE, points_of
from lensforge.drawings.sheet import PENS, PenName, Points, Sheet, Stroke, Words
from lensforge.report.figure_style import INK, in_report_style

_MM_PER_INCH = 25.4


@in_report_style
def sheet_figure(sheet: Sheet) -> Figure:
    """The sheet at its size; a millimetre on paper is one unit of its axes."""
    width, height = sheet.size_mm
    figure = Figure(figsize=(width / _MM_PER_INCH, height / _MM_PER_INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(0.0, height), aspect="equal")
    axes.set_axis_off()
    strokes = [*sheet.strokes, *(stroke for each in sheet.dimensions for stroke in strokes_of(each))]
    _add_lines(axes, strokes, sheet.unit_mm)
    for words in (*sheet.words, *(words_of_dimension(each) for each in sheet.dimensions)):
        _add_words(axes, words)
    return figure


def _add_lines(axes: Axes, strokes: list[Stroke], unit: float) -> None:
    lines: dict[PenName, list[Points]] = defaultdict(list)
    for stroke in strokes:
        if not stroke.filled:
            lines[stroke.pen].append(_chain(stroke))
    for name, chains in lines.items():
        pen = PENS[name]
        width = pen.width_mm * unit / MM_PER_POINT
        dashes = (0.0, tuple(length / pen.width_mm for length in pen.dashes_mm)) if pen.dashes_mm else "solid"
        axes.add_collection(
            LineCollection(chains, colors=INK, linewidths=width, linestyles=[dashes], capstyle="round", clip_on=False)
        )
    filled = [stroke.points for stroke in strokes if stroke.filled]
    axes.add_collection(PolyCollection(filled, facecolors=INK, edgecolors="none", clip_on=False))


def _chain(stroke: Stroke) -> Points:
    return np.vstack([stroke.points, stroke.points[:1]]) if stroke.closed else stroke.points


def _add_words(axes: Axes, words: Words) -> None:
    """The text; its base line is half of the capitals' height below the middle."""
    x, y = words.at
    shift = 0.5 * words.height_mm
    place = (x, y - shift) if words.turned_deg == 0 else (x + shift, y)
    axes.text(
        *place,
        words.text,
        size=points_of(words.height_mm),
        family=TYPEFACE,
        ha=words.anchor,
        va="baseline",
        rotation=words.turned_deg,
        rotation_mode="anchor",
    )
