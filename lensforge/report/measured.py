"""Section on the measured part: a photograph of its light, and its measured surfaces, as facts and pictures."""

from dataclasses import dataclass

import numpy as np

from lensforge.made.measurement_result import Alignment, PhotoComparison, SurfaceComparison
from lensforge.report import irradiance_figures, line_figures, surface_figures
from lensforge.report.corrected import correction_facts, correction_pictures, light_changes
from lensforge.report.numerals import number, number_with_error, percent, unit_of_light
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.proof import Facts
from lensforge.report.shown_receivers import top_of
from lensforge.results import Metric
from lensforge.results.chart import LightUnit
from lensforge.runs.results import Results

# A photograph has no unit of light: both pictures are scaled to a mean of 1.
RELATIVE = LightUnit("irradiance", "mean = 1", 1.0)


@dataclass(frozen=True)
class Measured:
    """One measurement of the part: its heading, facts, and rows of pictures; the ``first`` facts are seen at once."""

    title: str
    facts: Facts
    rows: list[list[PagePicture]]
    first: int = 4


def measured(results: Results) -> list[Measured]:
    """Every measurement of the part; empty where there is none."""
    found, photo = [], results.find(PhotoComparison)
    if photo is not None:
        pictures = [photo_pictures(photo), _photo_lines(photo)]
        found.append(Measured("A photograph of its light", photo_facts(photo), pictures))
    for side, surface in results.surfaces.items():
        pictures = [_surface_pictures(results, surface)]
        found.append(Measured(f"The {side} surface, measured", surface_facts(surface), pictures))
    for side, made in results.corrections.items():
        title = f"The {side} surface, corrected for a second cut"
        found.append(Measured(title, correction_facts(made), [correction_pictures(made)]))
    return found


def photo_facts(photo: PhotoComparison) -> Facts:
    """Facts from the photograph of the part's light."""
    facts = [
        ("Photographs", photo.on if photo.off is None else f"{photo.on} minus {photo.off}"),
        ("Similarity (SSIM) to the simulation", number(photo.ssim, 3)),
        ("NMSE against the simulation", number(photo.nmse, 3)),
        *_alignment(photo.alignment),
        ("SSIM and NMSE once aligned", f"{number(photo.aligned.ssim, 3)}, {number(photo.aligned.nmse, 3)}"),
    ]
    found, expected = photo.measured_evenness.uniformity, photo.simulated_evenness.uniformity
    if found is not None:
        facts.append(("Uniformity, measured", f"{number(found, 3)}, simulated {number(expected, 3)}"))
    if photo.likely_cause:
        facts.append(("Likely cause", photo.likely_cause))
    facts.append(("Clipped by the camera", f"{percent(photo.clipped, 2)} of the target"))
    return [*facts, ("Target\u2019s corners", _corners(photo))]


def _alignment(found: Alignment) -> Facts:
    """Place, size and rotation of the light, with the digits that their errors carry; without what it cannot tell."""
    named = {
        "Displacement of the light along x": found.displacement_x_mm,
        "Displacement of the light along y": found.displacement_y_mm,
        "Size of the light over the simulated": found.scale,
        "Rotation of the light, counter-clockwise": found.rotation_deg,
    }
    facts = [(name, metric) for name, metric in named.items() if metric is not None]
    return [(name, f"{number_with_error(metric, 6)} {metric.unit}".rstrip()) for name, metric in facts]


def _corners(photo: PhotoComparison) -> str:
    located = photo.corners_located
    if located is None:
        return "given"
    where = {"on": "the photograph with the LED on", "off": "the photograph with the LED off"}
    seen = where.get(located.seen_in, located.seen_in)
    return f"found in {seen}, edges straight to {number(located.edge_rms_px, 2)} pixel rms"


def photo_pictures(photo: PhotoComparison) -> list[PagePicture]:
    """Simulation, photograph and their difference on one scale."""
    chart, top = photo.chart, top_of([photo.measured, photo.simulated])
    draw = irradiance_figures.irradiance_map
    difference = irradiance_figures.difference_map(photo.measured - photo.simulated, chart, RELATIVE)
    return [
        picture("photo-simulated", draw(photo.simulated, chart, top, unit=RELATIVE), "Simulated"),
        picture("photo-measured", draw(photo.measured, chart, top, unit=RELATIVE), "Photographed", "Rectified."),
        picture("photo-difference", difference, "Photographed minus simulated", "Red: brighter than simulated."),
    ]


def _photo_lines(photo: PhotoComparison) -> list[PagePicture]:
    return [
        picture(
            f"photo-line{index}",
            line_figures.line_comparison(
                line, photo.simulated, photo.measured, photo.chart, RELATIVE, ("simulated", "photographed")
            ),
            f"Along {name}",
        )
        for index, (name, line) in enumerate(line_figures.profile_lines(photo.simulated, photo.chart))
    ]


def surface_facts(surface: SurfaceComparison) -> Facts:
    """Facts from measured points on one surface, and the light with it."""
    form, design, part = surface.form_deviation_um, surface.design, surface.measured
    facts = [
        ("Points", f"{number(surface.point_count)}, {percent(surface.used_share)} of them on the surface"),
        ("Surface measured", percent(surface.covered_share)),
        ("Form deviation, smooth", f"PV {number(form.pv, 3)} µm, rms {number(form.rms, 3)} µm"),
        ("Residual of the points after it", f"{number(surface.residual_rms_um, 2)} µm rms"),
        ("Registration", {"none": "none, by datums"}.get(surface.registration, surface.registration)),
        ("Efficiency with this surface", f"{_share(part.efficiency)}, designed {_share(design.efficiency)}"),
        ("NMSE of the pattern with this surface", f"{_value(part.nmse)}, designed {_value(design.nmse)}"),
    ]
    facts += light_changes(surface.change)
    if design.uniformity is not None:
        facts.append(
            ("Uniformity with this surface", f"{_value(part.uniformity)}, designed {_value(design.uniformity)}")
        )
    return facts


def _share(metric: Metric) -> str:
    return percent(metric.value, 2)


def _value(metric: Metric | None) -> str:
    return number_with_error(metric, 3)


def _surface_pictures(results: Results, surface: SurfaceComparison) -> list[PagePicture]:
    """The form deviation, the light with the measured surface, and its change."""
    side, chart, unit = surface.surface, surface.light_chart, unit_of_light(results, far_field=surface.far_field)
    before, after = surface.irradiance_design, surface.irradiance_measured
    lit = irradiance_figures.irradiance_map(after, chart, top_of([before, after]), unit=unit)
    change = irradiance_figures.difference_map(after - before, chart, unit)
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
