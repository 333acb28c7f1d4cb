"""compare_<surface>.png: the form deviation, and the irradiance before and after it."""

from pathlib import Path

import numpy as np
from jaxtyping import Float


def draw_surface(path: Path, arrays: dict[str, Float[np.ndarray, "..."]], side: str) -> None:
    """Draw the deviation over the chart (rim = unit circle) and both irradiances to ``path``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.5, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    form, before, after = figure.subplots(1, 3)
    reach = float(np.nanmax(np.abs(arrays["deviation_um"]))) or 1.0
    shown = form.imshow(
        arrays["deviation_um"], origin="lower", extent=(-1, 1, -1, 1), cmap="RdBu_r", vmin=-reach, vmax=reach
    )
    form.set(title=f"form deviation, {side} surface", xlabel="chart X", ylabel="chart Y")
    figure.colorbar(shown, ax=form, label="along the normal (µm)")
    axis, most = arrays["axis_mm"], float(arrays["irradiance_design"].max())
    half = float(axis[-1] + (axis[-1] - axis[-2]) / 2.0) if len(axis) > 1 else 1.0
    for axes, name, title in (
        (before, "irradiance_design", "as designed"),
        (after, "irradiance_measured", "as measured"),
    ):
        extent = (-half, half, -half, half)
        light = axes.imshow(arrays[name], origin="lower", extent=extent, cmap="inferno", vmin=0.0, vmax=most)
        axes.set(title=title, xlabel="x (mm)", ylabel="y (mm)")
    figure.colorbar(light, ax=[before, after], label="irradiance (W/m²)")
    figure.savefig(path, dpi=150)
