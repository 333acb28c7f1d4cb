"""The PDF for the shop: the drawing as its first page, in vectors and true to scale, then text and pictures on A4.

It is drawn by matplotlib, so that no browser is needed.
"""

import io

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread

from lensforge.drawings.lettering import wrapped
from lensforge.report.ownership import pdf_mark

_A4 = (8.27, 11.69)
_LINES, _COLUMNS = 68, 100
_DPI = 300
_CAPTION_MM, _CAPTION_LETTERS_MM = 85.0, 2.0
_NO_DATE = {"CreationDate": None}  # the same results make the same bytes

Pictures = list[tuple[str, Figure]]


def pdf_of(title: str, drawing: Figure, text: list[str], pictures: Pictures) -> bytes:
    """Make a PDF: the ``drawing``, the lines of ``text`` on as many pages as needed, ``pictures`` on one page."""
    buffer = io.BytesIO()
    with PdfPages(buffer, metadata={**_NO_DATE, "Title": title}) as pages:
        pages.savefig(drawing)
        folded = [piece for line in text for piece in _fold(line)]
        for first in range(0, len(folded), _LINES):
            page = Figure(figsize=_A4)
            page.text(0.07, 0.96, "\n".join(folded[first : first + _LINES]), family="monospace", size=7.5, va="top")
            pages.savefig(page)
        if pictures:
            pages.savefig(_picture_page(pictures))
    return buffer.getvalue() + pdf_mark()


def _picture_page(pictures: Pictures) -> Figure:
    """The pictures two by two, each as an image of 300 dpi."""
    page = Figure(figsize=_A4)
    rows = (len(pictures) + 1) // 2
    grid = page.add_gridspec(rows, 2, hspace=0.15, left=0.07, right=0.95, top=0.93, bottom=0.93 - 0.3 * rows)
    for number, (caption, figure) in enumerate(pictures):
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=_DPI, facecolor="white")
        buffer.seek(0)
        axes = page.add_subplot(grid[divmod(number, 2)])
        axes.imshow(imread(buffer), interpolation="none")
        axes.set_title("\n".join(wrapped(caption, _CAPTION_LETTERS_MM, _CAPTION_MM)), size=8.0, loc="left")
        axes.set_axis_off()
    return page


def _fold(line: str) -> list[str]:
    """Lines that fit the page, continuations indented; words are not broken."""
    pieces = [""]
    for word in line.split(" "):
        longer = f"{pieces[-1]} {word}" if pieces[-1] else word
        if len(longer) > _COLUMNS and pieces[-1].strip():
            pieces.append("    " + word)
        else:
            pieces[-1] = longer
    return pieces
