"""Crossings of nearly convex faces by rays from inside: found at once, and checked by one number of the face.

Along a ray ``G = |p|/rho`` has the curvature ``M h^2/|p|^3``, h the distance of its line from the origin, M the bend of
the face across the radius (``kernels.bicubic.least_bend``), so that G of a plane is straight. Where M >= -m, G exceeds
the chord between two points L apart by ``m L^2/2`` times the most of ``h^2/|p|^3`` between them, at most. A ray that is
inside of a face by more than that at one end, and inside of it at the other, does not cross it between. What this does
not decide is searched as in ``kernels.first_hit``. m holds where the face is in a ball about the medium: beyond it G
counts as ``|p|`` over the radius of the ball, and no ray is ever there.
"""

from math import inf, nan, sqrt

from lensforge.kernels.bicubic import index_at, jet, tile_of
from lensforge.kernels.compiled import inline
from lensforge.kernels.first_hit import (
    ALONG_X,
    BEFORE,
    CELL,
    CLOSING,
    DX,
    F_BEFORE,
    HIGH,
    INVERSE_BEFORE,
    LOST,
    LOW,
    MAX_CLOSING,
    NUMBER,
    OUTWARD,
    PX,
    SLOPE,
    STATUS,
    X0,
    F,
    R,
    T,
    close_in,
    evaluate,
    fetch_table,
    in_whole_vectors,
    locate,
    settle,
    three,
    write,
)
from lensforge.kernels.fresnel import dot, mixed

DEEP = 0.8  # of the least radius: in that ball every ray is inside by 1 - DEEP


@inline
def path_to_ball(outward, square, radius):
    """Path (mm) to where a ray leaves a ball, from a point of the distance whose ``square`` is given; 0 beyond it."""
    ahead = outward * outward + radius * radius - square
    return max(sqrt(max(ahead, 0.0)) - outward, 0.0) if square < radius * radius else 0.0


@inline
def depth(table, bounds, scene, p, enough):
    """``1 - |p|/rho`` at a point, or a smaller number that is ``enough``."""
    r = sqrt(dot(p, p))
    X, Y = p[0] / (r + p[2]), p[1] / (r + p[2])
    sure = 1.0 - r / tile_of(X, Y, scene[3], bounds)[0]
    return sure if sure > enough else 1.0 - r / jet(table, scene[3], scene[4], X, Y)[0]


@inline
def bulge(hollow, least, outward, square, length):
    """Most by which G exceeds a chord within a path of ``length`` from a point of that distance."""
    impact = max(square - outward * outward, 0.0)
    nearest = max(sqrt(square if outward >= 0.0 else impact), DEEP * least)
    return 0.5 * hollow * impact * length * length / (nearest * nearest * nearest)


@inline
def clear_ahead(p, d, length, starts_on, table, bounds, hollow, scene):
    """Whether a ray does not cross a face before the path ``length``; it may start on it."""
    square, outward = dot(p, p), dot(p, d)
    needed = bulge(hollow, bounds.least, outward, square, length)
    inside = starts_on or square < bounds.least * bounds.least or depth(table, bounds, scene, p, 0.0) > 0.0
    end = mixed(1.0, p, length, d, 0.0, d)
    return inside and needed < 1.0 - DEEP and depth(table, bounds, scene, end, needed) > needed


@inline
def nodal(table, scene, p):
    """Radius at the node near a direction: a guess."""
    per_shift, most = scene[4] / (sqrt(dot(p, p)) + max(p[2], 0.0)), len(table) - 1.0
    i = int(index_at(p[0] * per_shift - scene[3] * scene[4] + 0.5, most))
    j = int(index_at(p[1] * per_shift - scene[3] * scene[4] + 0.5, most))
    return table[i, j]


@inline
def start_quick(rays, lane, k, table, scene, least, ball):
    """Put the place in the search that ray k of the packet is in, near where it may cross a face."""
    p, d = three(rays, PX + k), three(rays, DX + k)
    square, outward = dot(p, p), dot(p, d)
    low = path_to_ball(outward, square, DEEP * least)
    high = min(path_to_ball(outward, square, ball), -p[2] / d[2] if d[2] < 0.0 else inf)
    t = path_to_ball(outward, square, least)
    for _ in range(2):
        t = path_to_ball(outward, square, nodal(table, scene, mixed(1.0, p, t, d, 0.0, d)))
    rays[T + lane], rays[LOW + lane], rays[HIGH + lane] = min(max(t, low), high), low, high
    rays[CLOSING + lane], rays[NUMBER + lane] = 1.0, float(k)
    write(rays, X0 + lane, p)
    write(rays, ALONG_X + lane, d)
    rays[BEFORE + lane], rays[F_BEFORE + lane], rays[INVERSE_BEFORE + lane] = low, nan, 1.0


@inline
def gauge(rays, count, ball):
    """1 - G and its slope along every ray in place of F and F'."""
    for k in range(count):
        r, gap = rays[R + k], rays[F + k]
        cosine, per = rays[OUTWARD + k] / r, 1.0 / (r + gap)
        slope = (rays[SLOPE + k] * r - cosine * gap) * per * per
        beyond = r + gap > ball
        rays[F + k] = 1.0 - r / ball if beyond else gap * per
        rays[SLOPE + k] = -cosine / ball if beyond else slope


@inline
def quick_hits(rays, count, table, scene, ball):
    """A crossing of each of the ``count`` rays on their way, or the end of the ball, or of the hemisphere."""
    for _ in range(MAX_CLOSING):
        whole = in_whole_vectors(count)
        locate(rays, whole, float(len(table)), scene[3], scene[4], 1.0, 0.0)
        fetch_table(rays, count, table, CELL)
        evaluate(rays, whole, scene[4], False)
        gauge(rays, whole, ball)
        close_in(rays, whole)
        count, _ = settle(rays, count, False)
        if count == 0:
            return
    for k in range(count):
        rays[STATUS + int(rays[NUMBER + k])] = LOST


@inline
def is_first(p, d, length, table, bounds, ball, hollow, scene):
    """Whether a crossing that was found is the first one."""
    square, outward = dot(p, p), dot(p, d)
    needed = bulge(hollow, bounds.least, outward, square, length)
    end = mixed(1.0, p, length, d, 0.0, d)
    deep = square < DEEP * DEEP * bounds.least * bounds.least or depth(table, bounds, scene, p, needed) > needed
    return deep and needed < 1.0 - DEEP and dot(end, end) < ball * ball * (1.0 - 1e-9)


@inline
def gauge_along(table, scene, p, d):
    """G at a point, and its slope along a direction."""
    r = sqrt(dot(p, p))
    X, Y = p[0] / (r + p[2]), p[1] / (r + p[2])
    rho, x, y, _, _, _ = jet(table, scene[3], scene[4], X, Y)
    cosine = dot(p, d) / r
    turn = (x * (d[0] - X * (cosine + d[2])) + y * (d[1] - Y * (cosine + d[2]))) / (r + p[2])
    return r / rho, (cosine - r / rho * turn) / rho


@inline
def stays_outside(p, d, length, value, slope, least, hollow):
    """Whether a ray does not cross a face from outside before the path ``length``.

    ``value`` and ``slope`` of G at its start, where the value is 1 if it starts on the face.
    """
    square, outward = dot(p, p), dot(p, d)
    lowest = value + slope * length - bulge(hollow, least / DEEP, outward, square, length)
    return (value > 1.0 or slope > 0.0) and value >= 1.0 and lowest > 1.0
