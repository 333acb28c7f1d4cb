"""The handover to the shop, from the results of a lens: the same content as HTML page and as PDF, and the tables.

The PDF has A4 pages drawn by matplotlib, so that no browser is needed.
"""

import io
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from textwrap import fill

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.image import imread

from lensforge.criteria import Criterion
from lensforge.drawings.dimensions import Dimension, dimensions, points_table, ring_angles, sag_table
from lensforge.drawings.facts import Facts, datum_text, face_facts, grid_facts, part_facts
from lensforge.drawings.grid_text import file_name, grid_text, origin_lines
from lensforge.drawings.grids import GridRequest, MeasuredGrid, make_grids
from lensforge.drawings.handover import POINTS_FILE, SAG_FILE, Handover, PointGrid
from lensforge.drawings.offset_face import offset_faces
from lensforge.drawings.raster import Raster
from lensforge.drawings.section import dimensioned_section
from lensforge.drawings.tolerance_table import ToleranceTable, tolerance_table
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check, Finding
from lensforge.report.figure_style import to_svg
from lensforge.report.ownership import pdf_mark
from lensforge.report.surface_figures import curvature_map, sag_map
from lensforge.results import Results
from lensforge.tolerancing.yield_result import Yield

_TEMPLATES = Path(__file__).with_name("templates")
_A4 = (8.27, 11.69)
_LINES, _COLUMNS = 68, 100
_DPI, _CAPTION = 300, 56
_NO_DATE = {"CreationDate": None}  # the same results make the same bytes

Pictures = list[tuple[str, Figure]]


@dataclass(frozen=True)
class _Content:
    """Text and numbers of page and PDF."""

    name: str
    facts: Facts
    datum: str
    dimensions: list[Dimension]
    tolerances: ToleranceTable
    faces: dict[str, Facts]
    grids: Facts
    verdicts: tuple[Finding, ...]
    criteria: tuple[Criterion, ...]
    hashes: Mapping[str, str]


def make_handover(results: Results, request: GridRequest | None = None) -> Handover:
    """Make the files that go to the shop with the STEP. Raises :class:`MissingResult` without part or check.

    ``request``: of the dense tables. Raises :class:`InputError` where they cannot be made so.
    """
    lens, part, check, request = results.lens, results.part, results.check, request or GridRequest()
    faces, head = offset_faces(lens, check, {"inner": 0.0, "outer": 0.0}), origin_lines(lens, part)
    grids = tuple(_point_grid(measured, lens, part, request) for measured in make_grids(lens, check, request))
    tables = {
        POINTS_FILE: points_table(faces, head).encode(),
        SAG_FILE: sag_table(faces, check, head).encode(),
        **{grid.file: grid.content for grid in grids},
    }
    hashes = {name: stamp.sha256 for name, stamp in part.files.items()}
    hashes |= {name: sha256(content).hexdigest() for name, content in tables.items()}
    content, figures = _content(results, grids, hashes), _pictures(lens, check)
    title = f"{content.name}: for manufacture"
    return Handover(
        name=title,
        html=_page(content, figures).encode(),
        pdf=pdf_of(title, _as_text(title, content), figures),
        points_csv=tables[POINTS_FILE],
        sag_csv=tables[SAG_FILE],
        points=len(faces) * len(ring_angles()),
        grids=grids,
        sha256=hashes,
        refused=tuple(verdict for verdict in check.verdicts if not verdict.holds),
    )


def _point_grid(measured: MeasuredGrid, lens: Lens, part: Part, request: GridRequest) -> PointGrid:
    grid = measured.grid
    return PointGrid(
        file=file_name(grid),
        face=grid.face.name,
        kind="raster" if isinstance(grid, Raster) else "polar",
        spacing_mm=grid.spacing_mm,
        interpolation=request.interpolation,
        error_nm=measured.error_nm,
        offset_mm=grid.face.offset_mm,
        covered=grid.covered_share(request.interpolation) if isinstance(grid, Raster) else 1.0,
        points=len(grid.rows),
        content=grid_text(measured, lens, part, request).encode(),
    )


