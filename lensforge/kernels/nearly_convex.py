"""Crossings of nearly convex faces by rays from inside: found at once, and checked by one number of the face.

Along a ray ``G = |p|/rho`` has the curvature ``M h^2/|p|^3``, h the distance of its line from the origin, M the bend of
the face across the radius (``least_bend``), so that G of a plane is straight. Where M >= -m, G exceeds
the chord between two points L apart by ``m L^2/2`` times the most of ``h^2/|p|^3`` between them, at most. A ray that is
inside of a face by more than that at one end, and inside of it at the other, does not cross it between. What this does
not decide is searched as in ``kernels.first_hit``. m holds where the face is in a ball about the medium: beyond it G
counts as ``|p|`` over the radius of the ball, and no ray is ever there.
"""

from math import inf, nan, sqrt

import numpy as np
from jaxtyping import Float, Int8

from lensforge.kernels.bicubic import FaceBounds, index_at, jet, nearest, tile_of
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.first_hit import LOST, MAX_CLOSING, close_in, settle
from lensforge.kernels.ray_packet import (
    ALONG_X,
    BEFORE,
    CELL,
    CLOSING,
    F_BEFORE,
    HIGH,
    INVERSE_BEFORE,
    LOW,
    NUMBER,
    OUTWARD,
    SIZE,
    SLOPE,
    STATUS,
    X0,
    F,
    R,
    T,
    evaluate,
    fetch_table,
    in_whole_vectors,
    locate,
    three,
)
from lensforge.kernels.vectors import add_scaled, dot

DEEP = 0.8  # of the least radius: in that ball every ray is inside by 1 - DEEP


@kernel
def farthest_nearest(tables, faces, origin, step):
    """Radius (mm) of a ball about the part of the hemisphere inside all of ``faces``."""
    side = tables.shape[1]
    rim = 1.0 + 2.0 * step
    ball = 0.0
    for i in range(side - 3):
        for j in range(side - 3):
            X = origin + (i + 1.5) * step
            Y = origin + (j + 1.5) * step
            if rim * rim < X * X + Y * Y:
                continue
            nearest = np.inf
            for face in faces:
                highest = 0.0
                for a in range(4):
                    for b in range(4):
                        highest = max(highest, tables[face, i + a, j + b])
                nearest = min(nearest, highest)
            ball = max(ball, nearest)
    return ball


@inline
def node_of_row(row, j):
    """Six times the value of a row's spline at a node, twice its slope, and its second derivative, per step."""
    before = row[j - 1]
    middle = row[j]
    behind = row[j + 1]
    return before + 4.0 * middle + behind, behind - before, behind - 2.0 * middle + before


@inline
def least_bend(table, i, j, origin, step):
    """Least eigenvalue of the Hessian on the sphere of ``1/rho``, plus ``1/rho``, at a node; and ``rho`` there.

    It is the curvature of ``|p|/rho`` across the radius, times |p|: 0 for a plane, and above 0 where a face is convex.
    """
    a, d, g = node_of_row(table[i - 1], j)
    b, e, h = node_of_row(table[i], j)
    c, f, k = node_of_row(table[i + 1], j)
    rho = (a + 4.0 * b + c) / 36.0
    x = (c - a) / (12.0 * step)
    y = (d + 4.0 * e + f) / (12.0 * step)
    xy = (f - d) / (4.0 * step * step)
    xx = (a - 2.0 * b + c) / (6.0 * step * step)
    yy = (g + 4.0 * h + k) / (6.0 * step * step)
    X = origin + i * step
    Y = origin + j * step
    per = 0.5 * (1.0 + X * X + Y * Y)  # rad on the sphere for 1/per on the chart
    along = X * x + Y * y
    xx = xx + (2.0 * X * x - along) / per
    yy = yy + (2.0 * Y * y - along) / per
    xy = xy + (X * y + Y * x) / per
    bend_x = 2.0 * x * x / rho - xx
    bend_y = 2.0 * y * y / rho - yy
    mean = 0.5 * (bend_x + bend_y)
    apart = 0.5 * (bend_x - bend_y)
    across = 2.0 * x * y / rho - xy
    return (rho + per * per * (mean - sqrt(apart * apart + across * across))) / (rho * rho), rho


