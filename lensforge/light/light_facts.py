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
from lensforge.light.light_ways import leak_facts, way_facts
from lensforge.light.photometry_result import Photometry
from lensforge.light.receiver_light import METRICS, ReceiverLight, judged_figures
from lensforge.light.seen_lens import seen_groups
from lensforge.optics.fundamental_limits import BY_SYMMETRY, LEVELS, transmittance_of
from lensforge.public import public
from lensforge.results import Fact, Group, Metric
from lensforge.results.case import Case
from lensforge.results.chart import LightUnit, light_unit
from lensforge.results.criteria import missed
from lensforge.results.estimates import scaled
from lensforge.results.figure import facts_in
from lensforge.results.numerals import number, percent, quantity, square
from lensforge.results.verdict import Reason
from lensforge.scene.application_light import light_in
from lensforge.scene.lens import Lens
from lensforge.sources.intensity import BEAM_SHARE
from lensforge.spec import Spec
from lensforge.spec.application import Application, names_of
from lensforge.spec.far_field_targets import BeamTarget
from lensforge.spec.light_limits import BeamAngleLimit
from lensforge.spec.trades import TRADES


@public
class Attainable(NamedTuple):
    """Most light that physics allows, and the law that says so."""

    value: float
    law: str


LimitBounds = Mapping[tuple[str, float], Attainable]  # by a limit's name and bound
BoundsByState = Mapping[str, LimitBounds]
_OF_POSSIBLE = 0.9  # of the efficiency: less deserves a look; the shipped specs have 0.78 to 1.00
_NOT_JUDGED = "; not judged, as the spec has limits"
_OF_WANTED = 0.1  # of a wanted beam angle: a beam that differs by more deserves a look
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
    return [*with_leds, *place_groups(light), Group("simulation", "Simulation", tuple(_simulation(light, lens)))]


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
        return next((name for name in entries if limit.label.startswith(f"{name}: ")), "")

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


def metric_facts(metrics: LightMetrics, note: str = "", *, changes: bool = False) -> tuple[Fact, ...]:
    """Facts of the metrics that are defined; ``changes``: they are differences, also of the mean square."""
    nmse = Fact.measured("nmse", METRICS["nmse"], metrics.nmse, note, is_square=not changes)
    named = {"uniformity": metrics.uniformity, "rsd": metrics.rsd}
    facts = [Fact.measured(key, METRICS[key], metric, note) for key, metric in named.items() if metric is not None]
    return (nmse, *facts, Fact.share("efficiency", METRICS["efficiency"], metrics.efficiency, note))


def change_facts(change: LightMetrics) -> tuple[Fact, ...]:
    """Facts of the change of every metric from the light as designed, by the same rays."""
    note = "change from the design, by the same rays"
    return tuple(
        replace(fact, key=f"{fact.key}_change", label=f"Change of {METRICS[fact.key]}", note=note)
        for fact in metric_facts(change, changes=True)
    )


def window_words(light: ReceiverLight) -> str:
    """Phrase after "flux" for the part of the receiver in which it is detected."""
    return f"within {light.where}" if light.is_far_field else light.where


def mask_words(spec: Spec, index: int) -> str:
    """Phrase after "mask" for the region of uniform light on receiver number ``index``: its size, or their number."""
    sections = spec.all_receivers
    targets = sections[index].targets if index < len(sections) else ()
    sizes = [(pair, target.unit) for target in targets if (pair := target.pair("uniform")) is not None]
    if len(sizes) != 1:
        return f"of {len(sizes)} parts"
    (width, height), unit = sizes[0]
    end = "°" if unit == "deg" else " mm"
    return f"of {width:g}{end}" if width == height else f"of {width:g} × {height:g}{end}"


def unit_on(light: Light, receiver: ReceiverLight) -> LightUnit:
    """Display unit of the light on ``receiver``."""
    return light_unit(light.lumens_per_watt, far_field=receiver.chart.far_field)


def _figures(case: Case[Light], lens: Lens) -> Iterator[Fact]:
    receiver = case.record
    mask = f"in the mask {mask_words(lens.spec, case.number)}"
    judged = {} if lens.spec.has_limits else judged_figures(receiver, transmittance_of(lens.media))
    unjudged = _NOT_JUDGED if lens.spec.has_limits else ""
    if lens.spec.optimise.aim == "pattern":
        pattern = _error_of_pattern(receiver, judged.get("nmse"))
        yield replace(pattern, note=f"{pattern.note}{unjudged}")
    share = _share_in_target(receiver, judged.get("share_in_target"))
    yield replace(share, note=f"{share.note}{unjudged}")
    most = receiver.possible.efficiency
    whole = lens.spec.all_lamps.whole
    yield Fact.share(
        "efficiency",
        METRICS["efficiency"],
        receiver.efficiency,
        f"share of the {f'flux {whole}' if whole else 'LED’s flux'} {window_words(receiver)}",
        sense=">=",
        possible=most,
        notice=f"below {_OF_POSSIBLE:g} of the upper bound" if receiver.efficiency.value < _OF_POSSIBLE * most else "",
        possible_note="reflectance of the mirror"
        if lens.spec.lens.is_opaque
        else "transmittance and largest deflection of two faces",
    )
    if receiver.uniformity is not None:
        yield Fact.measured(
            "uniformity", METRICS["uniformity"], receiver.uniformity, f"{receiver.evenness_words} {mask}"
        )
    if receiver.rsd is not None:
        yield Fact.measured("rsd", METRICS["rsd"], receiver.rsd, f"standard deviation/mean {mask}")
    if not lens.spec.applications:  # which judge the light of all lenses of their lamps
        yield from _in_region(receiver, unit_on(case.result, receiver), _of_lenses(lens.spec))
    if receiver.tristimulus_map is not None:
        yield from _colour(receiver.colour)


