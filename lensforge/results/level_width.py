"""Width of a profile above a level: of a beam, a cut, a spot."""

import numpy as np
from jaxtyping import Float


def width_above(places: Float[np.ndarray, " n"], profile: Float[np.ndarray, " n"], level: float) -> float | None:
    """Distance between the outermost crossings of ``level``, linear between places, or the ends if above it there.

    None if nothing is above it, or the level is not above 0.
    """
    above = np.flatnonzero(profile >= level)
    if not level > 0.0 or not len(above):
        return None
    first = int(above[0])
    last = int(above[-1])
    low = places[0] if first == 0 else _crossing(places, profile, first - 1, level)
    high = places[-1] if last == len(places) - 1 else _crossing(places, profile, last, level)
    return float(high - low)


def _crossing(places: Float[np.ndarray, " n"], profile: Float[np.ndarray, " n"], cell: int, level: float) -> float:
    start = profile[cell]
    end = profile[cell + 1]
    return float(places[cell] + (level - start) / (end - start) * (places[cell + 1] - places[cell]))
