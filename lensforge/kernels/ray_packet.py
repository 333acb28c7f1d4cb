"""A packet of rays: an array with one field after another, and the fields recomputed at each place on the rays' paths.

All rays of a packet go in step, so that the vector units of a core work on several rays at once. A loop over the rays
of a packet that reads and writes nothing but one array, at offsets that the compiler knows, and chooses between results
instead of branching, becomes vector instructions: each division then serves eight rays, where ray by ray it waits for
the one before. What needs an index into a table is copied into the array by a loop of its own.

Each field of the array has room for ``SIZE`` rays, and is named by its offset.
"""

from math import sqrt

import numpy as np
from jaxtyping import Float

from lensforge.kernels.bicubic import cell_at, cubic_splines, index_at
from lensforge.kernels.compiled import inline
from lensforge.kernels.precision import DOUBLE_PRECISION, Precision

# Rays. Of 256, fields of the same ray would share two of the cache's 64 sets: a trace then takes 1.5 times as long.
SIZE = 272
WIDTH = 8  # rays in the widest vector register, or in half of it in single precision


def fields(first: int, count: int) -> tuple[int, ...]:
    """Offsets of ``count`` fields, the first of which is number ``first``."""
    return tuple(range(first * SIZE, (first + count) * SIZE, SIZE))


# The sixteen coefficients of a table that act at each ray, row by row.
TABLE = 0
COEFFICIENTS = 16
# Rays in the order in which they entered the packet: number, point, direction, ratio of the indices at the face to
# which they go; the crossing that was found; cosine before the face, squared one behind, and transmittance. Behind the
# inner face that of either polarisation over their mean, their excess likewise, and the normal there; behind the outer
# one the share of the flux whose field is along z.
(
    RAY, PX, PY, PZ, DX, DY, DZ, RATIO, LENGTH, STATUS, RHO_X, RHO_Y, COSINE, BEHIND, THROUGH,
    T_S, T_P, EXCESS, MX, MY, MZ, AXIAL,
) = fields(COEFFICIENTS, PER_RAY := 22)  # fmt: skip
# Rays still on their way, in any order. What is theirs: number in the packet, point, direction, path t; the bracket of
# a root, if any, with the evaluation before; the state, and the table's slopes at the last evaluation.
OWN = 17
(
    NUMBER, X0, Y0, Z0, ALONG_X, ALONG_Y, ALONG_Z, T, CLOSING, LOW, HIGH, BEFORE, F_BEFORE, INVERSE_BEFORE,
    STATE, SLOPE_X, SLOPE_Y,
) = fields(COEFFICIENTS + PER_RAY, OWN)  # fmt: skip
# And what is made anew in each step: distance r, r times the cosine between ray and radius, chart and 1/(r + z); the
# table's cell; the bounds nearby; F and F'.
(
    R, OUTWARD, CHART_X, CHART_Y, PER_SHIFT, CELL, _, _, _, TILE_ROW, TILE_COLUMN,
    NEARBY, MOST_SLOPE, MOST_HESSIAN, F, SLOPE,
) = fields(COEFFICIENTS + PER_RAY + OWN, 16)  # fmt: skip
# Where it is one of several faces: whether a ray on its way starts on it, and the path behind which nothing matters.
ON_FACE, LIMIT = fields(COEFFICIENTS + PER_RAY + OWN + 16, 2)
OF_CHAIN = COEFFICIENTS + PER_RAY + OWN + 18  # what ``kernels.nearest_face`` and ``kernels.polarised_event`` keep
FACET, _, _ = fields(OF_CHAIN + 37, 3)  # where faces are rough, slopes of the facet that is met, and what more is seen
KEPT_Y, KEPT_D, _, _ = fields(OF_CHAIN + 40, 4)  # y and direction of a ray whose place its shadow takes
PACKET_NUMBERS = (OF_CHAIN + 44) * SIZE


def empty_packet(precision: Precision = DOUBLE_PRECISION) -> Float[np.ndarray, " k"]:
    """Memory of a packet, for one thread."""
    return np.zeros(PACKET_NUMBERS, precision.kind)


@inline
def in_whole_vectors(count):
    """Number of lanes of a loop for ``count`` rays, rounded up to whole vectors: memory is there."""
    return (count + WIDTH - 1) // WIDTH * WIDTH


@inline
def mark_cell(rays, cell, X, Y, side, grid):
    """Write :func:`kernels.bicubic.cell_at` into four fields from ``cell`` on."""
    i, j, share_x, share_y = cell_at(X, Y, side, grid)
    rays[cell] = i
    rays[cell + SIZE] = j
    rays[cell + 2 * SIZE] = share_x
    rays[cell + 3 * SIZE] = share_y


@inline
def mark_hit(rays, k, p, cell, side, grid):
    """The table's cell at a hit."""
    x, y, z = p
    per_shift = 1.0 / (sqrt(x * x + y * y + z * z) + z)
    mark_cell(rays, cell + k, x * per_shift, y * per_shift, side, grid)


@inline
def three(rays, place):
    """Three numbers from as many fields."""
    return rays[place], rays[place + SIZE], rays[place + 2 * SIZE]


