"""The machined part: a photograph of its light, and what was measured of its surfaces, in words and pictures."""

from dataclasses import dataclass

import numpy as np

from lensforge.report import irradiance_figures, surface_figures
from lensforge.figures.light_unit import LightUnit, light_unit
from lensforge.report.numerals import number, percent
from lensforge.report.part_records import JudgedRecord, PhotoRecord
from lensforge.report.pictures import Picture, picture
from lensforge.report.proof import Facts
from lensforge.report.results import MeasuredSurface, Results

# A photograph has no unit of light: both pictures are scaled to a mean of 1.
RELATIVE = LightUnit("irradiance", "mean = 1", 1.0)


@dataclass(frozen=True)
class Measured:
    """One thing measured on the part: its heading, facts, and rows of pictures."""

    title: str
    facts: Facts
    rows: list[list[Picture]]


def measured(results: Results) -> list[Measured]:
    """All that was measured on the part; empty where nothing was."""
    found = []
    if results.photo is not None:
        pictures = [photo_pictures(results), _photo_lines(results)]
        found.append(Measured("A photograph of its light", photo_facts(results.photo), pictures))
    for side, surface in results.surfaces.items():
        pictures = [_surface_pictures(results, side, surface)]
        found.append(Measured(f"The {side} surface, measured", _surface_facts(surface), pictures))
    return found


def photo_facts(record: PhotoRecord) -> Facts:
    """What the photograph says of the part."""
    aside = " and ".join(f"{number(value, 2)} mm" for value in record.displacement_mm)
    facts = [
        ("Photographs", record.on if record.off is None else f"{record.on} less {record.off}"),
        ("Similarity (SSIM) to the simulation", number(record.ssim, 3)),
        ("NMSE against the simulation", number(record.nmse, 3)),
        ("The pattern lies aside along x and y by", aside),
        ("Brought back: SSIM, NMSE", f"{number(record.aligned.ssim, 3)}, {number(record.aligned.nmse, 3)}"),
    ]
    if record.measured.uniformity is not None:
        both = f"{number(record.measured.uniformity, 3)}, simulated {number(record.simulated.uniformity, 3)}"
        facts.append(("Uniformity, measured", both))
    facts.append(("Clipped by the camera", f"{percent(record.clipped, 2)} of the target"))
    return [*facts, ("Target\u2019s corners", _corners(record))]


def _corners(record: PhotoRecord) -> str:
    located = record.corners_located
    if located is None:
        return "given"
    where = {"--on": "the picture with the LED on", "--off": "the picture with the LED off"}
    seen = where.get(located.seen_in, located.seen_in)
    return f"found in {seen}, edges straight to {number(located.edge_rms_px, 2)} pixel rms"


def photo_pictures(results: Results) -> list[Picture]:
    """Simulation, photograph and their difference on one scale."""
    images, side = results.photo_images, results.lens.spec.target.receiver_mm
    if images is None:
        return []
    top = float(max(image.max() for image in images.values())) or 1.0
    draw = irradiance_figures.irradiance_map
    apart = irradiance_figures.difference_map(images["measured"] - images["simulated"], side, RELATIVE)
    return [
        picture("photo-simulated", draw(images["simulated"], side, top, unit=RELATIVE), "Simulated"),
        picture("photo-measured", draw(images["measured"], side, top, unit=RELATIVE), "Photographed", "Rectified."),
        picture("photo-apart", apart, "Photographed less simulated", "Red: brighter than simulated."),
    ]


def _photo_lines(results: Results) -> list[Picture]:
    images, side = results.photo_images, results.lens.spec.target.receiver_mm
    if images is None:
        return []
    return [
        picture(
            f"photo-line{index}",
            irradiance_figures.line_comparison(
                line, images["simulated"], images["measured"], side, RELATIVE, ("simulated", "photographed")
            ),
            f"Along {name}",
        )
        for index, (name, line) in enumerate(irradiance_figures.telling_lines(images["simulated"], side))
    ]


def _surface_facts(surface: MeasuredSurface) -> Facts:
    record = surface.record
    form = record.form_deviation_um
    facts = [
        ("Points", f"{number(record.points)}, {percent(record.used_share)} of them over the surface"),
        ("Surface measured", percent(record.covered_share)),
        ("Form deviation, smooth", f"PV {number(form.pv, 3)} µm, rms {number(form.rms, 3)} µm"),
        ("Left of the points beside it", f"{number(record.residual_rms_um, 2)} µm rms"),
        ("Registration", {"none": "none, by datums"}.get(record.registration, record.registration)),
        ("Efficiency with it", _change(record.design, record.measured, "efficiency")),
        ("NMSE of the pattern with it", _change(record.design, record.measured, "nmse")),
    ]
    if record.design.uniformity is not None:
        facts.append(("Uniformity with it", _change(record.design, record.measured, "uniformity")))
    return facts


def _change(design: JudgedRecord, part: JudgedRecord, name: str) -> str:
    before, after = getattr(design, name), getattr(part, name)
    show = (lambda value: percent(value, 2)) if name == "efficiency" else (lambda value: number(value, 3))
    return f"{show(after)}, designed {show(before)}"


def _surface_pictures(results: Results, side: str, surface: MeasuredSurface) -> list[Picture]:
    """The form deviation, the light that the measured surface makes, and what it changes."""
    pictures, form, light = [], surface.form, surface.light
    if form is not None:
        outward = "Red: too much material." if side == "outer" else "Red: too little material."
        figure = surface_figures.form_map(np.transpose(form["deviation_um"]))
        pictures.append(picture(f"form-{side}", figure, "Form deviation", f"Along the normal. {outward}"))
    if light is not None:
        width, unit = results.lens.spec.target.receiver_mm, light_unit(results.lens.spec)
        before, after = light["irradiance_design"], light["irradiance_measured"]
        top = float(max(before.max(), after.max())) or 1.0
        lit = irradiance_figures.irradiance_map(after, width, top, unit=unit)
        change = irradiance_figures.difference_map(after - before, width, unit)
        rays = f"Simulated with the measured {side} surface, {number(surface.record.rays)} rays."
        pictures.append(picture(f"lit-{side}", lit, "The light it makes", rays))
        same = "The same rays through both. Red: brighter than designed."
        pictures.append(picture(f"changed-{side}", change, "Its light less the design\u2019s", same))
    return pictures