@kernel
def hollow(table, origin, step, ball, bends):
    """Depth of the hollows of a face within the ``ball`` (mm): the most by which :func:`least_bend` is below 0 (1/mm).

    Taken at the nodes; in a cell lower by as much as its corners differ. ``bends`` (2, side, 2): memory.
    """
    side = table.shape[0]
    rim = 1.0 + step
    hollowest = 0.0
    for i in range(1, side - 1):
        bend = bends[i % 2]
        before = bends[(i + 1) % 2]
        for j in range(1, side - 1):
            bend[j, 0], bend[j, 1] = least_bend(table, i, j, origin, step)
            if i == 1 or j == 1:
                continue
            X = nearest(origin, step, i - 1, i)
            Y = nearest(origin, step, j - 1, j)
            radius = min(min(bend[j, 1], bend[j - 1, 1]), min(before[j, 1], before[j - 1, 1]))
            if rim * rim < X * X + Y * Y or radius > ball * (1.0 + step):
                continue
            lowest = min(min(bend[j, 0], bend[j - 1, 0]), min(before[j, 0], before[j - 1, 0]))
            highest = max(max(bend[j, 0], bend[j - 1, 0]), max(before[j, 0], before[j - 1, 0]))
            hollowest = max(hollowest, highest - 2.0 * lowest)
    return hollowest


def chain_bounds(
    tables: Float[np.ndarray, "f side side"],
    bounds: FaceBounds,
    before: Int8[np.ndarray, " f"],
    origin: float,
    step: float,
) -> FaceBounds:
    """The ``bounds`` with those that a chain needs, of faces with these media ``before`` them."""
    balls = [farthest_nearest(tables, np.flatnonzero(before == medium), origin, step) for medium in before]
    memory = np.empty((2, tables.shape[1], 2))
    hollows = [hollow(table, origin, step, ball, memory) for table, ball in zip(tables, balls, strict=True)]
    return bounds._replace(balls=np.array(balls), hollows=np.array(hollows))


@inline
def path_to_ball(outward, distance_squared, radius):
    """Path (mm) to where a ray leaves a ball about the origin, from a point at that distance; 0 beyond the ball."""
    ahead = outward * outward + radius * radius - distance_squared
    return max(sqrt(max(ahead, 0.0)) - outward, 0.0) if distance_squared < radius * radius else 0.0


@inline
def depth(table, bounds, grid, p, enough):
    """``1 - |p|/rho`` at a point, or a smaller number that is ``enough``."""
    r = sqrt(dot(p, p))
    X = p[0] / (r + p[2])
    Y = p[1] / (r + p[2])
    sure = 1.0 - r / tile_of(X, Y, grid, bounds)[0]
    return sure if sure > enough else 1.0 - r / jet(table, grid, X, Y)[0]


@inline
def bulge(hollow, least, outward, distance_squared, length):
    """Upper bound of G less its chord over a segment of ``length``, from a point at that distance from the origin."""
    impact = max(distance_squared - outward * outward, 0.0)
    nearest = max(sqrt(distance_squared if outward >= 0.0 else impact), DEEP * least)
    return 0.5 * hollow * impact * length * length / (nearest * nearest * nearest)


@inline
def clear_ahead(p, d, length, starts_on, table, bounds, hollow, grid):
    """True if a ray does not cross a face before the path ``length``; it may start on the face."""
    distance_squared = dot(p, p)
    outward = dot(p, d)
    needed = bulge(hollow, bounds.least, outward, distance_squared, length)
    inside = starts_on or distance_squared < bounds.least * bounds.least or depth(table, bounds, grid, p, 0.0) > 0.0
    end = add_scaled(p, length, d)
    return inside and needed < 1.0 - DEEP and depth(table, bounds, grid, end, needed) > needed


@inline
def mark_node(rays, k, p, side, grid):
    """Write the row and the column of the table's node near the direction of a point into the field of cells."""
    per_shift = grid.inverse_step / (sqrt(dot(p, p)) + max(p[2], 0.0))
    rays[CELL + k] = index_at(p[0] * per_shift - grid.origin * grid.inverse_step + 0.5, side - 1.0)
    rays[CELL + SIZE + k] = index_at(p[1] * per_shift - grid.origin * grid.inverse_step + 0.5, side - 1.0)


