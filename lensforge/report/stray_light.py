"""Section on stray light: the flux budget with all reflections, and the stray light on the receiver."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from lensforge.proof.stray_result import ReceiverStray, StrayFlux, StrayLight
from lensforge.report import flux_figures, irradiance_figures
from lensforge.report.numerals import number, percent, unit_of_light
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.shown_receivers import numbered, suffix, top_of
from lensforge.runs.results import Results

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
    "cover_glass": "lost in the cover glass",
    "base": "absorbed by the base",
    "too_dim": "below the flux cut-off",
    "leaked": "leaked at the mesh's edges",
}


def stray_pictures(results: Results) -> list[list[PagePicture]]:
    """Flux budget with all reflections, stray light, and all light minus the design's model, for each receiver."""
    stray = results.find(StrayLight)
    if stray is None:
        return []
    return [_receiver_pictures(results, stray, index) for index in range(len(stray.receivers))]


def _receiver_pictures(results: Results, stray: StrayLight, index: int) -> list[PagePicture]:
    receiver, on = stray.receivers[index], suffix(stray.receivers, index)
    chart, unit = receiver.chart, unit_of_light(results, far_field=receiver.far_field)
    scattered = irradiance_figures.irradiance_map(receiver.stray, chart, top_of([receiver.stray]), unit=unit)
    difference = irradiance_figures.difference_map(receiver.direct + receiver.stray - receiver.sequential, chart, unit)
    budget = stray_budget(receiver)
    detected, less = "Green: detected in the window.", "Red: the design predicts too little."
    title = f"All light minus the design's model{on}"
    return [
        picture(numbered("stray-budget", index), budget, f"Flux budget with all reflections{on}", detected),
        picture(numbered("stray-light", index), scattered, f"Stray light on the receiver{on}", _spread(receiver)),
        picture(numbered("unmodelled", index), difference, title, less),
    ]


def stray_budget(stray: ReceiverStray) -> Figure:
    """A waterfall from the emitted flux through each loss to what is detected, as designed and as stray light."""
    return flux_figures.waterfall(_lost(stray.flux), _kept(stray))


def _spread(receiver: ReceiverStray) -> str:
    """Strength and width of the stray light on one receiver."""
    spread, chart = receiver.spread, receiver.chart
    if spread.rms_radius is None or spread.peak_of_mean is None:
        return "No stray light lands on the receiver."
    return (
        f"On its own scale: its peak is {percent(spread.peak_of_mean)} of the mean light on the receiver. "
        f"Rms distance from its centroid: {number(chart.labelled(spread.rms_radius), 3)} {chart.unit}."
    )


def _kept(stray: ReceiverStray) -> list[tuple[str, float]]:
    by_cause = stray.detected_stray_by_cause.model_dump().items()
    causes = [(f"stray: {_CAUSES.get(name, name)}", share) for name, share in by_cause if share > 0.0]
    return [("detected as designed", stray.flux.detected_direct), *causes]


def _lost(flux: StrayFlux) -> list[tuple[str, float]]:
    return [(words, getattr(flux, name)) for name, words in _ENDS.items() if getattr(flux, name) > 0.0]


def stray_sentence(results: Results) -> str:
    """Sentences on the flux that the sequential design does not model, for each receiver."""
    stray = results.find(StrayLight)
    if stray is None:
        return ""
    first = (
        f"The design follows each ray once in and once out. Followed through all reflections ({number(stray.rays)} "
        f"rays, {stray.base} base, absorption {stray.absorption_per_mm:g} per mm), "
    )
    return first + " ".join(_sentence(stray.receivers, index) for index in range(len(stray.receivers)))


def _sentence(receivers: Sequence[ReceiverStray], index: int) -> str:
    stray = receivers[index]
    gain = stray.efficiency - stray.efficiency_sequential
    nmse = "" if stray.nmse_vs_sequential is None else f", an NMSE of {number(stray.nmse_vs_sequential, 2)}"
    receiver, window = "the receiver", "the window"
    if len(receivers) > 1:
        receiver, window = stray.name, f"the window of {stray.name}"
    return (
        f"{percent(stray.flux.detected_stray, 2)} of the emitted flux lands in {window} as stray light, "
        f"{percent(stray.flux.absorbed, 2)} is absorbed, and the efficiency is "
        f"{percent(stray.efficiency, 2)} instead of {percent(stray.efficiency_sequential, 2)} "
        f"({'+' if gain >= 0.0 else '−'}{number(abs(100.0 * gain), 2)} points). "
        f"On {receiver} the sequential model is wrong by {percent(stray.misplaced_flux, 2)} of the flux{nmse}."
    )
