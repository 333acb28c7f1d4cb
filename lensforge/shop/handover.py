"""The files that go to the shop with the STEP, as a record."""

from base64 import b64encode
from html import escape
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PlainSerializer

from lensforge.public import public
from lensforge.results import Count, Fact, Group, NotNegative, Positive, Record, Sha256, Text
from lensforge.results.files import require_own, write_file
from lensforge.results.numerals import quantity
from lensforge.shop.findings import Findings

HTML_FILE = "manufacturing.html"
PDF_FILE = "manufacturing.pdf"
DXF_FILE = "drawing.dxf"
POINTS_FILE = "points.csv"
PLATE_PDF_FILE = "plate.pdf"
PLATE_DXF_FILE = "plate.dxf"
NO_SHRINKAGE = (
    "manufacture.shrinkage: not given, so the tables are of inserts as large as the lens; ask the moulder, and give "
    "it, such as shrinkage = 0.005"
)
Interpolation = Literal["bicubic", "linear"]  # between the nodes of a dense table


_Text = PlainSerializer(
    lambda content: None if content is None else b64encode(content).decode("ascii"),
    return_type=str | None,
    when_used="json",
)
FileBytes = Annotated[bytes, Field(repr=False), _Text]
FileBytesOrNone = Annotated[bytes | None, Field(repr=False), _Text]


class PointGrid(Record):
    """A dense table of ``points`` of one face, the bytes of ``file``.

    ``spacing_mm``: the widest between nodes. ``error_nm``: largest error of the ``interpolation`` between nodes, along
    the normal.
    """

    file: Text
    face: Text
    spacing_mm: Positive
    interpolation: Interpolation
    error_nm: NotNegative
    points: Count
    content: FileBytes


@public
class Handover(Record):
    """Page with drawings and verdicts, drawings as PDF and DXF, tables of points, models, as the bytes of files.

    ``name``: of the design. ``html``: the page. ``pdf``, ``dxf``: the drawing. ``points_csv``: table for a measuring
    machine. ``plate_pdf``, ``plate_dxf``: the drawing of the plate; None without one. ``models``: glTF files by name,
    of the lens, and with rays on request, and of all lamps or the plate where there are. ``points``: number of
    points in the table. ``scale``: of the mould's faces relative to the lens's, if the points are of the mould; None:
    of the lens. ``grids``: dense tables for milling and turning. ``sha256``: of the files that go to the shop, by name,
    except page and PDF; the page lists them. ``refused``: verdicts of the check that do not hold.
    """

    name: Text
    html: FileBytes
    pdf: FileBytes
    dxf: FileBytes
    points_csv: FileBytes
    plate_pdf: FileBytesOrNone = None
    plate_dxf: FileBytesOrNone = None
    models: Annotated[dict[Text, Annotated[bytes, _Text]], Field(repr=False)] = Field(default_factory=dict)
    points: Count
    scale: Positive | None = None
    grids: tuple[PointGrid, ...]
    sha256: dict[Text, Sha256]
    refused: Findings

    @property
    def files(self) -> dict[str, bytes]:
        """Files by name."""
        fixed = {HTML_FILE: self.html, PDF_FILE: self.pdf, DXF_FILE: self.dxf, POINTS_FILE: self.points_csv}
        plate = {PLATE_PDF_FILE: self.plate_pdf, PLATE_DXF_FILE: self.plate_dxf}
        fixed |= {name: content for name, content in plate.items() if content is not None}
        return fixed | self.models | {grid.file: grid.content for grid in self.grids}

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for what a shop will ask and no file states."""
        return (NO_SHRINKAGE,) if self.scale == 1.0 else ()

    @property
    def facts(self) -> Group:
        """Files, the points for a measuring machine, the error of each dense table, and failed findings."""
        grids = (
            Fact("grid", grid.file, grid.error_nm, "nm", note="max. interpolation error", digits=2)
            for grid in self.grids
        )
        refused = (Fact("refused", "Not met", finding.note) for finding in self.refused)
        points = Fact("points", "Points", self.points, note=f"for a measuring machine{self._of_inserts}")
        return Group("handover", self.name, (Fact("files", "Files", ", ".join(self.files)), points, *grids, *refused))

    @property
    def _of_inserts(self) -> str:
        """Phrase for the size of a mould's inserts; empty for a part that is cut directly."""
        if self.scale is None:
            return ""
        times = "no shrinkage stated" if self.scale == 1.0 else f"the lens times {quantity(self.scale, digits=12)}"
        return f": points of the mould inserts ({times})"

    def save(self, folder: Path | str) -> None:
        """Write the files into ``folder``.

        Raises :class:`InputError` if they cannot be written, and for a page or a PDF of another program.
        """
        for name in (HTML_FILE, *(name for name in self.files if name.endswith(".pdf"))):
            require_own(Path(folder) / name)
        for name, content in self.files.items():
            write_file(Path(folder) / name, content)

    def _repr_html_(self) -> str:
        page = escape(self.html.decode("utf-8"))
        return f'<iframe title="{escape(self.name)}" style="width:100%;height:40em" srcdoc="{page}"></iframe>'
