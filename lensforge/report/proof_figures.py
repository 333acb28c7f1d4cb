"""How far from the design the rays of each referee land, as a distribution."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from lensforge.report.drawing import BLUE, GREEN, INK, ORANGE, WIDE, in_house_style, new_figure

_COLOURS = (BLUE, GREEN, ORANGE)
_LEAST_MM = 1e-5  # nothing in light is finer than 10 nm


@in_house_style
def gap_figure(gaps_mm: Mapping[str, Float[np.ndarray, " q"]], limit_mm: float | None) -> Figure:
    """Share of the rays over the gap; ``gaps_mm``: by name of the referee, quantiles evenly from 0 to 1.

    ``limit_mm``: what the rms gap of the exported mesh must hold, dashed.
    """
    figure, axes = new_figure(WIDE, 3.1)
    for (name, quantiles), colour in zip(gaps_mm.items(), _COLOURS, strict=False):
        share = np.linspace(0.0, 1.0, len(quantiles))
        axes.plot(np.maximum(quantiles, _LEAST_MM), share, color=colour, label=name)
    if limit_mm is not None:
        axes.axvline(limit_mm, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="limit of the mesh's rms")
    axes.set(xscale="log", xlabel="distance from the design's landing (mm)", ylabel="share of the rays", ylim=(0, 1.02))
    low = min(float(quantiles[len(quantiles) // 50]) for quantiles in gaps_mm.values())
    axes.set_xlim(left=max(low, _LEAST_MM))
    axes.xaxis.set_major_locator(LogLocator(numticks=8))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.grid(True)
    figure.legend(loc="outside upper left", ncols=2, handlelength=1.3, columnspacing=1.0)
    return figure
