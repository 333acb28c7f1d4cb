"""``tradeoff.html``: the convergence studies as tables and Pareto plots."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lensforge.report.figure_style import BLUE, GREEN, GREY, INK, ORANGE, RED, WIDE, in_report_style, new_figure
from lensforge.report.numerals import NOTHING, number, number_with_error
from lensforge.report.page import template
from lensforge.report.pictures import PagePicture, picture
from lensforge.results import Metric
from lensforge.runs.tradeoff.convergence import ConvergenceStudy, Errors, RefinementLevel
from lensforge.runs.tradeoff.record import PresetAccuracy, Tradeoff
from lensforge.spec import Accuracy

_HEIGHT = 3.0
_COLOURS = (BLUE, ORANGE, GREEN, RED)

_NAMES = {
    "efficiency": "efficiency",
    "irradiance_nmse": "irradiance, NMSE",
    "nmse_raised": "NMSE raised by",
    "rho": "radius",
    "normal": "normal",
    "hit": "hit, largest",
    "hit_99_percent": "hit, 99th percentile",
    "splat_nmse": "splat, NMSE",
    "nmse_shift": "NMSE shifted by",
    "noise_nmse": "remaining noise, NMSE",
    "form": "form",
    "nmse": "NMSE",
    "loss": "lost light",
    "chord": "form",
}
_UNITS = {"um": "µm"}
_OTHER = {
    "nodes": "nodes per side",
    "nmse": "NMSE",
    "step_kb": "STEP (kB)",
    "triangles": "triangles",
    "inner_concave_mm": "smallest concave radius inside (mm)",
    "outer_concave_mm": "outside (mm)",
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
class StudySection:
    """A convergence study on the page."""

    title: str
    knob: str
    reference: str
    orders: list[str]
    head: list[str]
    rows: list[list[str]]
    pictures: list[PagePicture]


def tradeoff_page(tradeoff: Tradeoff) -> str:
    """The page: one self-contained HTML file."""
    return template("tradeoff.html").render(
        name=tradeoff.name,
        lens=tradeoff.lens,
        threads=tradeoff.threads,
        seconds=number(tradeoff.seconds, 3),
        preset_head=PRESET_HEAD,
        presets=preset_rows(tradeoff.presets),
        sections=[study_section(study) for study in tradeoff.studies.values()],
        version=tradeoff.version,
    )


def preset_rows(presets: Mapping[Accuracy, PresetAccuracy]) -> list[list[str]]:
    """Errors of each preset in design and in evaluation, under :data:`PRESET_HEAD`."""
    return [
        [f"{name}, {stage}", *(_plain(getattr(found, key)) for key in _PRESETS)]
        for name, preset in presets.items()
        for stage, found in (("design", preset.design), ("evaluation", preset.evaluation))
    ]


def _plain(value: Metric | float | None) -> str:
    return number(value.value if isinstance(value, Metric) else value, 3)


def study_section(study: ConvergenceStudy) -> StudySection:
    """The study's description, its levels as a table, and its plots."""
    other = list(dict.fromkeys(key for level in study.levels for key in level.other))
    head = [_headed(error, study.units) for error in study.units]
    return StudySection(
        study.title,
        study.knob,
        study.reference,
        [_order(series, found) for series, found in study.order.items() if found],
        ["method", "setting", "seconds", "MB", *head, *(_OTHER.get(key, key) for key in other), "used by"],
        [_cells(level, list(study.units), other) for level in study.levels],
        [
            picture(f"{study.name}-{error}", pareto(study, error), _title(error, study.against))
            for error in study.plotted
        ],
    )


def _headed(error: str, units: dict[str, str]) -> str:
    unit = _UNITS.get(units[error], units[error])
    return _named(error) + (f" ({unit})" if unit else "")


def _named(error: str) -> str:
    return _NAMES.get(error, error)


def _order(series: str, found: Errors) -> str:
    return f"{series}: " + ", ".join(f"{_named(error)} {number_with_error(order, 3)}" for error, order in found.items())


def _cells(level: RefinementLevel, errors: list[str], other: list[str]) -> list[str]:
    setting = NOTHING if level.reference and not level.setting else number(level.setting)
    used = "reference" if level.reference else "; ".join(level.used_by)
    costs = [number(level.seconds, 2), number(level.peak_mb, 2)]
    found = [number_with_error(level.errors[name], 3) for name in errors]
    return [level.series, setting, *costs, *found, *(number(level.other.get(key), 4) for key in other), used]


def _title(error: str, against: str) -> str:
    title = f"{_named(error)} against {'time' if against == 'seconds' else 'setting'}"
    return title[0].upper() + title[1:]


@in_report_style
def pareto(study: ConvergenceStudy, error: str) -> Figure:
    """The error of every level over its time or setting, both logarithmic; levels in use are labelled with the user."""
    figure, axes = new_figure(WIDE, _HEIGHT)
    shown = [
        level for level in study.levels if not level.reference and level.errors[error].value > 0.0 and _at(level, study)
    ]
    for series, colour in zip(dict.fromkeys(level.series for level in shown), _COLOURS, strict=False):
        levels = [level for level in shown if level.series == series]
        x, y = [_at(level, study) for level in levels], [level.errors[error].value for level in levels]
        known = [level.errors[error].standard_error or 0.0 for level in levels]
        noise = [min(own, 0.9 * value) for own, value in zip(known, y, strict=True)]
        axes.errorbar(x, y, noise, color=colour, ecolor=GREY, elinewidth=0.8, marker="o", markersize=3.5, label=series)
        if colour == _COLOURS[0]:
            for level, at, value in zip(levels, x, y, strict=True):
                _name(axes, level, at, value)
    axes.set(xscale="log", yscale="log", ylabel=_headed(error, study.units))
    axes.set_xlabel("seconds" if study.against == "seconds" else study.knob)
    for axis, least in ((axes.xaxis, 1.3), (axes.yaxis, 0.7)):
        _tick(axis, least)
    axes.margins(x=0.16, y=0.12)
    axes.grid(True)
    if len({level.series for level in shown}) > 1:
        figure.legend(loc="outside upper left", ncols=2)
    return figure


def _at(level: RefinementLevel, study: ConvergenceStudy) -> float:
    return (level.seconds or 0.0) if study.against == "seconds" else level.setting


def _tick(axis: Axis, decades: float) -> None:
    """Powers of ten; over fewer ``decades`` than given also twos and fives."""
    low, high = axis.get_data_interval()
    short = high > low > 0.0 and np.log10(high / low) < decades
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if short else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 3)))
    axis.set_minor_formatter(NullFormatter())


def _name(axes: Axes, level: RefinementLevel, at: float, value: float) -> None:
    text = "\n".join(level.used_by) or number(level.setting)
    colour = INK if level.used_by else GREY
    axes.annotate(text, (at, value), (5, 4), textcoords="offset points", fontsize=7.0, color=colour)
