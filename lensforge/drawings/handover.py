"""The files that go to the shop with the STEP, as a record."""

from base64 import b64encode
from html import escape
from pathlib import Path

from pydantic import field_serializer

from lensforge.files import replacing
from lensforge.manufacturing.result import Finding
from lensforge.records import Count, Record, Sha256, Text
from lensforge.report.ownership import require_own

HTML_FILE, PDF_FILE, POINTS_FILE, SAG_FILE = "manufacturing.html", "manufacturing.pdf", "points.csv", "sag.csv"


class Handover(Record):
    """Drawing and verdicts as page and PDF, tables of points and of sag, each as the bytes of its file.

    ``points``: number of points in the table. ``sha256``: of the files that go to the shop, by name, except page and
    PDF, which list them. ``refused``: verdicts of the check that do not hold.
    """

    name: Text
    html: bytes
    pdf: bytes
    points_csv: bytes
    sag_csv: bytes
    points: Count
    sha256: dict[Text, Sha256]
    refused: tuple[Finding, ...]

    @field_serializer("html", "pdf", "points_csv", "sag_csv", when_used="json")
    def _as_text(self, content: bytes) -> str:
        return b64encode(content).decode("ascii")

    @property
    def files(self) -> dict[str, bytes]:
        """The four files by name."""
        return {HTML_FILE: self.html, PDF_FILE: self.pdf, POINTS_FILE: self.points_csv, SAG_FILE: self.sag_csv}

    def save(self, folder: Path | str) -> None:
        """Write the four files into ``folder``.

        Raises :class:`InputError` where they cannot be written, and for a page or a PDF of another program.
        """
        for name in (HTML_FILE, PDF_FILE):
            require_own(Path(folder) / name)
        for name, content in self.files.items():
            with replacing(Path(folder) / name) as temporary:
                temporary.write_bytes(content)

    def _repr_html_(self) -> str:
        """HTML for a notebook: the page in a frame."""
        page = escape(self.html.decode("utf-8"))
        return f'<iframe title="{escape(self.name)}" style="width:100%;height:40em" srcdoc="{page}"></iframe>'
