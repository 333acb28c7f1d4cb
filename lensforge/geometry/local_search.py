"""Largest values of a function over the unit disc of the chart, searched for between the samples that came closest.

A largest sample is below the largest value by the square of the samples' spacing. Grids that shrink about the best few
samples close that gap: each round halves the window, so after ``rounds`` the place is known to ``reach / 2^rounds``.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

_SIDE = 5  # nodes across the grid about each start
STARTS = 8  # the best sample alone may lie beside a lower peak


def refined_maximum(
    figure: Callable[[Float[np.ndarray, "m 2"]], Float[np.ndarray, " m"]],
    chart: Float[np.ndarray, "k 2"],
    values: Float[np.ndarray, " k"],
    reach: float,
    *,
    starts: int = STARTS,
    rounds: int = 8,
) -> tuple[Float[np.ndarray, "2"], float]:
    """Chart point and value of the largest ``figure`` of the disc, searched within ``reach`` of the best samples.

    ``values``: the figure at the samples ``chart``, NaN where it has none; never less than their largest is returned.
    ``reach``: chart units, about the spacing of the samples or, if that is less, the width of the figure's peaks.
    """
    known = np.where(np.isnan(values), -np.inf, values)
    best = np.argsort(-known, kind="stable")[:starts]
    places, highest = chart[best], known[best]
    axis = np.linspace(-1.0, 1.0, _SIDE)
    around = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    for _ in range(rounds):
        window = (places[:, None] + reach * around).reshape(-1, 2)
        window /= np.maximum(1.0, np.linalg.norm(window, axis=1, keepdims=True))
        found = figure(window).reshape(len(places), -1)
        found = np.where(np.isnan(found), -np.inf, found)
        top = np.argmax(found, axis=1)
        higher = np.take_along_axis(found, top[:, None], axis=1)[:, 0]
        there = window.reshape(len(places), -1, 2)[np.arange(len(places)), top]
        places = np.where((higher > highest)[:, None], there, places)
        highest = np.maximum(highest, higher)
        reach /= 2.0
    first = int(np.argmax(highest))
    return places[first], float(highest[first])
