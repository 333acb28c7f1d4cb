"""First crossings of a packet of rays with a star-shaped surface, proven and fast.

The search walks along ``F(t) = rho(u(t)) - |p(t)|`` with steps that cannot jump over a root: where
``|F''| <= C`` along the ray ahead, the parabola ``F + F' s - C s^2/2`` bounds F from below, and its root is a safe
step. C comes from the bounds on the surface near the ray (``kernels.bicubic``), and a step never leaves their reach.
Once Kantorovich's condition ``C F <= F'^2 / 2`` holds the next root is unique, and bracketed Newton steps find it.
Rays come from the inside, where F > 0; where a scene asks for it from ``outside``, too, and are searched with -F.

All rays of a packet go in step, so that the vector units of a core work on several rays at once; one that has found its
crossing leaves its place to the last. A loop over the rays of a packet that reads and writes nothing but one array, at
offsets that the compiler knows, and chooses between results instead of branching, becomes vector instructions: each
division then serves eight rays, where ray by ray it waits for the one before. What needs an index into a table is
copied into the array by a loop of its own.

The array has one field after another, each with room for ``SIZE`` rays; a field is named by its offset.
"""

from math import inf, sqrt

import numpy as np
from jaxtyping import Float

from lensforge.kernels.bicubic import cell_at, cubic_splines, index_at
from lensforge.kernels.compiled import inline
from lensforge.kernels.precision import DOUBLE_PRECISION, ByPrecision, Precision

SIZE = 256  # rays
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
OF_CHAIN = COEFFICIENTS + PER_RAY + OWN + 18  # what ``kernels.chain`` keeps
PACKET_NUMBERS = (OF_CHAIN + 30) * SIZE


def empty_packet(precision: Precision = DOUBLE_PRECISION) -> Float[np.ndarray, " k"]:
    """Memory of a packet, for one thread."""
    return np.zeros(PACKET_NUMBERS, precision.kind)


@inline
def in_whole_vectors(count):
    """Number of places over which a loop for ``count`` rays goes, so that no vector is taken apart: room is there."""
    return (count + WIDTH - 1) // WIDTH * WIDTH


@inline
def mark_cell(rays, cell, X, Y, side, origin, inverse_step):
    """Write :func:`kernels.bicubic.cell_at` into four fields from ``cell`` on."""
    i, j, share_x, share_y = cell_at(X, Y, side, origin, inverse_step)
    rays[cell], rays[cell + SIZE] = i, j
    rays[cell + 2 * SIZE], rays[cell + 3 * SIZE] = share_x, share_y


@inline
def mark_hit(rays, k, x, y, z, cell, side, origin, inverse_step):
    """The table's cell at a hit."""
    per_shift = 1.0 / (sqrt(x * x + y * y + z * z) + z)
    mark_cell(rays, cell + k, x * per_shift, y * per_shift, side, origin, inverse_step)


@inline
def three(rays, place):
    """Three numbers from as many fields."""
    return rays[place], rays[place + SIZE], rays[place + 2 * SIZE]


@inline
def write(rays, place, vector):
    """Write three numbers into as many fields."""
    rays[place], rays[place + SIZE], rays[place + 2 * SIZE] = vector


@inline
def locate(rays, count, side, origin, inverse_step, tiles, per_unit):
    """Distance from the origin, place on the chart, cell of the table and tile of the bounds of every ray."""
    for k in range(count):
        t, dx, dy, dz = rays[T + k], rays[ALONG_X + k], rays[ALONG_Y + k], rays[ALONG_Z + k]
        x, y, z = rays[X0 + k] + t * dx, rays[Y0 + k] + t * dy, rays[Z0 + k] + t * dz
        r = sqrt(x * x + y * y + z * z)
        per_shift = 1.0 / (r + z)
        X, Y = x * per_shift, y * per_shift
        rays[R + k], rays[OUTWARD + k] = r, x * dx + y * dy + z * dz
        rays[CHART_X + k], rays[CHART_Y + k], rays[PER_SHIFT + k] = X, Y, per_shift
        mark_cell(rays, CELL + k, X, Y, side, origin, inverse_step)
        rays[TILE_ROW + k] = index_at((X - origin) * per_unit, tiles - 1.0)
        rays[TILE_COLUMN + k] = index_at((Y - origin) * per_unit, tiles - 1.0)


@inline
def fetch_bounds(rays, count, tiles):
    """Bounds near every ray."""
    for k in range(count):
        i, j = int(rays[TILE_ROW + k]), int(rays[TILE_COLUMN + k])
        rays[NEARBY + k], rays[MOST_SLOPE + k] = tiles[i, j, 0], tiles[i, j, 1]
        rays[MOST_HESSIAN + k] = tiles[i, j, 2]


