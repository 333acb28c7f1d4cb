"""Tables of the light: limits with what decides them, and what was asked for beside what came out and is possible."""

from dataclasses import dataclass

from lensforge.evaluation.light import Light
from lensforge.evaluation.limit_result import LimitResult, LimitState
from lensforge.evaluation.receiver_light import ReceiverLight
from lensforge.optics.two_refractions import transmittance_of
from lensforge.records import Metric
from lensforge.report.numerals import number, number_with_error, percent
from lensforge.report.receiver_table import share_with_error
from lensforge.report.shown_receivers import shown_receivers
from lensforge.results import Results

_BADGES: dict[LimitState, str] = {"held": "pass", "missed": "fail", "undecided": "open"}
_SIGNS = {">=": "≥", "<=": "≤"}


@dataclass(frozen=True)
class LimitRow:
    """One limit: its bound, the value that decides with its standard error, and the ``badge`` of its state."""

    name: str
    receiver: str
    quantity: str
    bound: str
    value: str
    state: LimitState
    badge: str


@dataclass(frozen=True)
class AskedRow:
    """A figure of the light on a receiver: ``asked`` for, what came out, and what is possible, by which law."""

    name: str
    asked: str
    got: str
    possible: str
    law: str


def limit_rows(results: Results) -> list[LimitRow]:
    """A row for each limit of the spec, as it was judged."""
    light = results.find(Light)
    return [] if light is None else [_limit_row(limit) for limit in light.limits]


def _limit_row(limit: LimitResult) -> LimitRow:
    def with_unit(words: str) -> str:
        return f"{words}{'' if limit.unit == '°' else ' '}{limit.unit}".rstrip()

    plain = Metric(value=limit.value.value, standard_error=limit.value.standard_error)
    return LimitRow(
        name=limit.name,
        receiver=limit.receiver,
        quantity=limit.quantity,
        bound=f"{_SIGNS[limit.sense]} {with_unit(number(limit.bound, 4))}",
        value=with_unit(number_with_error(plain, 4)),
        state=limit.state,
        badge=_BADGES[limit.state],
    )


def asked_rows(results: Results) -> list[AskedRow]:
    """Rows of every receiver: the light in the target, that in the window, and the NMSE."""
    transmitted = transmittance_of(results.lens.media)
    return [
        row
        for shown in shown_receivers(results)
        for row in _of_receiver(shown.light, transmitted, f", {shown.light.name}" if shown.several else "")
    ]


def _of_receiver(light: ReceiverLight, transmitted: float, where: str) -> list[AskedRow]:
    possible, about = light.possible, "an estimate of the luminance, " if light.possible.luminance_estimated else ""
    asked = percent(transmitted * light.wanted_in_target)
    return [
        AskedRow(
            f"Light in the target{where}", asked, share_with_error(light.share_in_target),
            f"≤ {percent(possible.share_in_target)}", about + possible.law,
        ),
        AskedRow(
            f"Light in the window{where}", percent(transmitted), share_with_error(light.efficiency),
            f"≤ {percent(possible.efficiency)}", "two faces transmit no more, and turn no further",
        ),
        AskedRow(
            f"NMSE{where}", "0", number_with_error(light.nmse, 3), f"≥ {number(possible.nmse, 2)}",
            f"{about}étendue of each pixel, for the light that arrives",
        ),
    ]  # fmt: skip