def _error_of_pattern(receiver: ReceiverLight, judged: Fact | None) -> Fact:
    possible = receiver.possible
    fact = judged or Fact.measured("nmse", METRICS["nmse"], receiver.nmse, is_square=True)
    return replace(
        fact,
        note=f"mean square deviation over the target’s mean square{_by_pixels(receiver)}",
        possible=possible.nmse if possible.nmse > 0.0 else None,
        possible_note="étendue of each pixel, for the light that arrives",
        remedy=_remedy(receiver, "a coarser pattern"),
    )


def _share_in_target(receiver: ReceiverLight, judged: Fact | None) -> Fact:
    possible = receiver.possible
    share = receiver.share_in_target
    fact = judged or Fact.measured("share_in_target", METRICS["share_in_target"], share, sense=">=")
    return replace(
        fact,
        note=f"share of the LED’s flux where the target is above a tenth of its maximum{_estimate(receiver)}",
        possible=possible.share_in_target,
        possible_note=possible.law,
        remedy=_remedy(receiver, "a wider target"),
    ).in_percent


def _remedy(receiver: ReceiverLight, other: str) -> str:
    """Changes that would bring more light; if symmetry bounds the lens, another shape of its faces."""
    return LEVELS if receiver.possible.law == BY_SYMMETRY else f"a larger lens, a smaller source or {other}"


def _estimate(receiver: ReceiverLight) -> str:
    """Phrase for the share limited by an estimated étendue, if the source's luminance is known from its rays alone."""
    possible = receiver.possible
    estimate = possible.estimate
    if estimate is None or estimate.share_in_target >= possible.share_in_target:
        return ""
    return f"; étendue may leave {percent(estimate.share_in_target)}, an estimate from rays of the source and no bound"


def _by_pixels(receiver: ReceiverLight) -> str:
    """Phrase for the NMSE with half as many pixels, if the change exceeds its noise."""
    change = receiver.nmse_of_raster
    error = receiver.nmse.standard_error
    if change is None or abs(change) <= (error or 0.0):
        return ""
    halved = receiver.nmse.value - change
    shown = number(halved, 2) if halved >= 0.0 else square(halved, error)
    return f"; depends on the pixels: {shown} with pixels twice as wide"


def _of_lenses(spec: Spec) -> str:
    """Phrase for the single lens that has the light, if a lamp has several; else empty."""
    return f"one lens of {spec.photometry.lenses}" if spec.photometry.lenses > 1 else ""


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


def _simulation(light: Light, lens: Lens) -> Iterator[Fact]:
    """Rays and pixels of the simulation; error by its tables and its rays, where that was measured."""
    rows, columns = light.map.shape
    unused = "which the search has not used" if light.fitted is not None else ""
    yield Fact("rays", "Rays", light.rays, note=unused)
    yield Fact("pixels", "Pixels", f"{columns} × {rows}", note=light.filter.replace("pixel^2", "pixel²"))
    if light.first.nmse.standard_error is not None:
        yield Fact("raw_nmse", "NMSE with ray noise", light.raw.nmse, note="before the noise is subtracted")
    if (fitted := light.fitted) is not None:
        note = f"by the {number(fitted.rays)} rays of the search, to which the lens is fitted"
        yield Fact.measured("fitted_nmse", "NMSE of fitted rays", fitted.nmse, note, is_square=True)
        yield Fact.share("fitted_efficiency", "Efficiency, fitted rays", fitted.efficiency, note)
    if (by_file := light.by_file) is not None:
        note = f"by {number(by_file.rays)} rays of the file, which the model of the LED was not fitted to"
        yield Fact.measured("file_nmse", "NMSE, file’s own rays", by_file.nmse, note, is_square=True)
        yield Fact.share("file_efficiency", "Efficiency, file’s own rays", by_file.efficiency, note)
    if light.preset_error is not None:
        left = light.preset_error.evaluation
        chart = light.first.chart
        note = f"NMSE of the tables of --accuracy {lens.accuracy} against the exact surfaces"
        yield Fact.measured("table_nmse", "Simulation error", left.irradiance_nmse, note, is_square=True)
        off = chart.labelled(left.hit_mm.value)
        yield Fact("table_hits", "Error of hit points", off, chart.unit, note="rms, of the same tables", digits=2)
        if light.first.nmse_of_noise is not None:
            yield Fact("noise_nmse", "NMSE of the ray noise", light.first.nmse_of_noise, digits=2)


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
    light_of = _of_lenses(spec) or spec.all_lamps.whole.replace("of all lamps", "one lamp")
    beside = f", {light_of}" if light_of else ""
    far = Group("far_field", f"Far field{beside}", tuple(_far_field(photometry, spec, light_of)))
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


