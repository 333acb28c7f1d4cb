"""Pictures of the light on each receiver: target, simulation, difference, lines across, isolines, and its flux."""

from dataclasses import dataclass, replace

from lensforge.light.evaluation_result import Light
from lensforge.light.receiver_light import ReceiverLight
from lensforge.report import flux_figures, irradiance_figures, line_figures
from lensforge.report.lit_frame import lit_frame
from lensforge.report.numerals import number
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.shown_receivers import ShownReceiver, shown_receivers, top_of
from lensforge.runs.results import Results

_FIRST = 4.6  # inches: half of the page
_ABOVE = 1.1  # of the target's peak: the ripple of a flat target can still be told


@dataclass(frozen=True)
class ReceiverPictures:
    """The pictures of one receiver: those ``seen`` at once, and rows of ``more``, under ``heading``."""

    heading: str
    seen: list[PagePicture]
    more: tuple[list[PagePicture], ...]


def first_picture(results: Results) -> PagePicture | None:
    """The light on the first receiver for the top of the page, in the place and on the scale of the target."""
    for shown in shown_receivers(results)[:1]:
        light, unit, target = shown.light, shown.unit, shown.light.target_map
        frame = lit_frame(target, light.map, light.chart)
        figure = irradiance_figures.irradiance_map(
            light.map, light.chart, _ABOVE * top_of([target]), target, unit=unit, width=_FIRST, frame=frame
        )
        cut = "" if frame == light.chart else " Cut to the lit part of the receiver."
        caption = f"Simulated {unit.quantity} {shown.place}. Line: the target at half its peak.{cut}"
        return picture("first", figure, "The light, on the target\u2019s scale", caption)
    return None


def receiver_pictures(results: Results) -> list[ReceiverPictures]:
    """The pictures of every receiver of the lens's own light."""
    light = results.find(Light)
    if light is None:
        return []
    return [_of_receiver(shown, light) for shown in shown_receivers(results)]


def _of_receiver(shown: ShownReceiver, whole: Light) -> ReceiverPictures:
    """All maps are seen at once where there is one receiver; of several the light on each: the page stays short."""
    maps, rest = _maps(shown, whole), (_lines(shown), _flux(shown))
    if not shown.several:
        return ReceiverPictures(shown.heading, maps, rest)
    wanted, lit, difference = maps
    return ReceiverPictures(shown.heading, [replace(lit, title=shown.heading)], ([wanted, difference], *rest))


def _maps(shown: ShownReceiver, whole: Light) -> list[PagePicture]:
    """Target, simulated light and their difference."""
    light, chart, unit = shown.light, shown.light.chart, shown.unit
    target, reached, draw = light.target_map, light.map, irradiance_figures.irradiance_map
    top, mask = top_of([target, reached]), shown.mask(irradiance_figures.MOST_DRAWN)
    has_mask = mask is not None and bool(mask.any())
    dashed = f" Dashed: the mask {shown.mask_words}." if has_mask else ""
    simulated = f"{number(whole.rays)} rays, {pixels_of(light)} pixels. {_typeset(whole.filter)}.{_as_means(light)}"
    wanted_map = draw(target, chart, top, target, unit=unit)
    reached_map = draw(reached, chart, top, target, mask if has_mask else None, unit)
    difference = irradiance_figures.difference_map(reached - target, chart, unit)
    name = shown.picture_name
    return [
        picture(name("target"), wanted_map, "Target", "Scaled to the simulated flux. Line: half peak."),
        picture(name("simulated"), reached_map, "Simulated", f"{simulated} Line: the target's.{dashed}"),
        picture(name("difference"), difference, "Simulated minus target", "Red: too bright. Blue: too dark."),
    ]


def pixels_of(light: ReceiverLight) -> str:
    """Number of columns and rows."""
    rows, columns = light.map.shape
    return f"{columns} × {rows}"


def _as_means(light: ReceiverLight) -> str:
    """A sentence on pixels that are finer than what is drawn; empty where all are drawn."""
    rows, columns = light.map.shape
    if max(rows, columns) <= irradiance_figures.MOST_DRAWN:
        return ""
    along = "per side" if rows == columns else "along the longer side"
    return f" Drawn as means on {irradiance_figures.MOST_DRAWN} pixels {along}."


def _typeset(text: str) -> str:
    return text.replace("pixel^2", "pixel²").replace("3x3", "3 × 3")


def _lines(shown: ShownReceiver) -> list[PagePicture]:
    """Cross-sections of target and simulation."""
    light, draw = shown.light, line_figures.line_comparison
    lines = line_figures.profile_lines(light.target_map, light.chart)
    return [
        picture(
            shown.picture_name(f"line{index}"),
            draw(line, light.target_map, light.map, light.chart, shown.unit),
            f"Along {name}",
        )
        for index, (name, line) in enumerate(lines)
    ]


def _flux(shown: ShownReceiver) -> list[PagePicture]:
    """Isolines, encircled energy, and the flux budget."""
    light, chart, name = shown.light, shown.light.chart, shown.picture_name
    lines = irradiance_figures.isolines(light.map, chart, top_of([light.target_map]), shown.unit)
    encircled = line_figures.encircled_energy(light.target_map, light.raw_map, chart)
    budget = flux_figures.flux_budget(light.flux, light.missed_by_cause)
    window = "all of the receiver" if light.kind == "sphere" else shown.window.removeprefix("within ")
    return [
        picture(name("isolines"), lines, "Isolines", "Of the simulation, in per cent of the target's peak."),
        picture(name("encircled"), encircled, "Encircled energy", "Around the centre, out to the corners."),
        picture(name("flux"), budget, "Flux budget", f"Window: {window}."),
    ]
