"""The report on one lens: a self-contained page, or the output of a notebook, from its results."""

import base64
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from functools import partial
from math import hypot
from pathlib import Path
from typing import Any

from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.part import Part, included_holders
from lensforge.light.evaluation_result import Light
from lensforge.light.light_facts import place_groups
from lensforge.light.photometry_result import Photometry
from lensforge.made.tolerance_result import Sensitivity, Yield
from lensforge.proof.proof_facts import tracer_groups
from lensforge.proof.proof_result import Proof, StrayLight
from lensforge.report import exported_part, headline, light_section, travel_section
from lensforge.report.added_section import FIRST, added_sections
from lensforge.report.headline import task
from lensforge.report.page import PagePicture, template
from lensforge.report.record_tables import number_tables, spec_tables
from lensforge.report.results import REPORT_FILE, Results
from lensforge.report.solid_view import SolidViews, solid_views
from lensforge.report.stored import RUN_FILE
from lensforge.report.yield_section import yield_sections
from lensforge.results import Group, StageResult
from lensforge.results.made_cache import made_once
from lensforge.results.numerals import number, percent
from lensforge.search.design_result import Design
from lensforge.shop.check_facts import finding_groups
from lensforge.shop.check_result import Check
from lensforge.surfaces.imported_face import LENS_FILE
from lensforge.version import __version__, versions_of

_PACKAGES = ("numpy", "scipy", "torch", "numba", "cadquery", "trimesh", "manifold3d", "matplotlib", "pyvista")


def render_report(results: Results, folder: Path | None = None, *, beside: bool = True) -> str:
    """The page on ``results``; ``folder``: where they lie, whose files are listed, linked if the page is ``beside``.

    A stage that has not run is said. Raises :class:`InputError` for an STL that is no mesh, or a file not readable.
    """
    part = results.find(Part)
    if part is None:
        views = SolidViews({}, problem="No 3-D picture: no part has been exported.")
        return template(REPORT_FILE).render(**_context(results, folder, beside), **_solid(views))
    radius_mm = float(lens_boundaries(results.lens)[1].radius(results.lens.directions(500)).max())  # to a per cent
    of = part.stl, hypot(radius_mm, 0.5 * (results.spec.lens.drawn_mm or 0.0)), part.plate_stl
    solid = ThreadPoolExecutor(1).submit(
        made_once, ("solid", *of), lambda: _solid(solid_views(*of)), dict[str, Any], lambda it: not it["views_problem"]
    )
    context = _context(results, folder, beside)  # meanwhile
    return template(REPORT_FILE).render(**context, **solid.result())


