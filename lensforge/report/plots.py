"""Plots for notebooks and scripts, on axes of the caller's or on new ones; each returns its axes."""

from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes

from lensforge.errors import InputError
from lensforge.lens import Lens
from lensforge.report.irradiance_figures import encircled_share
from lensforge.report.light import light_unit
from lensforge.report.pictures import source_outline
from lensforge.report.results import Results, load_results
from lensforge.report.section_figures import draw_section

Folder = Path | str


def plot_irradiance(
    directory: Folder, which: Literal["irradiance", "target", "raw"] = "irradiance", axes: Axes | None = None
) -> Axes:
    """The light on the receiver in false colour with its scale, in lux where the spec knows the lumens."""
    results, axes = _evaluated(directory), _on(axes)
    assert results.images is not None and results.evaluate is not None
    unit, half = light_unit(results.lens.spec), 0.5 * results.evaluate.receiver_mm
    light = unit.per_w_m2 * results.images[which]
    shown = axes.imshow(light, origin="lower", extent=(-half, half, -half, half), cmap="inferno", vmin=0.0)
    axes.figure.colorbar(shown, ax=axes, label=unit.label)
    axes.set(xlabel="x (mm)", ylabel="y (mm)")
    return axes


def plot_encircled_energy(directory: Folder, axes: Axes | None = None) -> Axes:
    """Shares of the receiver's flux within circles around the axis, of target and simulation."""
    results, axes = _evaluated(directory), _on(axes)
    assert results.images is not None and results.evaluate is not None
    for name, label, style in (("target", "target", "--"), ("raw", "simulated", "-")):
        axes.plot(*encircled_share(results.images[name], results.evaluate.receiver_mm), style, label=label)
    axes.set(xlabel="radius around the axis (mm)", ylabel="share of the receiver's flux", ylim=(0.0, 1.02))
    axes.legend()
    return axes


def plot_section(lens: Lens | Folder, azimuth_deg: float = 0.0, axes: Axes | None = None) -> Axes:
    """The lens cut along its axis, with rays from the centre of the source."""
    axes = _on(axes)
    if isinstance(lens, Lens):
        draw_section(axes, lens, azimuth_deg, None)
    else:
        results = load_results(Path(lens))
        draw_section(axes, results.lens, azimuth_deg, source_outline(results))
    return axes


def plot_history(
    directory: Folder,
    quantity: Literal["nmse", "loss", "efficiency", "g1_mm", "g2_mm", "g3_mm"] = "nmse",
    axes: Axes | None = None,
) -> Axes:
    """``quantity`` at every step of the search, one line for each level."""
    results, axes = load_results(Path(directory)), _on(axes)
    if results.design is None:
        raise InputError(f"{directory}: there is no design.json; run `lensforge design`")
    start = 0
    for level in results.design.history:
        values = np.array(getattr(level, quantity), dtype=np.float64)
        axes.plot(start + 1 + np.arange(len(values)), values, label=f"{level.functions} functions")
        start += len(level.nmse)
    axes.set(xlabel="step", ylabel=quantity.replace("_mm", " (mm)"), yscale="log" if quantity == "nmse" else "linear")
    axes.legend()
    return axes


def _evaluated(directory: Folder) -> Results:
    results = load_results(Path(directory))
    if results.evaluate is None or results.images is None:
        raise InputError(f"{directory}: the lens has not been simulated; run `lensforge evaluate {directory}`")
    return results


def _on(axes: Axes | None) -> Axes:
    """The caller's axes, or new ones that a notebook shows by itself."""
    if axes is not None:
        return axes
    import matplotlib.pyplot as plt

    created: Axes = plt.subplots(layout="constrained")[1]
    return created
