"""Facts of the light on roads: what a class requires, where it is worst, and what would keep a limit that is missed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np

from lensforge.addons.road.road_classes import THRESHOLD_INCREMENT, VEILING_RATIO
from lensforge.addons.road.road_record import RoadJudgement
from lensforge.addons.road.road_section import M_CLASSES, RP8_CLASSES, RoadSection
from lensforge.results import Fact, Group, Sense
from lensforge.results.figure import facts_in
from lensforge.spec.derived_values import three_digits
from lensforge.spec.spec_section import rounded_up


def with_remedies(limits: Sequence[Fact]) -> Iterator[Fact]:
    """The limits of one road, missed ones with a remedy as far as it follows from the flux."""
    light = _flux_remedy(limits)
    for limit in limits:
        remedy = light if limit.note == "light" else _OF_GLARE if limit.note in _GLARE else _OF_EVENNESS
        yield replace(limit, remedy=remedy) if limit.state == "fail" else limit


_GLARE = (THRESHOLD_INCREMENT.phrase, VEILING_RATIO.phrase)
_OF_GLARE = "less light near the horizon, or higher poles; the flux hardly changes it"
_OF_EVENNESS = "another pattern, higher poles, or poles nearer to each other; the flux does not change it"


def _flux_remedy(limits: Sequence[Fact]) -> str:
    """The flux that keeps all limits on light: luminance and illuminance are linear in it, and in lamps for a length.

    The glare of new lamps grows with a small power of it.
    """

    def factors(sense: Sense) -> list[float]:
        lit = [(limit.bound, limit.metric.value) for limit in limits if (limit.note, limit.sense) == ("light", sense)]
        return [bound / value if value > 1e-9 * bound else np.inf for bound, value in lit]

    least, most = max(factors(">="), default=1.0), min(factors("<="), default=np.inf)
    if least > most or least == np.inf:
        return "no luminous flux meets all limits: the light must be more uniform"
    if least <= 1.0 <= most:
        return ""
    factor = three_digits(least, ceil) if least > 1.0 else three_digits(most, floor)
    remedy = f"so lit the road needs × {factor:g} lumens, or × {three_digits(1.0 / factor):g} the spacing of poles"
    grown = factor ** (1.0 - THRESHOLD_INCREMENT.at(1.0)[1])
    of_glare = (limit for limit in limits if limit.note == THRESHOLD_INCREMENT.phrase)
    glaring = [limit for limit in of_glare if limit.metric.value * grown > limit.bound]
    if least > 1.0 and glaring:
        worst = max(glaring, key=lambda limit: limit.metric.value)
        remedy += f"; with so many its glare TI is {worst.metric.value * grown:.3g} %, above {worst.bound:g} %"
    return remedy


@dataclass(frozen=True)
class HeldSpacing:
    """Spacings (m) of poles that keep a class, ``least`` to ``largest``; ``beyond``: limits missed above.

    ``beyond``: None if the largest is 12 pole heights, the most that a road may have.
    """

    least: float
    largest: float
    beyond: Fact | None


def road_facts(road: RoadJudgement, section: RoadSection, *, with_limits: bool = True) -> Group:
    """The group of a road of this ``section``: its class, the requirements for every driver, and other figures.

    ``with_limits``: False if the light states the class's requirements, by the same intensities.
    """
    by_luminance = road.lighting_class in (M_CLASSES | RP8_CLASSES)
    note = f"{road.standard}; achieved: {road.reached}, by the intensities of the file"
    facts = [Fact("road_class", "Class", road.lighting_class, note=note), Fact("lanes", "Traffic", section.traffic)]
    limits = with_remedies(road.limits) if with_limits else ()
    facts += [replace(limit, key=f"road_{k}", note="") for k, limit in enumerate(limits)]
    for driver in road.drivers if by_luminance else ():
        label = f"Q, {'from ' * (driver.veiling_ratio is not None)}lane {driver.lane}"
        facts.append(Fact.measured(f"road_q_{driver.lane}", label, driver.luminance_per_lux))
    facts += facts_in(road)
    return Group("road", road.name, tuple(facts))


def spacing_fact(held: HeldSpacing | None) -> Fact:
    """The largest spacing of a road that keeps its class."""
    if held is None:
        return Fact("largest_spacing", "Largest spacing", "class met at none")
    beyond = "" if held.beyond is None else f"; beyond, {held.beyond.label} is missed"
    note = f"class met from {rounded_up(held.least, 3)} m up{beyond}"
    return Fact("largest_spacing", "Largest spacing", held.largest, "m", note=note)


def with_edge(label: str) -> str:
    """The ``label`` of a limit, with the edge of an edge ratio as its place: ``left edge: edge ratio``."""
    place, _, figure = label.rpartition(": ")
    if not figure.endswith(_EDGE):
        return label
    edge = f"{figure.removesuffix(_EDGE)} edge"
    return ": ".join(part for part in (place, edge, _EDGE[1:]) if part)


_EDGE = " edge ratio"
