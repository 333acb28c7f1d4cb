"""``tradeoff.html``: the ladders as tables and Pareto plots."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lensforge.records import Metric
from lensforge.report.drawing import BLUE, GREEN, GREY, INK, ORANGE, RED, WIDE, in_house_style, new_figure
from lensforge.report.numerals import NOTHING, number
from lensforge.report.page import template
from lensforge.report.pictures import Picture, picture
from lensforge.spec import Accuracy
from lensforge.studies.tradeoff.ladder import Errors, Ladder, Rung
from lensforge.studies.tradeoff.record import PresetPrice, Tradeoff

_HEIGHT = 3.0
_COLOURS = (BLUE, ORANGE, GREEN, RED)

NAMES = {
    "efficiency": "efficiency",
    "irradiance_nmse": "irradiance, NMSE",
    "nmse_raised": "NMSE raised by",
    "rho": "radius",
    "normal": "normal",
    "hit": "hit, largest",
    "hit_99_percent": "hit, 99 of 100",
    "splat_nmse": "splat, NMSE",
    "nmse_shift": "NMSE shifted by",
    "noise_nmse": "noise left, NMSE",
    "form": "form",
    "chord": "form",
    "flux": "flux",
}
_OTHER = {
    "nodes": "nodes a side",
    "tables_mb": "tables (MB)",
    "bisections": "bisections",
    "nmse": "NMSE",
    "step_kb": "STEP (kB)",
    "triangles": "triangles",
}

_PRESETS = {
    "rays": "rays",
    "table_rho": "radius (nm)",
    "table_normal": "normal (mrad)",
    "table_hit": "hit (mm)",
    "table_irradiance_nmse": "irradiance, NMSE",
    "noise_nmse": "ray noise, NMSE",
    "table_share": "table / noise",
    "efficiency_standard_error": "efficiency ±",
}
PRESET_HEAD = ["preset", *_PRESETS.values()]


@dataclass(frozen=True)
class Section:
    """One ladder on the page."""

    title: str
    knob: str
    reference: str
    orders: list[str]
    head: list[str]
    rows: list[list[str]]
    pictures: list[Picture]


def tradeoff_page(tradeoff: Tradeoff) -> str:
    """The page: one HTML file that needs nothing else."""
    return template("tradeoff.html").render(
        name=tradeoff.name,
        lens=tradeoff.lens,
        threads=tradeoff.threads,
        seconds=number(tradeoff.seconds, 3),
        preset_head=PRESET_HEAD,
        presets=preset_rows(tradeoff.presets),
        sections=sections_of(tradeoff),
        version=tradeoff.version,
    )


def sections_of(tradeoff: Tradeoff) -> list[Section]:
    """The ladders as the page shows them."""
    return [_section(ladder) for ladder in tradeoff.ladders.values()]


def preset_rows(presets: Mapping[Accuracy, PresetPrice]) -> list[list[str]]:
    """What each preset leaves in design and in evaluation, under :data:`PRESET_HEAD`."""
    return [
        [f"{name}, {stage}", *(_plain(getattr(found, key)) for key in _PRESETS)]
        for name, price in presets.items()
        for stage, found in (("design", price.design), ("evaluation", price.evaluation))
    ]


def _plain(value: Metric | float | None) -> str:
    return number(value.value if isinstance(value, Metric) else value, 3)


def _section(ladder: Ladder) -> Section:
    other = [key for key in _OTHER if any(key in rung.other for rung in ladder.rows)]
    head = [_headed(error, ladder.units) for error in ladder.units]
    return Section(
        ladder.title,
        ladder.knob,
        ladder.reference,
        [_order(series, found) for series, found in ladder.order.items() if found],
        ["method", "setting", "seconds", "MB", *head, *(_OTHER[key] for key in other), "used by"],
        [_cells(rung, other) for rung in ladder.rows],
        [
            picture(f"{ladder.name}-{error}", pareto(ladder, error), _title(error, ladder.against))
            for error in ladder.plotted
        ],
    )


def _headed(error: str, units: dict[str, str]) -> str:
    return f"{NAMES[error]} ({units[error]})" if units[error] else NAMES[error]


def _order(series: str, found: Errors) -> str:
    return f"{series}: " + ", ".join(f"{NAMES[error]} {_measured(order)}" for error, order in found.items())


def _measured(found: Metric) -> str:
    noise = found.standard_error
    return number(found.value, 3) + (f" ± {number(noise, 1)}" if noise else "")


def _cells(rung: Rung, other: list[str]) -> list[str]:
    setting = NOTHING if rung.reference and not rung.setting else number(rung.setting)
    used = "reference" if rung.reference else "; ".join(rung.presets)
    costs = [number(rung.seconds, 2), number(rung.peak_mb, 2)]
    errors = [_measured(error) for error in rung.errors.values()]
    return [rung.series, setting, *costs, *errors, *(number(rung.other.get(key), 4) for key in other), used]


def _title(error: str, against: str) -> str:
    title = f"{NAMES[error]} against {'time' if against == 'seconds' else 'setting'}"
    return title[0].upper() + title[1:]


@in_house_style
def pareto(ladder: Ladder, error: str) -> Figure:
    """The error of every rung over its time or its setting, both logarithmic; rungs that somebody uses are named."""
    figure, axes = new_figure(WIDE, _HEIGHT)
    shown = [
        rung for rung in ladder.rows if not rung.reference and rung.errors[error].value > 0.0 and _at(rung, ladder)
    ]
    for series, colour in zip(dict.fromkeys(rung.series for rung in shown), _COLOURS, strict=False):
        rungs = [rung for rung in shown if rung.series == series]
        x, y = [_at(rung, ladder) for rung in rungs], [rung.errors[error].value for rung in rungs]
        known = [rung.errors[error].standard_error or 0.0 for rung in rungs]
        noise = [min(own, 0.9 * value) for own, value in zip(known, y, strict=True)]
        axes.errorbar(x, y, noise, color=colour, ecolor=GREY, elinewidth=0.8, marker="o", markersize=3.5, label=series)
        if colour == _COLOURS[0]:
            for rung, at, value in zip(rungs, x, y, strict=True):
                _name(axes, rung, at, value)
    axes.set(xscale="log", yscale="log", ylabel=_headed(error, ladder.units))
    axes.set_xlabel("seconds" if ladder.against == "seconds" else ladder.knob)
    for axis, least in ((axes.xaxis, 1.3), (axes.yaxis, 0.7)):
        _tick(axis, least)
    axes.margins(x=0.16, y=0.12)
    axes.grid(True)
    if len({rung.series for rung in shown}) > 1:
        figure.legend(loc="outside upper left", ncols=2)
    return figure


def _at(rung: Rung, ladder: Ladder) -> float:
    return (rung.seconds or 0.0) if ladder.against == "seconds" else rung.setting


def _tick(axis: Axis, decades: float) -> None:
    """Powers of ten; over fewer ``decades`` than given also twos and fives."""
    low, high = axis.get_data_interval()
    short = high > low > 0.0 and np.log10(high / low) < decades
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if short else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 3)))
    axis.set_minor_formatter(NullFormatter())


def _name(axes: Axes, rung: Rung, at: float, value: float) -> None:
    text = "\n".join(rung.presets) or number(rung.setting)
    colour = INK if rung.presets else GREY
    axes.annotate(text, (at, value), (5, 4), textcoords="offset points", fontsize=7.0, color=colour)
