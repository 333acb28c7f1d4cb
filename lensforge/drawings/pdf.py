"""The same content on paper: a PDF of a few A4 pages, drawn by matplotlib, so that no browser is needed."""

import io
from textwrap import fill

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread

_A4 = (8.27, 11.69)
_LINES, _COLUMNS = 68, 100
_DPI, _CAPTION = 300, 56
_NO_DATE = {"CreationDate": None}  # the same results make the same bytes


def pdf_of(title: str, text: list[str], pictures: list[tuple[str, Figure]]) -> bytes:
    """``text`` as lines, as many pages as they need, then ``pictures`` under their captions: one across, then pairs."""
    buffer = io.BytesIO()
    with PdfPages(buffer, metadata={**_NO_DATE, "Title": title}) as pages:
        folded = [piece for line in text for piece in _fold(line)]
        for first in range(0, len(folded), _LINES):
            page = Figure(figsize=_A4)
            page.text(0.07, 0.96, "\n".join(folded[first : first + _LINES]), family="monospace", size=7.5, va="top")
            pages.savefig(page)
        pages.savefig(_picture_page(pictures))
    return buffer.getvalue()


def _picture_page(pictures: list[tuple[str, Figure]]) -> Figure:
    """The first picture across the page, the others below it two by two, each as an image of 300 dpi."""
    page = Figure(figsize=_A4)
    halves = page.add_gridspec(2, 1, height_ratios=(0.75, 1.0), left=0.07, right=0.95, top=0.95, bottom=0.04)
    rows = len(pictures) // 2
    pairs = halves[1].subgridspec(rows, 2, hspace=0.2)
    places = [halves[0], *(pairs[row, column] for row in range(rows) for column in range(2))]
    for place, (caption, figure) in zip(places, pictures, strict=False):
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=_DPI, facecolor="white")
        buffer.seek(0)
        axes = page.add_subplot(place)
        axes.imshow(imread(buffer), interpolation="none")
        axes.set_title(fill(caption, _CAPTION), size=8.0, loc="left")
        axes.set_axis_off()
    return page


def _fold(line: str) -> list[str]:
    """Lines that fit the page, later ones indented; words stay whole."""
    pieces = [""]
    for word in line.split(" "):
        longer = f"{pieces[-1]} {word}" if pieces[-1] else word
        if len(longer) > _COLUMNS and pieces[-1].strip():
            pieces.append("    " + word)
        else:
            pieces[-1] = longer
    return pieces
