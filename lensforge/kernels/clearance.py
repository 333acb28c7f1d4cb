"""Distances that constraints need: the nearest point of a surface, and how far a grown mesh reaches along a ray.

Half of the squared distance of a point ``p`` from ``rho u`` is ``rho^2/2 - rho p.u + p^2/2``, whose first and second
derivatives on the chart are closed forms. A search over the table's nodes finds the valley, Newton steps its bottom.

A triangle grown by a distance is convex: two parallel faces, a cylinder along each edge, a ball about each corner. A
ray leaves it through one of these, so the last exit that lies on such a piece is the extent, in closed form.
"""

from dataclasses import dataclass
from math import asin, cos, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lensforge.kernels.bicubic import TableSpacing, cubic_splines, index_at, jet
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.parallel import in_pieces

_STEPS = 30
_HALVINGS = 8
_WORTH_SHARING = 2**8  # points: a millisecond of work
_BLOCK = 8  # nodes along each side of a block
_TINY = 1e-300
_LONGEST = 0.3  # of a step, chart units
_SPARE = 0.55  # of the diagonal of a cell: the farthest that a point of it is from its nearest node
_DONE = 1e-7  # step, chart units: the distance's error is its square


@inline
def half_square(table, grid, p, X, Y):
    """Half of the squared distance, less that from the origin, and its derivatives by X, Y, XX, XY, YY."""
    px, py, pz = p
    rho, x, y, xx, xy, yy = jet(table, grid, X, Y)
    share = 1.0 / (1.0 + X * X + Y * Y)
    w = 2.0 * (px * X + py * Y + pz) * share
    wx, wy = 2.0 * (px - X * w) * share, 2.0 * (py - Y * w) * share
    wxx, wyy = -2.0 * (w + 2.0 * X * wx) * share, -2.0 * (w + 2.0 * Y * wy) * share
    wxy = -2.0 * (X * wy + Y * wx) * share
    along = w - pz  # p.u
    beyond = rho - along
    return (
        rho * (0.5 * rho - along),
        beyond * x - rho * wx,
        beyond * y - rho * wy,
        x * x + beyond * xx - 2.0 * x * wx - rho * wxx,
        x * y + beyond * xy - x * wy - y * wx - rho * wxy,
        y * y + beyond * yy - 2.0 * y * wy - rho * wyy,
    )


@inline
def newton_step(X, Y, gx, gy, hxx, hxy, hyy):
    """A step downhill within the disc: Newton's where the valley is convex; on the rim along it, or inwards."""
    outward = -(gx * X + gy * Y)
    rim = X * X + Y * Y > 1.0 - 1e-12
    if rim and outward > 0.0:
        bend = hxx * Y * Y - 2.0 * hxy * X * Y + hyy * X * X + outward
        slope = gy * X - gx * Y
        angle = -slope / bend if bend > 0.0 else (-_LONGEST if slope > 0.0 else _LONGEST)
        angle = min(max(angle, -_LONGEST), _LONGEST)
        return X * (cos(angle) - 1.0) - Y * sin(angle), Y * (cos(angle) - 1.0) + X * sin(angle)
    determinant = hxx * hyy - hxy * hxy
    sx, sy = (hxy * gy - hyy * gx) / determinant, (hxy * gx - hxx * gy) / determinant
    if not (determinant > 0.0 and hxx > 0.0) or (rim and sx * X + sy * Y > 0.0):
        size = abs(hxx) + abs(hyy)
        sx, sy = -gx / size, -gy / size
    length = hypot(sx, sy)
    if length > _LONGEST:
        sx, sy = sx * _LONGEST / length, sy * _LONGEST / length
    return sx, sy


@inline
def within(X, Y):
    """The point itself, or the point of the rim in its direction."""
    radius = sqrt(X * X + Y * Y)
    return (X / radius, Y / radius) if radius > 1.0 else (X, Y)


@inline
def foot(table, grid, p, X, Y):
    """Chart point of the bottom of the valley in which ``X``, ``Y`` lies."""
    at = half_square(table, grid, p, X, Y)
    for _ in range(_STEPS):
        sx, sy = newton_step(X, Y, at[1], at[2], at[3], at[4], at[5])
        if abs(sx) + abs(sy) < _DONE:
            break
        lower = False
        for _ in range(_HALVINGS):
            nx, ny = within(X + sx, Y + sy)
            new = half_square(table, grid, p, nx, ny)
            lower = new[0] < at[0]
            if lower:
                break
            sx, sy = 0.5 * sx, 0.5 * sy
        if not lower:
            break
        X, Y = nx, ny
        at = new
    return X, Y


