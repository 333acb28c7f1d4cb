"""``sweep.html`` and ``sweep.png``: error and efficiency over the varied field, and the designs side by side."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lensforge.report.compare import ComparedPictures
from lensforge.report.page import picture, template
from lensforge.report.results import Results
from lensforge.results.figure_style import BLUE, GREEN, GREY, ORANGE, WIDE, in_report_style, new_figure, to_png
from lensforge.runs.sweep import Curve, Sweep

_HEIGHT = 3.2
_AXES = {
    "constraints.max_radius_mm": "largest radius allowed, r_c (mm)",
    "constraints.min_thickness_mm": "minimum thickness, Δr (mm)",
    "target.distance_mm": "distance of the target (mm)",
    "source.side_mm": "side of the source (mm)",
}


def sweep_page(sweep: Sweep, results: Sequence[Results]) -> str:
    """The page; ``results`` of each design, in the order of the sweep."""
    names = [f"{sweep.vary.split('.')[-1]} = {row.value:g}" for row in sweep.designs]
    return template("sweep.html").render(
        name=sweep.spec.name,
        field=sweep.vary,
        scale=sweep.scale,
        accuracy=sweep.accuracy,
        seed=sweep.seed,
        plot=picture("sweep", sweep_figure(sweep), f"Error and efficiency against {_label(sweep)}"),
        designs=sweep.facts,
        pictures=ComparedPictures(names, results),
        version=sweep.version,
    )


def sweep_png(sweep: Sweep) -> bytes:
    """The plot of the sweep as a PNG file."""
    return to_png(sweep_figure(sweep))


def _label(sweep: Sweep) -> str:
    return _AXES.get(sweep.vary, sweep.vary)


@in_report_style
def sweep_figure(sweep: Sweep) -> Figure:
    """NMSE on the left axis, efficiency on the right one, with standard errors; uniformity where it is defined."""
    figure, left = new_figure(WIDE, _HEIGHT)
    right = left.twinx()
    right.spines["right"].set_visible(True)
    _draw(left, Curve.of(sweep, "nmse"), "NMSE", BLUE, "o")
    _draw(right, Curve.of(sweep, "efficiency"), "efficiency", ORANGE, "s")
    even = Curve.of(sweep, "uniformity")
    if even.y:
        _draw(right, even, "uniformity", GREEN, "^")
    left.set(xlabel=_label(sweep), ylabel="NMSE")
    left.set_ylim(bottom=0.0)
    right.set_ylabel("efficiency, uniformity" if even.y else "efficiency")
    left.grid(True)
    figure.legend(loc="outside upper left", ncols=3)
    return figure


def _draw(axes: Axes, curve: Curve, label: str, colour: str, marker: str) -> None:
    x, y, noise = curve.x, curve.y, curve.errors
    axes.errorbar(x, y, noise, color=colour, ecolor=GREY, elinewidth=0.8, marker=marker, markersize=4.0, label=label)
