"""The handover to the shop, from the results of a lens: drawing, page, PDF and DXF of the same content, and tables."""

from hashlib import sha256
from pathlib import Path
from typing import Protocol

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup

from lensforge.cad.part import Part
from lensforge.results import Group
from lensforge.results.figure_style import to_svg
from lensforge.scene.lens import Lens
from lensforge.shop.check_facts import finding_groups
from lensforge.shop.check_result import Check
from lensforge.shop.dense_table import GridRequest, MeasuredTable, dense_tables, file_name, table_text
from lensforge.shop.dimensions import dimensions
from lensforge.shop.drawing import DrawingContent, drawing_content, make_sheet, scale_words, tool_advice
from lensforge.shop.handover import DXF_FILE, PDF_FILE, POINTS_FILE, SAG_FILE, Handover, PointGrid
from lensforge.shop.handover_facts import DEFINITION, face_groups, shop_facts, table_facts
from lensforge.shop.offset_face import offset_faces
from lensforge.shop.point_files import origin_lines, points_table, ring_angles, sag_table
from lensforge.shop.sheet import Sheet, shown
from lensforge.shop.sheet_pdf import Pictures, Table, pdf_of
from lensforge.shop.sheet_writers import sheet_dxf, sheet_figure
from lensforge.shop.surface_figures import curvature_map, sag_map
from lensforge.shop.tolerance_table import ToleranceTable, tolerance_table
from lensforge.spec import DrawingSection

_TEMPLATES = Path(__file__).with_name("templates")


class HandedOver(Protocol):
    """Results of a lens that goes to the shop; each property raises :class:`MissingResult` where it is missing."""

    @property
    def lens(self) -> Lens:
        """The lens."""

    @property
    def part(self) -> Part:
        """The part and its files."""

    @property
    def check(self) -> Check:
        """The manufacturing check."""

    @property
    def yield_facts(self) -> list[Group]:
        """Facts of the yield; empty where it has not been computed."""


def make_handover(
    results: HandedOver, request: GridRequest | None = None, words: DrawingSection | None = None
) -> Handover:
    """Make the files that go to the shop with the STEP. Raises :class:`MissingResult` without part or check.

    ``request``: of the dense tables. Raises :class:`InputError` where they cannot be made so. ``words``: of title block
    and notes; None: those of the spec.
    """
    lens, part, check, request = results.lens, results.part, results.check, request or GridRequest()
    faces, head = offset_faces(lens, check, {"inner": 0.0, "outer": 0.0}), origin_lines(lens, part)
    grids = tuple(_point_grid(measured, head, request) for measured in dense_tables(lens, check, request))
    tables = {
        POINTS_FILE: points_table(faces, head).encode(),
        SAG_FILE: sag_table(faces, check, head).encode(),
        **{grid.file: grid.content for grid in grids},
    }
    tolerances, words = tolerance_table(lens, results.yield_facts), words or lens.spec.drawing
    drawn = drawing_content(lens, part, check, dimensions(lens), tolerances, words)
    sheet = make_sheet(drawn, words.sheet or "A3")
    dxf, figures = sheet_dxf(sheet), _pictures(check)
    hashes = {name: stamp.sha256 for name, stamp in part.files.items()}
    hashes |= {name: sha256(content).hexdigest() for name, content in {**tables, DXF_FILE: dxf}.items()}
    content = _tables(results, drawn, words, tolerances, grids, hashes)
    title = f"{drawn.title.title}: for manufacture"
    return Handover(
        name=title,
        html=_page(title, sheet, content, figures, lens.version).encode(),
        pdf=pdf_of(title, sheet_figure(sheet), content, figures),
        dxf=dxf,
        points_csv=tables[POINTS_FILE],
        sag_csv=tables[SAG_FILE],
        points=len(faces) * len(ring_angles()),
        grids=grids,
        sha256=hashes,
        refused=tuple(verdict for verdict in check.verdicts if not verdict.holds),
    )


