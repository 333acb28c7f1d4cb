"""Section on stray light: the flux budget with all reflections, and the stray light on the receiver."""

from lensforge.report import flux_figures, irradiance_figures
from lensforge.report.numerals import number, percent, unit_of_light
from lensforge.report.pictures import PagePicture, picture
from lensforge.results import Results
from lensforge.verification.proof import StrayFlux, StrayLight

_CAUSES = {
    "inner_reflection": "reflected at the cavity",
    "outer_reflection": "reflected inside the outer face",
    "total_reflection": "totally reflected",
    "base": "by the base",
    "met_again": "met the lens again",
}
_ENDS = {
    "outside_direct": "landed outside the window",
    "outside_stray": "stray, outside the window",
    "backward": "back to the board",
    "absorbed": "absorbed in the lens",
    "base": "absorbed by the base",
    "too_dim": "below the flux cut-off",
    "leaked": "leaked at the mesh's edges",
}


def stray_pictures(results: Results) -> list[PagePicture]:
    """Flux budget with all reflections, stray light on the receiver, and all light minus the design's model."""
    stray = results.find(StrayLight)
    if stray is None:
        return []
    side, unit, peak = stray.receiver_mm, unit_of_light(results), float(stray.stray.max())
    scattered = irradiance_figures.irradiance_map(stray.stray, side, peak or 1.0, unit=unit)
    spread, caption = stray.spread, "No stray light lands on the receiver."
    if spread.rms_radius_mm is not None and spread.peak_of_mean is not None:
        caption = (
            f"On its own scale: its peak is {percent(spread.peak_of_mean)} of the mean light on the receiver. "
            f"Rms distance from its centroid: {number(spread.rms_radius_mm, 3)} mm."
        )
    difference = irradiance_figures.difference_map(stray.direct + stray.stray - stray.sequential, side, unit)
    budget = flux_figures.waterfall(_lost(stray.flux), _kept(stray))
    return [
        picture("stray-budget", budget, "Flux budget with all reflections", "Green: detected in the window."),
        picture("stray-light", scattered, "Stray light on the receiver", caption),
        picture("unmodelled", difference, "All light minus the design's model", "Red: the design predicts too little."),
    ]


def _kept(stray: StrayLight) -> list[tuple[str, float]]:
    by_cause = stray.detected_stray_by_cause.model_dump().items()
    causes = [(f"stray: {_CAUSES.get(name, name)}", share) for name, share in by_cause if share > 0.0]
    return [("detected as designed", stray.flux.detected_direct), *causes]


def _lost(flux: StrayFlux) -> list[tuple[str, float]]:
    return [(words, getattr(flux, name)) for name, words in _ENDS.items() if getattr(flux, name) > 0.0]


def stray_sentence(results: Results) -> str:
    """Sentence on the flux that the sequential design does not model."""
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
        f"On the receiver the sequential model is wrong by {percent(stray.misplaced_flux, 2)} of the flux{nmse}."
    )
