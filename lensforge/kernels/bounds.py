"""Bounds on the radius, slope and Hessian of a table's surface, near every direction and everywhere.

Bounds come from differences of the B-spline coefficients (convex-hull property), so they hold between the nodes too.
Chart derivatives become derivatives on the unit sphere through the conformal factor 2/(1+R^2) of the chart.
"""

from math import ceil, sqrt, tan
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.jit import inline, kernel

# A tile is a block of cells; its bounds hold as far as ``reach`` around it, about 0.15 rad for the usual tables: wide
# enough that a search seldom stops at its edge, narrow enough that its bounds are local ones.
_TILES = 24
_REACH_CELLS = 16  # of the table's side


class SurfaceBounds(NamedTuple):
    """Bounds of ``rho`` on the hemisphere.

    ``least``, ``most``: of rho (mm). ``tiles[i, j]``: least rho, largest |gradient| (mm/rad) and |Hessian| (mm/rad^2)
    on the sphere within the angle ``atan(tan_reach)`` of any direction in that block of the chart; ``per_unit`` is
    the number of tiles per unit of the chart.
    """

    least: float
    most: float
    tiles: Float[np.ndarray, "t t 3"]
    per_unit: float
    tan_reach: float


@inline
def spread_of_row(table, i, columns):
    """Least coefficient of one row of a block, its largest |differences| x, y, xx, xy, yy, also to the next rows."""
    j0, j1 = columns
    side = table.shape[0]
    least, x, y, xx, xy, yy = np.inf, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(j0, j1):
        c = table[i, j]
        least = min(least, c)
        if i + 1 < side:
            x = max(x, abs(table[i + 1, j] - c))
            if j + 1 < j1:
                xy = max(xy, abs(table[i + 1, j + 1] - table[i + 1, j] - table[i, j + 1] + c))
        if i + 2 < side:
            xx = max(xx, abs(table[i + 2, j] - 2.0 * table[i + 1, j] + c))
        if j + 1 < j1:
            y = max(y, abs(table[i, j + 1] - c))
        if j + 2 < j1:
            yy = max(yy, abs(table[i, j + 2] - 2.0 * table[i, j + 1] + c))
    return least, x, y, xx, xy, yy


@inline
def spread(rows, b, spreads, step):
    """Least coefficient of a block, and its largest |differences| x, y, xx, xy, yy per step."""
    i0, i1 = rows
    least, x, y, xx, xy, yy = np.inf, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(i0, i1):
        row = spreads[i, b]
        least, y, yy = min(least, row[0]), max(y, row[2]), max(yy, row[5])
        if i + 1 < i1:
            x, xy = max(x, row[1]), max(xy, row[4])
        if i + 2 < i1:
            xx = max(xx, row[3])
    square = step * step
    return least, x / step, y / step, xx / square, xy / square, yy / square


@kernel
def extremes(table, origin, step):
    """Least and largest ``rho`` (mm) over the hemisphere."""
    lowest, highest = np.inf, -np.inf
    for i in range(1, table.shape[0] - 1):
        for j in range(1, table.shape[1] - 1):
            X, Y = origin + i * step, origin + j * step
            if sqrt(X * X + Y * Y) <= 1.0 + 4.0 * step:
                lowest, highest = min(lowest, table[i, j]), max(highest, table[i, j])
    return lowest, highest


@inline
def farthest(origin, step, first, last):
    """Largest |coordinate| of coefficients ``first`` to ``last`` along one axis of the chart."""
    return max(abs(origin + first * step), abs(origin + last * step))


@inline
def nearest(origin, step, first, last):
    """Least |coordinate| between coefficients ``first`` and ``last`` along one axis of the chart."""
    return max(0.0, origin + first * step, -(origin + last * step))


@inline
def acting(a, side, cells, reach):
    """First coefficient that acts on block ``a`` of cells and on those within reach along one axis, and the end."""
    return max(0, a * cells - reach - 1), min(side, (a + 1) * cells + reach + 2)


@kernel
def fill_tiles(table, origin, step, cells, reach, spreads, tiles):
    """Fill ``tiles`` (t, t, 3), see :class:`SurfaceBounds`; those below the horizon, which no ray needs, are 0.

    A step of the table counts as above it, so that rounding leads no horizontal ray into a tile of 0.

    ``spreads`` (side, t, 6): workspace for the spread of every row over the columns of each tile.
    """
    side, rim = table.shape[0], 1.0 + step
    for i in range(side):
        for b in range(tiles.shape[1]):
            spreads[i, b] = spread_of_row(table, i, acting(b, side, cells, reach))
    for a in range(tiles.shape[0]):
        near_x = nearest(origin, step, a * cells, (a + 1) * cells)
        rows = acting(a, side, cells, reach)
        far_x = farthest(origin, step, rows[0], rows[1] - 1)
        for b in range(tiles.shape[1]):
            near_y = nearest(origin, step, b * cells, (b + 1) * cells)
            if near_x * near_x + near_y * near_y > rim * rim:
                tiles[a, b, :] = 0.0
                continue
            columns = acting(b, side, cells, reach)
            least, x, y, xx, xy, yy = spread(rows, b, spreads, step)
            far_y = farthest(origin, step, columns[0], columns[1] - 1)
            radius = min(sqrt(far_x * far_x + far_y * far_y), 1.0)
            shrink = 0.5 * (1.0 + radius * radius)
            slope = sqrt(x * x + y * y)
            bend = 0.5 * (xx + yy) + sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
            tiles[a, b, 0] = least
            tiles[a, b, 1] = slope * shrink
            tiles[a, b, 2] = bend * shrink * shrink + slope * radius * shrink


def surface_bounds(table: Float[np.ndarray, "side side"], origin: float, step: float) -> SurfaceBounds:
    """Bounds of one table (mm) whose coefficient 0 lies at ``origin`` on the chart."""
    side = table.shape[0]
    cells, reach = ceil(side / _TILES), ceil(side / _REACH_CELLS)
    count = ceil(side / cells)
    tiles = np.empty((count, count, 3))
    fill_tiles(table, origin, step, cells, reach, np.empty((side, count, 6)), tiles)
    least, most = extremes(table, origin, step)
    return SurfaceBounds(least, most, tiles, 1.0 / (cells * step), tan(min(reach * step, 0.5)))
