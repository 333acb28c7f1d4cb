"""The handover to the shop, from the results of a lens: drawing, page, PDF and DXF of the same content, and tables."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure

from lensforge.cad.cutter_room import as_built
from lensforge.cad.part import SURFACES_FILE, Part, part_facts
from lensforge.cad.plate_layout import PlateLayout, layout_of
from lensforge.results import Fact, Group
from lensforge.results.criteria import shown as shown_criterion
from lensforge.results.figure_style import to_svg
from lensforge.results.numerals import quantity, with_unit
from lensforge.scene.lens import Lens
from lensforge.shop.check_facts import check_facts, finding_groups
from lensforge.shop.check_result import Check
from lensforge.shop.dimensions import dimensions
from lensforge.shop.drawing import DrawingContent, drawing_content, make_sheet, scale_label
from lensforge.shop.drawn_tables import drawn_point_tables
from lensforge.shop.drawn_views import drawn_dimensions
from lensforge.shop.handover import (
    DXF_FILE,
    PDF_FILE,
    PLATE_DXF_FILE,
    PLATE_PDF_FILE,
    POINTS_FILE,
    Handover,
    PointGrid,
)
from lensforge.shop.part_models import models_of
from lensforge.shop.plate_drawing import place_rows, plate_notes, plate_sheet
from lensforge.shop.point_tables import GridRequest, origin_lines, point_tables
from lensforge.shop.sheet import Sheet, shown
from lensforge.shop.sheet_tables import ToleranceTable, tolerance_table
from lensforge.shop.sheet_writers import sheet_dxf, sheet_figure, sheet_pdf
from lensforge.shop.surface_figures import curvature_map, sag_map
from lensforge.spec import DrawingSection
from lensforge.spec.processes import Process
from lensforge.spec.spec_section import rounded_up

_SIZES = "lenses", "size", "volume", "mass"  # of a lens, or of the plate in which it is one of several
_TEMPLATES = Path(__file__).with_name("templates")
Pictures = list[tuple[str, Figure]]


@dataclass(frozen=True)
class Table:
    """A table of the page: ``sentences`` above it, its ``head``, if any, and rows."""

    title: str
    rows: Sequence[Sequence[str]] = ()
    head: Sequence[str] = ()
    sentences: Sequence[str] = ()


def make_handover(
    part: Part,
    check: Check,
    studied: list[Group],
    request: GridRequest | None = None,
    drawing: DrawingSection | None = None,
    rays: int = 0,
) -> Handover:
    """Make the files that go to the shop with the STEP.

    ``studied``: facts of the yield, empty if it has not been computed. ``request``: of the dense tables. ``drawing``:
    of title block and notes; None: the spec's. ``rays``: in a model beside that of the lens alone. Raises
    :class:`InputError` for tables that cannot be made so.
    """
    lens = part.lens
    request = request or GridRequest()
    head = origin_lines(lens, part)
    is_drawn = lens.spec.lens.drawn_mm is not None
    points = drawn_point_tables(lens, head, request) if is_drawn else point_tables(lens, check, head, request)
    grids = points.grids
    tables = {POINTS_FILE: points.measured, **{grid.file: grid.content for grid in grids}}
    tolerances = tolerance_table(lens, studied)
    drawing = drawing or lens.spec.drawing
    sizes = drawn_dimensions(lens) if is_drawn else dimensions(lens)
    drawn = drawing_content(lens, part, check, sizes, tolerances, drawing)
    sheet = make_sheet(drawn, drawing.sheet or "A3")
    layout = layout_of(lens)
    made = layout is not None and lens.makes_plate
    plate = plate_sheet(lens, part, layout, drawing, drawing.sheet or "A3") if made and layout is not None else None
    dxf = sheet_dxf(sheet)
    figures = _pictures(check)
    plate_dxf = None if plate is None else sheet_dxf(plate)
    hashes = {name: stamp.sha256 for name, stamp in part.files.items()}
    models = dict(models_of(part, rays))
    hashed = {**tables, **models, DXF_FILE: dxf, **({} if plate_dxf is None else {PLATE_DXF_FILE: plate_dxf})}
    hashes |= {name: sha256(content).hexdigest() for name, content in hashed.items()}
    content = _tables(part, check, drawn, tolerances, grids, hashes)
    sheets = [(sheet, PDF_FILE, DXF_FILE)]
    if plate is not None and layout is not None:
        content[1:1] = _plate_tables(lens, layout, plate, drawing)
        sheets.insert(0, (plate, PLATE_PDF_FILE, PLATE_DXF_FILE))
    title = f"{drawn.title}: for manufacture"
    return Handover(
        name=title,
        html=_page(title, sheets, content, figures, lens.version).encode(),
        pdf=sheet_pdf(sheet),
        dxf=dxf,
        plate_pdf=None if plate is None else sheet_pdf(plate),
        plate_dxf=plate_dxf,
        points_csv=tables[POINTS_FILE],
        models=models,
        scale=lens.spec.manufacture.scale if lens.spec.manufacture.cuts == "inserts" else None,
        points=points.places,
        grids=grids,
        sha256=hashes,
        refused=tuple(verdict for verdict in check.verdicts if not verdict.holds),
    )


def made_by(part: Part, process: Process) -> Part:
    """The part as another process makes it: of the same body, without faces that are scaled for a mould."""
    files = {name: stamp for name, stamp in part.files.items() if name != SURFACES_FILE}
    return part.changed(lens=as_built(part.lens, process), untrimmed_surfaces=None, surfaces_step=None, files=files)


def _tables(
    part: Part,
    check: Check,
    drawn: DrawingContent,
    tolerances: ToleranceTable,
    grids: tuple[PointGrid, ...],
    hashes: dict[str, str],
) -> list[Table]:
    lens = part.lens
    sizes = [(size.name, shown(size.value_mm), size.tolerance, size.scope_phrase) for size in drawn.views.dimensions]
    notes = [f"{number}. {note}" for number, note in enumerate(drawn.notes, 1)]
    findings = [
        (f"{group.title}: {fact.label.lower()}", fact.text, ". Change: ".join(filter(None, (fact.note, fact.remedy))))
        for group in finding_groups(check)
        for fact in group.facts
    ]
    criteria = [shown_criterion(criterion) for criterion in (*part.criteria, *check.criteria)]
    judged = [(fact.label, fact.text, fact.required, fact.state) for fact in criteria]
    dense = table_facts(grids)
    return [
        Table("Part", _rows(shop_facts(lens, part, check))),
        Table("Sizes", sizes, ("Size", "mm", "Tolerance", "Where")),
        Table("Notes of the drawing", sentences=notes),
        *_tolerance_tables(tolerances),
        *(Table(group.title, _rows(group)) for group in face_groups(lens, check)),
        Table("Manufacture", findings, ("Question", "", "Answer")),
        Table("Criteria on files and shape", judged, ("Criterion", "Value", "Limit", "State")),
        Table(dense.title, _rows(dense)),
        Table("SHA-256", list(hashes.items())),
    ]


def _plate_tables(lens: Lens, layout: PlateLayout, plate: Sheet, drawing: DrawingSection) -> list[Table]:
    sizes = [(dimension.name, dimension.text) for dimension in plate.marks.dimensions]
    notes = [f"{number}. {note}" for number, note in enumerate(plate_notes(lens, layout, drawing), 1)]
    places = Table("Places on the plate", place_rows(layout), ("", "x (mm)", "y (mm)", ""))
    return [
        Table("Sizes of the plate", sizes, ("Size", "mm")),
        *([places] if places.rows else []),
        Table("Notes of its drawing", sentences=notes),
    ]


def _tolerance_tables(tolerances: ToleranceTable) -> list[Table]:
    """A table for each group; the column of largest amounts only if known; the sentence above the first."""
    head = ("Tolerance", "Amount", "From", "At most")
    tables = [Table("Tolerances", sentences=[tolerances.sentence])]
    for title, rows in (("The lens", tolerances.lens), ("LED and mounting", tolerances.assembly)):
        columns = 4 if any(row.at_most for row in rows) else 3
        texts = [(row.name, row.amount, row.source, row.at_most)[:columns] for row in rows]
        tables += [Table(title, texts, head[:columns])] if rows else []
    return tables


def _rows(group: Group) -> list[tuple[str, str]]:
    return [(fact.label, fact.sentence) for fact in group.facts]


def _pictures(check: Check) -> Pictures:
    figures: Pictures = []
    for name, face in reversed(check.faces.items()):
        cutter = face.cutter
        figures.append((f"{name}: departure from the best-fit sphere", sag_map(face.sag_mm)))
        line = "" if cutter is None else f"; line: where a {cutter.tip} of {cutter.radius_mm:g} mm just fits"
        drawn = curvature_map(face.kappa_min, None if cutter is None else cutter.radius_mm)
        figures.append((f"{name}: smaller principal curvature{line}", drawn))
    return figures


def _page(
    title: str, sheets: list[tuple[Sheet, str, str]], tables: list[Table], figures: Pictures, version: str
) -> str:
    drawings = [
        (f"Drawing, {sheet.name}, scale {scale_label(sheet.scale)}; the same as {pdf} and {dxf}", sheet_figure(sheet))
        for sheet, pdf, dxf in sheets
    ]
    drawn = [*drawings, *figures]
    pictures = [(caption, Markup(to_svg(figure, f"handover{k}", caption))) for k, (caption, figure) in enumerate(drawn)]
    environment = Environment(loader=FileSystemLoader(_TEMPLATES), autoescape=True)
    template = environment.get_template("manufacturing.html")
    count = len(sheets)
    return template.render(
        title=title, tables=tables, drawings=pictures[:count], pictures=pictures[count:], version=version
    )


def shop_facts(lens: Lens, part: Part, check: Check) -> Group:
    """Facts on the part and its files, beyond those of its title block."""
    files = part_facts(part)[0].select("form_error", "normal_error", "schema", "surfaces").facts
    sized = part_facts(part)[-1].select(*(f"{of}{size}" for of in ("", "plate_") for size in _SIZES)).facts
    groups = check_facts(check)
    walls = [fact for group in groups if group.key in ("walls", "edges", "mould") for fact in group.facts]
    facts = (
        *_make(lens, part),
        *sized,
        *files,
        *walls,
        Fact("sha256", "Lens, SHA-256", part.inputs["lens"]),
        Fact("lensforge", "lensforge", lens.version),
    )
    return Group("shop", "Part", facts)


def face_groups(lens: Lens, check: Check) -> list[Group]:
    """Facts of each face, from the outside in."""
    named = {group.key: group for group in check_facts(check)}
    return [named[name] for name in reversed(check.faces)]


def table_facts(grids: tuple[PointGrid, ...]) -> Group:
    """Facts on the dense tables of points."""
    return Group("tables", "Dense tables of points", tuple(map(_grid, grids)))


def _make(lens: Lens, part: Part) -> Iterator[Fact]:
    """Process and object that is cut; for a mould insert the shrinkage, and its files."""
    shop = lens.spec.manufacture
    made = "mould inserts" if shop.cuts == "inserts" else f"the lens itself, {shop.process}"
    yield Fact("process", "To be manufactured", made)
    if shop.cuts == "inserts":
        scale = quantity(shop.scale, digits=12)
        mould = "the tables of points, figures and pictures of the optical faces"
        if part.untrimmed_surfaces is not None:
            mould = f"{SURFACES_FILE}, {mould}"
        note = (
            f"{mould} are those of the mould: the lens times {scale} about the origin; lens.step, lens.stl, lens.3mf, "
            "drawing, dimensions, volume and wall are of the moulded lens"
        )
        yield Fact("shrinkage", "Shrinkage", shop.shrinkage, note=note, digits=12)


def _grid(grid: PointGrid) -> Fact:
    spacing = quantity(grid.spacing_mm, "mm", digits=4)
    error = with_unit(rounded_up(grid.error_nm, 3), "nm")
    note = (
        f"on the face, up to {spacing} apart; {grid.interpolation} interpolation error at most {error} "
        "along the normal; each node has its normal from the material into the air"
    )
    return Fact("grid", grid.file, grid.points, "points", note=note)
