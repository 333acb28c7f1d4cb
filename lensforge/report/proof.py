"""What the exported files were shown to be, in two short tables: the STEP as read back, and the part under rays."""

from lensforge.evaluation.light import Light
from lensforge.geometry.part import Part
from lensforge.report.numerals import number, percent
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
    """The exported mesh against the design, under the same rays and against the converged picture."""
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
        ("NMSE against the design's picture", number(record.nmse_vs_design, 3)),
        ("NMSE that the noise of so many rays makes", number(record.noise_floor_nmse, 3)),
        ("NMSE against the design under the same rays", number(record.nmse_same_rays, 3)),
        ("Efficiency", efficiency),
    ]
