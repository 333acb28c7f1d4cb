"""Figures of the measured part as PNG files: a photograph and a measured surface, each against the design."""

import io
from typing import TYPE_CHECKING

import numpy as np

from lensforge.figures.light_unit import light_unit
from lensforge.measurement.comparison import PhotoComparison, SurfaceComparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def photo_png(found: PhotoComparison) -> bytes:
    """Draw simulation and photograph on one scale, and their sections along x and y (mm), as a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 2)
    images = {"simulated": found.simulated, "measured": found.measured}
    chart, most = found.chart, max(float(image.max()) for image in images.values())
    for axes, (name, image) in zip(top, images.items(), strict=True):
        shown = axes.imshow(image, origin="lower", extent=chart.extent, cmap="inferno", vmin=0.0, vmax=most)
        axes.set(title=name)
        chart.label(axes)
    figure.colorbar(shown, ax=top, label="irradiance (mean = 1)")
    sections = {
        "x": (found.x_mm, {"simulated": found.section_x_simulated, "measured": found.section_x_measured}),
        "y": (found.y_mm, {"simulated": found.section_y_simulated, "measured": found.section_y_measured}),
    }
    sides = found.width_mm, found.height_mm
    for axes, (axis, (places, lines)), side in zip(bottom, sections.items(), sides, strict=True):
        for (name, line), style in zip(lines.items(), ("-", "--"), strict=True):
            axes.plot(places, line, style, label=name)
        axes.set(xlabel=f"{axis} (mm)", ylabel="irradiance (mean = 1)", xlim=(-side / 2.0, side / 2.0))
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        axes.legend(frameon=False)
    return _png(figure)


def surface_png(found: SurfaceComparison) -> bytes:
    """Draw the form deviation over the chart (rim = unit circle) and the light before and after, as a PNG file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.5, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    form, before, after = figure.subplots(1, 3)
    reach = float(np.nanmax(np.abs(found.deviation_um))) or 1.0
    shown = form.imshow(
        found.deviation_um, origin="lower", extent=(-1, 1, -1, 1), cmap="RdBu_r", vmin=-reach, vmax=reach
    )
    form.set(title=f"form deviation, {found.surface} surface", xlabel="chart X", ylabel="chart Y")
    figure.colorbar(shown, ax=form, label="along the normal (µm)")
    chart, most = found.light_chart, float(found.irradiance_design.max())
    for axes, image, title in (
        (before, found.irradiance_design, "as designed"),
        (after, found.irradiance_measured, "as measured"),
    ):
        light = axes.imshow(image, origin="lower", extent=chart.extent, cmap="inferno", vmin=0.0, vmax=most)
        axes.set(title=title)
        chart.label(axes)
    figure.colorbar(light, ax=[before, after], label=light_unit(None, far_field=found.far_field).label)
    return _png(figure)


def _png(figure: "Figure") -> bytes:
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=150)
    return png.getvalue()
