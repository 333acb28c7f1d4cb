"""Rays of a table of radiance, which is even in each cell of place and linear in azimuth and sin^2 gamma.

Four numbers in [0, 1) of a ray choose its row, its column, sin^2 gamma and azimuth, in the order row, column, azimuth,
sin^2 gamma, each by the inverse of its distribution given those before.
"""

from math import cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.compiled import inline, kernel


class RadianceSums(NamedTuple):
    """Radiance at its nodes, and sums of it up to each row, column, azimuth (rad), sin^2 gamma, within those before."""

    x_mm: Float[np.ndarray, " x1"]
    y_mm: Float[np.ndarray, " y1"]
    azimuths: Float[np.ndarray, " c"]
    squares: Float[np.ndarray, " g"]
    radiance: Float[np.ndarray, "y x c g"]
    by_row: Float[np.ndarray, " y1"]
    by_column: Float[np.ndarray, "y x1"]
    by_azimuth: Float[np.ndarray, "y x c"]
    by_square: Float[np.ndarray, "y x c g"]


@inline
def _within(before, share, wanted):
    """Position in [0, 1] of ``wanted`` in a cell that begins at ``before`` and holds ``share``."""
    return min((wanted - before) / share, 1.0) if share > 0.0 else 0.0


@inline
def _linear(first, second, share):
    """Position in [0, 1] up to which a density linear from ``first`` to ``second`` has the given ``share``."""
    target = share * (first + second)
    below = first + sqrt(max(first * first + (second - first) * target, 0.0))
    return min(target / below, 1.0) if below > 0.0 else 0.0


@kernel
def emit(points, sums, places, directions):
    """Put the start of each ray (mm, in the plane z = 0) into ``places``, its unit direction into ``directions``."""
    rows, columns, turns, rises = sums.radiance.shape
    for ray in range(len(points)):
        low = 0
        high = rows
        wanted = points[ray, 0] * sums.by_row[rows]
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if sums.by_row[middle] > wanted else (middle, high)
        row = low
        down = _within(sums.by_row[low], sums.by_row[low + 1] - sums.by_row[low], wanted)
        low = 0
        high = columns
        wanted = points[ray, 1] * sums.by_column[row, columns]
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if sums.by_column[row, middle] > wanted else (middle, high)
        before = sums.by_column[row, low]
        column = low
        across = _within(before, sums.by_column[row, low + 1] - before, wanted)
        first = 0
        second = 0
        between = points[ray, 3]
        azimuth = 2.0 * pi * between
        if turns > 1:
            low = 0
            high = turns - 1
            wanted = points[ray, 3] * sums.by_azimuth[row, column, turns - 1]
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (low, middle) if sums.by_azimuth[row, column, middle] > wanted else (middle, high)
            before = sums.by_azimuth[row, column, low]
            azimuth_share = _within(before, sums.by_azimuth[row, column, low + 1] - before, wanted)
            first = low
            second = low + 1
            planes = sums.by_square[row, column, first, rises - 1], sums.by_square[row, column, second, rises - 1]
            between = _linear(planes[0], planes[1], azimuth_share)
            azimuth = sums.azimuths[first] + between * (sums.azimuths[second] - sums.azimuths[first])
        weight = 1.0 - between
        low = 0
        high = rises - 1
        wanted = weight * sums.by_square[row, column, first, high] + between * sums.by_square[row, column, second, high]
        wanted *= points[ray, 2]
        while high - low > 1:
            middle = (low + high) // 2
            flux_here = (
                weight * sums.by_square[row, column, first, middle]
                + between * sums.by_square[row, column, second, middle]
            )
            low, high = (low, middle) if flux_here > wanted else (middle, high)
        before = weight * sums.by_square[row, column, first, low] + between * sums.by_square[row, column, second, low]
        after = weight * sums.by_square[row, column, first, high] + between * sums.by_square[row, column, second, high]
        inner = weight * sums.radiance[row, column, first, low] + between * sums.radiance[row, column, second, low]
        outer = weight * sums.radiance[row, column, first, high] + between * sums.radiance[row, column, second, high]
        rise = _linear(inner, outer, _within(before, after - before, wanted))
        square = sums.squares[low] + rise * (sums.squares[high] - sums.squares[low])
        sine = sqrt(square)
        places[ray, 0] = sums.x_mm[column] + across * (sums.x_mm[column + 1] - sums.x_mm[column])
        places[ray, 1] = sums.y_mm[row] + down * (sums.y_mm[row + 1] - sums.y_mm[row])
        places[ray, 2] = 0.0
        directions[ray, 0] = sine * cos(azimuth)
        directions[ray, 1] = sine * sin(azimuth)
        directions[ray, 2] = sqrt(max(1.0 - square, 0.0))