@inline
def fetch_table(rays, count, table, cell):
    """The sixteen coefficients that act in the ``cell`` of every ray."""
    for k in range(count):
        i, j = int(rays[cell + k]), int(rays[cell + SIZE + k])
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
        value, slope_x, slope_y = 0.0, 0.0, 0.0
        for a in range(4):
            row = TABLE + 4 * a * SIZE + k
            along = along_row(rays, row, wy)
            value += wx[a] * along
            slope_x += vx[a] * along
            slope_y += wx[a] * along_row(rays, row, vy)
        rho_x, rho_y = slope_x * inverse_step, slope_y * inverse_step
        r, dx, dy, dz = rays[R + k], rays[ALONG_X + k], rays[ALONG_Y + k], rays[ALONG_Z + k]
        cos_radial = rays[OUTWARD + k] / r
        ahead = cos_radial + dz
        turn = rho_x * (dx - rays[CHART_X + k] * ahead) + rho_y * (dy - rays[CHART_Y + k] * ahead)
        gap, slope = value - r, turn * rays[PER_SHIFT + k] - cos_radial
        rays[F + k], rays[SLOPE + k] = (-gap, -slope) if outside else (gap, slope)
        rays[SLOPE_X + k], rays[SLOPE_Y + k] = rho_x, rho_y


@inline
def jet_at(rays, k, share_x, share_y, inverse_step):
    """First and second derivatives of ``rho`` on the chart from a ray's coefficients: X, Y, XX, XY, YY."""
    wx, dx, cx = cubic_splines(share_x)
    wy, dy, cy = cubic_splines(share_y)
    x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(4):
        row = TABLE + 4 * a * SIZE + k
        along, across = along_row(rays, row, wy), along_row(rays, row, dy)
        x += dx[a] * along
        y += wx[a] * across
        xx += cx[a] * along
        xy += dx[a] * across
        yy += wx[a] * along_row(rays, row, cy)
    square = inverse_step * inverse_step
    return x * inverse_step, y * inverse_step, xx * square, xy * square, yy * square


# Below: it passes the plane z = 0 first; lost: no convergence; missed: it goes past the surface, outside of it.
FOUND, BELOW, LOST, GOING, MISSED = 0.0, 1.0, 2.0, 3.0, 4.0

MAX_STEPS, MAX_CLOSING = 1000, 60  # a ray that grazes a face takes hundreds
# Shares of the distance from the origin; in single precision a few of its last bits.
TOLERANCE = ByPrecision(1e-12, 2e-6)  # of a Newton step: the next error is its square
ROUNDING = ByPrecision(2e-15, 5e-7)  # F below it is noise; near tangency it would keep the root moving
STANDSTILL = ByPrecision(1e-13, 1e-6)  # a shorter safe step has arrived
NEAR, LAST_BIT = ByPrecision(1e-12, 2e-6), ByPrecision(1e-15, 2e-7)  # so near to a ball or the surface is on it
LEAP_SHARE = 0.9  # of the least radius nearby: up to there a step to that radius costs less than an evaluation
_LEAPS = 2  # of all rays before the first evaluation: to the ball in which no surface is, and to the radius nearby


@inline
def leap_of(r, outward, least, nearby, tan_reach):
    """Path (mm) to where the next evaluation is worth its time; 0 where it is at once.

    F > 0 in the ball of the ``least`` radius: to its far side, a last bit further; and up to the least radius
    ``nearby``, within reach of the bounds.
    """
    ball = (sqrt(outward * outward + least * least - r * r) - outward) * (1.0 + LAST_BIT) + LAST_BIT * least
    cos_radial = outward / r
    turning = sqrt(max(1.0 - cos_radial * cos_radial, 0.0)) - tan_reach * cos_radial
    room = r * tan_reach
    leap = sqrt(outward * outward + nearby * nearby - r * r) - outward
    leap = leap if leap * turning <= room else room / turning
    leap = leap if r < LEAP_SHARE * nearby else 0.0
    return ball if r * r < least * least else leap


@inline
def leap(rays, count, least, tan_reach):
    """Move every ray on its leap."""
    for k in range(count):
        rays[T + k] += leap_of(rays[R + k], rays[OUTWARD + k], least, rays[NEARBY + k], tan_reach)


