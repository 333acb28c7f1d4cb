"""Section of the report on the measured part: a photograph of its light, its measured and its corrected faces."""

from dataclasses import dataclass

import numpy as np

from lensforge.made.correction_result import Correction
from lensforge.made.measurement_result import PhotoComparison, SurfaceComparison
from lensforge.report import light_figures
from lensforge.report.light_section import top_of, unit_of_light
from lensforge.report.page import PagePicture, picture
from lensforge.report.results import Results
from lensforge.results import Group
from lensforge.results.chart import LightUnit
from lensforge.results.numerals import number
from lensforge.shop import surface_figures

# A photograph has no unit of light: both pictures are scaled to a mean of 1.
RELATIVE = LightUnit("irradiance", "mean = 1", 1.0)


@dataclass(frozen=True)
class MeasuredSection:
    """One measurement of the part: its facts and rows of pictures."""

    group: Group
    rows: list[list[PagePicture]]


def measured_sections(results: Results) -> list[MeasuredSection]:
    """Every measurement of the part; empty where there is none."""
    found, photo = [], results.find(PhotoComparison)
    if photo is not None:
        found.append(_section(results, photo, photo_pictures(photo), _photo_lines(photo)))
    for surface in results.surfaces.values():
        found.append(_section(results, surface, _surface_pictures(results, surface)))
    for made in results.corrections.values():
        found.append(_section(results, made, correction_pictures(made)))
    return found


def _section(
    results: Results, result: PhotoComparison | SurfaceComparison | Correction, *rows: list[PagePicture]
) -> MeasuredSection:
    (group,) = results.facts(result)
    return MeasuredSection(group, list(rows))


def photo_pictures(photo: PhotoComparison) -> list[PagePicture]:
    """Simulation, photograph and their difference on one scale."""
    chart, top = photo.chart, top_of([photo.measured, photo.simulated])
    draw = light_figures.irradiance_map
    difference = light_figures.difference_map(photo.measured - photo.simulated, chart, RELATIVE)
    return [
        picture("photo-simulated", draw(photo.simulated, chart, top, unit=RELATIVE), "Simulated"),
        picture("photo-measured", draw(photo.measured, chart, top, unit=RELATIVE), "Photographed", "Rectified."),
        picture("photo-difference", difference, "Photographed minus simulated", "Red: brighter than simulated."),
    ]


def _photo_lines(photo: PhotoComparison) -> list[PagePicture]:
    return [
        picture(
            f"photo-line{index}",
            light_figures.line_comparison(
                line, photo.simulated, photo.measured, photo.chart, RELATIVE, ("simulated", "photographed")
            ),
            f"Along {name}",
        )
        for index, (name, line) in enumerate(light_figures.profile_lines(photo.simulated, photo.chart))
    ]


def correction_pictures(made: Correction) -> list[PagePicture]:
    """Maps of the deviation, the correction, and the deviation expected of the second cut."""
    maps = {
        "first": (made.deviation_map_um, "Deviation of the first cut"),
        "correction": (made.correction_map_um, "Correction"),
        "second": (made.expected_map_um, "Expected deviation of the second cut"),
    }
    return [
        picture(
            f"{name}-cut-{made.surface}", surface_figures.form_map(np.transpose(values)), title, "Along the normal."
        )
        for name, (values, title) in maps.items()
        if np.isfinite(values).any()
    ]


def _surface_pictures(results: Results, surface: SurfaceComparison) -> list[PagePicture]:
    """The form deviation, the light with the measured surface, and its change."""
    side, chart, unit = surface.surface, surface.light_chart, unit_of_light(results, far_field=surface.far_field)
    before, after = surface.irradiance_design, surface.irradiance_measured
    lit = light_figures.irradiance_map(after, chart, top_of([before, after]), unit=unit)
    change = light_figures.difference_map(after - before, chart, unit)
    outward = "Red: too much material." if side == "outer" else "Red: too little material."
    rays = f"Simulated with the measured {side} surface, {number(surface.rays)} rays."
    same = "The same rays through both. Red: brighter than designed."
    pictures = [
        picture(f"lit-{side}", lit, "Simulated light", rays),
        picture(f"changed-{side}", change, "Simulated light minus the design\u2019s", same),
    ]
    if np.isfinite(surface.deviation_um).any():
        form = surface_figures.form_map(np.transpose(surface.deviation_um))
        pictures.insert(0, picture(f"form-{side}", form, "Form deviation", f"Along the normal. {outward}"))
    return pictures
