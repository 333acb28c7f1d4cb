"""Plots of arrays, on the caller's axes or new ones; each returns its axes."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.results import Image
from lensforge.results.chart import WATTS, Chart, LightUnit

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
else:
    Axes = Any  # Matplotlib is loaded where something is drawn


def plot_map(
    image: Image, chart: Chart, unit: LightUnit = WATTS, axes: "Axes | None" = None, outline: Image | None = None
) -> "Axes":
    """Light (W/m^2 or W/sr, [row y, column x]) on a receiver in false colour, with its scale in ``unit``.

    ``outline``: an image, such as the target, whose line at half of its peak is drawn.
    """
    axes = new_axes(axes)
    shown = axes.imshow(unit.per_watt * image, origin="lower", extent=chart.extent, cmap="inferno", vmin=0.0)
    axes.figure.colorbar(shown, ax=axes, label=unit.label)
    if outline is not None:
        draw_outline(axes, outline, chart)
    chart.label(axes)
    return axes


def draw_outline(axes: "Axes", image: Image, chart: Chart) -> None:
    """Draw the line at half of the peak of ``image``; one row of pixels, or no light, has none."""
    if min(image.shape) > 1 and image.max() > 0.0:
        x, y = chart.x(image.shape[1]), chart.y(image.shape[0])
        axes.contour(x, y, image, levels=[0.5 * image.max()], colors="white", linewidths=0.7, alpha=0.85)


def plot_face(values: Image, half_width: float, label: str, axes: "Axes | None" = None) -> "Axes":
    """A quantity over the chart of a face, a square of ``half_width`` ([X, Y], NaN outside); colours about zero."""
    axes = new_axes(axes)
    known = values[np.isfinite(values)]
    reach = float(np.abs(known).max()) if len(known) else 1.0
    half_width = half_width or 1.0  # a single node
    extent = (-half_width, half_width, -half_width, half_width)
    shown = axes.imshow(values.T, origin="lower", extent=extent, cmap="RdBu_r", vmin=-reach, vmax=reach)
    axes.figure.colorbar(shown, ax=axes, label=label)
    axes.set(xlabel="X of the chart", ylabel="Y of the chart")
    return axes


def plot_curves(
    curves: Mapping[str, tuple[Sequence[float] | Float[np.ndarray, " n"], Sequence[float] | Float[np.ndarray, " n"]]],
    labels: tuple[str, str],
    axes: "Axes | None" = None,
    logarithmic: tuple[bool, bool] = (False, False),
) -> "Axes":
    """Named lines, each as x and y; ``labels`` of the two axes, each ``logarithmic`` or not."""
    axes = new_axes(axes)
    for name, (x, y) in curves.items():
        axes.plot(x, y, label=name)
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set(**{f"{axis}scale": "log" for axis, wanted in zip("xy", logarithmic, strict=True) if wanted})
    if len(curves) > 1:
        axes.legend()
    return axes


def plot_outlines(outlines: Sequence[Float[np.ndarray, "_ 2"]], across: str, axes: "Axes | None" = None) -> "Axes":
    """Closed outlines of a section (position ``across`` the axis and z, mm), filled and to scale."""
    axes = new_axes(axes)
    for outline in outlines:
        axes.fill(*outline.T, facecolor="#2f7fd1", alpha=0.2, edgecolor="black", linewidth=1.0)
    axes.set(xlabel=f"{across} (mm)", ylabel="z (mm)", aspect="equal")
    return axes


def plot_bars(
    values: Mapping[str, float], label: str, axes: "Axes | None" = None, errors: Sequence[float] | None = None
) -> "Axes":
    """A bar for each named value, the first at the top, with the standard ``errors`` of them all where given."""
    axes = new_axes(axes)
    axes.barh(list(values), list(values.values()), xerr=errors, capsize=3.0)
    axes.invert_yaxis()
    axes.set(xlabel=label)
    return axes


def plot_distribution(
    values: Float[np.ndarray, " n"],
    label: str,
    axes: "Axes | None" = None,
    *,
    designed: float | None = None,
    bound: float | None = None,
) -> "Axes":
    """Share of the parts with at most each of ``values``, the value as ``designed``, and a ``bound`` that is kept."""
    axes = new_axes(axes)
    axes.step(np.sort(values), 100.0 * np.arange(1, len(values) + 1) / len(values), where="post", label="parts")
    if designed is not None:
        axes.axvline(designed, color="black", linewidth=1.0, linestyle=":", label="as designed")
    if bound is not None:
        axes.axvline(bound, color="#c62828", linewidth=1.5, label="bound")
    axes.set(xlabel=label, ylabel="cumulative share of the parts (%)", ylim=(0.0, 100.0))
    axes.legend()
    return axes


def new_axes(axes: "Axes | None") -> "Axes":
    """The caller's axes, or new ones that a notebook shows. Raises :class:`InputError` for anything else."""
    from matplotlib.axes import Axes

    if isinstance(axes, Axes):
        return axes
    if axes is not None:
        kind = type(axes).__name__
        raise InputError(f"axes: is of type {kind}, must be a matplotlib Axes; say what to plot by name, as in which=")
    import matplotlib.pyplot as plt

    return plt.subplots(layout="compressed")[1]
