"""Light of a lamp for an area or a road: its figures with all its lenses, and the light on roads as it is judged.

Classes of glare G*: EN 13201-2:2015, table A.1.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor
from typing import Annotated

import numpy as np
from jaxtyping import Float

from lensforge.light.evaluation_result import JudgedLimits
from lensforge.light.luminaire_classes import BugRating, DistributionType, LampLight, ZoneLumens, distribution_type
from lensforge.light.metrics import debiased_maximum, scaled
from lensforge.results import Count, Fact, Group, Metric, NotNegative, Positive, Record, Sense, Text
from lensforge.results.figure import Figure, facts_in
from lensforge.scene.road_classes import THRESHOLD_INCREMENT, VEILING_RATIO
from lensforge.spec.derived_values import three_digits
from lensforge.spec.light_limits import PhotometrySection
from lensforge.spec.road_section import M_CLASSES, RP8_CLASSES, RoadSection, names_of
from lensforge.spec.spec_section import rounded_up

_NONE = "none"
# Most candela per 1000 lm of the lamp at and above 70 and 80 degrees; none shines at 90, so that G*5 is G*6.
_G = {
    "G*6": (350.0, 100.0),
    "G*4": (500.0, 100.0),
    "G*3": (np.inf, 100.0),
    "G*2": (np.inf, 150.0),
    "G*1": (np.inf, 200.0),
}


class GlareIntensities(Record):
    """Largest intensity (cd per 1000 lm of the lamp) at and above 70 and 80 degrees; a lens sends none above 90.

    ``glare_class``: the strictest class of glare that these keep, or "none".
    """

    above_70: Metric
    above_80: Metric
    glare_class: Text


def glare_intensities(lamp: LampLight, lumens: float) -> GlareIntensities:
    """Largest intensities of ``lamp`` near the horizon, without the noise that would choose them."""
    above_70, above_80 = (_largest_from(lamp, gamma, 1000.0 / lumens) for gamma in (70.0, 80.0))
    keeps = (name for name, (at_70, at_80) in _G.items() if above_70.value <= at_70 and above_80.value <= at_80)
    return GlareIntensities(above_70=above_70, above_80=above_80, glare_class=next(keeps, _NONE))


def _largest_from(lamp: LampLight, gamma_deg: float, scale: float) -> Metric:
    nodes = np.append(gamma_deg, lamp.grid.gamma_deg[lamp.grid.gamma_deg > gamma_deg])
    lateral, gamma = (each.ravel() for each in np.meshgrid(lamp.grid.c_deg - lamp.street_deg, nodes, indexing="ij"))
    largest = debiased_maximum(scale * lamp.intensities(lateral, gamma))
    return largest.changed(value=max(largest.value, 0.0), unit="cd/klm")


class RoadFigures(Record):
    """Figures of a lamp with all its lenses. ``lumens``: that leave it."""

    lumens: Metric
    distribution: DistributionType
    bug: BugRating
    glare: GlareIntensities

    @staticmethod
    def of(
        section: PhotometrySection, lens: LampLight, lens_lm: Metric, zones_lm: Float[np.ndarray, "p 2 4"]
    ) -> "RoadFigures | None":
        """Figures of a lamp of ``section``, each lens with such light and flux by zone; None for general use."""
        if section.use == "general":
            return None
        lamp = lens.times(section.lenses)
        distribution = distribution_type(lamp)
        lumens = scaled(lens_lm, float(section.lenses), "lm")
        return RoadFigures(
            lumens=lumens,
            distribution=distribution,
            bug=BugRating.of(ZoneLumens.of(zones_lm * section.lenses), symmetric=distribution.lateral == "V"),
            glare=glare_intensities(lamp, lumens.value),
        )


class SeenRoad(Record):
    """Road as the driver in one ``lane`` sees it, counted from the side on which one drives.

    ``mean_cd_per_m2``, ``uniformity`` (U0, least over mean), ``uniformity_along`` (Ul, least over largest on the middle
    of the lane), ``glare_percent`` (threshold increment TI, of new lamps). ``luminance_per_lux``: mean luminance over
    mean illuminance of the road (cd/m^2 per lx), Q.

    By RP-8 one of each direction of travel, whose first lane ``lane`` is: ``uniformity_along`` is least over largest of
    all its points, and glare ``veiling_ratio``, the largest veiling luminance over the mean.
    """

    lane: Count
    mean_cd_per_m2: Metric
    uniformity: Metric
    uniformity_along: Metric
    glare_percent: Metric | None
    luminance_per_lux: Metric
    veiling_ratio: Metric | None = None


class RoadJudgement(Record):
    """Light of a row of lamps on one road. ``limits``: what its ``lighting_class`` asks, each judged.

    ``reached``: the best class M, C or P of the figures, by RP-8 all classes that they have; "none" below all.
    ``drivers``: by their lanes. ``s1``: None of a table that ends before tan gamma = 2.
    ``edges``: ratio of the illuminance beside the road to that within, at the right and at the left edge. ``mean_lx``,
    ``least_lx``, ``uniformity_lx``: horizontal illuminance of the road. ``power_density`` (W per lx and m^2, D_P) and
    ``yearly_energy`` (kWh per m^2, AECI): None if the power of a lamp is not known.
    """

    name: Text
    lighting_class: Text
    reached: Text
    surface: Annotated[Text, Figure("Surface", "Q0 {q0:3}, S1 {s1_words}")]
    q0: Positive
    s1: NotNegative | None
    drivers: tuple[SeenRoad, ...]
    edges: tuple[Metric, Metric]
    mean_lx: Annotated[Metric, Figure("Mean illuminance", key="road_lx")]
    least_lx: Annotated[Metric, Figure("Minimum illuminance", key="road_least_lx")]
    uniformity_lx: Metric
    power_density: Annotated[Metric | None, Figure("Power density D_P")]
    yearly_energy: Annotated[Metric | None, Figure("Annual energy D_E")]
    limits: JudgedLimits
    standard: Text = "EN 13201"

    @property
    def s1_words(self) -> str:
        """S1 of the surface, or why it is not known."""
        too_short = "not known: its table ends before tan γ = 2; light from beyond is ignored"
        return too_short if self.s1 is None else f"{self.s1:.3g}"


def with_remedies(limits: Sequence[Fact]) -> Iterator[Fact]:
    """The limits of one road, those that are missed with what would keep them, as far as that follows from the flux."""
    light = _flux_remedy(limits)
    for limit in limits:
        remedy = light if limit.note == "light" else _OF_GLARE if limit.note in _GLARE else _OF_EVENNESS
        yield replace(limit, remedy=remedy) if limit.state == "fail" else limit


_GLARE = (THRESHOLD_INCREMENT.name, VEILING_RATIO.name)
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
    words = f"so lit the road needs × {factor:g} lumens, or × {three_digits(1.0 / factor):g} the spacing of poles"
    grown = factor ** (1.0 - THRESHOLD_INCREMENT.at(1.0)[1])
    of_glare = (limit for limit in limits if limit.note == THRESHOLD_INCREMENT.name)
    glaring = [limit for limit in of_glare if limit.metric.value * grown > limit.bound]
    if least > 1.0 and glaring:
        worst = max(glaring, key=lambda each: each.metric.value)
        words += f"; with so many its glare TI is {worst.metric.value * grown:.3g} %, above {worst.bound:g} %"
    return words


@dataclass(frozen=True)
class HeldSpacing:
    """Spacings (m) of poles at which a class is held, from ``least`` to ``largest``; ``beyond``: what is missed there.

    ``beyond``: None if the largest is 12 pole heights, the most that a road may have.
    """

    least: float
    largest: float
    beyond: Fact | None


def road_facts(road: RoadJudgement, section: RoadSection, *, with_limits: bool = True) -> Group:
    """The group of one road, of this ``section``: its class, what that requires for every driver, and other figures.

    ``with_limits``: not where the light states what the class requires, by the same intensities.
    """
    by_luminance = road.lighting_class in (M_CLASSES | RP8_CLASSES)
    note = f"{road.standard}; achieved: {road.reached}, by the intensities of the file"
    facts = [Fact("road_class", "Class", road.lighting_class, note=note), Fact("lanes", "Traffic", section.traffic)]
    limits = with_remedies(road.limits) if with_limits else ()
    facts += [replace(limit, key=f"road_{k}", note="") for k, limit in enumerate(limits)]
    for driver in road.drivers if by_luminance else ():
        words = f"Q, {'from ' * (driver.veiling_ratio is not None)}lane {driver.lane}"
        facts.append(Fact.measured(f"road_q_{driver.lane}", words, driver.luminance_per_lux))
    facts += facts_in(road)
    return Group("road", road.name, tuple(facts))


def spacing_fact(held: HeldSpacing | None) -> Fact:
    """The largest spacing of a road at which its class is held."""
    if held is None:
        return Fact("largest_spacing", "Largest spacing", "class met at none")
    beyond = "" if held.beyond is None else f"; beyond, {held.beyond.label} is missed"
    note = f"class met from {rounded_up(held.least, 3)} m up{beyond}"
    return Fact("largest_spacing", "Largest spacing", held.largest, "m", note=note)


def worst_on_roads(limits: Sequence[Fact], roads: Sequence[RoadSection], end: str) -> Group:
    """Figures that the classes of ``roads`` ask for, each of the road, lane or edge that has it worst."""
    worst: dict[tuple[str, str], Fact] = {}
    for limit in limits:
        road = next((road for road in names_of(roads) if limit.label.startswith(f"{road}: ")), None)
        if road is None:
            continue
        place, _, figure = limit.label.removeprefix("" if len(roads) > 1 else f"{road}: ").rpartition(": ")
        if figure.endswith(_EDGE):
            place, figure = f"{f'{place}: ' * bool(place)}{figure.removesuffix(_EDGE)} edge", _EDGE[1:]
        note = f"worst: {place}" if place else ""
        fact = replace(limit, key="of_road", label=figure[:1].upper() + figure[1:], note=note)
        key = figure, limit.sense
        worst[key] = max(worst.get(key, fact), fact, key=_strain)
    words = dict.fromkeys(f"{road.lighting_class}, {road.traffic}" for road in roads)
    head = Fact("traffic", "Class and traffic", "; ".join(words))
    return Group("of_roads", f"{'Roads' if len(roads) > 1 else 'Road'}{end}", (head, *worst.values()))


_EDGE = " edge ratio"


def _strain(limit: Fact) -> float:
    """Part of an upper bound that is reached, or of what a lower one asks, its inverse."""
    part = limit.metric.value / limit.bound
    return part if limit.sense == "<=" else 1.0 / max(part, 1e-9)
