"""The picture of a measured surface: the form deviation, and the irradiance before and after it."""

import io

import numpy as np

from lensforge.measurement.comparison import SurfaceComparison


def surface_png(found: SurfaceComparison) -> bytes:
    """The deviation over the chart (rim = unit circle) and both irradiances, as a PNG file."""
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
    half, most = found.receiver_mm / 2.0, float(found.irradiance_design.max())
    for axes, image, title in (
        (before, found.irradiance_design, "as designed"),
        (after, found.irradiance_measured, "as measured"),
    ):
        extent = (-half, half, -half, half)
        light = axes.imshow(image, origin="lower", extent=extent, cmap="inferno", vmin=0.0, vmax=most)
        axes.set(title=title, xlabel="x (mm)", ylabel="y (mm)")
    figure.colorbar(light, ax=[before, after], label="irradiance (W/m²)")
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=150)
    return png.getvalue()
