"""compare.png: simulation and photograph side by side, and the lines through their centres."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float


def draw_comparison(
    path: Path, images: dict[str, Float[np.ndarray, "..."]], sections: dict[str, Any], receiver_mm: float
) -> None:
    """Draw both pictures on one scale, and their sections along x and y (mm), to ``path``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.5), layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 2)
    half, most = receiver_mm / 2.0, max(float(images["simulated"].max()), float(images["measured"].max()))
    for axes, name in zip(top, ("simulated", "measured"), strict=True):
        extent = (-half, half, -half, half)
        shown = axes.imshow(images[name], origin="lower", extent=extent, cmap="inferno", vmin=0.0, vmax=most)
        axes.set(title=name, xlabel="x (mm)", ylabel="y (mm)")
    figure.colorbar(shown, ax=top, label="irradiance (mean = 1)")
    for axes, axis in zip(bottom, "xy", strict=True):
        for name, style in (("simulated", "-"), ("measured", "--")):
            axes.plot(images["axis_mm"], sections[f"section_{axis}_{name}"], style, label=name)
        axes.set(xlabel=f"{axis} (mm)", ylabel="irradiance (mean = 1)", xlim=(-half, half))
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