def _judged_planes(spec: Spec) -> Iterator[float]:
    """Planes C (deg) whose beam angle a limit judges and reports."""
    by_name = {receiver.name: receiver for receiver in spec.all_receivers}
    for limit in spec.limits:
        if isinstance(limit, BeamAngleLimit) and limit.level == BEAM_SHARE:
            receiver = by_name[limit.receiver or next(iter(by_name))]
            if receiver.facing == (0.0, 0.0, 1.0) and receiver.rotation_deg == 0.0:
                yield limit.azimuth_deg % 180.0


def _target_beam_deg(spec: Spec) -> dict[float, float]:
    """Beam angle (deg) of the target of one lamp in a plane C (deg); None for any other target."""
    receiver = spec.all_receivers[0]
    match receiver.facing, receiver.rotation_deg, len(spec.all_lamps), receiver.targets:
        case (0.0, 0.0, 1.0), 0.0, 1, [BeamTarget(centre=(0.0, 0.0), rotation_deg=0.0) as target]:
            return dict(zip((0.0, 90.0), target.sides("fwhm"), strict=True))
    return {}


def _beam_note(angle: Metric | None, wanted_deg: float | None) -> tuple[str, str]:
    """Note and warning for a beam angle that differs from the target's."""
    note = "full width at 50 % of the peak in this plane"
    if angle is None or wanted_deg is None:
        return note, ""
    wanted = f"the target wants {quantity(wanted_deg, '°', digits=3)}"
    far = abs(angle.value - wanted_deg) > max(_OF_WANTED * wanted_deg, 3.0 * (angle.standard_error or 0.0))
    return f"{wanted}; {note}", wanted if far else ""


def _far_field(photometry: Photometry, spec: Spec, whose: str) -> Iterator[Fact]:
    """Facts of the files; ``whose``: phrase for the lens or lamps whose light they have."""
    direction = photometry.peak_direction
    start = f"{whose}; " if whose else ""
    source = f"{start}for {quantity(photometry.source_lm, 'lm', digits=5)} of the source"
    taken = ", whose flux is not stated" if photometry.per_1000_lm else ""
    taken += "" if spec.plate is None else "; as if none entered other lenses of the plate (verify --stray)"
    yield Fact.measured("exit_lm", "Luminous flux", photometry.exit_lm, f"{source}{taken}")
    at = f"at C {quantity(direction.c_deg, '°', digits=4)}, gamma {quantity(direction.gamma_deg, '°', digits=3)}"
    yield Fact.measured("peak_cd", "Peak intensity", photometry.peak_cd, f"{start}{at}")
    yield Fact.measured("axis_cd", "Intensity on the axis", photometry.axis_cd)
    for beam in (photometry.beam_c0, photometry.beam_c90):
        plane = f"C {beam.c_deg:.0f}"
        if beam.c_deg not in _judged_planes(spec):
            note, notice = _beam_note(beam.beam_angle_deg, _target_beam_deg(spec).get(beam.c_deg))
            yield Fact.measured(f"beam_{plane}", f"Beam angle, {plane}", beam.beam_angle_deg, note, notice=notice)
        yield Fact.measured(f"field_{plane}", f"Field angle, {plane}", beam.field_angle_deg, "full width at 10 %")
    yield from facts_in(photometry.figures)
    noise = "" if photometry.node_error is None else f"the table’s noise is {percent(photometry.node_error.rms)} rms"
    yield Fact("photometry_rays", "Rays", photometry.rays, note=noise)


def _lamp(case: Case[Photometry], road: AreaLamp, lenses: int) -> Iterator[Fact]:
    shape = road.distribution
    several = f"all {lenses} lenses" if lenses > 1 else ""
    yield Fact("lenses", "Lenses", lenses)
    yield Fact.measured("lamp_lm", "Luminous flux, lamp", road.lumens)
    if (files := case.result.luminaire) is not None:
        note = f"hold {quantity(files.ies.lumens, 'lm', digits=5)} of {several}"
        yield Fact("luminaire", "Luminaire files", f"luminaire{case.suffix}.ies, .ldt, .iesxml", note=note)
    yield Fact("distribution", "IES distribution", str(shape).removeprefix("type "))
    yield Fact.measured("street_mh", "Half-peak line reaches", shape.street_mh, "mounting heights towards the street")
    yield Fact("bug", "BUG rating", str(road.bug), note=several)
    yield from facts_in(road.glare)
