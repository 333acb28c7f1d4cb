"""Sections of the report on light: pictures of each receiver, photometry, and light under other conditions."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from lensforge.light.beam_colour import BeamColour
from lensforge.light.evaluation_result import Light
from lensforge.light.light_facts import Attainable, LimitBounds, light_reasons, unit_on
from lensforge.light.photometry_result import Photometry
from lensforge.light.receiver_light import ReceiverLight, mask_words, window_words
from lensforge.light.seen_lens import radiance_unit
from lensforge.report import body_figures, colour_figures, light_figures, study_figures
from lensforge.report.added_section import pictures_of_applications
from lensforge.report.page import PagePicture, numbered, picture
from lensforge.report.results import Results
from lensforge.results import Fact, Group, Image, StageResult
from lensforge.results.case import Case
from lensforge.results.chart import Chart, LightUnit, light_unit
from lensforge.results.numerals import number, percent
from lensforge.results.verdict import worst
from lensforge.scene.body_view import body_views
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import uniform_region
from lensforge.search.design_result import Design
from lensforge.search.scene_check import light_requirements
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec

OWN = "nominal"
_SEEN = "Seen from behind the receiver, towards the lens."
_SIDES: dict[body_figures.Side, str] = {"lit": "from the lens", "far": "from behind"}
_OF_PATCHES = "Each patch in the mean of its light, which rays bring to its outside. 25° aside."
_FIRST = 4.6  # inches: half of the page
_ABOVE = 1.1  # of the target's peak: shows the ripple of a flat target
_HOT = 1.25  # of the target's peak: brighter light has a scale of its own
# Groups of facts on a result under other conditions that stand for it in one row, and the keys of these facts.
_MAIN = {
    "part": ("landing", "nmse_vs_design", "part_efficiency"),
    "stray": ("detected_stray", "stray_efficiency"),
    "nominal": ("nmse", "efficiency"),
    "yield": ("pass_rate",),
    "far_field": ("exit_lm", "peak_cd"),
    "walls": ("thinnest",),
}


@dataclass(frozen=True)
class ShownReceiver:
    """Light on one receiver, in ``unit``. ``spec``: of its state. ``number``: counted over all states."""

    case: Case[Light]
    unit: LightUnit
    spec: Spec
    number: int

    @property
    def light(self) -> ReceiverLight:
        """The light on it."""
        return cast(ReceiverLight, self.case.record)

    @property
    def name(self) -> str:
        """Names of its state and of the receiver; empty if it is the only one."""
        return ", ".join(filter(None, (self.case.led, self.case.name)))

    @property
    def place(self) -> str:
        """Place of the receiver; among several with its name."""
        return f"{self.light.place} ({self.name})" if self.name else self.light.place

    @property
    def heading(self) -> str:
        """Heading of its pictures; empty if it is the only one."""
        return f"{self.name}, {self.light.place}" if self.name else ""

    def picture_name(self, name: str) -> str:
        """Name of one of its pictures, unique on the page; pictures of the first receiver have ``name`` itself."""
        return numbered(name, self.number)

    def mask(self, pixels: int) -> Bool[np.ndarray, "h w"] | None:
        """Its region of uniform light on ``pixels`` along the longer side; None if it has none."""
        sections = self.spec.all_receivers
        number = self.case.number
        if number >= len(sections):
            return None
        return uniform_region(sections[number].targets, receivers_of(self.spec, pixels)[number])


@dataclass(frozen=True)
class ReceiverPictures:
    """The pictures of one receiver: those ``seen`` at once, and rows of ``more``, under ``heading``."""

    heading: str
    seen: list[PagePicture]
    more: tuple[list[PagePicture], ...]


def shown_receivers(results: Results) -> list[ShownReceiver]:
    """The receivers of the lens's own light in each state; none where it has not been simulated."""
    light = results.find(Light)
    return [] if light is None else receivers_in(light, results.spec)


def receivers_in(light: Light, spec: Spec) -> list[ShownReceiver]:
    """Receivers of ``light``, state after state. ``spec``: of the lens, with all its states."""
    return [
        ShownReceiver(case, unit_on(case.result, case.record), spec.of_state(case.result.led), number)
        for number, case in enumerate(light.cases("receivers"))
    ]


def unit_of_light(results: Results, *, far_field: bool | None = None, led: str = "") -> LightUnit:
    """Lux or candela where lumens are known, else W/m^2 or W/sr; ``far_field``: by default as the first receiver is.

    ``led``: name of the LED, by default the first.
    """
    light = results.find(Light)
    design = results.find(Design)
    if far_field is None:
        far_field = results.spec.of_state(led).all_receivers[0].is_far_field
    if light is not None:
        with_led = next((case.result for case in light.cases() if case.led == led), light)
        return light_unit(with_led.lumens_per_watt, far_field=far_field)
    return light_unit(None if design is None else design.source.lumens_per_watt, far_field=far_field)


