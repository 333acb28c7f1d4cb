"""Facts of the light: its figures on each receiver, the limits of the spec, and how it was simulated.

Light is judged by the limits of the spec. Where it sets none, it fails if the pattern is far from the target or too
little of the light lands there; ``light.receiver_light`` has both bounds.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

from lensforge.light.area_lamp import AreaLamp
from lensforge.light.beam_colour import BeamColour
from lensforge.light.evaluation_result import Light, LightMetrics
from lensforge.light.irradiated_body import body_groups
from lensforge.light.light_ways import leak_facts, way_facts
from lensforge.light.photometry_result import Photometry, light_of, one_of_lenses
from lensforge.light.receiver_light import ReceiverLight
from lensforge.light.seen_lens import seen_groups
from lensforge.public import public
from lensforge.results import Fact, Group
from lensforge.results.case import Case
from lensforge.results.chart import LightUnit, light_unit
from lensforge.results.criteria import missed
from lensforge.results.estimates import scaled
from lensforge.results.figure import facts_in
from lensforge.results.numerals import quantity
from lensforge.results.verdict import Reason
from lensforge.scene.application_light import light_in
from lensforge.scene.lens import Lens
from lensforge.spec import Spec
from lensforge.spec.application import Application, name_before, names_of
from lensforge.spec.trades import TRADES


@public
class Attainable(NamedTuple):
    """Most light that physics allows, and the law that says so."""

    value: float
    law: str


LimitBounds = Mapping[tuple[str, float], Attainable]  # by a limit's name and bound
BoundsByState = Mapping[str, LimitBounds]
_LIGHT = {"cd": "luminous intensity", "W/sr": "radiant intensity", "lx": "illuminance", "W/m²": "irradiance"}


def light_facts(light: Light, lens: Lens, possible: BoundsByState | None = None) -> list[Group]:
    """Groups: one for each receiver, the ways of the light, the limits (``possible``: light there), and at the end the
    place of each LED and the simulation.

    Of a lens for several states all but the last are those in each, which its name tells apart.
    """
    with_leds = [
        replace(group, title=led.title(group.title))
        for led in light.cases()
        for group in _with_led(led, lens.of_state(led.result.led), (possible or {}).get(led.result.led, {}))
    ]
    return [*with_leds, *place_groups(light), Group("simulation", "Simulation", tuple(facts_in(light, (), None, lens)))]


def _with_led(led: Case[Light], lens: Lens, possible: LimitBounds) -> Iterator[Group]:
    light = led.result
    if light.figures and lens.spec.trade is not None:
        title = TRADES[lens.spec.trade].title
        yield Group("trade", title, tuple(replace(figure, key="figure") for figure in light.figures))
    for case in led.among("receivers"):
        lost = (case.record.missed_by_cause, case.record.flux)
        leaks = () if case.number else leak_facts(lens.spec.lens, light.ways, *lost)
        yield Group("light", case.name or "Light", (*_figures(case, lens), *leaks))
    if light.ways:
        yield way_facts(light.ways)
    yield from seen_groups(light.seen, light.lumens_per_watt)
    yield from body_groups(light.on_bodies, light.lumens_per_watt)
    if light.limits:
        yield Group("limits", "Limits", tuple(limit_facts(led, lens.spec.applications, possible)))
        yield from _worst(light.limits, lens.spec.applications)


def place_groups(light: Light) -> list[Group]:
    """Groups for the place of each LED that is from a ray file or displaced."""
    groups = ((case, case.result.place.group()) for case in light.cases() if case.result.place is not None)
    return [replace(group, title=case.title(group.title)) for case, group in groups]


def light_reasons(light: Light, lens: Lens) -> Iterator[Reason]:
    """Reasons why the light fails: the spec's limits if it has any, else the default ones."""
    for led in light.cases():
        alone = lens.of_state(led.result.led)
        yield from missed(led.criteria)
        if not alone.spec.has_limits:
            for case in led.among("receivers"):
                yield from _reasons(replace(fact, label=case.title(fact.label)) for fact in _figures(case, alone))
        elif led.result.limits:
            yield from _reasons(limit_facts(led, alone.spec.applications))
        else:
            yield "undecided", "the limits of the spec have not been judged in this light"


def _reasons(facts: Iterable[Fact]) -> Iterator[Reason]:
    """A reason for each failed fact."""
    for fact in facts:
        if fact.state != "pass" and fact.state != "":
            yield fact.state, fact.reason


