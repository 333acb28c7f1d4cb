"""The largest value of a figure over a region of the plane, searched for between samples.

A largest sample is below the largest value by the square of the samples' spacing. Grids that shrink about the best few
samples close that gap: each round halves the window, so after ``rounds`` the place is known to ``reach / 2^rounds``.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

_AXIS = np.linspace(-1.0, 1.0, 5)
NODES = np.stack(np.meshgrid(_AXIS, _AXIS, indexing="ij"), axis=-1).reshape(-1, 2)  # of the window about each start
STARTS = 8  # the best sample alone may lie beside a lower peak

Places = Float[np.ndarray, "*m 2"]


def in_disc(places: Places) -> Places:
    """Places outside the unit disc moved to its rim."""
    return places / np.maximum(1.0, np.linalg.norm(places, axis=-1, keepdims=True))


def refined_maximum(
    figure: Callable[[Float[np.ndarray, "m 2"]], Float[np.ndarray, " m"]],
    samples: Float[np.ndarray, "k 2"],
    values: Float[np.ndarray, " k"],
    reach: float,
    *,
    starts: int = STARTS,
    rounds: int = 8,
    within: Callable[[Places], Places] = in_disc,
) -> tuple[Float[np.ndarray, "2"], float]:
    """Place and value of the largest ``figure`` of a region, searched within ``reach`` of the best samples.

    ``values``: the figure at ``samples``, NaN where undefined; at least their largest is returned. ``reach``: in the
    unit of the places, about the spacing of the samples or, if that is less, the width of the figure's peaks.
    ``within``: moves places into the region, by default the unit disc. The figure is evaluated for each start's places
    together, starts in the order of their values.
    """
    known = np.where(np.isnan(values), -np.inf, values)
    best = np.argsort(-known, kind="stable")[:starts]
    places = samples[best]
    highest = known[best]
    for _ in range(rounds):
        window = within(places[:, None] + reach * NODES)
        heights = figure(window.reshape(-1, 2)).reshape(len(places), -1)
        heights = np.where(np.isnan(heights), -np.inf, heights)
        top = np.argmax(heights, axis=1)
        rows = np.arange(len(places))
        higher = heights[rows, top]
        places = np.where((higher > highest)[:, None], window[rows, top], places)
        highest = np.maximum(highest, higher)
        reach /= 2.0
    first = int(np.argmax(highest))
    return places[first], float(highest[first])