@inline
def bound_ahead(outward, r, sine, cos_radial, slope, hessian, least):
    """Bound C of ``|F''|`` ahead, and the path (mm) up to which it holds within the reach of the bounds.

    With theta between ray and radius, ``|F''| <= sin^2 (1/r + H/r^2) + G |sin 2 theta|/r^2``; theta falls along a ray.
    """
    per_r = 1.0 / r
    twist = 2.0 * sine * cos_radial if sine < cos_radial else 1.0
    bend_out = (sine * sine * (1.0 + hessian * per_r) + slope * twist * per_r) * per_r
    nearest = max(r * sine, least)
    bend_in = (1.0 + (hessian + slope) / nearest) / nearest
    # inwards, up to the start of the ball in which F > 0
    path = -outward - sqrt(outward * outward - r * r + least * least) + NEAR * r
    path = path if r * sine < least else inf
    return (bend_out, inf) if cos_radial >= 0.0 else (bend_in, path)


@inline
def approach(r, outward, most):
    """Path (mm) to the ball in which the whole surface lies, from outside of it; infinite for a ray that misses it."""
    square = outward * outward - (r - most) * (r + most)
    ahead = outward < 0.0 and square > 0.0
    return -outward - sqrt(square if ahead else 0.0) if ahead else inf


@inline
def walk(rays, count, least, most, tan_reach, among, outside):
    """One safe step of every ray that has no bracket yet, or its bracket: ``[t, t - 2 F/slope]`` has one root.

    The bracket ends at the plane z = 0, a little below which the table ends: there it is a polynomial without bounds.
    ``among`` several faces a ray that starts on this one is not at a root there, and need not go past its limit.
    """
    for k in range(count):
        t, r, outward, gap, slope = rays[T + k], rays[R + k], rays[OUTWARD + k], rays[F + k], rays[SLOPE + k]
        pz, dz = rays[Z0 + k], rays[ALONG_Z + k]
        plane = -pz / dz if dz < 0.0 else inf
        cos_radial = outward / r
        sine = sqrt(max(1.0 - cos_radial * cos_radial, 0.0))
        # after a path s the ray has turned by atan(s sine / (r + s cos_radial)): s turning <= room stays in reach
        turning, room = sine - tan_reach * cos_radial, r * tan_reach
        bend, path = bound_ahead(outward, r, sine, cos_radial, rays[MOST_SLOPE + k], rays[MOST_HESSIAN + k], least)
        if outside:
            leap = approach(r, outward, most) if r > most * (1.0 + NEAR) else 0.0
        else:
            leap = leap_of(r, outward, least, rays[NEARBY + k], tan_reach)
        farthest = -2.0 * gap / slope
        closes = slope < 0.0 and 2.0 * bend * gap <= slope * slope and farthest * turning <= room and farthest <= path
        root = sqrt(slope * slope + 2.0 * bend * gap)
        move = min(2.0 * gap / (root - slope) if slope < 0.0 else (slope + root) / bend, path)
        move = move if move * turning <= room else room / turning
        at_root, below = gap <= ROUNDING * r, pz + t * dz < 0.0 and dz <= 0.0
        if among:
            at_root = at_root and not (t == 0.0 and slope > 0.0 and rays[ON_FACE + k] == 1.0)
        high = min(t + farthest, plane)
        closed, moved = min(t + 0.5 * farthest, high), t + move
        state = FOUND if move <= STANDSTILL * r and not closes else GOING
        state = (FOUND if -NEAR * r < gap and t > 0.0 else LOST) if at_root else state
        state = GOING if leap > 0.0 else state
        if outside:
            state = MISSED if leap == inf or (r >= most and outward >= 0.0 and not at_root) else state
        state = BELOW if below else state
        if among:
            state = MISSED if (t + leap if leap > 0.0 else max(t, moved)) >= rays[LIMIT + k] else state
        t_after = closed if closes else moved
        t_after = t if at_root else t_after
        t_after = t + leap if leap > 0.0 else t_after
        closes = closes and not at_root and not leap > 0.0
        if rays[CLOSING + k] == 0.0:
            rays[T + k], rays[STATE + k] = t if below else t_after, state
            rays[CLOSING + k] = 1.0 if closes else 0.0
            rays[LOW + k], rays[HIGH + k] = t, high
            rays[BEFORE + k], rays[F_BEFORE + k], rays[INVERSE_BEFORE + k] = t, gap, 1.0 / slope