def top_of(images: Iterable[np.ndarray]) -> float:
    """Peak of ``images``, the top of their scale; 1 where all of them are dark."""
    return max((float(image.max()) for image in images), default=0.0) or 1.0


def possible_limits(spec: Spec) -> dict[str, LimitBounds]:
    """Most light that étendue and two refractions leave for each limit of each state.

    Empty for a source from a file: a folder need not hold it, so that nothing can be said afterwards.
    """
    return {name: _possible_limits(state) for name, state in spec.by_state.items()}


def _possible_limits(spec: Spec) -> LimitBounds:
    if not spec.has_limits or spec.source.extent_mm is None:
        return {}
    _, limits = light_requirements(spec, build_source(spec.source))
    return {
        (limit.name, limit.required): Attainable(
            limit.possible, limit.law if limit.bounds is None else limit.bounds.law
        )
        for limit in limits
        if not limit.estimated
    }


def first_picture(results: Results) -> PagePicture | None:
    """The light on the first receiver for the top of the page, in the place and on the scale of the target.

    Light with a hot spot is on a scale of its own, on which a line is the target's peak.
    """
    for shown in shown_receivers(results)[:1]:
        light = shown.light
        unit = shown.unit
        target = shown.light.target_map
        frame = light_figures.lit_frame(target, light.map, light.chart)
        wanted = top_of([target])
        peak = top_of([light_figures.drawn(light.map)])
        hot = peak > _HOT * wanted
        top, whose = (peak, "its own") if hot else (_ABOVE * wanted, "the target\u2019s")
        figure = light_figures.irradiance_map(light.map, light.chart, top, target, unit=unit, width=_FIRST, frame=frame)
        if hot:
            figure = light_figures.with_level(figure, unit.per_watt * wanted)
        level = " Line on the scale: the target\u2019s peak." if hot else ""
        cut = "" if frame == light.chart else " Cut to the lit part of the receiver."
        caption = f"Simulated {unit.quantity} {shown.place}. {_SEEN} Line: the target at half its peak.{level}{cut}"
        return picture("first", figure, f"The light, on {whose} scale", caption)
    return None


def receiver_pictures(results: Results) -> list[ReceiverPictures]:
    """Pictures of the lens's own light: on every receiver, as the eyes of limits see the lens, and on bodies."""
    on_receivers = (_of_receiver(shown, results.light) for shown in shown_receivers(results))
    return [*on_receivers, *_seen_by_eyes(results), *_on_bodies(results)]


def _seen_by_eyes(results: Results) -> Iterator[ReceiverPictures]:
    light = results.find(Light)
    drawn = [
        picture(
            numbered("seen", index),
            light_figures.seen_lens(seen, radiance_unit(case.result.lumens_per_watt)),
            case.title(seen.name),
            f"Each pixel: the mean over the spot of {number(seen.spot_mm, 2)} mm about it. Circle: the brightest.",
        )
        for index, (case, seen) in enumerate(
            (case, seen) for case in (light.cases() if light else ()) for seen in case.result.seen
        )
    ]
    if drawn:
        yield ReceiverPictures("The lens as seen", drawn, ())


def _on_bodies(results: Results) -> Iterator[ReceiverPictures]:
    light = results.find(Light)
    drawn: list[PagePicture] = []
    for case in light.cases() if light else ():
        views = {view.name: view for view in body_views(results.spec.of_state(case.result.led))}
        for body in case.result.on_bodies:
            unit = light_unit(case.result.lumens_per_watt)
            view = views[body.name]
            for side in body_figures.sides_of(view):
                figure = body_figures.lit_body(view, body.irradiance, unit, side)
                name = numbered("body", len(drawn))
                drawn.append(picture(name, figure, case.title(f"{body.name}, {_SIDES[side]}"), _OF_PATCHES))
    if drawn:
        yield ReceiverPictures("Light on bodies of the scene", drawn, ())


def _of_receiver(shown: ShownReceiver, whole: Light) -> ReceiverPictures:
    """All maps are seen at once where there is one receiver; of several the light on each: the page stays short."""
    light = shown.light
    lines = line_pictures(shown.picture_name, (light.target_map, light.map), light.chart, shown.unit)
    maps = _maps(shown, whole)
    rest = [lines, _flux(shown)]
    if light.colour is not None and light.tristimulus_map is not None:
        rest.insert(0, _colours(shown, light.colour, light.tristimulus_map))
    if not shown.name:
        return ReceiverPictures(shown.heading, maps, tuple(rest))
    wanted, lit, difference = maps
    return ReceiverPictures(shown.heading, [replace(lit, title=shown.heading)], ([wanted, difference], *rest))


