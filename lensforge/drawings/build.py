"""The handover to the shop, from the results of a lens: drawing, page, PDF and DXF of the same content, and tables."""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure

from lensforge.criteria import Criterion
from lensforge.drawings.cloud import cloud_facts, cloud_name, cloud_text
from lensforge.drawings.dimensions import Dimension, dimensions
from lensforge.drawings.drawing import DrawingContent, drawing_content, make_sheet
from lensforge.drawings.drawing_notes import tool_advice
from lensforge.drawings.facts import DEFINITION, Facts, face_facts, grid_facts, part_facts
from lensforge.drawings.grid_text import file_name, grid_text, origin_lines
from lensforge.drawings.grids import GridRequest, MeasuredGrid, make_grids
from lensforge.drawings.handover import DXF_FILE, PDF_FILE, POINTS_FILE, SAG_FILE, Handover, PointGrid
from lensforge.drawings.offset_face import offset_faces
from lensforge.drawings.pdf import Pictures, Table, pdf_of
from lensforge.drawings.point_tables import points_table, ring_angles, sag_table
from lensforge.drawings.polar import Polar
from lensforge.drawings.raster import Raster
from lensforge.drawings.sheet import Sheet, shown
from lensforge.drawings.sheet_dxf import sheet_dxf
from lensforge.drawings.sheet_figure import sheet_figure
from lensforge.drawings.title_block import scale_words
from lensforge.drawings.tolerance_table import ToleranceTable, tolerance_table
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check, Finding
from lensforge.report.criterion_words import criterion_words
from lensforge.report.figure_style import to_svg
from lensforge.report.numerals import number
from lensforge.report.surface_figures import curvature_map, sag_map
from lensforge.results import Results
from lensforge.spec import DrawingSection
from lensforge.tolerancing.yield_result import Yield

_TEMPLATES = Path(__file__).with_name("templates")
_CRITERIA_HEAD = ("Criterion", "Value", "Limit", "Met")


@dataclass(frozen=True)
class _Content:
    """Text and numbers of page and PDF."""

    name: str
    facts: Facts
    datums: tuple[str, ...]
    definition: str
    dimensions: list[Dimension]
    notes: list[str]
    tolerances: ToleranceTable
    faces: dict[str, Facts]
    grids: Facts
    verdicts: tuple[Finding, ...]
    changes: list[str]
    criteria: list[tuple[str, str, str, str]]
    hashes: Mapping[str, str]


