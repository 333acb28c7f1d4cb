"""The sheet as a figure of matplotlib, from which SVG and PDF are made, and as DXF, by ezdxf.

Both are vectors and true to scale. ezdxf's drawing add-on makes texts outlines, which nobody can search or copy.

The DXF has the part at its true size, its origin that of the part in the section, and dimensions that CAD programs
measure. A layout of the sheet's size shows all of it at the scale. Signs that their typefaces lack are written out.
"""

import io
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from lensforge.results.figure_style import INK, in_report_style, report_style
from lensforge.results.files import pdf_mark
from lensforge.shop.sheet import (
    MM_PER_POINT,
    PENS,
    TYPEFACE,
    LinearDimension,
    PenName,
    Place,
    Points,
    Sheet,
    SheetText,
    Stroke,
    points_of,
)
from lensforge.shop.sheet_marks import ARROW, BEYOND, dimension_text, strokes_of

if TYPE_CHECKING:
    from ezdxf.document import Drawing

_MM_PER_INCH = 25.4


def sheet_pdf(sheet: Sheet) -> bytes:
    """The bytes of a PDF of one page, the sheet in vectors; the same sheet gives the same bytes."""
    stream = io.BytesIO()
    with report_style():
        sheet_figure(sheet).savefig(stream, format="pdf", metadata={"CreationDate": None, "Title": sheet.title})
    return stream.getvalue() + pdf_mark()


