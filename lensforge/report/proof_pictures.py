"""Pictures of the proof: the part's light against the design's, how far rays land off, and the light gone astray."""

from lensforge.report import flux_figures, irradiance_figures, proof_figures
from lensforge.report.numerals import number, percent
from lensforge.report.pictures import Picture, picture
from lensforge.report.task import unit_of_light
from lensforge.results import Results
from lensforge.verification.proof import Proof, StrayFlux, StrayLight

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
    proof = results.find(Proof)
    if proof is None:
        return []
    side, unit = results.spec.target.receiver_mm, unit_of_light(results.spec)
    design, part = proof.design_irradiance, proof.irradiance
    top = float(max(design.max(), part.max())) or 1.0
    rays = f"{number(proof.rays)} rays cast through the exported mesh."
    noise = "What is left where the two agree is the noise of the rays."
    draw, difference = irradiance_figures.irradiance_map, irradiance_figures.difference_map(part - design, side, unit)
    return [
        picture("design", draw(design, side, top, unit=unit), "Design"),
        picture("part", draw(part, side, top, unit=unit), "Exported part", rays),
        picture("part-less-design", difference, "Part less design", noise),
    ]


def gap_pictures(results: Results) -> list[Picture]:
    """How far from the design's landings each referee puts the rays."""
    proof = results.find(Proof)
    if proof is None:
        return []
    named = {
        "exported mesh": proof.gaps_mesh_mm,
        "STEP file": proof.gaps_step_mm,
        "mesh, by Mitsuba": proof.gaps_mitsuba_mm,
    }
    gaps = {name: quantiles for name, quantiles in named.items() if quantiles is not None}
    limit = next((gate.limit for gate in proof.gates if gate.name == "deviation_rms"), None)
    figure = proof_figures.gap_figure(gaps, limit)
    caption = "Share of the rays that land no farther than this from where the design sends them."
    return [picture("gaps", figure, "Ray by ray", caption)]


def stray_pictures(results: Results) -> list[Picture]:
    """Where the light goes that the design does not follow, in one account and on the receiver."""
    stray = results.find(StrayLight)
    if stray is None:
        return []
    side, unit, peak = stray.receiver_mm, unit_of_light(results.spec), float(stray.stray.max())
    scattered = irradiance_figures.irradiance_map(stray.stray, side, peak or 1.0, unit=unit)
    spread, caption = stray.spread, "No stray light lands on the receiver."
    if spread.rms_radius_mm is not None and spread.peak_of_mean is not None:
        caption = (
            f"A scale of its own: its peak is {percent(spread.peak_of_mean)} of the mean light on the receiver. "
            f"Rms distance from its centroid: {number(spread.rms_radius_mm, 3)} mm."
        )
    whole = irradiance_figures.difference_map(stray.direct + stray.stray - stray.sequential, side, unit)
    account = flux_figures.waterfall(_lost(stray.flux), _kept(stray))
    return [
        picture("stray-account", account, "Where all of the light ends", "Green: what the window gets."),
        picture("stray-light", scattered, "Stray light on the receiver", caption),
        picture("misjudged", whole, "All light less the design's model", "Red: the design foretells too little."),
    ]


def _kept(stray: StrayLight) -> list[tuple[str, float]]:
    by_cause = stray.detected_stray_by_cause.model_dump().items()
    causes = [(f"stray: {_CAUSES.get(name, name)}", share) for name, share in by_cause if share > 0.0]
    return [("detected as designed", stray.flux.detected_direct), *causes]


def _lost(flux: StrayFlux) -> list[tuple[str, float]]:
    return [(words, getattr(flux, name)) for name, words in _ENDS.items() if getattr(flux, name) > 0.0]


def stray_sentence(results: Results) -> str:
    """How much flux the sequential design misjudges, in words."""
    stray = results.find(StrayLight)
    if stray is None:
        return ""
    gain = stray.efficiency - stray.efficiency_sequential
    nmse = "" if stray.nmse_vs_sequential is None else f", an NMSE of {number(stray.nmse_vs_sequential, 2)}"
    return (
        f"The design follows each ray once in and once out. Followed through all reflections ({number(stray.rays)} "
        f"rays, {stray.base} base, absorption {stray.absorption_per_mm:g} per mm), "
        f"{percent(stray.flux.detected_stray, 2)} of the emitted flux lands in the window as stray light, "
        f"{percent(stray.flux.absorbed, 2)} is absorbed, and the efficiency is "
        f"{percent(stray.efficiency, 2)} instead of {percent(stray.efficiency_sequential, 2)} "
        f"({'+' if gain >= 0.0 else '−'}{number(abs(100.0 * gain), 2)} points). "
        f"On the receiver the sequential model misjudges {percent(stray.misjudged_flux, 2)} of the flux{nmse}."
    )
