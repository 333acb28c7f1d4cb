"""Extent of a grown triangle mesh along rays from the origin: the last point within a distance of any triangle.

A triangle grown by a distance is convex: two parallel faces, a cylinder along each edge, a ball about each corner. A
ray leaves it through one of these, so the last exit that lies on such a piece is the extent, in closed form.
"""

from math import sqrt

from lensforge.kernels.jit import inline, kernel

_TINY = 1e-300


@inline
def ball_exit(ux, uy, uz, corner, growth):
    """Distance at which a ray leaves the ball about ``corner``; -1 where it misses it."""
    along = ux * corner[0] + uy * corner[1] + uz * corner[2]
    squared = corner[0] * corner[0] + corner[1] * corner[1] + corner[2] * corner[2]
    under = along * along - squared + growth * growth
    return along + sqrt(under) if under >= 0.0 else -1.0


@inline
def cylinder_exit(ux, uy, uz, one, other, growth):
    """Distance at which a ray leaves the cylinder about the edge from ``one`` to ``other``; -1 where beside it."""
    ex, ey, ez = other[0] - one[0], other[1] - one[1], other[2] - one[2]
    length = sqrt(ex * ex + ey * ey + ez * ez)
    if length < _TINY:
        return -1.0
    ex, ey, ez = ex / length, ey / length, ez / length
    turned, start = ux * ex + uy * ey + uz * ez, one[0] * ex + one[1] * ey + one[2] * ez
    across = 1.0 - turned * turned
    if across < 1e-24:  # along the axis of the cylinder: it leaves through the ball at an end
        return -1.0
    middle = ux * one[0] + uy * one[1] + uz * one[2] - turned * start
    squared = one[0] * one[0] + one[1] * one[1] + one[2] * one[2] - start * start
    under = middle * middle - across * (squared - growth * growth)
    if under < 0.0:
        return -1.0
    distance = (middle + sqrt(under)) / across
    place = distance * turned - start
    return distance if 0.0 <= place <= length else -1.0


@inline
def plane_exit(ux, uy, uz, corners, growth):
    """Distance at which a ray leaves the triangle, shifted along its normal by ``growth`` both ways; -1 beside it."""
    a, b, c = corners[0], corners[1], corners[2]
    px, py, pz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    qx, qy, qz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    area = sqrt(nx * nx + ny * ny + nz * nz)
    if area < _TINY:
        return -1.0
    nx, ny, nz = nx / area, ny / area, nz / area
    slope, height = ux * nx + uy * ny + uz * nz, a[0] * nx + a[1] * ny + a[2] * nz
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
    """True where a ray passes beside a ``ball`` (centre, radius), or leaves it before the distance ``best``."""
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