@inline
def write(rays, place, vector):
    """Write three numbers into as many fields."""
    rays[place], rays[place + SIZE], rays[place + 2 * SIZE] = vector


@inline
def store_ray(rays, lane, number, p, d, ratio):
    """Put a ray into a packet; ``ratio``: of the indices before and behind the face to which it goes."""
    rays[RAY + lane] = float(number)
    rays[RATIO + lane] = ratio
    write(rays, PX + lane, p)
    write(rays, DX + lane, d)


@inline
def locate(rays, count, side, grid, tiles, per_unit):
    """Distance from the origin, place on the chart, cell of the table and tile of the bounds of every ray."""
    for k in range(count):
        t = rays[T + k]
        dx = rays[ALONG_X + k]
        dy = rays[ALONG_Y + k]
        dz = rays[ALONG_Z + k]
        x, y, z = rays[X0 + k] + t * dx, rays[Y0 + k] + t * dy, rays[Z0 + k] + t * dz
        r = sqrt(x * x + y * y + z * z)
        per_shift = 1.0 / (r + z)
        X = x * per_shift
        Y = y * per_shift
        rays[R + k] = r
        rays[OUTWARD + k] = x * dx + y * dy + z * dz
        rays[CHART_X + k] = X
        rays[CHART_Y + k] = Y
        rays[PER_SHIFT + k] = per_shift
        mark_cell(rays, CELL + k, X, Y, side, grid)
        rays[TILE_ROW + k] = index_at((X - grid.origin) * per_unit, tiles - 1.0)
        rays[TILE_COLUMN + k] = index_at((Y - grid.origin) * per_unit, tiles - 1.0)


# Indices without a sign need no test of whether they count from the end, as those below 0 do.


@inline
def fetch_bounds(rays, count, tiles):
    """Bounds near every ray."""
    for k in range(count):
        i = np.uint32(rays[TILE_ROW + k])
        j = np.uint32(rays[TILE_COLUMN + k])
        rays[NEARBY + k] = tiles[i, j, 0]
        rays[MOST_SLOPE + k] = tiles[i, j, 1]
        rays[MOST_HESSIAN + k] = tiles[i, j, 2]


@inline
def fetch_table(rays, count, table, cell):
    """The sixteen coefficients that act in the ``cell`` of every ray."""
    for k in range(count):
        i = np.uint32(rays[cell + k])
        j = np.uint32(rays[cell + SIZE + k])
        for a in range(4):
            row = table[i + a]
            for b in range(4):
                rays[TABLE + (4 * a + b) * SIZE + k] = row[j + b]


@inline
def along_row(rays, row, w):
    """Sum of four of a ray's coefficients, weighted."""
    return w[0] * rays[row] + w[1] * rays[row + SIZE] + w[2] * rays[row + 2 * SIZE] + w[3] * rays[row + 3 * SIZE]


@inline
def evaluate(rays, count, inverse_step, outside):
    """F and F' of every ray, from outside of the surface -F and -F', and the slopes of the table."""
    for k in range(count):
        wx, vx, _ = cubic_splines(rays[CELL + 2 * SIZE + k])
        wy, vy, _ = cubic_splines(rays[CELL + 3 * SIZE + k])
        value = 0.0
        slope_x = 0.0
        slope_y = 0.0
        for a in range(4):
            row = TABLE + 4 * a * SIZE + k
            along = along_row(rays, row, wy)
            value += wx[a] * along
            slope_x += vx[a] * along
            slope_y += wx[a] * along_row(rays, row, vy)
        rho_x, rho_y = slope_x * inverse_step, slope_y * inverse_step
        r = rays[R + k]
        dx = rays[ALONG_X + k]
        dy = rays[ALONG_Y + k]
        dz = rays[ALONG_Z + k]
        cos_radial = rays[OUTWARD + k] / r
        ahead = cos_radial + dz
        turn = rho_x * (dx - rays[CHART_X + k] * ahead) + rho_y * (dy - rays[CHART_Y + k] * ahead)
        gap = value - r
        slope = turn * rays[PER_SHIFT + k] - cos_radial
        rays[F + k], rays[SLOPE + k] = (-gap, -slope) if outside else (gap, slope)
        rays[SLOPE_X + k] = rho_x
        rays[SLOPE_Y + k] = rho_y


@inline
def jet_at(rays, k, share_x, share_y, inverse_step):
    """First and second derivatives of ``rho`` on the chart from a ray's coefficients: X, Y, XX, XY, YY."""
    wx, dx, cx = cubic_splines(share_x)
    wy, dy, cy = cubic_splines(share_y)
    x = 0.0
    y = 0.0
    xx = 0.0
    xy = 0.0
    yy = 0.0
    for a in range(4):
        row = TABLE + 4 * a * SIZE + k
        along = along_row(rays, row, wy)
        across = along_row(rays, row, dy)
        x += dx[a] * along
        y += wx[a] * across
        xx += cx[a] * along
        xy += dx[a] * across
        yy += wx[a] * along_row(rays, row, cy)
    square = inverse_step * inverse_step
    return x * inverse_step, y * inverse_step, xx * square, xy * square, yy * square
