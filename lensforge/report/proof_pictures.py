"""Pictures of the proof: the part's light against the design's, how far rays land off, and the light gone astray."""

from lensforge.report import flux_figures, irradiance_figures, proof_figures
from lensforge.figures.light_unit import light_unit
from lensforge.report.numerals import number, percent
from lensforge.report.pictures import Picture, picture
from lensforge.report.results import Results

_CAUSES = {
    "inner_reflection": "reflected at the cavity",
    "outer_reflection": "reflected inside the outer face",
    "total_reflection": "totally reflected",
    "base": "by way of the base",
    "met_again": "met the lens again",
}
_ENDS = {
    "outside_direct": "landed outside the window",
    "outside_stray": "stray, outside the window",
    "backward": "back to the board",
    "absorbed": "absorbed in the lens",
    "base": "taken by the base",
    "too_dim": "too dim to be followed",
    "leaked": "leaked at the mesh's edges",
}


def verification_pictures(results: Results) -> list[Picture]:
    """The design's picture, the part's, and their difference."""
    if results.verify is None or results.verified is None:
        return []
    side, unit = results.lens.spec.target.receiver_mm, light_unit(results.lens.spec)
    design, part = results.verified["design_irradiance"], results.verified["irradiance"]
    top = float(max(design.max(), part.max())) or 1.0
    rays = f"{number(results.verify.rays)} rays cast through the exported mesh."
    noise = "What is left where the two agree is the noise of the rays."
    draw, difference = irradiance_figures.irradiance_map, irradiance_figures.difference_map(part - design, side, unit)
    return [
        picture("design", draw(design, side, top, unit=unit), "Design"),
        picture("part", draw(part, side, top, unit=unit), "Exported part", rays),
        picture("part-less-design", difference, "Part less design", noise),
    ]


def gap_pictures(results: Results) -> list[Picture]:
    """How far from the design's landings each referee puts the rays."""
    if not results.gaps or results.verify is None:
        return []
    names = {"gaps_mesh_mm": "exported mesh", "gaps_step_mm": "STEP file", "gaps_mitsuba_mm": "mesh, by Mitsuba"}
    gaps = {names[key]: values for key, values in results.gaps.items()}
    limit = next((gate.limit for gate in results.verify.gates if gate.name == "deviation_rms"), None)
    figure = proof_figures.gap_figure(gaps, limit)
    caption = "Share of the rays that land no farther than this from where the design sends them."
    return [picture("gaps", figure, "Ray by ray", caption)]


def stray_pictures(results: Results) -> list[Picture]:
    """Where the light goes that the design does not follow, in one account and on the receiver."""
    record, images = results.stray, results.stray_images
    if record is None:
        return []
    stray = {name: share for name, share in record.detected_stray_by_cause.items() if share > 0.0}
    kept = [("detected as designed", record.flux.get("detected_direct", 0.0))]
    kept += [(f"stray: {_CAUSES.get(name, name)}", share) for name, share in stray.items()]
    lost = [(_ENDS.get(name, name), share) for name, share in _lost(record.flux).items() if share > 0.0]
    account = flux_figures.waterfall(lost, kept)
    pictures = [picture("stray-account", account, "Where all of the light ends", "Green: what the window gets.")]
    if images is None:
        return pictures
    side, unit = results.lens.spec.target.receiver_mm, light_unit(results.lens.spec)
    spread, peak = record.stray, float(images["stray"].max())
    scattered = irradiance_figures.irradiance_map(images["stray"], side, peak or 1.0, unit=unit)
    caption = "No stray light lands on the receiver."
    if spread.rms_radius_mm is not None and spread.peak_of_mean is not None:
        caption = (
            f"A scale of its own: its peak is {percent(spread.peak_of_mean)} of the mean light on the receiver. "
            f"Rms distance from its centroid: {number(spread.rms_radius_mm, 3)} mm."
        )
    change = images["direct"] + images["stray"] - images["sequential"]
    whole = irradiance_figures.difference_map(change, side, unit)
    return [
        *pictures,
        picture("stray-light", scattered, "Stray light on the receiver", caption),
        picture("misjudged", whole, "All light less the design's model", "Red: the design foretells too little."),
    ]


def _lost(flux: dict[str, float]) -> dict[str, float]:
    return {name: share for name, share in flux.items() if not name.startswith("detected")}


def stray_sentence(results: Results) -> str:
    """How much flux the sequential design misjudges, in words."""
    record = results.stray
    if record is None:
        return ""
    gain = record.efficiency - record.efficiency_sequential
    nmse = "" if record.nmse_vs_sequential is None else f", an NMSE of {number(record.nmse_vs_sequential, 2)}"
    return (
        f"The design follows each ray once in and once out. Followed through all reflections ({number(record.rays)} "
        f"rays, {record.base} base, absorption {record.absorption_per_mm:g} per mm), "
        f"{percent(record.flux['detected_stray'], 2)} of the emitted flux lands in the window as stray light, "
        f"{percent(record.flux['absorbed'], 2)} is absorbed, and the efficiency is "
        f"{percent(record.efficiency, 2)} instead of {percent(record.efficiency_sequential, 2)} "
        f"({'+' if gain >= 0.0 else '−'}{number(abs(100.0 * gain), 2)} points). "
        f"On the receiver the sequential model misjudges {percent(record.misjudged_flux, 2)} of the flux{nmse}."
    )
