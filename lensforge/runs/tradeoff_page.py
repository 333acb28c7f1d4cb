"""``tradeoff.html``: accuracy against time as a table and two plots."""

from matplotlib.figure import Figure

from lensforge.report.page import picture, template
from lensforge.results.figure_style import BLUE, GREY, ORANGE, WIDE, in_report_style, new_figure
from lensforge.results.numerals import number
from lensforge.runs.tradeoff_result import Series, TradedError, Tradeoff, error_label

_HEIGHT = 3.0
_SERIES: dict[Series, str] = {
    "presets": "Evaluation by preset",
    "rays": "Evaluation by number of rays",
    "search": "Stages of a search",
}
_ERRORS: tuple[tuple[TradedError, str, str], ...] = (("nmse", BLUE, "o"), ("efficiency", ORANGE, "s"))


def tradeoff_page(tradeoff: Tradeoff) -> str:
    """The page: one self-contained HTML file."""
    return template("tradeoff.html").render(
        name=tradeoff.name,
        accuracy=tradeoff.accuracy,
        threads=tradeoff.threads,
        seconds=number(tradeoff.seconds, 3),
        sections=[(title, [row.facts for row in tradeoff.series(name)]) for name, title in _SERIES.items()],
        pictures=[
            picture(f"tradeoff-{name}", tradeoff_figure(tradeoff, name), f"{_SERIES[name]}: error against time")
            for name in ("rays", "search")
        ],
        version=tradeoff.version,
    )


@in_report_style
def tradeoff_figure(tradeoff: Tradeoff, series: Series) -> Figure:
    """Both errors of a series over its seconds, logarithmic; each point of the NMSE is named by its setting."""
    figure, axes = new_figure(WIDE, _HEIGHT)
    for error, colour, marker in _ERRORS:
        rows = [row for row in tradeoff.series(series) if row.seconds > 0.0 and row.error(error) > 0.0]
        x, y = [row.seconds for row in rows], [row.error(error) for row in rows]
        axes.plot(x, y, color=colour, marker=marker, markersize=4.0, label=error_label(series, error))
        if error == "nmse":
            for row, at, value in zip(rows, x, y, strict=True):
                axes.annotate(row.setting, (at, value), (5, 4), textcoords="offset points", fontsize=7.0, color=GREY)
    axes.set(xscale="log", yscale="log", xlabel="seconds")
    axes.margins(x=0.16, y=0.12)
    axes.grid(True)
    figure.legend(loc="outside upper left", ncols=2)
    return figure