@inline
def nodal(table, rays, k):
    """Radius at the node that :func:`mark_node` wrote: a guess."""
    return table[np.uint32(rays[CELL + k]), np.uint32(rays[CELL + SIZE + k])]


@inline
def start_quick(rays, count, table, grid, least, ball):
    """Start the search of ``count`` rays near their likely crossings with a face, from guesses of their radii in R."""
    for k in range(in_whole_vectors(count)):
        p = three(rays, X0 + k)
        d = three(rays, ALONG_X + k)
        ahead = path_to_ball(dot(p, d), dot(p, p), rays[R + k])
        mark_node(rays, k, add_scaled(p, ahead, d), float(len(table)), grid)
    for k in range(count):
        rays[R + k] = nodal(table, rays, k)
    for k in range(in_whole_vectors(count)):
        p = three(rays, X0 + k)
        d = three(rays, ALONG_X + k)
        distance_squared = dot(p, p)
        outward = dot(p, d)
        low = path_to_ball(outward, distance_squared, DEEP * least)
        high = min(path_to_ball(outward, distance_squared, ball), -p[2] / d[2] if d[2] < 0.0 else inf)
        ahead = path_to_ball(outward, distance_squared, rays[R + k])
        rays[T + k] = min(max(ahead, low), high)
        rays[LOW + k] = low
        rays[HIGH + k] = high
        rays[CLOSING + k] = 1.0
        rays[BEFORE + k] = low
        rays[F_BEFORE + k] = nan
        rays[INVERSE_BEFORE + k] = 1.0


@inline
def gauge(rays, count, ball):
    """1 - G and its slope along every ray in place of F and F'."""
    for k in range(count):
        r = rays[R + k]
        gap = rays[F + k]
        cosine = rays[OUTWARD + k] / r
        per = 1.0 / (r + gap)
        slope = (rays[SLOPE + k] * r - cosine * gap) * per * per
        beyond = r + gap > ball
        rays[F + k] = 1.0 - r / ball if beyond else gap * per
        rays[SLOPE + k] = -cosine / ball if beyond else slope


@inline
def quick_hits(rays, count, table, grid, ball):
    """A crossing of each of the ``count`` searching rays, or the end of the ball, or of the hemisphere."""
    for _ in range(MAX_CLOSING):
        whole = in_whole_vectors(count)
        locate(rays, whole, float(len(table)), grid, 1.0, 0.0)
        fetch_table(rays, count, table, CELL)
        evaluate(rays, whole, grid.inverse_step, False)
        gauge(rays, whole, ball)
        close_in(rays, whole)
        count, _ = settle(rays, count, False)
        if count == 0:
            return
    for k in range(count):
        rays[STATUS + int(rays[NUMBER + k])] = LOST


@inline
def is_first(p, d, length, table, bounds, ball, hollow, grid):
    """True if a crossing is the first along its ray."""
    distance_squared = dot(p, p)
    outward = dot(p, d)
    needed = bulge(hollow, bounds.least, outward, distance_squared, length)
    end = add_scaled(p, length, d)
    deep = (
        distance_squared < DEEP * DEEP * bounds.least * bounds.least or depth(table, bounds, grid, p, needed) > needed
    )
    return deep and needed < 1.0 - DEEP and dot(end, end) < ball * ball * (1.0 - 1e-9)


@inline
def gauge_along(table, grid, p, d):
    """G at a point, and its slope along a direction."""
    r = sqrt(dot(p, p))
    X = p[0] / (r + p[2])
    Y = p[1] / (r + p[2])
    rho, x, y, _, _, _ = jet(table, grid, X, Y)
    cosine = dot(p, d) / r
    turn = (x * (d[0] - X * (cosine + d[2])) + y * (d[1] - Y * (cosine + d[2]))) / (r + p[2])
    return r / rho, (cosine - r / rho * turn) / rho


@inline
def stays_outside(p, d, length, value, slope, least, hollow):
    """True if a ray does not cross a face from outside before the path ``length``.

    ``value`` and ``slope`` of G at its start, where the value is 1 if it starts on the face.
    """
    distance_squared = dot(p, p)
    outward = dot(p, d)
    lowest = value + slope * length - bulge(hollow, least / DEEP, outward, distance_squared, length)
    return (value > 1.0 or slope > 0.0) and value >= 1.0 and lowest > 1.0
