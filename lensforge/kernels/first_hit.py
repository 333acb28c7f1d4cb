"""First crossing of a ray with a star-shaped surface, proven and fast.

The search walks from the inside along ``F(t) = rho(u(t)) - |p(t)|`` with steps that cannot jump over a root: where
``|F''| <= C`` along the ray ahead, the parabola ``F + F' s - C s^2/2`` bounds F from below, and its root is a safe
step. C comes from the bounds on the surface near the ray (``kernels.bounds``), and a step never leaves their reach.
Once Kantorovich's condition ``C F <= F'^2 / 2`` holds the next root is unique, and bracketed Newton steps find it.
"""

from math import inf, sqrt

from lensforge.kernels.jit import inline
from lensforge.kernels.spline import value_and_slope

FOUND = 0
BELOW = 1  # passed the plane z = 0 first
LOST = 2  # no convergence

MAX_STEPS = 200
MAX_CLOSING = 60
TOLERANCE = 1e-12  # of the distance from the origin: the next error is its square
ROUNDING = 2e-15  # F below this share of the distance is noise; near tangency it would keep the root moving
LEAP_SHARE = 0.9  # of the least radius nearby: up to there a step to that radius costs less than an evaluation


@inline
def gap_and_slope(X, Y, per_shift, cos_radial, r, dx, dy, dz, table, origin, inverse_step):
    """F, F' and the table's slopes at a point of a ray: chart X, Y and 1/(r + z), cosine to the radius, distance r."""
    rho, rho_x, rho_y = value_and_slope(table, origin, inverse_step, X, Y)
    ahead = cos_radial + dz
    return rho - r, (rho_x * (dx - X * ahead) + rho_y * (dy - Y * ahead)) * per_shift - cos_radial, rho_x, rho_y


@inline
def tile_of(X, Y, origin, bounds):
    """Bounds near a direction; indices stay within the table even where X or Y is NaN."""
    last = len(bounds.tiles) - 1
    i = max(min(int((X - origin) * bounds.per_unit), last), 0)
    j = max(min(int((Y - origin) * bounds.per_unit), last), 0)
    return bounds.tiles[i, j, 0], bounds.tiles[i, j, 1], bounds.tiles[i, j, 2]


@inline
def bound_ahead(outward, r, sine, cos_radial, slope, hessian, least):
    """Bound C of ``|F''|`` ahead, and the path (mm) up to which it holds within the reach of the bounds.

    With theta between ray and radius, ``|F''| <= sin^2 (1/r + H/r^2) + G |sin 2 theta|/r^2``; theta falls along a ray.
    """
    if cos_radial >= 0.0:
        per_r = 1.0 / r
        twist = 2.0 * sine * cos_radial if sine < cos_radial else 1.0
        return (sine * sine * (1.0 + hessian * per_r) + slope * twist * per_r) * per_r, inf
    nearest, path = r * sine, inf
    if nearest < least:  # up to the start of the ball in which F > 0
        nearest = least
        path = -outward - sqrt(outward * outward - r * r + least * least) + 1e-12 * r
    return (1.0 + (hessian + slope) / nearest) / nearest, path


@inline
def close_in(px, py, pz, dx, dy, dz, t, F, slope, table, origin, inverse_step):
    """The one root in ``[t, t - 2 F/slope]``: a Newton step, then inverse Hermite interpolation in the bracket.

    The bracket ends at the plane z = 0, a little below which the table ends: there it is a polynomial without bounds.
    """
    plane = -pz / dz if dz < 0.0 else inf
    low, high = t, min(t - 2.0 * F / slope, plane)
    before, F_before, inverse_before = t, F, 1.0 / slope
    t = min(t - F * inverse_before, high)
    for _ in range(MAX_CLOSING):
        x, y, z = px + t * dx, py + t * dy, pz + t * dz
        r = sqrt(x * x + y * y + z * z)
        per_shift, cos_radial = 1.0 / (r + z), (x * dx + y * dy + z * dz) / r
        F, slope, rho_x, rho_y = gap_and_slope(
            x * per_shift, y * per_shift, per_shift, cos_radial, r, dx, dy, dz, table, origin, inverse_step
        )
        inverse = 1.0 / slope
        newton = -F * inverse
        if abs(newton) <= TOLERANCE * r or abs(F) <= ROUNDING * r:
            return t + newton, FOUND, rho_x, rho_y
        if F > 0.0:
            if t >= plane:
                return t, BELOW, 0.0, 0.0
            low = t
        else:
            high = t
        # divided differences of t as a function of F, each point counted twice
        per_F = 1.0 / (F - F_before)
        secant = (t - before) * per_F
        second = (inverse - secant) * per_F
        third = (inverse_before - 2.0 * secant + inverse) * per_F * per_F
        before, F_before, inverse_before = t, F, inverse
        t += newton + F * F * (second - third * F_before)
        t = t if low <= t <= high else min(before + newton, plane)
        t = t if low <= t <= high else 0.5 * (low + high)
    return t, LOST, 0.0, 0.0


@inline
def first_hit(px, py, pz, dx, dy, dz, table, origin, inverse_step, bounds):
    """Path length to the first crossing from a point with ``|p| <= rho`` and z >= 0, a status, the table's slopes."""
    least = bounds.least
    t = 0.0
    for _ in range(MAX_STEPS):
        x, y, z = px + t * dx, py + t * dy, pz + t * dz
        if z < 0.0 and dz <= 0.0:
            return t, BELOW, 0.0, 0.0
        r_squared = x * x + y * y + z * z
        outward = x * dx + y * dy + z * dz
        if r_squared < least * least:  # F > 0 in the whole ball: go to its far side
            t += (sqrt(outward * outward + least * least - r_squared) - outward) * (1.0 + 1e-15) + 1e-15 * least
            continue
        r = sqrt(r_squared)
        per_shift, cos_radial = 1.0 / (r + z), outward / r
        X, Y = x * per_shift, y * per_shift
        low, max_slope, max_hessian = tile_of(X, Y, origin, bounds)
        sine = sqrt(max(1.0 - cos_radial * cos_radial, 0.0))
        # after a path s the ray has turned by atan(s sine / (r + s cos_radial)): s turning <= room stays in reach
        turning, room = sine - bounds.tan_reach * cos_radial, r * bounds.tan_reach
        if r < LEAP_SHARE * low:
            leap = sqrt(outward * outward + low * low - r_squared) - outward
            t += leap if leap * turning <= room else room / turning
            continue
        F, slope, rho_x, rho_y = gap_and_slope(X, Y, per_shift, cos_radial, r, dx, dy, dz, table, origin, inverse_step)
        if ROUNDING * r >= F:  # at the root to rounding, or started on or beyond it
            return t, FOUND if -1e-12 * r < F and t > 0.0 else LOST, rho_x, rho_y
        bend, path = bound_ahead(outward, r, sine, cos_radial, max_slope, max_hessian, least)
        farthest = -2.0 * F / slope
        if slope < 0.0 and 2.0 * bend * F <= slope * slope and farthest * turning <= room and farthest <= path:
            return close_in(px, py, pz, dx, dy, dz, t, F, slope, table, origin, inverse_step)
        root = sqrt(slope * slope + 2.0 * bend * F)
        move = min(2.0 * F / (root - slope) if slope < 0.0 else (slope + root) / bend, path)
        move = move if move * turning <= room else room / turning
        t += move
        if move <= 1e-13 * r:
            return t, FOUND, rho_x, rho_y
    return t, LOST, 0.0, 0.0