@in_report_style
def sheet_figure(sheet: Sheet) -> Figure:
    """The sheet at its size; a millimetre on paper is one unit of its axes."""
    width, height = sheet.size_mm
    figure = Figure(figsize=(width / _MM_PER_INCH, height / _MM_PER_INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(0.0, height), aspect="equal")
    axes.set_axis_off()
    marks = sheet.marks
    strokes = [*marks.strokes, *(stroke for dimension in marks.dimensions for stroke in strokes_of(dimension))]
    _add_lines(axes, strokes, sheet.unit_mm)
    for word in (*marks.texts, *map(dimension_text, marks.dimensions)):
        _write_text(axes, word)
    return figure


def _add_lines(axes: Axes, strokes: list[Stroke], unit: float) -> None:
    lines: dict[PenName, list[Points]] = defaultdict(list)
    for stroke in strokes:
        if not stroke.filled:
            ends = stroke.points[:1] if stroke.closed else stroke.points[:0]
            lines[stroke.pen].append(np.vstack([stroke.points, ends]))
    for name, chains in lines.items():
        pen = PENS[name]
        width = pen.width_mm * unit / MM_PER_POINT
        dashes = (0.0, tuple(length / pen.width_mm for length in pen.dashes_mm)) if pen.dashes_mm else "solid"
        axes.add_collection(
            LineCollection(chains, colors=INK, linewidths=width, linestyles=[dashes], capstyle="round", clip_on=False)
        )
    filled = [stroke.points for stroke in strokes if stroke.filled]
    axes.add_collection(PolyCollection(filled, facecolors=INK, edgecolors="none", clip_on=False))


def _write_text(axes: Axes, label: SheetText) -> None:
    """The text; its baseline lies half the capitals' height below the middle."""
    x, y = label.at
    shift = 0.5 * label.height_mm
    place = (x, y - shift) if label.turned_deg == 0 else (x + shift, y)
    axes.text(
        *place,
        label.text,
        size=points_of(label.height_mm),
        family=TYPEFACE,
        ha=label.anchor,
        va="baseline",
        rotation=label.turned_deg,
        rotation_mode="anchor",
    )


_VERSION = "R2010"
_STYLE = "LENSFORGE"
_ALIGN = {"left": "MIDDLE_LEFT", "center": "MIDDLE_CENTER", "right": "MIDDLE_RIGHT"}
_TEXTS = "TEXTS"
_DIMENSIONS = "DIMENSIONS"
_SIGNS = {"⌀": "%%c", "±": "%%p", "°": "%%d", "□": "SQ ", "…": "...", "–": "-", "“": '"', "”": '"'}
_WIDTHS = (9, 13, 18, 25, 35, 50, 70)  # of lines, in hundredths of a millimetre; a DXF knows no others
_DIGITS = 3
_SAME_SCALE = 1e-6


def sheet_dxf(sheet: Sheet) -> bytes:
    """The bytes of the DXF file; the same sheet gives the same bytes."""
    with _without_clock():
        document = _document(sheet)
        stream = io.StringIO()
        document.write(stream)
    return stream.getvalue().encode(document.output_encoding, errors="dxfreplace")


def _document(sheet: Sheet) -> "Drawing":
    from ezdxf import units
    from ezdxf.filemanagement import new

    document = new(_VERSION)
    document.units = units.MM
    document.header["$MEASUREMENT"] = 1
    _add_styles(document, sheet)
    for stroke in sheet.marks.strokes:
        _add_stroke(document, sheet, stroke)
    for word in sheet.marks.texts:
        _add_text(document, sheet, word)
    for dimension in sheet.marks.dimensions:
        _add_dimension(document, sheet, dimension)
    _add_layout(document, sheet)
    for kind in sorted(document.entitydb.dxf_types_in_use()):  # ezdxf would name them in the order of a set
        document.classes.add_class(kind)
    return document


@contextmanager
def _without_clock() -> Iterator[None]:
    """Keep time and new identifiers out of a file: ezdxf takes both from the clock."""
    from ezdxf import options  # type: ignore[attr-defined]  # public, but not named in __all__

    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def _add_styles(document: "Drawing", sheet: Sheet) -> None:
    """Layers for the pens, texts and dimensions, with their line types, and the styles of text and dimensions."""
    for name, pen in PENS.items():
        line = "CONTINUOUS"
        if pen.dashes_mm:
            line = f"LENSFORGE_{name.upper()}"
            lengths = [_in_model(sheet, length * sheet.unit_mm) for length in pen.dashes_mm]
            signed = [length if k % 2 == 0 else -length for k, length in enumerate(lengths)]
            document.linetypes.add(line, [sum(lengths), *signed], description=line)
        width = min(_WIDTHS, key=lambda width: abs(width - 100.0 * pen.width_mm * sheet.unit_mm))
        document.layers.add(name.upper(), linetype=line, lineweight=width)
    document.layers.add(_TEXTS, lineweight=18)
    document.layers.add(_DIMENSIONS, lineweight=18)
    document.styles.add(_STYLE, font="arial.ttf")
    size = _in_model(sheet, 2.5 * sheet.unit_mm)
    style = document.dimstyles.add(_STYLE)
    style.dxf.dimtxsty = _STYLE
    style.dxf.dimtxt = size
    style.dxf.dimasz = ARROW * size
    style.dxf.dimexe = BEYOND * size
    style.dxf.dimexo = 0.0
    style.dxf.dimgap = 0.25 * size
    style.dxf.dimdec = _DIGITS
    style.dxf.dimzin = 0
    style.dxf.dimtad = 1
    style.dxf.dimdsep = ord(".")
    style.dxf.dimscale = 1.0
    style.dxf.dimlunit = 2
    style.dxf.dimtih = 0
    style.dxf.dimtoh = 0
    style.dxf.dimlfac = 1.0
    style.dxf.dimtofl = 1


def _in_model(sheet: Sheet, length_mm: float) -> float:
    return length_mm / sheet.scale


def _place(sheet: Sheet, at: Place) -> Place:
    return (at[0] - sheet.origin[0]) / sheet.scale, (at[1] - sheet.origin[1]) / sheet.scale


def _add_stroke(document: "Drawing", sheet: Sheet, stroke: Stroke) -> None:
    points = [_place(sheet, (x, y)) for x, y in stroke.points.tolist()]
    attributes = {"layer": stroke.pen.upper()}
    space = document.modelspace()
    if stroke.filled:
        space.add_solid(points, dxfattribs=attributes)
    elif len(points) == 2:
        space.add_line(points[0], points[1], dxfattribs=attributes)
    else:
        space.add_lwpolyline(points, close=stroke.closed, dxfattribs=attributes)


def _add_text(document: "Drawing", sheet: Sheet, label: SheetText) -> None:
    from ezdxf.enums import TextEntityAlignment

    text = document.modelspace().add_text(
        plain_text(label.text),
        height=_in_model(sheet, label.height_mm),
        rotation=label.turned_deg,
        dxfattribs={"layer": _TEXTS, "style": _STYLE},
    )
    text.set_placement(_place(sheet, label.at), align=TextEntityAlignment[_ALIGN[label.anchor]])


def plain_text(text: str) -> str:
    """``text`` with DXF codes for signs, and spelled out where typefaces lack them."""
    for sign, code in _SIGNS.items():
        text = text.replace(sign, code)
    return text


def _add_dimension(document: "Drawing", sheet: Sheet, dimension: LinearDimension) -> None:
    """A dimension that CAD programs measure themselves: ``<>`` in its text is the length between its ends.

    In a view at another scale than the sheet's a factor corrects that length.
    """
    low, high = dimension.ends_mm
    factor = dimension.length_mm / _in_model(sheet, high - low)
    override = {} if abs(factor - 1.0) < _SAME_SCALE else {"dimlfac": factor}
    made = document.modelspace().add_linear_dim(
        base=_place(sheet, dimension.at(dimension.text_mm, dimension.line_mm)),
        p1=_place(sheet, dimension.start),
        p2=_place(sheet, dimension.end),
        angle=dimension.turned_deg,
        text=plain_text(f"{dimension.before}<>{dimension.after}"),
        dimstyle=_STYLE,
        override=override,
        dxfattribs={"layer": _DIMENSIONS},
    )
    made.set_location(_place(sheet, dimension_text(dimension).at))
    made.render()


def _add_layout(document: "Drawing", sheet: Sheet) -> None:
    width, height = sheet.size_mm
    layout = document.paperspace("Layout1")
    document.layouts.rename("Layout1", sheet.name)
    layout.page_setup(size=(width, height), margins=(0, 0, 0, 0), units="mm")
    middle = width / 2.0, height / 2.0
    layout.add_viewport(
        center=middle,
        size=(width, height),
        view_center_point=_place(sheet, middle),
        view_height=_in_model(sheet, height),
        status=2,
    )
