"""``sweep.html`` and ``sweep.png``: error and efficiency over the varied field, and the designs side by side."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lensforge.files import replacing
from lensforge.report.compare_pictures import ComparedPictures
from lensforge.report.drawing import BLUE, GREEN, GREY, ORANGE, WIDE, in_house_style, new_figure, save_picture
from lensforge.report.numerals import number
from lensforge.report.page import template
from lensforge.report.pictures import picture
from lensforge.report.results import load_results

PAGE, PLOT = "sweep.html", "sweep.png"
_HEIGHT = 3.2
_AXES = {
    "constraints.max_radius_mm": "largest radius allowed, r_c (mm)",
    "constraints.min_thickness_mm": "thickness demanded, Δr (mm)",
    "target.distance_mm": "distance of the target (mm)",
    "source.side_mm": "side of the source (mm)",
}
_JUDGED = {"nmse": "NMSE", "uniformity": "uniformity", "efficiency": "efficiency"}
_HEAD = ("largest radius (mm)", "height (mm)", "steps", "gates")


def build_page(content: dict[str, Any], directory: Path) -> Path:
    """Draw the content of ``sweep.json``; every design's folder is beside it. The page's path."""
    figure = tradeoff_figure(content)
    save_picture(figure, directory / PLOT)
    designs = content["designs"]
    judged = [name for name in _JUDGED if any(row[name] is not None for row in designs)]
    names = [f"{content['vary'].split('.')[-1]} = {row['value']:g}" for row in designs]
    compared = ComparedPictures(names, [load_results(directory / row["folder"]) for row in designs])
    page = template("sweep.html").render(
        name=content["spec"]["name"],
        field=content["vary"],
        scale=content["scale"],
        accuracy=content["accuracy"],
        seed=content["seed"],
        plot=picture("sweep", figure, f"Error and efficiency against {_label(content)}"),
        head=[content["vary"], *content["scale"], *(_JUDGED[name] for name in judged), *_HEAD],
        rows=[(row["folder"], _cells(row, judged)) for row in designs],
        maps=compared.maps,
        sections=compared.sections,
        version=content["version"],
    )
    path = directory / PAGE
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def _cells(row: dict[str, Any], judged: list[str]) -> list[str]:
    failed = [gate["name"] for gate in row["gates"] if not gate["passed"]]
    return [
        *(number(value, 4) for value in row["changes"].values()),
        *(_measured(row, name) for name in judged),
        f"{row['max_radius_mm']:.3f}",
        f"{row['height_mm']:.3f}",
        number(row["steps"]),
        f"fails: {', '.join(failed)}" if failed else "all hold",
    ]


def _measured(row: dict[str, Any], name: str) -> str:
    value, noise = row[name], row[f"{name}_standard_error"]
    return number(value, 4) + (f" ± {number(noise, 1)}" if noise else "")


def _label(content: dict[str, Any]) -> str:
    field: str = content["vary"]
    return _AXES.get(field, field)


@in_house_style
def tradeoff_figure(content: dict[str, Any]) -> Figure:
    """NMSE on the left axis, efficiency on the right one, with their standard errors; uniformity where it is judged."""
    figure, left = new_figure(WIDE, _HEIGHT)
    right = left.twinx()
    right.spines["right"].set_visible(True)
    designs = content["designs"]
    _draw(left, designs, "nmse", "NMSE", BLUE, "o")
    _draw(right, designs, "efficiency", "efficiency", ORANGE, "s")
    even = any(row["uniformity"] is not None for row in designs)
    if even:
        _draw(right, designs, "uniformity", "uniformity", GREEN, "^")
    left.set(xlabel=_label(content), ylabel="NMSE")
    left.set_ylim(bottom=0.0)
    right.set_ylabel("efficiency, uniformity" if even else "efficiency")
    left.grid(True)
    figure.legend(loc="outside upper left", ncols=3)
    return figure


def _draw(axes: Axes, designs: list[dict[str, Any]], name: str, label: str, colour: str, marker: str) -> None:
    rows = [row for row in designs if row[name] is not None]
    x, y = [row["value"] for row in rows], [row[name] for row in rows]
    noise = [row[f"{name}_standard_error"] or 0.0 for row in rows]
    axes.errorbar(x, y, noise, color=colour, ecolor=GREY, elinewidth=0.8, marker=marker, markersize=4.0, label=label)