def _colours(shown: ShownReceiver, colour: BeamColour, tristimulus: Float[np.ndarray, "3 h w"]) -> list[PagePicture]:
    """The light in its colours, their distances from the beam's, and over the angle or the radius."""
    chart = shown.light.chart
    name = shown.picture_name
    line = f"Dashed: {percent(colour.level)} of the peak."
    over = "Over angle" if chart.far_field else "Over radius"
    drawings = (
        ("colour", colour_figures.true_colours, "In colour", f"In sRGB. {line}"),
        (
            "delta-uv",
            colour_figures.delta_uv_map,
            "Δu′v′ from the beam’s colour",
            f"With ray noise. {line}",
        ),
        ("colour-over", colour_figures.colour_over_angle, f"{over}", "Mean u′ and v′ of rings about the centre."),
    )
    return [
        picture(name(key), draw(tristimulus, colour, chart), title, caption) for key, draw, title, caption in drawings
    ]


def _maps(shown: ShownReceiver, whole: Light) -> list[PagePicture]:
    light = shown.light
    chart = shown.light.chart
    unit = shown.unit
    target = light.target_map
    reached = light.map
    draw = light_figures.irradiance_map
    top = top_of([target, reached])
    mask = shown.mask(light_figures.MOST_DRAWN)
    has_mask = mask is not None and bool(mask.any())
    dashed = f" Dashed: the mask {mask_words(shown.spec, light.name)}." if has_mask else ""
    rows, columns = light.map.shape
    filtered = whole.filter.replace("pixel^2", "pixel²").replace("3x3", "3 × 3")
    simulated = f"{number(whole.rays)} rays, {columns} × {rows} pixels. {filtered}.{_as_means(light)}"
    wanted_map = draw(target, chart, top, target, unit=unit)
    reached_map = draw(reached, chart, top, target, mask if has_mask else None, unit)
    difference = light_figures.difference_map(reached - target, chart, unit)
    name = shown.picture_name
    scaled = f"Scaled to the simulated flux. Line: half peak. {_SEEN}"
    return [
        picture(name("target"), wanted_map, "Target", scaled),
        picture(name("simulated"), reached_map, "Simulated", f"{simulated} Line: the target's.{dashed}"),
        picture(name("difference"), difference, "Simulated minus target", "Red: too bright. Blue: too dark."),
    ]


def _as_means(light: ReceiverLight) -> str:
    """A sentence on pixels that are finer than what is drawn; empty if all are drawn."""
    rows, columns = light.map.shape
    if max(rows, columns) <= light_figures.MOST_DRAWN:
        return ""
    along = "per side" if rows == columns else "along the longer side"
    return f" Drawn as means on {light_figures.MOST_DRAWN} pixels {along}."


def line_pictures(
    name: Callable[[str], str],
    images: tuple[Image, Image],
    chart: Chart,
    unit: LightUnit,
    labels: tuple[str, str] = ("target", "simulated"),
) -> list[PagePicture]:
    """Cross-sections of two images; ``name``: makes the name of a picture unique on the page."""
    draw = light_figures.line_comparison
    return [
        picture(name(f"line{index}"), draw(line, *images, chart, unit, labels), f"Along {title}")
        for index, (title, line) in enumerate(light_figures.profile_lines(images[0], chart))
    ]


def _flux(shown: ShownReceiver) -> list[PagePicture]:
    light = shown.light
    chart = shown.light.chart
    name = shown.picture_name
    lines = light_figures.isolines(light.map, chart, shown.unit)
    encircled = light_figures.encircled_energy(light.target_map, light.raw_map, chart)
    budget = light_figures.flux_budget(light.flux, light.missed_by_cause, light.lost_in_bodies)
    whole = light.section.is_round and not light.is_far_field
    window = "all of the receiver" if whole else window_words(light).removeprefix("within ")
    return [
        picture(name("isolines"), lines, "Isolines", "Of the simulation, in per cent of its peak."),
        picture(name("encircled"), encircled, "Encircled energy", "Around the centre, out to the corners."),
        picture(name("flux"), budget, "Flux budget", f"Window: {window}."),
    ]


def photometry_pictures(results: Results) -> list[PagePicture]:
    """Polar and isocandela diagram, and of a lamp for an area or a road the light on the ground, with each LED."""
    photometry = results.find(Photometry)
    if photometry is None:
        return []
    return [
        replace(drawn, title=case.title(drawn.title))
        for case in photometry.cases()
        for drawn in _photometry_of_led(case.result, results, case.number)
    ]


