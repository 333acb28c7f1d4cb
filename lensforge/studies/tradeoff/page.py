"""``tradeoff.html``: the ladders of ``tradeoff.json`` as tables and Pareto plots; the page needs nothing else."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from lensforge.files import replacing
from lensforge.report.drawing import BLUE, GREEN, GREY, INK, ORANGE, RED, WIDE, in_house_style, new_figure
from lensforge.report.numerals import NOTHING, number
from lensforge.report.page import template
from lensforge.report.pictures import Picture, picture

FILE_NAME = "tradeoff.html"
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


def build_page(content: dict[str, Any], directory: Path) -> Path:
    """Write ``tradeoff.html`` from the content of ``tradeoff.json`` and return its path."""
    page = template("tradeoff.html").render(
        name=content["name"],
        lens=content["lens"],
        threads=content["threads"],
        seconds=number(content["seconds"], 3),
        preset_head=PRESET_HEAD,
        presets=preset_rows(content["presets"]),
        sections=sections_of(content),
        version=content["version"],
    )
    path = directory / FILE_NAME
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def sections_of(content: dict[str, Any]) -> list[Section]:
    """The ladders of ``tradeoff.json`` as the page shows them."""
    return [_section(name, ladder, content["plots"][name]) for name, ladder in content["ladders"].items()]


def preset_rows(presets: dict[str, Any]) -> list[list[str]]:
    """What each preset leaves in design and in evaluation, under :data:`PRESET_HEAD`."""
    return [
        [f"{name}, {stage}", *(number(found.get(key), 3) for key in _PRESETS)]
        for name, price in presets.items()
        for stage, found in price.items()
    ]


def _section(name: str, ladder: dict[str, Any], plot: dict[str, Any]) -> Section:
    rows = ladder["rows"]
    other = [key for key in _OTHER if any(key in row for row in rows)]
    head = [_headed(error, ladder["unit"]) for error in ladder["unit"]]
    return Section(
        ladder["title"],
        ladder["knob"],
        ladder["reference"],
        [_order(series, found) for series, found in ladder["order"].items() if found],
        ["method", "setting", "seconds", "MB", *head, *(_OTHER[key] for key in other), "used by"],
        [_cells(row, other) for row in rows],
        [
            picture(f"{name}-{error}", pareto(ladder, error, plot["against"]), _title(error, plot["against"]))
            for error in plot["errors"]
        ],
    )


def _headed(error: str, units: dict[str, str]) -> str:
    return f"{NAMES[error]} ({units[error]})" if units[error] else NAMES[error]


def _order(series: str, found: dict[str, dict[str, float | None]]) -> str:
    parts = []
    for error, order in found.items():
        noise = order["standard_error"]
        parts.append(f"{NAMES[error]} {number(order['value'], 3)}" + (f" ± {number(noise, 1)}" if noise else ""))
    return f"{series}: " + ", ".join(parts)


def _cells(row: dict[str, Any], other: list[str]) -> list[str]:
    errors = []
    for error, value in row["error"].items():
        noise = row["standard_error"][error]
        errors.append(number(value, 3) + (f" ± {number(noise, 1)}" if noise else ""))
    setting = NOTHING if row["reference"] and not row["setting"] else number(row["setting"])
    used = "reference" if row["reference"] else "; ".join(row["presets"])
    costs = [number(row["seconds"], 2), number(row["peak_mb"], 2)]
    return [row["series"], setting, *costs, *errors, *(number(row.get(key), 4) for key in other), used]


def _title(error: str, against: str) -> str:
    title = f"{NAMES[error]} against {'time' if against == 'seconds' else 'setting'}"
    return title[0].upper() + title[1:]


@in_house_style
def pareto(ladder: dict[str, Any], error: str, against: str) -> Figure:
    """The error of every rung over its time or its setting, both logarithmic; rungs that somebody uses are named."""
    figure, axes = new_figure(WIDE, _HEIGHT)
    shown = [row for row in ladder["rows"] if not row["reference"] and row["error"][error] > 0.0 and row[against]]
    for series, colour in zip(dict.fromkeys(row["series"] for row in shown), _COLOURS, strict=False):
        rows = [row for row in shown if row["series"] == series]
        x, y = [row[against] for row in rows], [row["error"][error] for row in rows]
        noise = [min(row["standard_error"][error] or 0.0, 0.9 * value) for row, value in zip(rows, y, strict=True)]
        axes.errorbar(x, y, noise, color=colour, ecolor=GREY, elinewidth=0.8, marker="o", markersize=3.5, label=series)
        if colour == _COLOURS[0]:
            for row, at, value in zip(rows, x, y, strict=True):
                _name(axes, row, at, value)
    axes.set(xscale="log", yscale="log", ylabel=_headed(error, ladder["unit"]))
    axes.set_xlabel("seconds" if against == "seconds" else ladder["knob"])
    for axis, least in ((axes.xaxis, 1.3), (axes.yaxis, 0.7)):
        _tick(axis, least)
    axes.margins(x=0.16, y=0.12)
    axes.grid(True)
    if len({row["series"] for row in shown}) > 1:
        figure.legend(loc="outside upper left", ncols=2)
    return figure


def _tick(axis: Axis, decades: float) -> None:
    """Powers of ten; over fewer ``decades`` than given also twos and fives."""
    low, high = axis.get_data_interval()
    short = high > low > 0.0 and np.log10(high / low) < decades
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if short else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 3)))
    axis.set_minor_formatter(NullFormatter())


def _name(axes: Axes, row: dict[str, Any], at: float, value: float) -> None:
    text = "\n".join(row["presets"]) or number(row["setting"])
    axes.annotate(
        text, (at, value), (5, 4), textcoords="offset points", fontsize=7.0, color=INK if row["presets"] else GREY
    )
