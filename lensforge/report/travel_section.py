"""Section of the report on the travel of an LED: its light at every stop, and what changes along the way."""

from dataclasses import dataclass

from matplotlib.figure import Figure

from lensforge.light.evaluation_result import Light
from lensforge.light.light_facts import unit_on
from lensforge.light.travel_stops import Travel, TravelStop, cuts
from lensforge.report import light_figures
from lensforge.report.light_section import top_of
from lensforge.report.page import PagePicture, picture
from lensforge.report.results import Results
from lensforge.results import Group
from lensforge.results.chart import LightUnit
from lensforge.results.figure_style import BLUE, DASHED, NARROW, ORANGE, in_report_style, new_figure
from lensforge.results.numerals import number

_CUT_HEIGHT, _CURVE_HEIGHT = 2.9, 1.6  # inches
_ROOM = 1.05  # of the scale over the largest light


@dataclass(frozen=True)
class StopPictures:
    """The light at one stop, its cuts, and its figures in a line, the ``caption``."""

    title: str
    caption: str
    seen: list[PagePicture]


@dataclass(frozen=True)
class TravelPictures:
    """The ``stops`` in their order, the curves over all, and a ``caption`` on the simulation."""

    stops: list[StopPictures]
    curves: list[PagePicture]
    caption: str


def travel_of(results: Results) -> tuple[Travel, LightUnit] | None:
    """The travel in the light of the lens, and the unit of its light; None where there is none."""
    light = results.find(Light)
    if light is None or light.travel is None:
        return None
    return light.travel, unit_on(light, light.first)


def travel_groups(results: Results) -> list[Group]:
    """A row of figures for each stop; none without a travel."""
    travel_and_unit = travel_of(results)
    if travel_and_unit is None:
        return []
    travel, unit = travel_and_unit
    return list(travel.groups(unit))


def stop_caption(stop: Group) -> str:
    """The place and the figures of a stop in a line."""
    figures = (f"{fact.label[:1].lower()}{fact.label[1:]} {fact.text}" for fact in stop.facts)
    return f"{stop.title}: {', '.join(figures)}"


def travel_pictures(results: Results) -> TravelPictures | None:
    """Pictures of the stops, each on its own scale, with cuts on the scale of all; None without a travel."""
    travel_and_unit = travel_of(results)
    if travel_and_unit is None:
        return None
    travel, unit = travel_and_unit
    rows, columns = travel.stops[0].map.shape
    caption = (
        f"By {number(travel.rays)} rays at each stop, the same at all, on {columns} × {rows} pixels: the axis is the "
        "mean of the four pixels about it, the width that at half of the largest light, mean along x and y."
    )
    top = _ROOM * top_of(cut.light for stop in travel.stops for cut in cuts(stop.map, travel.chart).values())
    stops = [
        StopPictures(stop.title, stop_caption(group), _of_stop(f"stop-{index}", stop, travel, unit, top))
        for index, (stop, group) in enumerate(zip(travel.stops, travel.groups(unit), strict=True))
    ]
    return TravelPictures(stops, _curves(travel, unit), caption)


def _of_stop(name: str, stop: TravelStop, travel: Travel, unit: LightUnit, top: float) -> list[PagePicture]:
    light = light_figures.irradiance_map(stop.map, travel.chart, top_of([stop.map]), unit=unit)
    return [
        picture(f"{name}-map", light, f"The light at {stop.title}", f"{travel.place[:1].upper()}{travel.place[1:]}."),
        picture(f"{name}-cut", _cut_figure(stop, travel, unit, top), "Cut through the axis", "All stops on one scale."),
    ]


@in_report_style
def _cut_figure(stop: TravelStop, travel: Travel, unit: LightUnit, top: float) -> Figure:
    """Light along x and y through the axis, up to ``top`` (W/m² or W/sr)."""
    figure, axes = new_figure(NARROW, _CUT_HEIGHT)
    for (name, cut), style in zip(cuts(stop.map, travel.chart).items(), ("-", DASHED), strict=True):
        axes.plot(cut.places, unit.per_watt * cut.light, color=BLUE, linestyle=style, label=f"along {name}")
    axes.set(xlabel=f"from the axis ({travel.chart.unit})", ylabel=unit.label, ylim=(0.0, unit.per_watt * top))
    axes.margins(x=0.0)
    axes.grid(True)
    figure.legend(loc="outside upper right", ncols=2)
    return figure


def _curves(travel: Travel, unit: LightUnit) -> list[PagePicture]:
    on_axis = {stop.shift_mm: unit.per_watt * stop.on_axis.value for stop in travel.stops}
    width = {stop.shift_mm: stop.width for stop in travel.stops if stop.width is not None}
    return [
        picture("travel-axis", _curve(on_axis, unit.label, BLUE), "On the axis"),
        picture("travel-width", _curve(width, f"width ({travel.chart.unit})", ORANGE), "Full width at half maximum"),
    ]


@in_report_style
def _curve(values: dict[float, float], label: str, colour: str) -> Figure:
    """Values by their places (mm) on the travel, each with a mark."""
    figure, axes = new_figure(NARROW, _CURVE_HEIGHT)
    axes.plot(list(values), list(values.values()), color=colour, marker="o", markersize=3.0)
    axes.set(xlabel="travel of the LED (mm)", ylabel=label)
    axes.set_ylim(bottom=0.0)
    axes.grid(True)
    return figure
