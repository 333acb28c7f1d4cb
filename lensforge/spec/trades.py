"""Trades: the figures by which the people of each judge a light, which screen and page tell first.

A trade names figures of the first receiver, in its units, and facts of the photometry. Each is stated without a bound;
a bound on it is a limit of the spec, by the same section.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import radians, tan
from typing import Any, Literal

from lensforge.optics.efficacy import Efficacy
from lensforge.optics.pose import ORIGIN
from lensforge.results.record import Sense
from lensforge.spec.cut_off import CutOffLimit
from lensforge.spec.light_field import LightFieldLimit
from lensforge.spec.light_limits import OF_MEAN, PHOTONS, ZONES, LimitSection, ZoneLimit, zone_of
from lensforge.spec.peak_limit import PeakLimit
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.screen_points import ScreenLimit
from lensforge.spec.shape_targets import RectangleTarget
from lensforge.spec.target_sections import SizedTarget

TradeName = Literal[
    "backlight",
    "bicycle",
    "curing",
    "headlamp",
    "horticulture",
    "machine vision",
    "medical",
    "projector",
    "simulator",
    "torch",
]
_ABOVE_DEG = 3.4  # from the brightest place of a bicycle's light to where it may dazzle (TA 23 of StVZO § 22a)


@dataclass(frozen=True)
class StatedFigure:
    """Figure that limits of the kind of ``section`` call ``bounded``, told as ``label``; ``sense``: its better side."""

    label: str
    section: LimitSection
    bounded: str
    sense: Sense = ">="


@dataclass(frozen=True)
class Trade:
    """A trade, by its ``title``: its ``figures`` on a receiver, in units that the efficacy of the source allows.

    ``photometry``: keys of facts of the photometry that are its figures, too. ``limit``: a kind that no other trade
    has: a spec with one is of this trade, unless it says another.
    """

    title: str
    figures: Callable[[ReceiverSection, Efficacy], Iterator[StatedFigure]]
    photometry: tuple[str, ...] = ()
    limit: type[LimitSection] | None = None


def trade_of(application: TradeName | None, limits: Sequence[LimitSection]) -> TradeName | None:
    """The trade that a spec states, or that its limits tell; None for neither."""
    kinds = {type(limit) for limit in limits}
    return application or next((name for name, trade in TRADES.items() if trade.limit in kinds), None)


def figures_of(
    name: TradeName | None, receiver: ReceiverSection, efficacy: Efficacy, limits: Sequence[LimitSection] = ()
) -> Iterator[StatedFigure]:
    """Figures of the trade called ``name`` on ``receiver``; none without a trade.

    Where one of ``limits`` bounds the same figure, it is stated for its places and by its meter.
    """
    here = [limit for limit in limits if limit.receiver in (None, receiver.name)]
    for figure in () if name is None else TRADES[name].figures(receiver, efficacy):
        bounded = (limit for limit in here if limit.reads_as(figure.section))
        yield replace(figure, section=next(bounded, figure.section))


def _stated(kind: type[LimitSection], **fields: Any) -> LimitSection:
    """A section of ``kind`` without a bound, which no spec may have."""
    return kind.model_construct(**fields)


def _zone(receiver: ReceiverSection) -> LimitSection:
    """Zone in which light is to be even: the mask of uniform light, else the shape of the target, else the window."""
    target = receiver.targets[0]
    even = target.pair("uniform")
    unit = receiver.unit
    placed = {f"centre_{unit}": target.length("centre"), "rotation_deg": target.rotation_deg}
    if even is not None:
        zone = RectangleTarget(**{f"width_{unit}": even[0], f"height_{unit}": even[1], **placed})
        return _stated(ZoneLimit, zone=zone)
    if isinstance(target, ZONES) and len(receiver.targets) == 1:
        return _stated(ZoneLimit, zone=zone_of(target))
    return _stated(ZoneLimit)


def _unit(receiver: ReceiverSection, efficacy: Efficacy) -> str:
    if receiver.unit == "deg":
        return "w_per_sr" if efficacy.lumens is None else "cd"
    return "w_per_m2" if efficacy.lumens is None else "lx"


def _evenness(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    zone = _zone(receiver)
    yield StatedFigure("Min/max", zone, "min_over_max")
    yield StatedFigure("Min/mean", zone, "min_over_mean")
    if receiver.unit == "mm":
        yield StatedFigure("Mean light", zone, f"{OF_MEAN}{_unit(receiver, efficacy)}")


def _curing(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    zone = _zone(receiver)
    if receiver.unit == "mm":
        yield StatedFigure("Mean irradiance", zone, f"{OF_MEAN}mw_per_cm2")
        yield StatedFigure("Peak irradiance", _stated(PeakLimit), "mw_per_cm2")
    yield StatedFigure("Min/mean", zone, "min_over_mean")


def _horticulture(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    if receiver.unit != "mm" or efficacy.photons is None:
        yield from _evenness(receiver, efficacy)
        return
    zone = _zone(receiver)
    yield StatedFigure("Mean PPFD", zone, f"{OF_MEAN}{PHOTONS}")
    yield StatedFigure("Minimum PPFD", zone, PHOTONS)
    yield StatedFigure("Min/mean", zone, "min_over_mean")


def _simulator(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    zone = _zone(receiver)
    yield StatedFigure("Non-uniformity", zone, "contrast", "<=")
    if receiver.unit == "mm":
        yield StatedFigure("Mean irradiance", zone, f"{OF_MEAN}w_per_m2")


def _projector(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    target = receiver.targets[0]
    if not isinstance(target, SizedTarget):
        return
    unit = receiver.unit
    size = {f"width_{unit}": target.size("width"), f"height_{unit}": target.sides("height")[1]}
    screen = _stated(ScreenLimit, **size, **{f"centre_{unit}": target.length("centre")})
    yield StatedFigure("Mean of nine points", screen, _unit(receiver, efficacy))
    yield StatedFigure("Darkest of 13 points", screen, "min_over_mean")
    yield StatedFigure("Brightest of 13 points", screen, "max_over_mean", "<=")


def _medical(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    unit = receiver.unit
    light_field = _stated(LightFieldLimit, **{f"centre_{unit}": receiver.targets[0].length("centre")})
    yield StatedFigure("Central light Ec", light_field, _unit(receiver, efficacy))
    yield StatedFigure("d10", light_field, f"d10_{unit}")
    yield StatedFigure("d50", light_field, f"d50_{unit}")
    yield StatedFigure("d50/d10", light_field, "d50_over_d10")


def _bicycle(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    light = _unit(receiver, efficacy)
    yield StatedFigure("Brightest place", _stated(PeakLimit), light)
    up = {"up_deg": _ABOVE_DEG}
    if receiver.unit == "mm":
        up = {"up_mm": receiver.clear_mm(ORIGIN) * tan(radians(_ABOVE_DEG))}
    yield StatedFigure("3.4° above it and higher", _stated(PeakLimit, **up), light, "<=")


def _headlamp(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    yield StatedFigure("Brightest direction", _stated(PeakLimit), _unit(receiver, efficacy))
    if receiver.unit == "deg":
        yield StatedFigure("Gradient G of the cut-off", _stated(CutOffLimit), "gradient")


def _torch(receiver: ReceiverSection, efficacy: Efficacy) -> Iterator[StatedFigure]:
    yield StatedFigure("Brightest place", _stated(PeakLimit), _unit(receiver, efficacy))


TRADES: dict[TradeName, Trade] = {
    "backlight": Trade("Backlight", _evenness),
    "bicycle": Trade("Bicycle headlamp", _bicycle),
    "curing": Trade("Curing", _curing),
    "headlamp": Trade("Headlamp", _headlamp, limit=CutOffLimit),
    "horticulture": Trade("Horticulture", _horticulture, ("ppf", "ppfd")),
    "machine vision": Trade("Machine vision", _evenness),
    "medical": Trade("Medical", _medical, limit=LightFieldLimit),
    "projector": Trade("Projector", _projector, limit=ScreenLimit),
    "simulator": Trade("Solar simulator", _simulator),
    "torch": Trade("Torch", _torch, ("peak_cd", "throw", "beam_C 0", "field_C 0")),
}
