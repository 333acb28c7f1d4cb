"""The handover to the shop, from the results of a lens: drawing, page, PDF and DXF of the same content, and tables.

Facts on the page say what the part is, what defines it, how its faces measure, and what each table holds.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup
from matplotlib.figure import Figure

from lensforge.cad.part import Part
from lensforge.made.tolerance_result import Yield
from lensforge.report.criterion_words import criterion_words
from lensforge.report.figure_style import to_svg
from lensforge.report.numerals import number
from lensforge.report.surface_figures import curvature_map, sag_map
from lensforge.results.criteria import Criterion
from lensforge.runs.results import Results
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import BallClearance, Check, FaceName, FaceResult, Finding
from lensforge.shop.dimensions import Dimension, dimensions
from lensforge.shop.drawing import DrawingContent, drawing_content, make_sheet, tool_advice
from lensforge.shop.handover import DXF_FILE, PDF_FILE, POINTS_FILE, SAG_FILE, Handover, PointGrid
from lensforge.shop.offset_face import offset_faces
from lensforge.shop.point_files import (
    cloud_facts,
    cloud_name,
    cloud_text,
    file_name,
    grid_text,
    origin_lines,
    points_table,
    ring_angles,
    sag_table,
)
from lensforge.shop.point_grids import GridRequest, MeasuredGrid, Polar, Raster, make_grids
from lensforge.shop.sheet import Sheet, shown
from lensforge.shop.sheet_dxf import sheet_dxf
from lensforge.shop.sheet_pdf import Pictures, Table, pdf_of, sheet_figure
from lensforge.shop.sheet_tables import scale_words
from lensforge.shop.tolerance_table import ToleranceTable, tolerance_table
from lensforge.spec import DrawingSection
from lensforge.spec.spec_section import rounded_up

Facts = dict[str, str]
DEFINITION = (
    "lens.step alone defines the part; its faces OPTICAL_OUTER and OPTICAL_INNER are the optical ones. Drawing, tables "
    "and pictures are for inspection, the dense tables for tool paths within the error that they state. All have the "
    "coordinates of lens.step: z = 0 is the plane in which both optical faces end, z the optical axis."
)


def part_facts(lens: Lens, part: Part, check: Check, words: DrawingSection) -> Facts:
    """Facts on the part and its files; ``words``: those of its drawing."""
    spec, signature = lens.spec, part.signature
    return {
        "Number": words.part_number or "not stated",
        "Revision": words.revision or "not stated",
        "Author": signature.author or "not stated",
        "Organisation": signature.organisation or "not stated",
        "Date": signature.date or "not stated",
        "Material": spec.lens.material,
        "Refractive index": f"{spec.lens.refractive_index:g}",
        **({} if spec.lens.cavity_index == 1.0 else {"Index in the cavity": f"{spec.lens.cavity_index:g}"}),
        **({} if spec.lens.outside_index == 1.0 else {"Index outside": f"{spec.lens.outside_index:g}"}),
        **{
            f"Fixed {name} face": face.title
            for name, face in (("inner", spec.lens.fixed_inner), ("outer", spec.lens.fixed_outer))
            if face is not None
        },
        **_coating_facts(lens),
        "To be manufactured": {"part": "the lens itself", "insert": "mould inserts"}[spec.manufacture.make],
        **_mould_facts(lens, part),
        **_untrimmed_facts(part),
        **_tolerance_facts(lens, part),
        "Volume": f"{part.volume_mm3:.3f} mm³",
        **({} if part.mass_g is None else {"Mass": f"{part.mass_g:.3f} g"}),
        "Form error of the STEP's faces against the design": f"{part.form_error_nm.max:.2g} nm at most",
        "Error of their normals": f"{1e3 * part.normal_error_mrad.max:.2g} µrad at most",
        "STEP schema": part.step_schema,
        "Thinnest wall": f"{check.min_wall_mm:.4f} mm",
        "Thickest wall, along rays from the origin": f"{check.wall.thickest.thickness_mm:.4f} mm",
        "Lens, SHA-256": lens.sha256,
        "lensforge": lens.version,
    }


def _coating_facts(lens: Lens) -> Facts:
    """Coatings of the optical faces; nothing for bare ones."""
    section = lens.spec.lens
    each = (("inner", section.inner_coating), ("outer", section.outer_coating))
    return {f"Coating of the {name} face": coating.title for name, coating in each if coating is not None}


def _mould_facts(lens: Lens, part: Part) -> Facts:
    """Shrinkage, and the files that carry it; nothing for a lens that is cut itself."""
    shop = lens.spec.manufacture
    if shop.make == "part":
        return {}
    mould = "the tables of points, figures and pictures of the optical faces"
    if part.untrimmed_surfaces is not None:
        mould = f"lens_surfaces.step, {mould}"
    return {
        "Shrinkage": f"{shop.shrinkage:.12g}; {mould} are those of the mould: the lens times {shop.scale:.12g} about "
        "the origin; lens.step, lens.stl, lens.3mf, section, dimensions, volume and wall are of the moulded lens"
    }


def _untrimmed_facts(part: Part) -> Facts:
    """Run-out and errors of the untrimmed faces; nothing where they are not exported."""
    found = part.untrimmed_surfaces
    if found is None:
        return {}
    return {
        "Faces of lens_surfaces.step": f"{found.runout_deg:g}° beyond the rim; above it their form errs by "
        f"{found.form_error_nm:.2g} nm at most against the design times {found.scale:.12g}, their normals by "
        f"{1e3 * found.normal_error_mrad:.2g} µrad"
    }


def _tolerance_facts(lens: Lens, part: Part) -> Facts:
    """Form tolerance of the optical faces; nothing where the spec has none."""
    width_um = lens.spec.manufacture.form_tolerance_um
    if width_um is None:
        return {}
    carried = "its schema carries none"
    if part.form_tolerances:
        against = "against A" if part.form_tolerances[0].datum_faces else "without datum, as no face lies in z = 0"
        carried = f"it is on these faces as a surface profile {against}"
    return {
        "Form tolerance of the lens's optical faces": f"{width_um:g} µm, width of the zone, half of it on each side of "
        f"the face; in lens.step {carried}"
    }


def face_facts(name: FaceName, face: FaceResult, relief: BallClearance) -> Facts:
    """Figures of one optical face by the check."""
    sphere, ball = face.best_fit_sphere, face.cutter
    base = relief.beyond_shop(ball.largest_radius_mm, ball.radius_mm, name)
    return {
        "Best-fit sphere, radius": f"{sphere.radius_mm:.4f} mm",
        "Departure from it, peak to valley": f"{1e3 * sphere.pv_mm:.2f} µm",
        "Departure, rms": f"{1e3 * sphere.rms_mm:.2f} µm",
        "Smallest concave radius": _length(face.curvature.smallest_concave_radius_mm),
        "Largest ball that reaches the whole face": f"{_length(ball.largest_radius_mm)}{base}",
        "Largest tilt": f"{face.largest_tilt_deg:.2f}°",
        "Least draft": f"{face.draft_deg.min:.2f}°",
    }


def grid_facts(grid: PointGrid) -> str:
    """Points, spacing, coverage and error of a dense table."""
    at = "on the face" if grid.offset_mm == 0.0 else f"{grid.offset_mm:g} mm off the face, into the air"
    return (
        f"{grid.points} points {at}, up to {grid.spacing_mm:.4g} mm apart; complete cells over "
        f"{100.0 * grid.covered:.1f} % of the face's area; {grid.interpolation} interpolation errs by at most "
        f"{rounded_up(grid.error_nm, 3)} nm along the normal"
    )


def _length(value: float | None) -> str:
    return "any" if value is None else f"{value:.4f} mm"


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