def limit_facts(
    led: Case[Light], applications: Sequence[Application], possible: LimitBounds | None = None
) -> Iterator[Fact]:
    """A fact for each limit of the spec; ``applications``: those of the spec."""
    entries = dict(zip(names_of(applications), applications, strict=True))

    def named(limit: Fact) -> str:
        return name_before(limit.label, entries) or ""

    for name, limits in groupby(led.result.limits, key=named):
        for limit in light_in(entries[name]).with_remedies([*limits]) if name else limits:
            on = f", on {limit.place}" if len(led.result.receivers) > 1 and limit.place else ""
            on += ", by the intensities of the file" if name else ""
            quantity = _LIGHT.get(limit.unit, "light") if limit.note == "light" else limit.note
            fact = replace(limit, key="limit", label=led.title(limit.label), note=f"{quantity}{on}")
            most = (possible or {}).get((limit.label, limit.bound))
            fact = fact if most is None else replace(fact, possible=most.value, possible_note=most.law)
            yield fact.in_percent if limit.note.endswith("share of the flux") else fact


def _worst(limits: Sequence[Fact], applications: Sequence[Application]) -> list[Group]:
    """A group for each table of applications, with each required figure at its worst place."""
    tables = [[*entries] for _, entries in groupby(applications, key=type)]
    return [light_in(table[0]).worst(table, limits) for table in tables]


def change_facts(change: LightMetrics) -> Iterator[Fact]:
    """Facts of the change of every metric from the light as designed, by the same rays."""
    note = "change from the design, by the same rays"
    for fact in facts_in(change):
        label = f"Change of {fact.label}"
        yield replace(fact, key=f"{fact.key}_change", label=label, note=note, is_square=False)


def unit_on(light: Light, receiver: ReceiverLight) -> LightUnit:
    """Display unit of the light on ``receiver``."""
    return light_unit(light.lumens_per_watt, far_field=receiver.chart.far_field)


def _figures(case: Case[Light], lens: Lens) -> Iterator[Fact]:
    receiver = case.record
    yield from case.facts(lens)
    for blocked in receiver.blocked:
        yield from facts_in(blocked)
    if not lens.spec.applications:  # which judge the light of all lenses of their lamps
        yield from _in_region(receiver, unit_on(case.result, receiver), one_of_lenses(lens.spec))
    if receiver.tristimulus_map is not None:
        yield from _colour(receiver.colour)


def _in_region(receiver: ReceiverLight, unit: LightUnit, lens_phrase: str) -> Iterator[Fact]:
    """Light in the region of uniform light or where the target is bright; in the dark, the peak of the map.

    ``lens_phrase``: names the lens if a lamp has several.
    """
    of = f", {lens_phrase}" if lens_phrase else ""
    region = receiver.in_region
    if region is None:
        peak = unit.per_watt * float(receiver.map.max())
        note = f"largest of a pixel, {receiver.place}"
        yield Fact("level", f"Peak {unit.quantity}{of}", peak, unit.symbol, note=note, digits=3)
        return
    mean = scaled(region.mean, unit.per_watt, unit.symbol)
    yield Fact.measured("level", f"Mean {unit.quantity}{of}", mean, region.where)
    yield from facts_in(region)


def _colour(colour: BeamColour | None) -> Iterator[Fact]:
    return iter([Fact("colour_u", "Colour", "no light")]) if colour is None else facts_in(colour)


def photometry_facts(photometry: Photometry, spec: Spec) -> list[Group]:
    """Groups of the far field with each LED and, of a lamp for an area or a road, of the lamp and its zones."""
    return [
        replace(group, title=case.title(group.title))
        for case in photometry.cases()
        for group in _photometry_of_led(case, spec.of_state(case.result.led))
    ]


def _photometry_of_led(case: Case[Photometry], spec: Spec) -> list[Group]:
    photometry = case.result
    lenses = spec.photometry.lenses
    beside = f", {whose}" if (whose := light_of(spec)) else ""
    far = Group("far_field", f"Far field{beside}", tuple(facts_in(photometry, (), None, spec)))
    judged = zip(spec.applications, photometry.judgements_of(spec.applications), strict=True)
    groups = [far, *_of_spectrum(photometry), *(light_in(entry).facts(judgement) for entry, judgement in judged)]
    if photometry.road is None:
        return groups
    whole = f", all {lenses} lenses" if lenses > 1 else beside
    lamp = Group("lamp", f"Lamp{whole}", tuple(_lamp(case, photometry.road, lenses)))
    zones = facts_in(photometry.road.bug.zones)
    return [*groups, lamp, Group("zones", f"Zones{whole}", tuple(zones))]


def _of_spectrum(photometry: Photometry) -> Iterator[Group]:
    if photometry.spectrum is not None:
        yield Group("spectrum", "Spectrum of the source", tuple(facts_in(photometry.spectrum)))


def _lamp(case: Case[Photometry], lamp: AreaLamp, lenses: int) -> Iterator[Fact]:
    whole = f"all {lenses} lenses" if lenses > 1 else ""
    flux, *classes = facts_in(case.result, (), lamp, whole)
    yield Fact("lenses", "Lenses", lenses)
    yield flux
    if (files := case.result.luminaire) is not None:
        note = f"hold {quantity(files.ies.lumens, 'lm', digits=5)} of {whole}"
        yield Fact("luminaire", "Luminaire files", f"luminaire{case.suffix}.ies, .ldt, .iesxml", note=note)
    yield from classes
