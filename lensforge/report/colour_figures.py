"""Figures of colours on a receiver: the light as a screen shows it, distances from the beam's colour, and over angle.

Tristimulus values are maps of X, Y and Z per measure of the receiver, indexed [3, row y, column x], y upwards.
"""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from lensforge.light.beam_colour import BeamColour
from lensforge.optics.colorimetry import srgb_of, uv_of
from lensforge.report.light_figures import ON_DARK, ON_PALE, draw_border, drawn, label_radii, show
from lensforge.results.chart import Chart
from lensforge.results.figure_style import BLUE, NARROW, ORANGE, add_colour_bar, in_report_style, new_figure, new_map

Tristimulus = Float[np.ndarray, "3 h w"]
_DARK = 0.1  # of the peak: colours of less light are not drawn
_RINGS = 40


@in_report_style
def true_colours(tristimulus: Tristimulus, colour: BeamColour, chart: Chart) -> Figure:
    """The light as it looks, its brightest place as bright as a screen can show that colour; dashed: the beam."""
    figure, axes, bar = new_map(tall=chart.height / chart.width)
    small = _drawn(tristimulus)
    show(axes, srgb_of(np.moveaxis(small, 0, -1)), chart, ON_DARK)
    draw_border(axes, _beam(small, colour), chart)
    bar.set_axis_off()
    return figure


@in_report_style
def delta_uv_map(tristimulus: Tristimulus, colour: BeamColour, chart: Chart) -> Figure:
    """Distances in u', v' from the beam's colour, where there is at least a tenth of the peak; dashed: the beam.

    The scale ends at the largest in the beam.
    """
    figure, axes, bar = new_map(tall=chart.height / chart.width)
    small = _drawn(tristimulus)
    away = np.linalg.norm(uv_of(np.moveaxis(small, 0, -1)) - (colour.u.value, colour.v.value), axis=-1)
    shown = np.where(small[1] >= _DARK * small[1].max(), away, np.nan)
    beam = _beam(small, colour)
    top = float(shown[beam].max()) or 1.0
    picture = show(axes, shown, chart, ON_PALE, cmap="viridis", vmin=0.0, vmax=top)
    draw_border(axes, beam, chart)
    add_colour_bar(bar, picture, "Δu′v′", "max" if np.nanmax(shown) > top else "neither")
    return figure


@in_report_style
def colour_over_angle(tristimulus: Tristimulus, colour: BeamColour, chart: Chart) -> Figure:
    """Colour of rings about the middle of the receiver, as differences in u' and v' from the beam's."""
    figure, axes = new_figure(NARROW, 2.75)
    radii, uv = colour_of_rings(tristimulus, chart)
    for index, (name, mean, line) in enumerate((("Δu′", colour.u, ORANGE), ("Δv′", colour.v, BLUE))):
        axes.plot(radii, uv[:, index] - mean.value, color=line, label=name)
    label_radii(axes, chart, float(radii[-1]))
    axes.set(ylabel="from the beam’s colour", xlim=(0.0, None))
    axes.grid(True)
    axes.legend()
    return figure


def colour_of_rings(tristimulus: Tristimulus, chart: Chart) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 2"]]:
    """Radii on the chart of the rings in which there is a tenth of the brightest one's light, and their u', v'."""
    _, rows, columns = tristimulus.shape
    distance = np.hypot(chart.y(rows)[:, None], chart.x(columns)[None, :])
    count = min(_RINGS, max(1, min(rows, columns) // 2))
    width = 0.5 * min(chart.width, chart.height) / count
    ring = np.floor(distance / width).astype(int).ravel()
    totals = np.stack([np.bincount(ring, values.ravel())[:count] for values in tristimulus], axis=1)
    pixels = np.bincount(ring)[:count]
    light = np.divide(totals[:, 1], pixels, out=np.zeros(len(pixels)), where=pixels > 0)
    lit = (light >= _DARK * light.max()) & (light > 0.0)
    return (np.flatnonzero(lit) + 0.5) * width, uv_of(totals[lit])


def _drawn(tristimulus: Tristimulus) -> Tristimulus:
    return np.stack([drawn(values) for values in tristimulus])


def _beam(tristimulus: Tristimulus, colour: BeamColour) -> Bool[np.ndarray, "h w"]:
    return tristimulus[1] >= colour.level * tristimulus[1].max()
