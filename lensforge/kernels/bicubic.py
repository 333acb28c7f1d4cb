"""Bicubic table of ``rho`` over the stereographic chart: value, slope, sums of patches, refinement and bounds.

A table is square, first index X; ``origin`` and ``inverse_step`` place coefficient 0 and the spacing. A patch holds
the spline coefficients of one basis function on the rectangle of nodes where they are not negligible. A finer table is
the same spline on half the step, by the two-scale relation 1/8 (1, 4, 6, 4, 1) of cubic B-splines.

Bounds on radius, slope and Hessian come from differences of the B-spline coefficients (convex-hull property), so they
hold between the nodes too. Chart derivatives become derivatives on the unit sphere through the conformal factor
2/(1+R^2) of the chart.
"""

from collections.abc import Sequence
from math import ceil, sqrt, tan
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.compiled import inline, kernel

_SIXTH = 1.0 / 6.0
_TWO_THIRDS = 2.0 / 3.0


def uniform_cubic(f: Any) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...]]:
    """The four uniform cubic B-splines at the fraction ``f`` of a cell, a number or a tensor, and two derivatives.

    The first and second derivatives are per step.
    """
    g = 1.0 - f
    return (
        (
            _SIXTH * g * g * g,
            _TWO_THIRDS - f * f * (1.0 - 0.5 * f),
            _TWO_THIRDS - g * g * (1.0 - 0.5 * g),
            _SIXTH * f * f * f,
        ),
        (-0.5 * g * g, f * (1.5 * f - 2.0), g * (2.0 - 1.5 * g), 0.5 * f * f),
        (g, 3.0 * f - 2.0, 3.0 * g - 2.0, f),
    )


cubic_splines = inline(uniform_cubic)


class TableSpacing(NamedTuple):
    """Place of coefficient 0 of a table on the chart, on both axes, and one over the step.

    ``half_mm``: of faces that are profiles drawn along y half of their length, at whose ends light is absorbed; None
    for any other.
    """

    origin: float
    inverse_step: float
    half_mm: float | None = None


@inline
def index_at(position, most):
    """The whole number up to ``position``, from 0 to ``most``, also where that is NaN; still a float."""
    position = position if position < most else most
    return float(np.int32(position if position > 0.0 else 0.0))


@inline
def cell_at(X, Y, side, grid):
    """First row and column that act at a place of the chart, as floats, and its distance behind the second ones.

    The distances are shares of a step. ``side`` of the table is a float.
    """
    px, py = (X - grid.origin) * grid.inverse_step, (Y - grid.origin) * grid.inverse_step
    i = index_at(px - 1.0, side - 4.0)
    j = index_at(py - 1.0, side - 4.0)
    return i, j, px - (i + 1.0), py - (j + 1.0)


@inline
def jet(table, grid, X, Y):
    """``rho`` and its derivatives by X, Y, XX, XY, YY."""
    i, j, share_x, share_y = cell_at(X, Y, float(table.shape[0]), grid)
    wx, dx, cx = cubic_splines(share_x)
    wy, dy, cy = cubic_splines(share_y)
    row = int(i)
    column = int(j)
    value = 0.0
    x = 0.0
    y = 0.0
    xx = 0.0
    xy = 0.0
    yy = 0.0
    for a in range(4):
        along = 0.0
        across = 0.0
        bend = 0.0
        for b in range(4):
            coefficient = table[row + a, column + b]
            along += wy[b] * coefficient
            across += dy[b] * coefficient
            bend += cy[b] * coefficient
        value += wx[a] * along
        x += dx[a] * along
        y += wx[a] * across
        xx += cx[a] * along
        xy += dx[a] * across
        yy += wx[a] * bend
    inverse_step = grid.inverse_step
    square = grid.inverse_step * grid.inverse_step
    return value, x * inverse_step, y * inverse_step, xx * square, xy * square, yy * square


