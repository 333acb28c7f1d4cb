"""Section on verification: the STEP as read back, rays through the exported part, its light against the design's."""

from lensforge.evaluation.light import Light
from lensforge.geometry.part import Part
from lensforge.report import irradiance_figures
from lensforge.report.numerals import number, percent, unit_of_light
from lensforge.report.pictures import PagePicture, picture
from lensforge.results import Results
from lensforge.verification.proof import Proof

Facts = list[tuple[str, str]]


def step_facts(results: Results) -> Facts:
    """The STEP and STL as read back from disk."""
    record = results.find(Part)
    if record is None:
        return []
    form, normal = record.form_error_nm, record.normal_error_mrad
    return [
        ("Form error of the optical faces", f"{number(form.max, 3)} nm largest, {number(form.rms, 3)} nm rms"),
        ("Error of their normals", f"{number(normal.max, 3)} mrad largest, {number(normal.rms, 3)} mrad rms"),
        ("Volume", f"{number(record.volume_mm3, 6)} mm³"),
        ("Mesh", f"{'watertight' if record.watertight else 'not watertight'}, genus {record.genus}"),
    ]


def cast_facts(results: Results) -> Facts:
    """The exported mesh against the design: ray by ray, and against the converged irradiance."""
    record, light = results.find(Proof), results.find(Light)
    if record is None:
        return []
    deviation = record.deviation_mm
    efficiency = percent(record.efficiency, 2)
    if light is not None:
        efficiency += f"; the design has {percent(light.efficiency.value, 2)}"
    return [
        ("Rays", number(record.rays)),
        ("Landing, part against design", f"{number(deviation.rms, 3)} mm rms, {number(deviation.max, 3)} mm largest"),
        ("NMSE against the design's irradiance", number(record.nmse_vs_design, 3)),
        ("NMSE of the ray noise alone", number(record.noise_floor_nmse, 3)),
        ("NMSE against the design with the same rays", number(record.nmse_same_rays, 3)),
        ("Efficiency", efficiency),
    ]


def verification_pictures(results: Results) -> list[PagePicture]:
    """Irradiance of the design, of the part, and their difference."""
    proof = results.find(Proof)
    if proof is None:
        return []
    side, unit = results.spec.target.receiver_mm, unit_of_light(results)
    design, part = proof.design_irradiance, proof.irradiance
    top = float(max(design.max(), part.max())) or 1.0
    rays = f"{number(proof.rays)} rays cast through the exported mesh."
    noise = "Where the two agree, only the noise of the rays is left."
    draw, difference = irradiance_figures.irradiance_map, irradiance_figures.difference_map(part - design, side, unit)
    return [
        picture("design", draw(design, side, top, unit=unit), "Design"),
        picture("part", draw(part, side, top, unit=unit), "Exported part", rays),
        picture("part-minus-design", difference, "Part minus design", noise),
    ]
