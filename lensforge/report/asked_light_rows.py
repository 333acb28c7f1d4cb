"""Rows of the first table on the light: what targets and limits ask for, what came out, and what is possible."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from lensforge.light.evaluation_result import Light, LimitResult, LimitState
from lensforge.light.receiver_light import LARGEST_NMSE, LEAST_SHARE, REGIONS, ReceiverLight, possible_share
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.report.numerals import NOTHING, number, number_with_error, percent, percent_with_error
from lensforge.report.possible_limits import PossibleLimit, possible_limits
from lensforge.report.shown_receivers import ShownReceiver, shown_receivers
from lensforge.results import Metric
from lensforge.results.criteria import beyond_doubt
from lensforge.runs.results import Results

AskedState = Literal["pass", "fail", "open", ""]  # "": nothing was asked, or nobody has judged it

_STATES: dict[LimitState, AskedState] = {"held": "pass", "missed": "fail", "undecided": "open"}
_SIGNS = {">=": "≥", "<=": "≤"}
_QUANTITIES = {
    "share": "share of the LED’s flux",
    "beam_angle": "beam angle",
    "relative": "light relative to the brightest place",
    "min_over_mean": "least over mean light",
    "min_over_max": "least over largest light",
}
_LIGHT = {"cd": "luminous intensity", "W/sr": "radiant intensity", "lx": "illuminance", "W/m²": "irradiance"}


@dataclass(frozen=True)
class AskedRow:
    """A figure that was asked for, with what came out and what is possible; ``–`` where one of them is not known.

    ``note``: of the name; ``passes``: bound by which it is judged, where that is not what was asked; ``law``: by which
    no more is possible.
    """

    name: str
    asked: str
    got: str
    state: AskedState
    note: str = ""
    passes: str = ""
    possible: str = NOTHING
    law: str = ""


def light_rows(results: Results) -> list[AskedRow]:
    """The limits of the spec, which decide where there are any, then the figures of the light on each receiver."""
    light, shown = results.find(Light), shown_receivers(results)
    if light is None:
        return []
    transmitted, judged = transmittance_of(results.lens.media), not results.spec.limits
    bounds = possible_limits(results.spec) if light.limits else {}
    limits = [_limit_row(each, bounds.get((each.name, each.bound)), several=len(shown) > 1) for each in light.limits]
    return limits + [row for each in shown for row in _on_receiver(each, transmitted, judged)]


def _limit_row(limit: LimitResult, possible: PossibleLimit | None, several: bool) -> AskedRow:
    def with_unit(words: str) -> str:
        return f"{words}{'' if limit.unit == '°' else ' '}{limit.unit}".rstrip()

    plain = Metric(value=limit.value.value, standard_error=limit.value.standard_error)
    named = _LIGHT.get(limit.unit) if limit.quantity == "light" else _QUANTITIES.get(limit.quantity)
    return AskedRow(
        name=limit.name,
        note=f"{named or limit.quantity}{f', on {limit.receiver}' if several else ''}",
        asked=f"{_SIGNS[limit.sense]} {with_unit(number(limit.bound, 4))}",
        got=with_unit(number_with_error(plain, 4)),
        state=_STATES[limit.state],
        possible=NOTHING if possible is None else possible.words,
        law="" if possible is None else possible.law,
    )


def _on_receiver(shown: ShownReceiver, transmitted: float, judged: bool) -> Iterator[AskedRow]:
    """Light in the target and in the window, error of the pattern, and evenness, in the mask too where there is one.

    ``judged``: by the bounds of a spec without limits of its own.
    """
    light, where = shown.light, f", {shown.light.name}" if shown.several else ""
    possible, about = light.possible, "an estimate of the luminance, " if light.possible.luminance_estimated else ""
    least, nmse, share = LEAST_SHARE * possible_share(light, transmitted)[0], light.nmse, light.share_in_target
    yield AskedRow(
        name=f"Light in the target{where}",
        note="share of the LED’s flux that lands where the target is bright",
        asked=NOTHING,
        passes=f"passes from {percent(least)}" if judged else "",
        got=percent_with_error(share),
        state=_state(least - share.value, share.standard_error) if judged else "",
        possible=f"≤ {percent(possible.share_in_target)}",
        law=about + possible.law,
    )
    yield AskedRow(
        name=f"Error of the pattern (NMSE){where}",
        note=f"squared distance from the target, over the target squared{_by_raster(light)}",
        asked=NOTHING,
        passes=f"passes up to {number(LARGEST_NMSE)}" if judged else "",
        got=number_with_error(nmse, 4),
        state=_state(nmse.value - LARGEST_NMSE, nmse.standard_error) if judged else "",
        possible=f"≥ {number(possible.nmse, 2)}" if possible.nmse > 0.0 else NOTHING,
        law=f"{about}étendue of each pixel, for the light that arrives" if possible.nmse > 0.0 else "",
    )
    yield AskedRow(
        name=f"Efficiency{where}",
        note=f"share of the LED’s flux {shown.window}",
        asked=NOTHING,
        got=percent_with_error(light.efficiency),
        state="",
        possible=f"≤ {percent(possible.efficiency)}",
        law="two faces transmit no more, and turn no further",
    )
    for metric, name, words in (
        (light.uniformity, "Uniformity", light.evenness_words),
        (light.rsd, "Relative standard deviation (RSD)", "standard deviation over mean"),
    ):
        if metric is not None:
            note = f"{words} in the mask {shown.mask_words}"
            yield AskedRow(f"{name}{where}", NOTHING, number_with_error(metric, 3), "", note)
    if (region := light.in_region) is not None:
        rim = f"without its rim, which leaves {percent(region.inner_share)} of the area"
        note = f"least over mean light {REGIONS[region.region]}, {rim}"
        yield AskedRow(f"Evenness of the inner 90\u2009%{where}", NOTHING, number_with_error(region.inner, 3), "", note)
        note = "largest light over the target’s largest, both with the same flux"
        yield AskedRow(f"Peak to target{where}", NOTHING, number_with_error(region.peak, 3), "", note)


def _by_raster(light: ReceiverLight) -> str:
    """Words for the change of an NMSE with half as many pixels."""
    if light.nmse_of_raster is None:
        return ""
    return f"; with half as many pixels it is {number(light.nmse.value - light.nmse_of_raster, 2)}"


def _state(excess: float, error: float | None) -> AskedState:
    """Judgement of a value that is beyond its bound by ``excess``: open within two standard errors."""
    missed = beyond_doubt(excess, error)
    return "open" if missed is None else "fail" if missed else "pass"
