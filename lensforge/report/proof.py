"""Section on verification: the STEP as read back, rays through the exported part, its light against the design's."""

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.proof.proof_result import Proof, ReceiverProof
from lensforge.report import irradiance_figures
from lensforge.report.numerals import number, percent, unit_of_light
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.shown_receivers import numbered, suffix, top_of
from lensforge.results.chart import light_unit
from lensforge.runs.results import Results

Facts = list[tuple[str, str]]


def step_facts(results: Results) -> Facts:
    """The STEP and STL as read back from disk."""
    record = results.find(Part)
    if record is None:
        return []
    form, normal = record.form_error_nm, record.normal_error_mrad
    return [
        ("Form error of the optical faces", f"{number(form.max, 2)} nm largest, {number(form.rms, 2)} nm rms"),
        ("Error of their normals", f"{number(normal.max, 2)} mrad largest, {number(normal.rms, 2)} mrad rms"),
        ("Volume", f"{number(record.volume_mm3, 6)} mm³"),
        ("Mesh", f"{'watertight' if record.watertight else 'not watertight'}, genus {record.genus}"),
    ]


def cast_facts(results: Results) -> dict[str, Facts]:
    """The exported mesh against the design, by title: ray by ray, and against the converged light on each receiver."""
    record, light = results.find(Proof), results.find(Light)
    if record is None:
        return {}
    designed = {} if light is None else {each.name: each.efficiency.value for each in light.receivers}
    return {
        f"Rays through the exported mesh{suffix(record.receivers, index)}": [
            ("Rays", number(record.rays)),
            *receiver_facts(receiver, designed.get(receiver.name)),
        ]
        for index, receiver in enumerate(record.receivers)
    }


def receiver_facts(receiver: ReceiverProof, designed: float | None) -> Facts:
    """Facts on one receiver; ``designed``: efficiency of the design's light there."""
    deviation, quantity = receiver.deviation_mm, light_unit(None, far_field=receiver.far_field).quantity
    largest = "largest, at 1 m" if receiver.far_field else "largest"
    efficiency = percent(receiver.efficiency, 2)
    if designed is not None:
        efficiency += f"; the design has {percent(designed, 2)}"
    return [
        ("Landing, part against design", f"{number(deviation.rms, 3)} mm rms, {number(deviation.max, 3)} mm {largest}"),
        (f"NMSE against the design's {quantity}", number(receiver.nmse_vs_design, 3)),
        ("NMSE of the ray noise alone", number(receiver.noise_floor_nmse, 3)),
        ("NMSE against the design with the same rays", number(receiver.nmse_same_rays, 3)),
        ("Efficiency", efficiency),
    ]


def verification_pictures(results: Results) -> list[list[PagePicture]]:
    """Light of the design, of the part, and their difference, for each receiver."""
    proof = results.find(Proof)
    if proof is None:
        return []
    return [_receiver_pictures(results, proof, index) for index in range(len(proof.receivers))]


def _receiver_pictures(results: Results, proof: Proof, index: int) -> list[PagePicture]:
    receiver, on = proof.receivers[index], suffix(proof.receivers, index)
    chart, unit = receiver.chart, unit_of_light(results, far_field=receiver.far_field)
    design, part = receiver.design_irradiance, receiver.irradiance
    top = top_of([design, part])
    rays = f"{number(proof.rays)} rays cast through the exported mesh."
    noise = "Where the two agree, only the noise of the rays is left."
    draw, difference = irradiance_figures.irradiance_map, irradiance_figures.difference_map(part - design, chart, unit)
    return [
        picture(numbered("design", index), draw(design, chart, top, unit=unit), f"Design{on}"),
        picture(numbered("part", index), draw(part, chart, top, unit=unit), f"Exported part{on}", rays),
        picture(numbered("part-minus-design", index), difference, f"Part minus design{on}", noise),
    ]
