"""Pictures of the machined part: of its light, of its measured faces, and of a face corrected for a second cut."""

import numpy as np

from lensforge.addons.measure.measurement_result import Correction, PhotoComparison, SurfaceComparison
from lensforge.optics.face_roles import CAVITY
from lensforge.report import light_figures
from lensforge.report.added_section import OnPlace, Place, shown_on_page
from lensforge.report.light_section import line_pictures, top_of, unit_of_light
from lensforge.report.page import PagePicture, picture
from lensforge.report.results import Results
from lensforge.results.chart import LightUnit
from lensforge.results.numerals import number
from lensforge.shop import surface_figures

# A photograph has no unit of light: both pictures are scaled to a mean of 1.
RELATIVE = LightUnit("irradiance", "mean = 1", 1.0)


_SHOWN_CAVITIES = 8
MEASURED = Place("measured", "Measured part", "The measured part")


@shown_on_page.register
def _photo_on_page(photo: PhotoComparison, results: Results) -> OnPlace:
    lit = (photo.simulated, photo.measured)
    labels = ("simulated", "photographed")
    lines = line_pictures(lambda name: f"photo-{name}", lit, photo.chart, RELATIVE, labels)
    return OnPlace(MEASURED, [photo_pictures(photo), lines])


@shown_on_page.register
def _surface_on_page(surface: SurfaceComparison, results: Results) -> OnPlace:
    return OnPlace(MEASURED, [_surface_pictures(results, surface), _parts_pictures(surface)])


@shown_on_page.register
def _correction_on_page(made: Correction, results: Results) -> OnPlace:
    return OnPlace(MEASURED, [correction_pictures(made)])


def photo_pictures(photo: PhotoComparison) -> list[PagePicture]:
    """Simulation, photograph and their difference on one scale."""
    chart = photo.chart
    top = top_of([photo.measured, photo.simulated])
    draw = light_figures.irradiance_map
    difference = light_figures.difference_map(photo.measured - photo.simulated, chart, RELATIVE)
    return [
        picture("photo-simulated", draw(photo.simulated, chart, top, unit=RELATIVE), "Simulated"),
        picture("photo-measured", draw(photo.measured, chart, top, unit=RELATIVE), "Photographed", "Rectified."),
        picture("photo-difference", difference, "Photographed minus simulated", "Red: brighter than simulated."),
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


def _parts_pictures(surface: SurfaceComparison) -> list[PagePicture]:
    """Scatter of several parts, and the mean of each cavity, of many those that are farthest from the common face."""
    series = surface.series
    if series is None:
        return []
    draw = surface_figures.form_map
    scatter = draw(np.transpose(series.scatter_map_um))
    note = "Standard deviation of a part, along the normal."
    pictures = [picture(f"scatter-{surface.surface}", scatter, "Repeatability", note)]
    by_distance = sorted(series.cavities, key=lambda cavity: -cavity.apart_um)[:_SHOWN_CAVITIES]
    for place, cavity in enumerate(cavity for cavity in by_distance if len(series.cavities) > 1):
        mean = draw(np.transpose(cavity.map_um))
        title = f"Mean deviation, {cavity.cavity}"
        pictures.append(picture(f"cavity-{place}-{surface.surface}", mean, title, "Along the normal."))
    return pictures


def _surface_pictures(results: Results, surface: SurfaceComparison) -> list[PagePicture]:
    """The form deviation, the light with the measured surface, and its change."""
    side = surface.surface
    chart = surface.light_chart
    unit = unit_of_light(results, far_field=surface.far_field)
    before = surface.irradiance_design
    after = surface.irradiance_measured
    lit = light_figures.irradiance_map(after, chart, top_of([before, after]), unit=unit)
    change = light_figures.difference_map(after - before, chart, unit)
    much = "little" if results.lens.body.face(side).before == CAVITY else "much"
    along = f"Along the normal. Red: too {much} material."
    led = f" and the LED {next(iter(surface.by_led))}" if surface.by_led else ""
    rays = f"Simulated with the measured {side} surface{led}, {number(surface.rays)} rays."
    same = "The same rays through both. Red: brighter than designed."
    pictures = [
        picture(f"lit-{side}", lit, "Simulated light", rays),
        picture(f"changed-{side}", change, "Simulated light minus the design\u2019s", same),
    ]
    if np.isfinite(surface.deviation_um).any():
        form = surface_figures.form_map(np.transpose(surface.deviation_um))
        pictures.insert(0, picture(f"form-{side}", form, "Form deviation", along))
    return pictures