def make_handover(
    results: Results, request: GridRequest | None = None, words: DrawingSection | None = None
) -> Handover:
    """Make the files that go to the shop with the STEP. Raises :class:`MissingResult` without part or check.

    ``request``: of the dense tables. Raises :class:`InputError` where they cannot be made so. ``words``: of title block
    and notes; None: those of the spec.
    """
    lens, part, check, request = results.lens, results.part, results.check, request or GridRequest()
    faces, head = offset_faces(lens, check, {"inner": 0.0, "outer": 0.0}), origin_lines(lens, part)
    made = make_grids(lens, check, request)
    grids = tuple(_point_grid(measured, lens, part, request) for measured in made)
    rings = [measured.grid for measured in made if isinstance(measured.grid, Polar)]
    clouds = {cloud_name(polar): cloud_text(polar).encode() for polar in rings}
    tables = {
        POINTS_FILE: points_table(faces, head).encode(),
        SAG_FILE: sag_table(faces, check, head).encode(),
        **{grid.file: grid.content for grid in grids},
        **clouds,
    }
    sizes, tolerances = dimensions(lens), tolerance_table(lens, results.find(Yield))
    words = words or lens.spec.drawing
    drawn = drawing_content(lens, part, check, sizes, tolerances, words)
    sheet = make_sheet(drawn, words.sheet or "A3")
    dxf, drawing, figures = sheet_dxf(sheet), sheet_figure(sheet), _pictures(check)
    hashes = {name: stamp.sha256 for name, stamp in part.files.items()}
    hashes |= {name: sha256(content).hexdigest() for name, content in {**tables, DXF_FILE: dxf}.items()}
    dense = {grid.file: grid_facts(grid) for grid in grids} | {cloud_name(polar): cloud_facts(polar) for polar in rings}
    content = _content(results, drawn, words, tolerances, dense, hashes)
    title = f"{content.name}: for manufacture"
    return Handover(
        name=title,
        html=_page(content, sheet, drawing, figures).encode(),
        pdf=pdf_of(title, drawing, _tables(content), figures),
        dxf=dxf,
        points_csv=tables[POINTS_FILE],
        sag_csv=tables[SAG_FILE],
        points=len(faces) * len(ring_angles()),
        grids=grids,
        clouds=clouds,
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


def _content(
    results: Results,
    drawn: DrawingContent,
    words: DrawingSection,
    tolerances: ToleranceTable,
    grids: Facts,
    hashes: Mapping[str, str],
) -> _Content:
    lens, part, check = results.lens, results.part, results.check
    return _Content(
        name=drawn.title.title,
        facts=part_facts(lens, part, check, words),
        datums=drawn.views.datums.lines,
        definition=DEFINITION,
        dimensions=drawn.views.dimensions,
        notes=drawn.notes,
        tolerances=tolerances,
        faces={
            "outer": face_facts("outer", check.outer, check.relief),
            "inner": face_facts("inner", check.inner, check.relief),
        },
        grids=grids,
        verdicts=check.verdicts,
        changes=tool_advice(lens, check),
        criteria=[_criterion_row(each) for each in (*part.criteria, *check.criteria)],
        hashes=hashes,
    )


def _pictures(check: Check) -> Pictures:
    figures: Pictures = []
    for name, face, sag, kappa in (
        ("outer", check.outer, check.outer_sag_mm, check.outer_kappa_min),
        ("inner", check.inner, check.inner_sag_mm, check.inner_kappa_min),
    ):
        radius = face.cutter.radius_mm
        figures.append((f"{name}: departure from the best-fit sphere", sag_map(sag)))
        caption = f"{name}: smaller principal curvature; line: where a ball of {radius:g} mm just fits"
        figures.append((caption, curvature_map(kappa, radius)))
    return figures


def _page(content: _Content, sheet: Sheet, drawing: Figure, figures: Pictures) -> str:
    environment = Environment(loader=FileSystemLoader(_TEMPLATES), autoescape=True)
    environment.globals.update(shown=shown, criteria_head=_CRITERIA_HEAD)
    pictures = [(caption, Markup(to_svg(f, f"handover{k}", caption))) for k, (caption, f) in enumerate(figures, 1)]
    caption = f"Drawing, {sheet.name}, scale {scale_words(sheet.scale)}; the same as {PDF_FILE} and {DXF_FILE}"
    main = caption, Markup(to_svg(drawing, "handover0", caption))
    template = environment.get_template("manufacturing.html")
    return template.render(**vars(content), drawing=main, pictures=pictures)


def _tables(content: _Content) -> list[Table]:
    """The page's content for the PDF."""
    sizes = [(size.name, shown(size.value_mm), size.tolerance, size.scope_words) for size in content.dimensions]
    notes = [f"{number}. {note}" for number, note in enumerate(content.notes, 1)]
    findings = [(f"{each.name}, {each.surface}", _yes(each.holds), each.reason) for each in content.verdicts]
    faces = zip(content.faces["outer"].items(), content.faces["inner"].values(), strict=True)
    return [
        Table("Part", list(content.facts.items())),
        Table("Datums", sentences=[*(f"{line}." for line in content.datums), content.definition]),
        Table("Sizes", sizes, ("Size", "mm", "Tolerance", "Where"), (0.44, 0.12, 0.14, 0.3)),
        Table("Notes of the drawing", sentences=notes),
        *_tolerance_tables(content.tolerances),
        Table("Optical faces", [(name, outer, inner) for (name, outer), inner in faces],
              ("Figure", "Outer", "Inner"), (0.5, 0.25, 0.25)),
        Table("Can it be cut?", findings, ("Question", "", "Answer"), (0.2, 0.08, 0.72)),
        *([Table("Changes of the specification", sentences=content.changes)] if content.changes else []),
        Table("Criteria on files and shape", content.criteria, _CRITERIA_HEAD, (0.5, 0.2, 0.2, 0.1)),
        Table("Dense tables of points", list(content.grids.items())),
        Table("SHA-256", list(content.hashes.items()), shares=(0.3, 0.7)),
    ]  # fmt: skip


def _tolerance_tables(tolerances: ToleranceTable) -> list[Table]:
    """A table for each group; the sentence above them is their own where there are none."""
    head, shares = ("Tolerance", "Amount", "From", "At most"), (0.36, 0.24, 0.2, 0.2)
    return [
        Table("Tolerances", sentences=[tolerances.sentence]),
        *(
            Table(title, [(row.name, row.amount, row.source, row.at_most) for row in rows], head, shares)
            for title, rows in tolerances.groups.items()
        ),
    ]


def _criterion_row(criterion: Criterion) -> tuple[str, str, str, str]:
    """A criterion in words, its value, its limit, and whether it is met."""
    words, sense = criterion_words(criterion.name), {"<=": "≤", ">=": "≥"}[criterion.sense]
    question = words.removesuffix(" (1: yes)")
    value, limit = f"{number(criterion.value, 4)} {criterion.unit}", f"{sense} {criterion.limit:g} {criterion.unit}"
    if question != words:
        value, limit = "yes" if criterion.value == 1.0 else "no", "yes"
    if criterion.value is None:
        value = "not measured"
    return question, value.strip(), limit.strip(), _yes(criterion.passed)


def _yes(holds: bool) -> str:
    return "yes" if holds else "no"