def _context(results: Results, folder: Path | None, beside: bool) -> dict[str, object]:
    lens = results.lens
    design = results.find(Design)
    proof = results.find(Proof)
    possible = light_section.possible_limits(results.spec)
    lights = light_section.other_lights(results)
    pictures = _pictures(results)
    return {
        "lens": lens,
        "subtitle": task(lens.spec),
        "included_holders": included_holders(lens.spec),
        "places": place_groups(results.light) if results.find(Light) else [],
        "headline": headline.headline(results),
        "outdated": headline.outdated(results),
        "altered_files": () if proof is None else proof.notes,
        "kinds": headline.kinds(results, folder is not None and beside),
        "warnings": () if design is None else design.source.warnings,
        "required": headline.required_facts(results, possible),
        "further": headline.further_facts(results),
        "criteria": headline.criterion_groups(results),
        "missed": headline.criterion_groups(results, missed=True),
        "remarks": headline.missing(results),
        "search_end": None if design is None else design.ended,
        "times": headline.times(results),
        "facts": _facts(results),
        "left_by_tool": results.spec.manufacture.making.terms.left,
        "far_proof": proof is not None and any(receiver.far_field for receiver in proof.receivers),
        "photometry": _photometry_sentence(results),
        "first": pictures.pop("first"),
        "pictures": pictures,
        "added": added_sections(results),
        "seen_at_once": FIRST,
        "yields": yield_sections(results),
        "other_lights": lights,
        "other_conditions": sum(isinstance(result, Light) for result in results.others.values()),
        "other_results": light_section.other_results(results),
        "outline_known": exported_part.source_outline(results) is not None,
        "files": exported_part.exported_files(results)
        if folder is None
        else exported_part.folder_files(folder, _own_files(results), beside),
        "spec": spec_tables(results),
        "numbers": number_tables(results),
        "versions": versions_of(_PACKAGES),
        "version": __version__,
        "written": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def _own_files(results: Results) -> set[str]:
    every = {**results.found, **results.others}.items()
    return {LENS_FILE, RUN_FILE}.union(*(result.file_names(stem) for stem, result in every))


def _facts(results: Results) -> dict[str, list[Group]]:
    """Groups of facts by the section of the page that shows them; light and size stand in the table at its head."""

    def of(*kinds: type[StageResult]) -> list[Group]:
        stages = (results.find(kind) for kind in kinds)
        return [group for result in stages if result is not None for group in results.facts(result)]

    check = results.find(Check)
    proof = results.find(Proof)
    lit = [group for group in of(Light) if group.key != "limits"]
    return {
        "light": lit,
        "travel": travel_section.travel_groups(results),
        "photometry": of(Photometry),
        "lens": [group for group in of(Design) if group.key != "costs"],
        "costs": [group for group in of(Design) if group.key == "costs"],
        "findings": [] if check is None else finding_groups(check),
        "faces": [group for group in of(Check) if not group.key.startswith("findings")],
        "tracers": [] if proof is None else tracer_groups(proof),
        "proof": of(Part, Proof),
        "stray": of(StrayLight),
        "sensitivity": of(Sensitivity),
        "yield": of(Yield),
    }


def _photometry_sentence(results: Results) -> str:
    """A sentence on rays and noise of the far field; empty without one."""
    photometry = results.find(Photometry)
    if photometry is None:
        return ""
    basis = "per 1000 lm of the source, whose flux is not known" if photometry.per_1000_lm else "are absolute"
    noise = "" if photometry.node_error is None else f"; the table’s noise is {percent(photometry.node_error.rms)} rms"
    return f"By {number(photometry.rays)} rays{noise}. Candela and lumens {basis}."


_Drawn = Callable[[Results], object]
_LIST = list[PagePicture]
_ROWS = list[list[PagePicture]]
# Pictures of the page by their section, what each is, and the results that they show beside the lens: they see no
# others.
_PICTURES: dict[str, tuple[_Drawn, Any, tuple[type[StageResult], ...]]] = {
    "first": (light_section.first_picture, PagePicture | None, (Light,)),
    "light": (light_section.receiver_pictures, list[light_section.ReceiverPictures], (Light,)),
    "travel": (travel_section.travel_pictures, travel_section.TravelPictures | None, (Light,)),
    "photometry": (light_section.photometry_pictures, _LIST, (Photometry,)),
    "history": (exported_part.history_pictures, _LIST, (Design,)),
    "sections": (exported_part.section_pictures, _LIST, (Design, Part)),
    "faults": (exported_part.fault_pictures, _LIST, (Check,)),
    "surfaces": (exported_part.surface_pictures, _ROWS, (Check,)),
    "verification": (exported_part.verification_pictures, _ROWS, (Design, Light, Proof)),
    "gaps": (exported_part.gap_pictures, _LIST, (Proof,)),
    "stray": (exported_part.stray_pictures, _ROWS, (Design, Light, StrayLight)),
}


def _pictures(results: Results) -> dict[str, object]:
    drawn = dict[str, object]()
    for name, (draw, drawn_as, kinds) in _PICTURES.items():
        shown = {stem: result for stem, result in results.found.items() if isinstance(result, kinds)}
        of = [name, results.lens.sha256, *((stem, result.sha256) for stem, result in shown.items())]
        drawn[name] = made_once(of, partial(draw, Results(results.lens, shown)), drawn_as)
    return drawn | {"other": light_section.other_pictures(results)}


def results_html(results: Results) -> str:
    """``results`` as HTML for the output of a notebook's cell: verdict, main facts, the light and a section."""
    first = light_section.first_picture(results)
    shown = [*([first] if first else []), exported_part.section_pictures(results)[0]]
    return template("notebook.html").render(
        name=results.spec.name,
        headline=headline.headline(results),
        facts=[*headline.required_facts(results), *headline.further_facts(results)],
        pictures=shown,
    )


def _solid(views: SolidViews) -> dict[str, object]:
    encoded = {name: base64.b64encode(picture).decode() for name, picture in views.pictures.items()}
    low_high = views.bounds_mm
    extent = [high - low for low, high in zip(low_high[::2], low_high[1::2], strict=True)]
    mesh = base64.b64encode(views.mesh).decode()
    return {"views": encoded, "mesh": mesh, "extent_mm": extent, "views_problem": views.problem}
