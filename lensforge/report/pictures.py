"""Pictures of lens, faces and search with their titles and captions, as the page shows them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from lensforge.report import search_figures, section_figures, surface_figures
from lensforge.report.figure_style import to_svg
from lensforge.report.numerals import number, percent, unit_of_light
from lensforge.report.snapshots import Snapshot
from lensforge.report.surface_figures import ChartMap
from lensforge.runs.results import Results
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check, FaceResult
from lensforge.sources.build_source import build_source
from lensforge.spec.source_sections import SquareSource


@dataclass(frozen=True)
class PagePicture:
    """A figure as SVG, a short title and a caption."""

    svg: str
    title: str
    caption: str


def picture(name: str, figure: Figure, title: str, caption: str = "") -> PagePicture:
    """``figure`` for a page; ``name`` must be unique on the page."""
    return PagePicture(to_svg(figure, name, title), title, caption)


def history_pictures(results: Results) -> list[PagePicture]:
    """Merit function, pattern error, efficiency and constraints over the search."""
    design = results.find(Design)
    if design is None or not any(level.nmse for level in design.history):
        return []
    levels, draw = design.history, search_figures.history
    total = "Minimised by the optimiser: the error of the pattern plus the penalties of constraints and bounds."
    free = "Numbers above: free basis functions of each surface."
    least = "Least clearance of the cavity, thickness and radius over the lens. Below 0 (red) a constraint is violated."
    return [
        picture("loss", draw(levels, "loss"), "Merit function by level", total),
        picture("error", draw(levels, "nmse"), "Pattern error by level", free),
        picture("efficiency", draw(levels, "efficiency"), "Efficiency by level"),
        picture("margins", search_figures.constraint_history(levels), "Constraints by level", least),
    ]


def snapshot_pictures(results: Results, taken: Sequence[Snapshot]) -> list[PagePicture]:
    """Snapshots of the levels of the search, all on one scale."""
    unit = unit_of_light(results)
    steepest = max((float(np.abs(each.slope).max()) for each in taken), default=None)
    top = max((float(each.irradiance.max()) for each in taken), default=None)
    return [
        picture(
            f"level{each.level}",
            search_figures.snapshot_figure(
                each.surface_mm, each.slope, each.irradiance, each.chart, unit, steepest=steepest, top=top
            ),
            f"Level {each.level}: {each.functions} functions",
            f"After step {each.step}: NMSE {number(each.nmse, 3)}, efficiency {percent(each.efficiency)}.",
        )
        for each in taken
    ]


def section_pictures(results: Results) -> list[PagePicture]:
    """The lens in two sections."""
    outline = source_outline(results)
    return [
        picture(
            f"section{azimuth:.0f}",
            section_figures.lens_section(results.lens, azimuth, outline),
            f"Section at φ = {azimuth:.0f}°",
        )
        for azimuth in (0.0, 90.0)
    ]


def source_outline(results: Results) -> Float[np.ndarray, "k 3"] | None:
    """A polygon (mm) around the emitting area: from the design's record, or from the spec where that says it."""
    source, design = results.spec.source, results.find(Design)
    if design is not None and design.source_outline_mm:
        return np.array(design.source_outline_mm, dtype=np.float64)
    return build_source(source).outline() if isinstance(source, SquareSource) else None


def surface_pictures(results: Results) -> list[list[PagePicture]]:
    """Sag, curvature and uncut material, for each face."""
    check = results.find(Check)
    if check is None:
        return []
    return [
        _face_pictures("inner", check.inner, check.inner_sag_mm, check.inner_kappa_min, check.inner_residual_mm),
        _face_pictures("outer", check.outer, check.outer_sag_mm, check.outer_kappa_min, check.outer_residual_mm),
    ]


def _face_pictures(name: str, face: FaceResult, sag: ChartMap, kappa: ChartMap, left: ChartMap) -> list[PagePicture]:
    sphere, cutter = face.best_fit_sphere, face.cutter
    pv, rms, radius = number(sphere.pv_mm, 4), number(sphere.rms_mm, 4), number(sphere.radius_mm, 5)
    face_name, pictures = f"{name.capitalize()} face", []
    if np.isfinite(sag).any():
        caption = f"Best-fit sphere R = {radius} mm; PV {pv} mm, rms {rms} mm."
        title = f"{face_name}: departure from a sphere"
        pictures.append(picture(f"sag-{name}", surface_figures.sag_map(sag), title, caption))
    if np.isfinite(kappa).any():
        caption = f"Concave is negative. Line: −1/R of the mill, R = {cutter.radius_mm:g} mm."
        drawn = surface_figures.curvature_map(kappa, cutter.radius_mm)
        pictures.append(picture(f"curvature-{name}", drawn, f"{face_name}: curvature", caption))
    if (left > 0.0).any():
        caption = f"The mill reaches {percent(cutter.reachable_fraction, 2)} of the face (grey)."
        pictures.append(
            picture(f"uncut-{name}", surface_figures.uncut_map(left), f"{face_name}: left uncut by the mill", caption)
        )
    return pictures