@inline
def take_shares(side, grid, X, Y, columns, shares):
    """Fill in the sixteen coefficients that act at a chart point, and their shares in ``rho``."""
    px, py = (X - grid.origin) * grid.inverse_step, (Y - grid.origin) * grid.inverse_step
    i, j = index_at(px - 1.0, side - 4.0), index_at(py - 1.0, side - 4.0)
    wx, _, _ = cubic_splines(px - (i + 1.0))
    wy, _, _ = cubic_splines(py - (j + 1.0))
    for a in range(4):
        for b in range(4):
            columns[4 * a + b] = (int(i) + a) * side + int(j) + b
            shares[4 * a + b] = wx[a] * wy[b]


@inline
def squared_gap(box, px, py, pz):
    """Squared distance of a point from a box, 0 in it; after rounding no more than that from any node in the box."""
    dx = max(box[0, 0] - px, 0.0, px - box[1, 0])
    dy = max(box[0, 1] - py, 0.0, py - box[1, 1])
    dz = max(box[0, 2] - pz, 0.0, pz - box[1, 2])
    return dx * dx + dy * dy + dz * dz


@inline
def nearest_node(nodes, boxes, px, py, pz, window, farthest, guess):
    """Squared distance, row and column of the node of a ``window`` (rows, then columns: first, end) nearest to a point.

    The first of equally near ones, row by row; ``farthest`` and -1 if none is nearer. ``boxes`` (b, b, 2, 3): least and
    largest coordinates of blocks of ``nodes`` (n, n, 3). ``guess``: row and column of a node that is likely to be near,
    which leaves fewer blocks to look into.
    """
    best, row, column = farthest, -1, -1  # the nearest node so far
    first_row, end_row, first_column, end_column = window
    if first_row <= guess[0] < end_row and first_column <= guess[1] < end_column:
        dx, dy, dz = nodes[guess][0] - px, nodes[guess][1] - py, nodes[guess][2] - pz
        squared = dx * dx + dy * dy + dz * dz
        if squared < best:
            best = squared
            row = guess[0]
            column = guess[1]
    for r in range(first_row // _BLOCK, (end_row - 1) // _BLOCK + 1):
        for c in range(first_column // _BLOCK, (end_column - 1) // _BLOCK + 1):
            if squared_gap(boxes[r, c], px, py, pz) > best:
                continue
            for a in range(max(first_row, r * _BLOCK), min(end_row, (r + 1) * _BLOCK)):
                for b in range(max(first_column, c * _BLOCK), min(end_column, (c + 1) * _BLOCK)):
                    dx, dy, dz = nodes[a, b, 0] - px, nodes[a, b, 1] - py, nodes[a, b, 2] - pz
                    squared = dx * dx + dy * dy + dz * dz
                    earlier = row >= 0 and (a < row or (a == row and b < column))
                    if squared < best or (squared == best and earlier):
                        best = squared
                        row = a
                        column = b
    return best, row, column


class SurfaceNodes(NamedTuple):
    """A surface at places ``apart`` on the chart, boxes around blocks of these, and a point's largest distance."""

    places: Float[np.ndarray, "n n 3"]
    boxes: Float[np.ndarray, "b b 2 3"]
    apart: float
    spare_mm: float


class PointsToFind(NamedTuple):
    """Points, how far the surface is along their rays from the origin, and their feet with columns and shares."""

    points: Float[np.ndarray, "k 3"]
    radial_mm: Float[np.ndarray, " k"]
    feet: Float[np.ndarray, "k 2"]
    columns: Int[np.ndarray, "k 16"]
    shares: Float[np.ndarray, "k 16"]


@kernel
def nearest_points(table, origin, step, nodes, reach, out):
    """Fill the feet of points with the nearest chart point, NaN where none is within ``reach`` mm.

    ``nodes``: a :class:`SurfaceNodes`; ``out``: a :class:`PointsToFind`, with the columns and shares of the table's
    coefficients at the feet.
    """
    points, radial, feet, columns, shares = out
    count = len(nodes.places)
    first = origin + step
    apart = nodes.apart
    grid = TableSpacing(origin, 1.0 / step)
    near = 0, 0
    for k in range(len(points)):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        radius = sqrt(px * px + py * py + pz * pz)
        X, Y = px / (radius + pz), py / (radius + pz)
        ball = max(min(abs(radial[k]), reach), -radial[k]) + nodes.spare_mm
        angle = asin(ball / radius) if ball < radius else 0.5 * np.pi
        wide = (sqrt(2.0 * (1.0 + X * X + Y * Y)) * sin(0.5 * angle)) / apart
        i, j = (X - first) / apart, (Y - first) / apart
        rows = max(0, int(i - wide)), min(count, int(i + wide) + 2)
        best, row, column = nearest_node(
            nodes.places,
            nodes.boxes,
            px,
            py,
            pz,
            (*rows, max(0, int(j - wide)), min(count, int(j + wide) + 2)),
            ball * ball,
            near,
        )
        if row >= 0:
            near = row, column  # of the next point, which is likely to be beside this one
        is_near = abs(radial[k]) <= ball and radial[k] * radial[k] <= best
        if is_near or row >= 0:
            if not is_near:
                X, Y = within(first + row * apart, first + column * apart)
            X, Y = foot(table, grid, (px, py, pz), X, Y)
            feet[k, 0], feet[k, 1] = X, Y
            take_shares(len(table), grid, X, Y, columns[k], shares[k])


@dataclass(frozen=True)
class Feet:
    """Feet of some points on a surface: numbers of the ``points``, and chart point of each foot.

    ``columns``, ``shares``: the table's coefficients that make the radius there.
    """

    points: Int[np.ndarray, " f"]
    chart: Float[np.ndarray, "f 2"]
    columns: Int[np.ndarray, "f 16"]
    shares: Float[np.ndarray, "f 16"]


def nearest_on_table(
    table: Float[np.ndarray, "s s"],
    origin: float,
    step: float,
    nodes: Float[np.ndarray, "n n 3"],
    apart: float,
    points: Float[np.ndarray, "k 3"],
    radial_mm: Float[np.ndarray, " k"],
    reach_mm: float,
) -> Feet:
    """Feet of ``points`` (mm) on the surface of ``table``.

    ``nodes``: the surface at places ``apart`` on the chart, from its first node. Of all points whose distance is up to
    ``reach_mm``, and of those beyond the surface, their ``radial_mm`` below 0; of some of the others.
    """
    diagonals = nodes[1:, 1:] - nodes[:-1, :-1], nodes[1:, :-1] - nodes[:-1, 1:]
    spare = _SPARE * max(float(np.sqrt(np.einsum("ijk,ijk->ij", diagonal, diagonal).max())) for diagonal in diagonals)
    surface = SurfaceNodes(nodes, _boxes(nodes), apart, spare)
    count = len(points)
    feet = np.full((count, 2), np.nan)
    columns = np.empty((count, 16), dtype=np.int64)
    shares = np.empty((count, 16))

    def work(rows: slice) -> None:
        batch = PointsToFind(points[rows], radial_mm[rows], feet[rows], columns[rows], shares[rows])
        nearest_points(table, origin, step, surface, reach_mm, batch)

    in_pieces(work, count, worth=_WORTH_SHARING)
    at = np.flatnonzero(~np.isnan(feet[:, 0]))
    return Feet(at, feet[at], columns[at], shares[at])


def _boxes(nodes: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "b b 2 3"]:
    starts = np.arange(0, len(nodes), _BLOCK)
    ends = [
        extremum.reduceat(extremum.reduceat(nodes, starts, axis=0), starts, axis=1)
        for extremum in (np.minimum, np.maximum)
    ]
    return np.stack(ends, axis=2)


@inline
def ball_exit(ux, uy, uz, corner, growth):
    """Distance at which a ray leaves the ball about ``corner``; -1 where it misses it."""
    along = ux * corner[0] + uy * corner[1] + uz * corner[2]
    squared = corner[0] * corner[0] + corner[1] * corner[1] + corner[2] * corner[2]
    under = along * along - squared + growth * growth
    return along + sqrt(under) if under >= 0.0 else -1.0


@inline
def cylinder_exit(ux, uy, uz, tail, head, growth):
    """Distance at which a ray leaves the cylinder about the edge from ``tail`` to ``head``; -1 where beside it."""
    ex = head[0] - tail[0]
    ey = head[1] - tail[1]
    ez = head[2] - tail[2]
    length = sqrt(ex * ex + ey * ey + ez * ez)
    if length < _TINY:
        return -1.0
    ex, ey, ez = ex / length, ey / length, ez / length
    turned = ux * ex + uy * ey + uz * ez
    start = tail[0] * ex + tail[1] * ey + tail[2] * ez
    across = 1.0 - turned * turned
    if across < 1e-24:  # along the axis of the cylinder: it leaves through the ball at an end
        return -1.0
    middle = ux * tail[0] + uy * tail[1] + uz * tail[2] - turned * start
    squared = tail[0] * tail[0] + tail[1] * tail[1] + tail[2] * tail[2] - start * start
    under = middle * middle - across * (squared - growth * growth)
    if under < 0.0:
        return -1.0
    distance = (middle + sqrt(under)) / across
    place = distance * turned - start
    return distance if 0.0 <= place <= length else -1.0


@inline
def plane_exit(ux, uy, uz, corners, growth):
    """Distance at which a ray leaves the triangle, shifted along its normal by ``growth`` both ways; -1 beside it."""
    a = corners[0]
    b = corners[1]
    c = corners[2]
    px, py, pz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    qx, qy, qz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    area = sqrt(nx * nx + ny * ny + nz * nz)
    if area < _TINY:
        return -1.0
    nx, ny, nz = nx / area, ny / area, nz / area
    slope = ux * nx + uy * ny + uz * nz
    height = a[0] * nx + a[1] * ny + a[2] * nz
    if abs(slope) < 1e-12:  # it runs along the plane, and leaves through an edge or a corner
        return -1.0
    distance = (height + (growth if slope > 0.0 else -growth)) / slope
    x, y, z = distance * ux - a[0], distance * uy - a[1], distance * uz - a[2]
    # barycentric coordinates of the foot of the perpendicular
    of_b = ((y * qz - z * qy) * nx + (z * qx - x * qz) * ny + (x * qy - y * qx) * nz) / area
    of_c = ((py * z - pz * y) * nx + (pz * x - px * z) * ny + (px * y - py * x) * nz) / area
    return distance if of_b >= 0.0 and of_c >= 0.0 and of_b + of_c <= 1.0 else -1.0


@inline
def beside(ux, uy, uz, ball, best):
    """True if a ray passes beside a ``ball`` (centre, radius), or leaves it before the distance ``best``."""
    along = ux * ball[0] + uy * ball[1] + uz * ball[2]
    if along + ball[3] <= best:
        return True
    squared = ball[0] * ball[0] + ball[1] * ball[1] + ball[2] * ball[2]
    under = along * along - squared + ball[3] * ball[3]
    return under < 0.0 or (along < best and under <= (best - along) * (best - along))


@kernel
def grown_extents(directions, triangles, balls, groups, size, growth, extents):
    """Fill ``extents`` (n,), in mm, at unit directions (n, 3): the last point within ``growth`` of a triangle, or 0.

    ``triangles`` (t, 3, 3): corners, in groups of ``size`` neighbours. A ball (centre,
    radius) holds each grown triangle, ``balls`` (t, 4), and each group of them, ``groups`` (g, 4).
    """
    for k in range(len(directions)):
        ux, uy, uz = directions[k, 0], directions[k, 1], directions[k, 2]
        best = 0.0
        for g in range(len(groups)):
            if beside(ux, uy, uz, groups[g], best):
                continue
            for j in range(g * size, min((g + 1) * size, len(triangles))):
                if beside(ux, uy, uz, balls[j], best):
                    continue
                corners = triangles[j]
                best = max(best, plane_exit(ux, uy, uz, corners, growth))
                for i in range(3):
                    best = max(best, ball_exit(ux, uy, uz, corners[i], growth))
                    best = max(best, cylinder_exit(ux, uy, uz, corners[i], corners[(i + 1) % 3], growth))
        extents[k] = best