def _photometry_of_led(photometry: Photometry, results: Results, led: int) -> list[PagePicture]:
    section = results.spec.photometry
    polar = study_figures.polar_diagram(photometry)
    isocandela = study_figures.isocandela_diagram(photometry)
    drawn = [
        picture(numbered("polar", led), polar, "Polar diagram", "Intensity (cd); gamma = 0 is the axis of the lens."),
        picture(numbered("isocandela", led), isocandela, "Isocandela", "C around, gamma outwards, as in the files."),
    ]
    if photometry.road is not None:
        height_m = next((entry.height_m for entry in results.spec.applications), None)
        ground = study_figures.ground_diagram(photometry, section.street_side_deg, section.lenses, height_m)
        caption = "One lamp at the centre; above the line is the street."
        drawn.append(picture(numbered("ground", led), ground, "On the ground", caption))
    return [*drawn, *pictures_of_applications(photometry, results.spec, led)]


def other_lights(results: Results) -> list[Group]:
    """Rows of the lens's own light and each light under other conditions, by receiver; none where there is no other."""
    return [row for name, light in _compared(results).items() for row in _light_rows(results, name, light)]


def other_pictures(results: Results) -> list[PagePicture]:
    """The lens's own light and every other, those in one unit on a receiver of one name on one scale."""
    entries = [
        (index, name, light, shown)
        for index, (name, light) in enumerate(_compared(results).items())
        for shown in receivers_in(light, results.spec)
    ]
    return [
        picture(
            shown.picture_name(f"other-{index}"),
            _map(shown, [receiver for _, _, _, receiver in entries]),
            shown.case.title(name),
            "" if light.conditions is None else str(light.conditions),
        )
        for index, name, light, shown in entries
    ]


def other_results(results: Results) -> list[Group]:
    """A row for each result under other conditions that is no light: its file, conditions, main facts, and misses."""
    rows = []
    for stem, result in results.others.items():
        if not isinstance(result, Light):
            main = [line for group in results.facts(result) if (line := _main_line(result, group))]
            missed = [str(criterion) for criterion in result.all_criteria() if not criterion.holds]
            facts = [
                Fact("conditions", "Conditions", str(result.conditions)),
                Fact("figures", "Figures", "; ".join(main)),
            ]
            rows.append(
                Group("other", f"{stem}.json", tuple(facts), "; ".join(f"missed: {criterion}" for criterion in missed))
            )
    return rows


def _main_line(result: StageResult, group: Group) -> str:
    """The facts of a group that stand for it in one row; empty if it has none."""
    return group.select(*(result.on_page.in_row or _MAIN.get(group.key, ()))).line


def _compared(results: Results) -> dict[str, Light]:
    """The lens's own light before every other, with each LED alone; none where there is no other."""
    nominal = results.find(Light)
    others = [light for light in results.others.values() if isinstance(light, Light)]
    named = {} if nominal is None else {OWN: nominal}
    named |= {OWN if light.conditions is None else light.conditions.name: light for light in others}
    with_leds = {
        f"{name}, {led}" if led else name: alone for name, light in named.items() for led, alone in light.by_led.items()
    }
    return with_leds if others or len(with_leds) > 1 else {}


def _light_rows(results: Results, name: str, light: Light) -> Iterator[Group]:
    reasons = list(light_reasons(light, results.lens))
    conditions = light.conditions
    spec = results.spec.of_state(light.led)
    source = spec.source.title
    celsius = conditions.temperature_c if conditions is not None else None
    celsius = spec.lens.at_work_c if celsius is None else celsius
    notes = () if celsius is None else (f"lens at {celsius:g} °C",)
    if conditions is not None:  # the reasons against the own light stand at the top of the page
        notes = (
            *notes,
            *(warning for _, warning in reasons),
            *(f"warning: {warning}" for warning in conditions.warnings),
        )
        source = conditions.source or source
    lit = [group for group in results.facts(light) if group.key == "light"]
    simulated = next(group for group in results.facts(light) if group.key == "simulation").select("rays")
    for case, group in zip(light.cases("receivers"), lit, strict=True):
        columns, rows = case.record.map.shape[::-1]
        facts = (
            Fact("source", "Source", source),
            *simulated.facts,
            Fact("pixels", "Pixels", f"{columns} × {rows}"),
            *group.select("nmse", "efficiency", "share_in_target", "uniformity").facts,
        )
        state = worst(state for state, _ in reasons)
        yield Group("light", case.title(name), facts, "" if case.number else "; ".join(notes), state)


def _map(shown: ShownReceiver, receivers: Sequence[ShownReceiver]) -> Figure:
    same = shown.light.name, shown.spec.all_receivers
    alike = [candidate for candidate in receivers if (candidate.light.name, candidate.spec.all_receivers) == same]
    one_unit = len({receiver.unit for receiver in alike}) == 1
    top = top_of(receiver.light.map for receiver in (alike if one_unit else [shown]))
    return light_figures.irradiance_map(shown.light.map, shown.light.chart, top, unit=shown.unit)
