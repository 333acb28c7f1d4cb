"""First crossings of a packet of rays with a star-shaped surface, proven and fast.

The search walks along ``F(t) = rho(u(t)) - |p(t)|`` with steps that cannot jump over a root: where
``|F''| <= C`` along the ray ahead, the parabola ``F + F' s - C s^2/2`` bounds F from below, and its root is a safe
step. C comes from the bounds on the surface near the ray (``kernels.bicubic``), and a step never leaves their reach.
Once Kantorovich's condition ``C F <= F'^2 / 2`` holds the next root is unique, and bracketed Newton steps find it.
Rays come from the inside, where F > 0; where a scene asks for it from ``outside``, too, and are searched with -F.

All rays of a packet go in step, see ``kernels.ray_packet``; one that has found its crossing leaves its place to the
last.
"""

from math import inf, sqrt

from lensforge.kernels.compiled import NONE_YET, inline
from lensforge.kernels.precision import ByPrecision
from lensforge.kernels.ray_packet import (
    ALONG_Z,
    BEFORE,
    CELL,
    CLOSING,
    F_BEFORE,
    HIGH,
    INVERSE_BEFORE,
    LENGTH,
    LIMIT,
    LOW,
    MOST_HESSIAN,
    MOST_SLOPE,
    NEARBY,
    NUMBER,
    ON_FACE,
    OUTWARD,
    OWN,
    PX,
    RHO_X,
    RHO_Y,
    SIZE,
    SLOPE,
    SLOPE_X,
    SLOPE_Y,
    STATE,
    STATUS,
    X0,
    Z0,
    F,
    R,
    T,
    evaluate,
    fetch_bounds,
    fetch_table,
    in_whole_vectors,
    locate,
)

# Below: it passes the plane z = 0 first; lost: no convergence; missed: it goes past the surface, outside of it.
FOUND = 0.0
BELOW = 1.0
LOST = 2.0
GOING = 3.0
MISSED = 4.0

MAX_STEPS = 1000  # a ray that grazes a face takes hundreds
MAX_CLOSING = 60
# Shares of the distance from the origin; in single precision a few of its last bits.
TOLERANCE = ByPrecision(1e-12, 2e-6)  # of a Newton step: the next error is its square
ROUNDING = ByPrecision(2e-15, 5e-7)  # F below it is noise; near tangency it would keep the root moving
STANDSTILL = ByPrecision(1e-13, 1e-6)  # a shorter safe step has arrived
# A point so near to a ball or a surface counts as on it.
NEAR = ByPrecision(1e-12, 2e-6)
LAST_BIT = ByPrecision(1e-15, 2e-7)
LEAP_SHARE = 0.9  # of the least radius nearby: up to there a step to that radius costs less than an evaluation
_LEAPS = 2  # of all rays before the first evaluation: to the ball in which no surface is, and to the radius nearby


