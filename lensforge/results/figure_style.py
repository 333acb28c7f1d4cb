"""Style of all figures; a figure as SVG for a page (its ink is the page's text colour), as PNG, or as a file."""

import io
import re
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from functools import wraps
from types import MappingProxyType
from typing import Any, ParamSpec

import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

# Drawn in this colour, replaced by `currentColor` in the page, so that one picture serves light, dark and print.
INK = "#0b0b0d"
# Mid tones, distinct to colour-blind readers, that stand out on white and on black.
BLUE = "#2f7fd1"
ORANGE = "#e07a2f"
GREEN = "#2f9e6e"
RED = "#d6453d"
GREY = "#8b929c"
COLOURS = (BLUE, ORANGE, GREEN, RED, "#8a5cc9", "#c2569b", GREY, INK)  # of curves in one picture
DASHED = (0, (4, 2))

# Height over width of the axes of a map: between these its scale can be read.
_FLATTEST = 0.5
_TALLEST = 1.4
NARROW = 3.7  # inches: three figures side by side in the page
WIDE = 4.8  # inches: two
_EXPECTED_FONT = "DejaVu Sans"  # comes with matplotlib, so every machine lays out the same

_STYLE: dict[Any, Any] = {  # matplotlib types the keys, each version others
    "font.family": _EXPECTED_FONT,
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": False,
    "grid.color": INK,
    "grid.alpha": 0.12,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "hatch.linewidth": 0.5,
    "text.parse_math": False,
    "svg.fonttype": "none",
    "savefig.dpi": 200.0,
    "figure.autolayout": False,  # no engine is none
    "figure.constrained_layout.use": False,
}

_METADATA = ("Date", "Creator", "Format", "Type")  # none of it: the same results make the same picture

_Arguments = ParamSpec("_Arguments")


def report_style(more: Mapping[Any, Any] = MappingProxyType({})) -> AbstractContextManager[None]:
    """The report's style, and ``more``, on top of matplotlib's defaults, whatever a matplotlibrc or the caller sets."""
    return matplotlib.style.context(["default", {**_STYLE, **more}])


def in_report_style(draw: Callable[_Arguments, Figure]) -> Callable[_Arguments, Figure]:
    """Make a figure function draw in the report's style, whatever style its caller uses."""

    @wraps(draw)
    def styled(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> Figure:
        with report_style():
            return draw(*args, **kwargs)

    return styled


def new_figure(width: float, height: float) -> tuple[Figure, Axes]:
    """An empty figure of the given size (inches) and its axes."""
    figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.03))
    return figure, figure.add_subplot()


def new_map(
    width: float = NARROW, left: float = 0.6, bottom: float = 0.46, right: float = 0.88, tall: float = 1.0
) -> tuple[Figure, Axes, Axes]:
    """A figure with axes and a colour bar of their height, at fixed positions so that neighbours line up.

    ``tall``: height over width of the map; an elongated map lies at the right of its axes.
    """
    side = width - left - right
    top = 0.1
    box = side * min(max(tall, _FLATTEST), _TALLEST)
    height = bottom + box + top
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((left / width, bottom / height, side / width, box / height))
    axes.set_anchor("E")
    bar = figure.add_axes(((left + side + 0.1) / width, bottom / height, 0.1 / width, box / height))
    return figure, axes, bar


def add_colour_bar(bar: Axes, mapped: ScalarMappable, label: str, extend: str = "neither") -> Colorbar:
    """The scale of ``mapped`` in the axes ``bar``, one raster image instead of 256 rectangles."""
    scale = bar.figure.colorbar(mapped, cax=bar, extend=extend, extendfrac=0.03)
    scale.set_label(label, labelpad=5.0)
    scale.outline.set_visible(False)
    if scale.solids is not None:
        scale.solids.set_rasterized(True)
    scale.ax.tick_params(length=2.0)
    return scale


def to_svg(figure: Figure, name: str, description: str) -> str:
    """``figure`` as an SVG element for HTML. ``name`` keeps its ids apart from the ids of other figures."""
    buffer = io.StringIO()
    with report_style({"svg.hashsalt": name}):
        _lay_out(figure)
        figure.savefig(buffer, format="svg", transparent=True, metadata=dict.fromkeys(_METADATA))
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :].strip()
    svg = re.sub(r"<metadata>.*?</metadata>\s*", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    svg = re.sub(r"font: ([\d.]+px) [^;\"]+", r"font-size: \1", svg)
    svg = re.sub(r"font-family: [^;\"]+;? ?", "", svg)
    svg = svg.replace(INK, "currentColor")
    width = f"{figure.get_figwidth() * 96.0:.0f}"
    return re.sub(
        r'<svg ([^>]*?)width="[^"]*"([^>]*?)height="[^"]*"|<svg ([^>]*?)height="[^"]*"([^>]*?)width="[^"]*"',
        lambda match: _open_tag(match, width, description),
        svg,
        count=1,
    )


def _lay_out(figure: Figure) -> None:
    """Lay out for an SVG, and for good: savefig would draw all of the figure once more for it."""
    engine = figure.get_layout_engine()
    if engine is not None:
        FigureCanvasSVG(figure)  # by whose texts margins are measured
        figure.dpi = 72.0  # of an SVG
        engine.execute(figure)
        figure.set_layout_engine(None)  # "none" is an engine, for which savefig draws the figure once more


def _open_tag(match: re.Match[str], width: str, description: str) -> str:
    attributes = " ".join(part.strip() for part in match.groups() if part)
    label = description.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return f'<svg role="img" aria-label="{label}" width="{width}" {attributes}'
