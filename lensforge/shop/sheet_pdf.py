"""The sheet as a figure and as PDF: the drawing true to scale, in vectors, then tables and pictures on A4.

matplotlib draws both, so that no browser is needed.
"""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread

from lensforge.results.files import pdf_mark
from lensforge.shop.sheet import LETTERS, Marks, Sheet, Words, wrapped
from lensforge.shop.sheet_marks import PITCH, row, row_height
from lensforge.shop.sheet_writers import sheet_figure

_A4 = (8.27, 11.69)
_DPI = 300
_CAPTION_MM, _CAPTION_LETTERS_MM = 85.0, 2.0
_NO_DATE = {"CreationDate": None}  # the same results make the same bytes
_SIZE_MM, _LEFT, _TOP, _BOTTOM, _WIDTH = (210.0, 297.0), 20.0, 280.0, 20.0, 175.0
_UNIT = 0.8  # letters of 2 mm

Pictures = list[tuple[str, Figure]]


@dataclass(frozen=True)
class Table:
    """A table of the PDF: ``sentences`` above it, its ``head``, if any, and rows; ``shares`` of the width by column."""

    title: str
    rows: Sequence[Sequence[str]] = ()
    head: Sequence[str] = ()
    shares: Sequence[float] = (0.4, 0.6)
    sentences: Sequence[str] = ()

    @property
    def widths(self) -> list[float]:
        """Widths (mm) of the columns."""
        return [_WIDTH * share for share in self.shares]


@dataclass
class _Page:
    """A page while it is filled from the top."""

    marks: Marks = field(default_factory=Marks)
    top: float = _TOP

    def has_room(self, height: float) -> bool:
        return self.top - height >= _BOTTOM

    def add_line(self, text: str) -> None:
        height = PITCH * LETTERS * _UNIT
        self.marks.words.append(Words((_LEFT, self.top - 0.5 * height), text, LETTERS * _UNIT))
        self.top -= height

    def add_row(self, texts: Sequence[str], widths: Sequence[float]) -> None:
        self.marks.add(row(_LEFT, self.top, texts, widths, _UNIT))
        self.top -= row_height(texts, widths, _UNIT)


def pdf_of(title: str, drawing: Figure, tables: Sequence[Table], pictures: Pictures) -> bytes:
    """Make a PDF: the ``drawing``, the ``tables`` on as many pages as needed, ``pictures`` on one page."""
    buffer = io.BytesIO()
    with PdfPages(buffer, metadata={**_NO_DATE, "Title": title}) as pages:
        pages.savefig(drawing)
        for number, page in enumerate(_filled(tables), start=2):
            page.marks.words.append(Words((_LEFT, 0.5 * _BOTTOM), f"{title}, page {number}", LETTERS * _UNIT))
            pages.savefig(sheet_figure(Sheet("A4", _SIZE_MM, _UNIT, 1.0, title, (0.0, 0.0), page.marks)))
        if pictures:
            pages.savefig(_picture_page(pictures))
    return buffer.getvalue() + pdf_mark()


def _filled(tables: Sequence[Table]) -> Iterator[_Page]:
    """Pages with the tables one below the other; where one goes on, its title and its head stand above it again."""
    page, line = _Page(), PITCH * LETTERS * _UNIT
    for table in tables:
        lines = [each for text in table.sentences for each in wrapped(text, LETTERS * _UNIT, _WIDTH)]
        if not page.has_room((len(lines) + 5.0) * line):
            yield page
            page = _Page()
        if page.top < _TOP:
            page.top -= line
        for each in (table.title, *lines):
            if not page.has_room(line):
                yield page
                page = _Page()
            page.add_line(each)
        heads = [table.head] if table.head else []
        for texts in (*heads, *table.rows):
            if not page.has_room(row_height(texts, table.widths, _UNIT)):
                yield page
                page = _Page()
                page.add_line(f"{table.title}, continued")
                for head in heads:
                    page.add_row(head, table.widths)
            page.add_row(texts, table.widths)
    yield page


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
