"""The same content on paper: a PDF of a few A4 pages, drawn by matplotlib, so that no browser is needed."""

from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from lensforge.files import replacing

_A4 = (8.27, 11.69)
_LINES, _COLUMNS = 68, 100
_NO_DATE = {"CreationDate": None}  # the same results make the same bytes


def write_pdf(path: Path, title: str, text: list[str], figures: list[Figure]) -> None:
    """``text`` as lines, as many pages as they need, then each figure on its own page size."""
    with replacing(path) as temporary, PdfPages(temporary, metadata={**_NO_DATE, "Title": title}) as pages:
        folded = [piece for line in text for piece in _fold(line)]
        for first in range(0, len(folded), _LINES):
            page = Figure(figsize=_A4)
            page.text(0.07, 0.96, "\n".join(folded[first : first + _LINES]), family="monospace", size=7.5, va="top")
            pages.savefig(page)
        for figure in figures:
            pages.savefig(figure)


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
