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
from lensforge.drawings.dimensions import Dimension, dimensions, points_table, sag_table
from lensforge.drawings.handover import POINTS_FILE, SAG_FILE, Handover
from lensforge.drawings.section import dimensioned_section
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.manufacturing.result import Check, FaceResult, Finding
from lensforge.report.figure_style import to_svg
from lensforge.report.ownership import pdf_mark
from lensforge.report.surface_figures import curvature_map, sag_map
from lensforge.results import Results

DATUM = (
    "A is the plane z = 0, in which both optical faces end; B is the optical axis z through the origin of the STEP; "
    "a clocking flat lies across +x. Lengths in mm. The optical faces are the named faces OPTICAL_OUTER and "
    "OPTICAL_INNER of the STEP file, which alone defines them; tables and pictures are for inspection."
)
_TEMPLATES = Path(__file__).with_name("templates")
_A4 = (8.27, 11.69)
_LINES, _COLUMNS = 68, 100
_DPI, _CAPTION = 300, 56
_NO_DATE = {"CreationDate": None}  # the same results make the same bytes

Pictures = list[tuple[str, Figure]]
Facts = dict[str, str]


@dataclass(frozen=True)
class _Content:
    """Text and numbers of page and PDF."""

    name: str
    facts: Facts
    dimensions: list[Dimension]
    faces: dict[str, Facts]
    verdicts: tuple[Finding, ...]
    criteria: tuple[Criterion, ...]
    hashes: Mapping[str, str]


def make_handover(results: Results) -> Handover:
    """Make the files that go to the shop with the STEP. Raises :class:`MissingResult` without part or check."""
    lens, part, check = results.lens, results.part, results.check
    points, sag = points_table(lens), sag_table(lens, check)
    hashes = {name: stamp.sha256 for name, stamp in part.files.items()}
    hashes |= {name: sha256(text.encode()).hexdigest() for name, text in ((POINTS_FILE, points), (SAG_FILE, sag))}
    content, figures = _content(lens, part, check, hashes), _pictures(lens, check)
    title = f"{content.name}: for manufacture"
    return Handover(
        name=title,
        html=_page(content, figures).encode(),
        pdf=pdf_of(title, _as_text(title, content), figures),
        points_csv=points.encode(),
        sag_csv=sag.encode(),
        points=points.count("\n") - 1,
        sha256=hashes,
        refused=tuple(verdict for verdict in check.verdicts if not verdict.holds),
    )


def _content(lens: Lens, part: Part, check: Check, hashes: Mapping[str, str]) -> _Content:
    spec = lens.spec
    facts = {
        "Material": spec.lens.material,
        "Refractive index": f"{spec.lens.refractive_index:g}",
        "To be manufactured": {"part": "the lens itself", "insert": "mould inserts"}[spec.manufacture.make],
        "Volume": f"{part.volume_mm3:.3f} mm³",
        **({} if part.mass_g is None else {"Mass": f"{part.mass_g:.3f} g"}),
        "Form error of the STEP's faces against the design": f"{part.form_error_nm.max:.2g} nm at most",
        "Error of their normals": f"{1e3 * part.normal_error_mrad.max:.2g} µrad at most",
        "STEP schema": part.step_schema,
        "Thinnest wall": f"{check.min_wall_mm:.4f} mm",
        "Thickest wall, along rays from the origin": f"{check.wall.thickest.thickness_mm:.4f} mm",
        "lensforge": lens.version,
    }
    return _Content(
        name=spec.name,
        facts=facts,
        dimensions=dimensions(lens),
        faces={"outer": _face(check.outer), "inner": _face(check.inner)},
        verdicts=check.verdicts,
        criteria=(*part.criteria, *check.criteria),
        hashes=hashes,
    )


def _face(face: FaceResult) -> Facts:
    sphere = face.best_fit_sphere
    return {
        "Best-fit sphere, radius": f"{sphere.radius_mm:.4f} mm",
        "Departure from it, peak to valley": f"{1e3 * sphere.pv_mm:.2f} µm",
        "Departure, rms": f"{1e3 * sphere.rms_mm:.2f} µm",
        "Smallest concave radius": _length(face.curvature.smallest_concave_radius_mm),
        "Largest ball that reaches the whole face": _length(face.cutter.largest_radius_mm),
        "Largest tilt": f"{face.largest_tilt_deg:.2f}°",
        "Least draft": f"{face.draft_deg.min:.2f}°",
    }


def _length(value: float | None) -> str:
    return "any" if value is None else f"{value:.4f} mm"


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
    return environment.get_template("manufacturing.html").render(**vars(content), datum=DATUM, pictures=drawn)


def _as_text(title: str, content: _Content) -> list[str]:
    lines = [title, "", *(f"{key}: {value}" for key, value in content.facts.items()), "", "Datum", DATUM]
    lines += ["", "Dimensions (mm)", *(f"{d.value_mm:10.4f}  {d.name}" for d in content.dimensions)]
    for name, facts in content.faces.items():
        lines += ["", f"Face {name}", *(f"{key}: {value}" for key, value in facts.items())]
    lines += ["", "Verdicts", *(f"[{_yes(v.holds)}] {v.name}, {v.surface}: {v.reason}" for v in content.verdicts)]
    lines += ["", "Criteria", *(f"[{_yes(c.passed)}] {c.name} {_value(c)}" for c in content.criteria)]
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