def _point_grid(measured: MeasuredTable, head: list[str], request: GridRequest) -> PointGrid:
    table = measured.table
    return PointGrid(
        file=file_name(table),
        face=table.face.name,
        spacing_mm=table.spacing_mm,
        interpolation=request.interpolation,
        error_nm=measured.error_nm,
        offset_mm=table.face.offset_mm,
        points=len(table.rows),
        content=table_text(measured, head, request).encode(),
    )


def _tables(
    results: HandedOver,
    drawn: DrawingContent,
    words: DrawingSection,
    tolerances: ToleranceTable,
    grids: tuple[PointGrid, ...],
    hashes: dict[str, str],
) -> list[Table]:
    """Content of page and PDF beside drawing and pictures."""
    lens, part, check = results.lens, results.part, results.check
    datums = [*(f"{line}." for line in drawn.views.datums.lines), DEFINITION]
    sizes = [(size.name, shown(size.value_mm), size.tolerance, size.scope_words) for size in drawn.views.dimensions]
    notes = [f"{number}. {note}" for number, note in enumerate(drawn.notes, 1)]
    outer, inner = face_groups(lens, check)
    findings = [
        (f"{group.title}: {fact.label.lower()}", fact.text, fact.note)
        for group in finding_groups(check, lens.spec)
        for fact in group.facts
    ]
    changes, criteria = tool_advice(lens, check), [each.fact for each in (*part.criteria, *check.criteria)]
    judged = [(fact.label, fact.text, fact.asked, fact.state) for fact in criteria]
    dense = table_facts(grids)
    return [
        Table("Part", _rows(shop_facts(lens, part, check, words))),
        Table("Datums", sentences=datums),
        Table("Sizes", sizes, ("Size", "mm", "Tolerance", "Where"), (0.44, 0.12, 0.14, 0.3)),
        Table("Notes of the drawing", sentences=notes),
        *_tolerance_tables(tolerances),
        Table("Outer face", _rows(outer)),
        Table("Inner face", _rows(inner)),
        Table("Can it be cut?", findings, ("Question", "", "Answer"), (0.2, 0.08, 0.72)),
        *([Table("Changes of the specification that would help", sentences=changes)] if changes else []),
        Table("Criteria on files and shape", judged, ("Criterion", "Value", "Limit", "State"), (0.5, 0.2, 0.2, 0.1)),
        Table(dense.title, _rows(dense)),
        Table("SHA-256", list(hashes.items()), shares=(0.3, 0.7)),
    ]  # fmt: skip


def _tolerance_tables(tolerances: ToleranceTable) -> list[Table]:
    """A table for each group, its last column only where an amount is known; the sentence above all of them."""
    head, shares = ("Tolerance", "Amount", "From", "At most"), (0.36, 0.24, 0.2, 0.2)
    found = [Table("Tolerances", sentences=[tolerances.sentence])]
    for title, rows in tolerances.groups.items():
        columns = 4 if any(row.at_most for row in rows) else 3
        texts = [(row.name, row.amount, row.source, row.at_most)[:columns] for row in rows]
        found.append(Table(title, texts, head[:columns], shares[:columns]))
    return found


def _rows(group: Group) -> list[tuple[str, str]]:
    return [(fact.label, fact.sentence) for fact in group.facts]


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


def _page(title: str, sheet: Sheet, tables: list[Table], figures: Pictures, version: str) -> str:
    caption = f"Drawing, {sheet.name}, scale {scale_words(sheet.scale)}; the same as {PDF_FILE} and {DXF_FILE}"
    drawn = [(caption, sheet_figure(sheet)), *figures]
    pictures = [(words, Markup(to_svg(figure, f"handover{k}", words))) for k, (words, figure) in enumerate(drawn)]
    environment = Environment(loader=FileSystemLoader(_TEMPLATES), autoescape=True)
    template = environment.get_template("manufacturing.html")
    return template.render(title=title, tables=tables, pictures=pictures, version=version)
