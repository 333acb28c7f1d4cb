"""The report on one lens: a self-contained page, from its results."""

import base64
from collections.abc import Sequence
from contextlib import closing
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.proof.proof_result import Proof
from lensforge.report import headline, pictures, proof
from lensforge.report.asked_table import asked_rows
from lensforge.report.cards import further_cards
from lensforge.report.file_rows import exported_files, folder_files
from lensforge.report.light_pictures import first_picture, receiver_pictures
from lensforge.report.measured import measured
from lensforge.report.other_conditions import light_pictures, light_rows, result_rows
from lensforge.report.page import template
from lensforge.report.photometry_section import photometry_section
from lensforge.report.referees import gap_pictures, referee_rows
from lensforge.report.sensitivity_rows import change_rows
from lensforge.report.snapshots import Snapshot, load_snapshots
from lensforge.report.solid_view import Rendering, SolidViews
from lensforge.report.stray_light import stray_pictures, stray_sentence
from lensforge.report.tables import Row, rows
from lensforge.report.task import task
from lensforge.report.yield_section import yield_section
from lensforge.runs.results import REPORT_FILE, Results
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.version import __version__

_PACKAGES = ("numpy", "scipy", "torch", "numba", "cadquery", "trimesh", "manifold3d", "matplotlib", "pyvista")


def render_report(results: Results, folder: Path | None = None, *, beside: bool = True) -> str:
    """The page on ``results``; ``folder``: that of the results, whose files and snapshots of the search are shown.

    ``beside``: the page will lie in that folder, so that it may have links to the files.

    The section of a stage that has not run says so. Raises :class:`InputError` for a damaged snapshot, an STL that is
    no mesh, or a file that cannot be read.
    """
    part = results.find(Part)
    if part is None:
        views = SolidViews({}, problem="No 3-D picture: no part has been exported.")
        return template(REPORT_FILE).render(**_context(results, folder, beside), **_solid(views))
    with closing(Rendering(part.stl, _optics_radius_mm(results.lens))) as rendering:
        context = _context(results, folder, beside)
        return template(REPORT_FILE).render(**context, **_solid(rendering.result()))


def _optics_radius_mm(lens: Lens) -> float:
    """The largest radius (mm) of the outer surface, to a per cent."""
    return float(lens.outer.radius(fibonacci_hemisphere(500)).max())


def _context(results: Results, folder: Path | None, beside: bool) -> dict[str, object]:
    lens, taken = results.lens, [] if folder is None else load_snapshots(folder, results.lens)
    return {
        "lens": lens,
        "subtitle": task(lens.spec),
        "headline": headline.headline(results),
        "outdated": headline.outdated(results),
        "altered_files": headline.altered_files(results),
        "warnings": headline.source_warnings(results),
        "cards": further_cards(results),
        "criteria": headline.criterion_rows(results),
        "missed": headline.missed_rows(results),
        "remarks": headline.missing(results),
        "search_end": headline.search_end(results),
        "times": headline.times(results),
        "check": results.find(Check),
        "proof": results.find(Proof),
        "step_facts": proof.step_facts(results),
        "cast_facts": proof.cast_facts(results),
        "first": first_picture(results),
        "asked": asked_rows(results),
        "photometry": photometry_section(results),
        "pictures": _pictures(results, taken),
        "referees": referee_rows(results),
        "stray_sentence": stray_sentence(results),
        "measured": measured(results),
        "changes": change_rows(results),
        "parts": yield_section(results, folder if beside else None),
        "other_lights": light_rows(results),
        "other_conditions": sum(isinstance(each, Light) for each in results.others.values()),
        "other_results": result_rows(results),
        "outline_known": pictures.source_outline(results) is not None,
        "files": exported_files(results) if folder is None else folder_files(folder, beside),
        "spec": _spec_tables(results),
        "numbers": _number_tables(results),
        "versions": _versions(),
        "version": __version__,
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def _pictures(results: Results, taken: Sequence[Snapshot]) -> dict[str, object]:
    return {
        "light": receiver_pictures(results),
        "history": pictures.history_pictures(results),
        "snapshots": pictures.snapshot_pictures(results, taken),
        "sections": pictures.section_pictures(results),
        "surfaces": pictures.surface_pictures(results),
        "verification": proof.verification_pictures(results),
        "gaps": gap_pictures(results),
        "stray": stray_pictures(results),
        "other": light_pictures(results),
    }


def _solid(views: SolidViews) -> dict[str, object]:
    encoded = {name: base64.b64encode(picture).decode() for name, picture in views.pictures.items()}
    low_high = views.bounds_mm
    extent = [high - low for low, high in zip(low_high[::2], low_high[1::2], strict=True)]
    mesh = base64.b64encode(views.mesh).decode()
    return {"views": encoded, "mesh": mesh, "extent_mm": extent, "views_problem": views.problem}


def _spec_tables(results: Results) -> dict[str, list[Row]]:
    """Rows of each section of the spec by name; those of its top-level entries under ``""``.

    Of target and receivers what is given: a target may have many lengths in either of two units.
    """
    spec, tables = results.spec, {}
    content = {key: value for key, value in spec.model_dump().items() if value is not None and key != "receivers"}
    tables[""] = rows({key: value for key, value in content.items() if not isinstance(value, dict)})
    for key, value in content.items():
        if isinstance(value, dict):
            tables[key] = rows(value if key != "target" else {k: v for k, v in value.items() if v is not None})
    for receiver in spec.all_receivers if spec.receivers else ():
        tables[f"receivers.{receiver.name}"] = rows(receiver.model_dump(exclude_none=True))
    return tables


def _number_tables(results: Results) -> dict[str, list[Row]]:
    """All values of each file, by its name; criteria, verdicts and the spec have their own tables."""
    records = {stem: result.plain() for stem, result in {**results.found, **results.others}.items()}
    tables = {"lens": results.lens.to_json(), **records}
    return {f"{stem}.json": rows(content, without=("criteria", "verdicts", "spec")) for stem, content in tables.items()}


def _versions() -> dict[str, str]:
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
