"""Polar diagram of intensities as data sheets have it: gamma = 0 downwards, rings of constant candela."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLOURS = ("#c0392b", "#2f7fd1")
_RINGS = 5
_STEP_DEG = 30.0


def draw_polar(axes: "Axes", curves: Mapping[str, tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]]) -> None:
    """Draw each curve, signed angles gamma (deg) and intensities (cd), on ordinary ``axes`` with rings and rays."""
    largest = max(float(values.max()) for _, values in curves.values())
    ring = _round_step(largest / _RINGS)
    rings = ring * np.arange(1, int(np.ceil(largest / ring - 1e-9)) + 1)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    for radius in rings:
        axes.plot(radius * np.sin(turn), -radius * np.cos(turn), color="0.85", linewidth=0.7, zorder=0)
        axes.annotate(f"{radius:g}", (0.0, radius), fontsize=7, color="0.45", ha="center", va="bottom")
    for angle in np.deg2rad(np.arange(0.0, 360.0, _STEP_DEG)):
        axes.plot([0.0, rings[-1] * np.sin(angle)], [0.0, -rings[-1] * np.cos(angle)], color="0.9", lw=0.6, zorder=0)
    for (name, (gamma, values)), colour in zip(curves.items(), _COLOURS, strict=False):
        angle = np.deg2rad(gamma)
        axes.plot(values * np.sin(angle), -values * np.cos(angle), color=colour, linewidth=1.8, label=name)
    axes.set(aspect="equal", title="intensity (cd), gamma = 0 downwards", xticks=[], yticks=[])
    axes.set_frame_on(False)
    axes.legend(frameon=False, loc="upper right")


def _round_step(step: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(next(power * each for each in (1.0, 2.0, 5.0, 10.0) if power * each >= step * (1.0 - 1e-9)))
