"""Grid of points at which standards judge the illuminance of a rectangle: EN 12464-1 indoors, EN 12193 in sports."""

from math import ceil, log10

import numpy as np
from jaxtyping import Float

_STEP_OF_1_M = 0.2  # largest step (m) for a longer side of 1 m
_PER_DECADE = 5.0  # of a side ten times as long it is five times as large
_ROUNDING = 1e-9

_Shares = Float[np.ndarray, " n"]


def measuring_grid(sides_m: tuple[float, float], *, least: int = 1, odd: bool = False) -> tuple[_Shares, _Shares]:
    """Points in the middles of equal cells, as shares of both sides, row by row along the first one.

    ``sides_m``: lengths (m) of both sides. ``least``: fewest points along a side. ``odd``: an odd number along each.

        along, across = measuring_grid((105.0, 68.0), odd=True)
    """
    step_m = _STEP_OF_1_M * _PER_DECADE ** log10(max(sides_m))
    counts = [max(ceil(side_m / step_m - _ROUNDING), least) for side_m in sides_m]
    if odd:
        counts = [count + 1 - count % 2 for count in counts]
    first, second = np.meshgrid(*((np.arange(count) + 0.5) / count for count in counts))
    return first.ravel(), second.ravel()