@inline
def leap_of(r, outward, least, nearby, tan_reach):
    """Path (mm) to the next useful evaluation; 0 if that is here.

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
def walked(rays, k, least, most, tan_reach, among, outside):
    """A safe step of a ray without a bracket, or its bracket: ``[t, t - 2 F/slope]`` has one root.

    Returns path, state, whether it has a bracket now, and the bracket. It ends at the plane z = 0, a little below which
    the table ends: there it is a polynomial without bounds. ``among`` several faces a ray that starts on this one is
    not at a root there, and need not go past its limit.
    """
    t = rays[T + k]
    r = rays[R + k]
    outward = rays[OUTWARD + k]
    gap = rays[F + k]
    slope = rays[SLOPE + k]
    pz = rays[Z0 + k]
    dz = rays[ALONG_Z + k]
    plane = -pz / dz if dz < 0.0 else inf
    cos_radial = outward / r
    sine = sqrt(max(1.0 - cos_radial * cos_radial, 0.0))
    # after a path s the ray has turned by atan(s sine / (r + s cos_radial)): s turning <= room stays in reach
    turning = sine - tan_reach * cos_radial
    room = r * tan_reach
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
    at_root = gap <= ROUNDING * r
    below = pz + t * dz < 0.0 and dz <= 0.0
    if among:
        at_root = at_root and not (t == 0.0 and slope > 0.0 and rays[ON_FACE + k] == 1.0)
    high = min(t + farthest, plane)
    closed = min(t + 0.5 * farthest, high)
    moved = t + move
    state = FOUND if move <= STANDSTILL * r and not closes else GOING
    state = (FOUND if -NEAR * r < gap and t > 0.0 else LOST) if at_root else state
    state = GOING if leap > 0.0 else state
    if outside:
        state = MISSED if leap == inf or (r >= most and outward >= 0.0 and not at_root) else state
    state = BELOW if below else state
    if among:
        state = MISSED if (t + leap if leap > 0.0 else max(t, moved)) >= rays[LIMIT + k] else state
    after = closed if closes else moved
    after = t if at_root else after
    after = t + leap if leap > 0.0 else after
    return t if below else after, state, closes and not at_root and not leap > 0.0, t, high


@inline
def closed_in(rays, k):
    """A step of a ray with a bracket: inverse Hermite interpolation, or Newton's, or half of the bracket.

    Returns path, state and bracket.
    """
    t = rays[T + k]
    r = rays[R + k]
    gap = rays[F + k]
    slope = rays[SLOPE + k]
    pz = rays[Z0 + k]
    dz = rays[ALONG_Z + k]
    plane = -pz / dz if dz < 0.0 else inf
    before = rays[BEFORE + k]
    gap_before = rays[F_BEFORE + k]
    inverse_before = rays[INVERSE_BEFORE + k]
    inverse = 1.0 / slope
    newton = -gap * inverse
    arrived = abs(newton) <= TOLERANCE * r or abs(gap) <= ROUNDING * r
    below = gap > 0.0 and t >= plane
    low = t if gap > 0.0 else rays[LOW + k]
    high = rays[HIGH + k] if gap > 0.0 else t
    # divided differences of t as a function of F, each point counted twice
    per_gap = 1.0 / (gap - gap_before)
    secant = (t - before) * per_gap
    second = (inverse - secant) * per_gap
    third = (inverse_before - 2.0 * secant + inverse) * per_gap * per_gap
    guess = t + newton + gap * gap * (second - third * gap_before)
    guess = guess if low <= guess and guess <= high else min(t + newton, plane)
    guess = guess if low <= guess and guess <= high else 0.5 * (low + high)
    after = t + newton if arrived else (t if below else guess)
    return after, FOUND if arrived else (BELOW if below else GOING), low, high


@inline
def keep(rays, k, after, state, closing, low, high):
    """Store a step, and the evaluation before it."""
    rays[BEFORE + k] = rays[T + k]
    rays[F_BEFORE + k] = rays[F + k]
    rays[INVERSE_BEFORE + k] = 1.0 / rays[SLOPE + k]
    rays[T + k] = after
    rays[STATE + k] = state
    rays[CLOSING + k] = closing
    rays[LOW + k] = low
    rays[HIGH + k] = high


@inline
def close_in(rays, count):
    """A step of every ray if all have a bracket."""
    for k in range(count):
        after, state, low, high = closed_in(rays, k)
        keep(rays, k, after, state, 1.0, low, high)


@inline
def advance(rays, count, closing, least, most, tan_reach, among, outside):
    """Advance every ray by one step; ``closing`` of them, but not all, already bracket the root.

    Where some do both steps are computed for each ray, and one is chosen: to write under a condition, which
    becomes a store by masks, costs some processors more than all else here.
    """
    if closing == 0:
        for k in range(count):
            after, state, closes, low, high = walked(rays, k, least, most, tan_reach, among, outside)
            keep(rays, k, after, state, 1.0 if closes else 0.0, low, high)
    else:
        for k in range(count):
            has = rays[CLOSING + k] == 1.0
            after, state, closes, low, high = walked(rays, k, least, most, tan_reach, among, outside)
            nearer, state_in, low_in, high_in = closed_in(rays, k)
            after = nearer if has else after
            state = state_in if has else state
            low = low_in if has else low
            high = high_in if has else high
            keep(rays, k, after, state, 1.0 if has or closes else 0.0, low, high)


@inline
def settle(rays, count, among):
    """Store finished rays and fill their places with the last ones.

    Returns the number of unfinished rays, and of those among them that have a bracket.
    """
    k = 0
    closing = 0.0
    while k < count:
        if rays[STATE + k] == GOING:
            closing += rays[CLOSING + k]
            k += 1
            continue
        number = int(rays[NUMBER + k])
        rays[LENGTH + number] = rays[T + k]
        rays[STATUS + number] = rays[STATE + k]
        rays[RHO_X + number] = rays[SLOPE_X + k]
        rays[RHO_Y + number] = rays[SLOPE_Y + k]
        count -= 1
        for field in range(OWN):
            rays[NUMBER + field * SIZE + k] = rays[NUMBER + field * SIZE + count]
        if among:
            rays[ON_FACE + k] = rays[ON_FACE + count]
            rays[LIMIT + k] = rays[LIMIT + count]
    return count, int(closing)


@inline
def start_all(rays, count):
    """Start the search of all rays of a packet."""
    for k in range(count):
        rays[NUMBER + k] = float(k)
        rays[T + k] = 0.0
        rays[CLOSING + k] = 0.0
    for field in range(6):
        for k in range(count):
            rays[X0 + field * SIZE + k] = rays[PX + field * SIZE + k]
    return count


@inline
def drop_far(rays, count):
    """End the search of rays past their limits. Returns the number of the others, and 0 for brackets."""
    for k in range(count):
        rays[STATE + k] = MISSED if rays[T + k] >= rays[LIMIT + k] else GOING
    return settle(rays, count, True)


@inline
def first_hits(rays, count, table, grid, bounds, among, outside):
    """First crossings of the ``count`` searching rays, from points with ``|p| <= rho`` and z >= 0.

    Fills their path lengths, statuses and, where one was found, the table's slopes there. ``among``: whether this is
    one of several faces, on which rays may start, and behind whose limits no crossing matters. From ``outside`` points
    have ``|p| >= rho``. Both are known to the compiler.
    """
    side = float(len(table))
    tiles = float(len(bounds.tiles))
    closing = NONE_YET
    for step in range(_LEAPS + MAX_STEPS + MAX_CLOSING):
        whole = in_whole_vectors(count)
        locate(rays, whole, side, grid, tiles, bounds.per_unit)
        if closing < count:
            fetch_bounds(rays, count, bounds.tiles)
        if step < _LEAPS and not outside:
            leap(rays, whole, bounds.least, bounds.tan_reach)
            if among:
                count, closing = drop_far(rays, count)
            continue
        fetch_table(rays, count, table, CELL)
        evaluate(rays, whole, grid.inverse_step, outside)
        if closing == count:
            close_in(rays, whole)
        else:
            advance(rays, whole, closing, bounds.least, bounds.most, bounds.tan_reach, among, outside)
        count, closing = settle(rays, count, among)
        if count == 0:
            return
    for k in range(count):
        rays[STATUS + int(rays[NUMBER + k])] = LOST
