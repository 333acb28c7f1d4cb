"""``report.html``: one page that needs nothing else, from the files of a result folder."""

import base64
import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.report import headline, pictures, proof
from lensforge.report.cards import cards
from lensforge.report.measured_pictures import measured
from lensforge.report.numerals import size
from lensforge.report.page import template
from lensforge.report.pdf import drop_stale
from lensforge.report.proof_pictures import gap_pictures, stray_pictures, stray_sentence, verification_pictures
from lensforge.report.referees import referee_rows
from lensforge.report.results import EXTRAS, STAGES, Results, load_results
from lensforge.report.solid_view import Rendering, SolidViews
from lensforge.report.tables import Row, rows
from lensforge.report.task import task
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.version import __version__

FILE_NAME = "report.html"

_PACKAGES = ("numpy", "scipy", "torch", "numba", "cadquery", "trimesh", "manifold3d", "matplotlib", "pyvista")
_REMARKS = {
    "design": "There is no design.json, so how the lens was found is not known; run lensforge design.",
    "evaluate": "There is no evaluate.json: the finished lens has not been simulated; run lensforge evaluate.",
    "export": "There is no export.json: no file for a shop has been written; run lensforge export.",
    "check": "There is no check.json: the lens has not been checked for manufacture; run lensforge check.",
    "verify": "There is no verify.json: the exported part has not been verified; run lensforge verify.",
}


@dataclass(frozen=True)
class FileRow:
    """One file of the folder, with the hash by which anyone can tell it from another."""

    name: str
    size: str
    sha256: str


def build_report(directory: Path) -> Path:
    """Write ``report.html`` into ``directory`` from what the stages left there, and return its path.

    A stage that has not run is named as such in its section; a PDF of an earlier page goes. Raises
    :class:`InputError` when lens.json is missing or any file is damaged.
    """
    directory = Path(directory)
    results = load_results(directory)
    stl = directory / "lens.stl"
    rendering = Rendering(stl, _optics_radius_mm(results)) if stl.exists() else None
    try:
        context = _context(results)
        views = rendering.result() if rendering else SolidViews({}, problem="No 3-D picture: there is no lens.stl.")
    finally:
        if rendering:
            rendering.close()
    page = template("report.html").render(**context, **_solid(views))
    path = directory / FILE_NAME
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    drop_stale(path)
    return path


def _optics_radius_mm(results: Results) -> float:
    """The largest radius (mm) of the outer surface, to a per cent."""
    return float(results.lens.outer.radius(fibonacci_hemisphere(500)).max())


def _context(results: Results) -> dict[str, Any]:
    lens = results.lens
    return {
        "lens": lens,
        "subtitle": task(lens.spec),
        "verdict": headline.verdict(results),
        "cards": cards(results),
        "gates": headline.gate_rows(results),
        "failed": headline.failed_rows(results),
        "remarks": {stage: remark for stage, remark in _REMARKS.items() if stage in results.missing},
        "results": results,
        "step_facts": proof.step_facts(results),
        "cast_facts": proof.cast_facts(results),
        "first": pictures.first_picture(results),
        "pictures": {
            "irradiance": pictures.irradiance_pictures(results),
            "lines": pictures.line_pictures(results),
            "flux": pictures.flux_pictures(results),
            "history": pictures.history_pictures(results),
            "snapshots": pictures.snapshot_pictures(results),
            "sections": pictures.section_pictures(results),
            "surfaces": pictures.surface_pictures(results),
            "verification": verification_pictures(results),
            "gaps": gap_pictures(results),
            "stray": stray_pictures(results),
        },
        "referees": referee_rows(results),
        "stray_sentence": stray_sentence(results),
        "measured": measured(results),
        "outline_known": pictures.source_outline(results) is not None,
        "files": _files(results.directory),
        "spec": _spec_tables(results),
        "numbers": _number_tables(results),
        "versions": _versions(),
        "version": __version__,
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def _solid(views: SolidViews) -> dict[str, Any]:
    encoded = {name: base64.b64encode(picture).decode() for name, picture in views.pictures.items()}
    low_high = views.bounds_mm
    extent = [high - low for low, high in zip(low_high[::2], low_high[1::2], strict=True)]
    mesh = base64.b64encode(views.mesh).decode()
    return {"views": encoded, "mesh": mesh, "extent_mm": extent, "views_problem": views.problem}


def _files(directory: Path) -> list[FileRow]:
    """What lies in the folder, less this report, on screen or on paper, and what programs hide."""
    found = []
    for path in sorted(directory.iterdir()):
        if path.is_file() and path.name not in (FILE_NAME, "report.pdf") and not path.name.startswith("."):
            try:
                with path.open("rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                found.append(FileRow(path.name, size(path.stat().st_size), digest))
            except OSError as error:
                raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    return found


def _spec_tables(results: Results) -> dict[str, list[Row]]:
    """Section of the spec -> its rows, what stands before the first section under ``""``."""
    content = results.lens.spec.model_dump()
    top = {key: value for key, value in content.items() if not isinstance(value, dict)}
    sections = {key: rows(value) for key, value in content.items() if isinstance(value, dict)}
    return {"": rows(top), **sections}


def _number_tables(results: Results) -> dict[str, list[Row]]:
    """File -> all of its values; gates and the spec have tables of their own."""
    tables = {}
    for stage in ("lens", *STAGES, *EXTRAS):
        if stage in results.content:
            tables[f"{stage}.json"] = rows(results.content[stage], without=("gates", "verdicts", "spec"))
    return tables


def _versions() -> dict[str, str]:
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