@inline
def scatter(gradient, cell, inverse_step, by_table):
    """Add the sensitivities to value and slopes of :func:`jet` to the sixteen coefficients that acted.

    ``cell``: as :func:`cell_at` returns it.
    """
    row_of, column_of, share_x, share_y = cell
    by_value, by_slope_x, by_slope_y = by_table
    i = int(row_of)
    j = int(column_of)
    wx, dx, _ = cubic_splines(share_x)
    wy, dy, _ = cubic_splines(share_y)
    sx = by_slope_x * inverse_step
    sy = by_slope_y * inverse_step
    for a in range(4):
        row = gradient[i + a]
        along = by_value * wx[a] + sx * dx[a]
        across = sy * wx[a]
        for b in range(4):
            row[j + b] += along * wy[b] + across * dy[b]


@kernel
def add_patches(boxes, starts, values, weights, table):
    """Add all patches, times their weights (m), to a table (side, side).

    ``boxes`` (m, 4): first row and column, rows and columns of each patch; its ``values`` begin at ``starts``.
    """
    for j in range(len(boxes)):
        row = boxes[j, 0]
        column = boxes[j, 1]
        rows = boxes[j, 2]
        columns = boxes[j, 3]
        weight = weights[j]
        begin = starts[j]
        for r in range(rows):
            line = table[row + r, column : column + columns]
            patch = values[begin : begin + columns]
            for c in range(columns):
                line[c] += weight * patch[c]
            begin += columns


@kernel
def patch_sums(boxes, starts, values, table, by_weights):
    """Adjoint of :func:`add_patches`: fill ``by_weights`` (m).

    Eight partial sums for each product, so that the additions need not wait for one another.
    """
    for j in range(len(boxes)):
        row = boxes[j, 0]
        column = boxes[j, 1]
        rows = boxes[j, 2]
        columns = boxes[j, 3]
        eights = columns // 8 * 8
        begin = starts[j]
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
        for r in range(rows):
            line = table[row + r, column : column + columns]
            patch = values[begin : begin + columns]
            for c in range(0, eights, 8):
                s0 += patch[c] * line[c]
                s1 += patch[c + 1] * line[c + 1]
                s2 += patch[c + 2] * line[c + 2]
                s3 += patch[c + 3] * line[c + 3]
                s4 += patch[c + 4] * line[c + 4]
                s5 += patch[c + 5] * line[c + 5]
                s6 += patch[c + 6] * line[c + 6]
                s7 += patch[c + 7] * line[c + 7]
            for c in range(eights, columns):
                s0 += patch[c] * line[c]
            begin += columns
        by_weights[j] = ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))