def _content(results: Results, grids: tuple[PointGrid, ...], hashes: Mapping[str, str]) -> _Content:
    lens, part, check = results.lens, results.part, results.check
    return _Content(
        name=lens.spec.name,
        facts=part_facts(lens, part, check),
        datum=datum_text(lens),
        dimensions=dimensions(lens),
        tolerances=tolerance_table(lens, results.find(Yield)),
        faces={"outer": face_facts(check.outer), "inner": face_facts(check.inner)},
        grids={grid.file: grid_facts(grid) for grid in grids},
        verdicts=check.verdicts,
        criteria=(*part.criteria, *check.criteria),
        hashes=hashes,
    )


def _pictures(lens: Lens, check: Check) -> Pictures:
    figures: Pictures = [("Section at y = 0, to scale", dimensioned_section(lens))]
    for name, face, sag, kappa in (
        ("outer", check.outer, check.outer_sag_mm, check.outer_kappa_min),
        ("inner", check.inner, check.inner_sag_mm, check.inner_kappa_min),
    ):
        radius = face.cutter.radius_mm
        figures.append((f"{name}: departure from the best-fit sphere", sag_map(sag)))
        caption = f"{name}: smaller principal curvature; line: where a ball of {radius:g} mm just fits"
        figures.append((caption, curvature_map(kappa, radius)))
    return figures


def _page(content: _Content, figures: Pictures) -> str:
    environment = Environment(loader=FileSystemLoader(_TEMPLATES), autoescape=True)
    drawn = [(caption, Markup(to_svg(f, f"handover{k}", caption))) for k, (caption, f) in enumerate(figures)]
    return environment.get_template("manufacturing.html").render(**vars(content), pictures=drawn)


def _as_text(title: str, content: _Content) -> list[str]:
    lines = [title, "", *(f"{key}: {value}" for key, value in content.facts.items()), "", "Datum", content.datum]
    lines += ["", "Dimensions (mm)", *(f"{d.value_mm:10.4f}  {d.name}" for d in content.dimensions)]
    lines += ["", "Tolerances", *content.tolerances.lines]
    for name, facts in content.faces.items():
        lines += ["", f"Face {name}", *(f"{key}: {value}" for key, value in facts.items())]
    lines += ["", "Verdicts", *(f"[{_yes(v.holds)}] {v.name}, {v.surface}: {v.reason}" for v in content.verdicts)]
    lines += ["", "Criteria", *(f"[{_yes(c.passed)}] {c.name} {_value(c)}" for c in content.criteria)]
    lines += ["", "Dense tables of points", *(f"{key}: {value}" for key, value in content.grids.items())]
    return [*lines, "", "SHA-256", *(f"{digest}  {name}" for name, digest in content.hashes.items())]


def _yes(holds: bool) -> str:
    return "yes" if holds else "NO "


def _value(criterion: Criterion) -> str:
    return "could not be measured" if criterion.value is None else f"= {criterion.value:.6g} {criterion.unit}"


def pdf_of(title: str, text: list[str], pictures: list[tuple[str, Figure]]) -> bytes:
    """Make a PDF: the lines of ``text`` on as many pages as needed, then ``pictures`` with captions on one page."""
    buffer = io.BytesIO()
    with PdfPages(buffer, metadata={**_NO_DATE, "Title": title}) as pages:
        folded = [piece for line in text for piece in _fold(line)]
        for first in range(0, len(folded), _LINES):
            page = Figure(figsize=_A4)
            page.text(0.07, 0.96, "\n".join(folded[first : first + _LINES]), family="monospace", size=7.5, va="top")
            pages.savefig(page)
        pages.savefig(_picture_page(pictures))
    return buffer.getvalue() + pdf_mark()


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
    """Lines that fit the page, continuations indented; words are not broken."""
    pieces = [""]
    for word in line.split(" "):
        longer = f"{pieces[-1]} {word}" if pieces[-1] else word
        if len(longer) > _COLUMNS and pieces[-1].strip():
            pieces.append("    " + word)
        else:
            pieces[-1] = longer
    return pieces