@inline
def close_in(rays, count):
    """A step of every ray with a bracket: inverse Hermite interpolation, or Newton's, or half of the bracket."""
    for k in range(count):
        t, r, gap, slope = rays[T + k], rays[R + k], rays[F + k], rays[SLOPE + k]
        pz, dz = rays[Z0 + k], rays[ALONG_Z + k]
        plane = -pz / dz if dz < 0.0 else inf
        before, gap_before, inverse_before = rays[BEFORE + k], rays[F_BEFORE + k], rays[INVERSE_BEFORE + k]
        inverse = 1.0 / slope
        newton = -gap * inverse
        arrived = abs(newton) <= TOLERANCE * r or abs(gap) <= ROUNDING * r
        below = gap > 0.0 and t >= plane
        low, high = (t, rays[HIGH + k]) if gap > 0.0 else (rays[LOW + k], t)
        # divided differences of t as a function of F, each point counted twice
        per_gap = 1.0 / (gap - gap_before)
        secant = (t - before) * per_gap
        second = (inverse - secant) * per_gap
        third = (inverse_before - 2.0 * secant + inverse) * per_gap * per_gap
        guess = t + newton + gap * gap * (second - third * gap_before)
        guess = guess if low <= guess and guess <= high else min(t + newton, plane)
        guess = guess if low <= guess and guess <= high else 0.5 * (low + high)
        closing = rays[CLOSING + k] == 1.0
        state = FOUND if arrived else (BELOW if below else GOING)
        after = t + newton if arrived else (t if below else guess)
        if closing:
            rays[T + k], rays[STATE + k] = after, state
            rays[LOW + k], rays[HIGH + k] = low, high
            rays[BEFORE + k], rays[F_BEFORE + k], rays[INVERSE_BEFORE + k] = t, gap, inverse


@inline
def settle(rays, count, among):
    """Write down what was found; the last ray on its way takes the place.

    Returns the number of those that go on, and of those among them that have a bracket.
    """
    k, closing = 0, 0.0
    while k < count:
        if rays[STATE + k] == GOING:
            closing += rays[CLOSING + k]
            k += 1
            continue
        number = int(rays[NUMBER + k])
        rays[LENGTH + number], rays[STATUS + number] = rays[T + k], rays[STATE + k]
        rays[RHO_X + number], rays[RHO_Y + number] = rays[SLOPE_X + k], rays[SLOPE_Y + k]
        count -= 1
        for field in range(OWN):
            rays[NUMBER + field * SIZE + k] = rays[NUMBER + field * SIZE + count]
        if among:
            rays[ON_FACE + k], rays[LIMIT + k] = rays[ON_FACE + count], rays[LIMIT + count]
    return count, int(closing)


@inline
def start_all(rays, count):
    """Put all rays of a packet on their way."""
    for k in range(count):
        rays[NUMBER + k], rays[T + k], rays[CLOSING + k] = float(k), 0.0, 0.0
    for field in range(6):
        for k in range(count):
            rays[X0 + field * SIZE + k] = rays[PX + field * SIZE + k]
    return count


@inline
def drop_far(rays, count):
    """End the way of the rays that are past their limits. Returns the number of the others, and 0 for brackets."""
    for k in range(count):
        rays[STATE + k] = MISSED if rays[T + k] >= rays[LIMIT + k] else GOING
    return settle(rays, count, True)


@inline
def first_hits(rays, count, table, origin, inverse_step, bounds, among, outside):
    """First crossings of the ``count`` rays on their way, from points with ``|p| <= rho`` and z >= 0.

    Fills their path lengths, statuses and, where one was found, the table's slopes there. ``among``: whether this is
    one of several faces, on which rays may start, and behind whose limits no crossing matters. From ``outside`` points
    have ``|p| >= rho``. Both are known to the compiler.
    """
    side, tiles = float(len(table)), float(len(bounds.tiles))
    closing = 0
    for step in range(_LEAPS + MAX_STEPS + MAX_CLOSING):
        whole = in_whole_vectors(count)
        locate(rays, whole, side, origin, inverse_step, tiles, bounds.per_unit)
        if closing < count:
            fetch_bounds(rays, count, bounds.tiles)
        if step < _LEAPS and not outside:
            leap(rays, whole, bounds.least, bounds.tan_reach)
            if among:
                count, closing = drop_far(rays, count)
            continue
        fetch_table(rays, count, table, CELL)
        evaluate(rays, whole, inverse_step, outside)
        if closing > 0:
            close_in(rays, whole)
        if closing < count:
            walk(rays, whole, bounds.least, bounds.most, bounds.tan_reach, among, outside)
        count, closing = settle(rays, count, among)
        if count == 0:
            return
    for k in range(count):
        rays[STATUS + int(rays[NUMBER + k])] = LOST