@kernel
def refine(coarse, halfway, fine):
    """Fill ``fine`` (t, t) with the spline of ``coarse`` (s, s); ``halfway`` (t, s): workspace."""
    for r in range(len(fine)):
        first = r // 2
        line = halfway[r]
        if r % 2:
            row = coarse[first]
            two = coarse[first + 1]
            three = coarse[first + 2]
            for c in range(len(line)):
                line[c] = 0.125 * (row[c] + three[c]) + 0.75 * two[c]
        else:
            row = coarse[first]
            two = coarse[first + 1]
            for c in range(len(line)):
                line[c] = 0.5 * (row[c] + two[c])
        for c in range(len(fine) // 2):
            fine[r, 2 * c] = 0.5 * (line[c] + line[c + 1])
            fine[r, 2 * c + 1] = 0.125 * (line[c] + line[c + 2]) + 0.75 * line[c + 1]
        fine[r, len(fine) - 1] = 0.5 * (line[len(line) - 2] + line[len(line) - 1])


@kernel
def refine_adjoint(by_fine, halfway, by_coarse):
    """Adjoint of :func:`refine`: fill ``by_coarse`` (s, s) from ``by_fine`` (t, t)."""
    by_coarse[:] = 0.0
    for r in range(len(by_fine)):
        line = halfway[r]
        row = by_fine[r]
        line[:] = 0.0
        for c in range(len(row) // 2):
            even = 0.5 * row[2 * c]
            odd = row[2 * c + 1]
            line[c] += even + 0.125 * odd
            line[c + 1] += even + 0.75 * odd
            line[c + 2] += 0.125 * odd
        line[len(line) - 2] += 0.5 * row[len(row) - 1]
        line[len(line) - 1] += 0.5 * row[len(row) - 1]
        first = r // 2
        if r % 2:
            _add(by_coarse[first], 0.125, line)
            _add(by_coarse[first + 1], 0.75, line)
            _add(by_coarse[first + 2], 0.125, line)
        else:
            _add(by_coarse[first], 0.5, line)
            _add(by_coarse[first + 1], 0.5, line)


@kernel
def _add(total, factor, line):
    for c in range(len(line)):
        total[c] += factor * line[c]


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


class FaceBounds(NamedTuple):
    """Bounds of several surfaces on one grid, as the kernels take them: arrays in place of the numbers of one.

    ``balls`` (mm): about the medium that each bounds, and ``hollows`` (1/mm), see :func:`hollow`: of a chain.
    """

    least: Float[np.ndarray, " f"]
    most: Float[np.ndarray, " f"]
    tiles: Float[np.ndarray, "f t t 3"]
    per_unit: float
    tan_reach: float
    balls: Float[np.ndarray, " f"] | None = None
    hollows: Float[np.ndarray, " f"] | None = None

    @staticmethod
    def of(bounds: Sequence[SurfaceBounds]) -> "FaceBounds":
        """The bounds of several surfaces as arrays."""
        least, most, tiles = (np.array([bound[number] for bound in bounds]) for number in range(3))
        return FaceBounds(least, most, tiles, bounds[0].per_unit, bounds[0].tan_reach)


@inline
def bounds_of(bounds, face):
    """Bounds of one face."""
    return SurfaceBounds(bounds.least[face], bounds.most[face], bounds.tiles[face], bounds.per_unit, bounds.tan_reach)


@inline
def tile_of(X, Y, grid, bounds):
    """Bounds near a direction: least radius, largest slope and Hessian."""
    last = len(bounds.tiles) - 1.0
    i = int(index_at((X - grid.origin) * bounds.per_unit, last))
    j = int(index_at((Y - grid.origin) * bounds.per_unit, last))
    return bounds.tiles[i, j, 0], bounds.tiles[i, j, 1], bounds.tiles[i, j, 2]


@inline
def spread_of_row(table, i, columns):
    """Least coefficient of one row of a block, its largest |differences| x, y, xx, xy, yy, also to the next rows."""
    j0, j1 = columns
    side = table.shape[0]
    least = np.inf
    x = 0.0
    y = 0.0
    xx = 0.0
    xy = 0.0
    yy = 0.0
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
    least = np.inf
    x = 0.0
    y = 0.0
    xx = 0.0
    xy = 0.0
    yy = 0.0
    for i in range(i0, i1):
        row = spreads[i, b]
        least = min(least, row[0])
        y = max(y, row[2])
        yy = max(yy, row[5])
        if i + 1 < i1:
            x = max(x, row[1])
            xy = max(xy, row[4])
        if i + 2 < i1:
            xx = max(xx, row[3])
    square = step * step
    return least, x / step, y / step, xx / square, xy / square, yy / square


@kernel
def extremes(table, origin, step):
    """Least and largest ``rho`` (mm) over the hemisphere."""
    lowest = np.inf
    highest = -np.inf
    for i in range(1, table.shape[0] - 1):
        for j in range(1, table.shape[1] - 1):
            X = origin + i * step
            Y = origin + j * step
            if sqrt(X * X + Y * Y) <= 1.0 + 4.0 * step:
                lowest = min(lowest, table[i, j])
                highest = max(highest, table[i, j])
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
    side = table.shape[0]
    rim = 1.0 + step
    for i in range(side):
        for b in range(tiles.shape[1]):
            spread_here = spread_of_row(table, i, acting(b, side, cells, reach))
            for number in range(6):  # at once numba would compile a message on sizes, too: 0.4 s
                spreads[i, b, number] = spread_here[number]
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
    cells = ceil(side / _TILES)
    reach = ceil(side / _REACH_CELLS)
    count = ceil(side / cells)
    tiles = np.empty((count, count, 3))
    fill_tiles(table, origin, step, cells, reach, np.empty((side, count, 6)), tiles)
    least, most = extremes(table, origin, step)
    return SurfaceBounds(least, most, tiles, 1.0 / (cells * step), tan(min(reach * step, 0.5)))
