"""Exit rays onto receivers: the chart coordinates of each, and the adjoint to the exit ray.

``frame`` (3, 4): the receiver's unit axes x, y, and z, which points away from the lens, and its centre (mm) as columns.
A ray that does not reach the receiver's surface gets the coordinates 0, the path -1, and ``reached`` False.
``paths``: lengths (mm) of those that do, infinite to a far field.

A ray p + t d meets a surface of normal N at q: with the sensitivity g to q, tangential to the surface, those to the ray
are g - (g d) N / (N d) to p, and t times that to d.
"""

from math import atan2, inf, sqrt

from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.frames import place_back, turn, turn_back

# Least component of a direction along the normal of a plane that it reaches: below it the hit, or its square, could
# overflow.
LEAST_RISE = 1e-12
POLE = 1e-12  # of 1 + cos of the angle to the axis: a ray straight back has no place on an equal-area chart


@inline
def write(vector, row):
    """Write three numbers into ``row``."""
    row[0], row[1], row[2] = vector


@inline
def write_ray(by_hit, normal, direction, t, frame, by_point, by_direction):
    """Write the sensitivities to a ray from those to its hit on a surface of this normal; all in its frame."""
    gx, gy, gz = by_hit
    nx, ny, nz = normal
    dx, dy, dz = direction
    across = (gx * dx + gy * dy + gz * dz) / (nx * dx + ny * dy + nz * dz)
    ex, ey, ez = gx - across * nx, gy - across * ny, gz - across * nz
    write(turn(frame, (ex, ey, ez)), by_point)
    write(turn(frame, (t * ex, t * ey, t * ez)), by_direction)


@kernel
def plane(points, directions, frame, radius, hits, paths, reached):
    """Coordinates (mm) on a plane; ``radius`` has no meaning."""
    for k in range(len(points)):
        hits[k, 0] = 0.0
        hits[k, 1] = 0.0
        paths[k] = -1.0
        dx, dy, dz = turn_back(frame, directions[k])
        reached[k] = dz > LEAST_RISE
        if reached[k]:
            x, y, z = place_back(frame, points[k])
            t = -z / dz
            paths[k] = t
            hits[k, 0] = x + t * dx
            hits[k, 1] = y + t * dy


@kernel
def plane_adjoint(points, directions, frame, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to hits on a plane."""
    for k in range(len(points)):
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx == 0.0 and gy == 0.0:
            by_points[k, :] = 0.0
            by_directions[k, :] = 0.0
            continue
        dx, dy, dz = turn_back(frame, directions[k])
        t = -place_back(frame, points[k])[2] / dz
        write_ray((gx, gy, 0.0), (0.0, 0.0, 1.0), (dx, dy, dz), t, frame, by_points[k], by_directions[k])


@inline
def equal_area(x, y, z):
    """Lambert's azimuthal equal-area chart of a unit vector; the pole z = -1 is excluded."""
    scale = sqrt(2.0 / (1.0 + z))
    return scale * x, scale * y


@inline
def equal_area_adjoint(x, y, z, gx, gy):
    """Sensitivities to a unit vector from those to its place on the chart."""
    scale = sqrt(2.0 / (1.0 + z))
    return scale * gx, scale * gy, -0.5 * scale * (gx * x + gy * y) / (1.0 + z)


@kernel
def far_field(points, directions, frame, radius, hits, paths, reached):
    """Chart coordinates of directions; ``radius`` has no meaning."""
    for k in range(len(points)):
        hits[k, 0] = 0.0
        hits[k, 1] = 0.0
        paths[k] = -1.0
        x, y, z = turn_back(frame, directions[k])
        reached[k] = 1.0 + z > POLE
        if reached[k]:
            paths[k] = inf
            hits[k, 0], hits[k, 1] = equal_area(x, y, z)


@kernel
def far_field_adjoint(points, directions, frame, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to the chart coordinates of their directions."""
    for k in range(len(points)):
        by_points[k, :] = 0.0
        by_directions[k, :] = 0.0
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx != 0.0 or gy != 0.0:
            x, y, z = turn_back(frame, directions[k])
            write(turn(frame, equal_area_adjoint(x, y, z, gx, gy)), by_directions[k])


@inline
def to_sphere(x, y, z, dx, dy, dz, radius):
    """Path length to where a ray leaves a sphere about the origin; -1: it never meets it."""
    half = x * dx + y * dy + z * dz
    root = half * half - (x * x + y * y + z * z - radius * radius)
    return -1.0 if root < 0.0 else sqrt(root) - half


@kernel
def sphere(points, directions, frame, radius, hits, paths, reached):
    """Chart coordinates (mm) on a sphere of ``radius`` about the pose's centre, where rays leave it."""
    for k in range(len(points)):
        hits[k, 0] = 0.0
        hits[k, 1] = 0.0
        paths[k] = -1.0
        x, y, z = place_back(frame, points[k])
        dx, dy, dz = turn_back(frame, directions[k])
        t = to_sphere(x, y, z, dx, dy, dz, radius)
        x, y, z = (x + t * dx) / radius, (y + t * dy) / radius, (z + t * dz) / radius
        reached[k] = t > 0.0 and 1.0 + z > POLE
        if reached[k]:
            paths[k] = t
            x, y = equal_area(x, y, z)
            hits[k, 0] = radius * x
            hits[k, 1] = radius * y


@kernel
def sphere_adjoint(points, directions, frame, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to the chart coordinates on a sphere."""
    for k in range(len(points)):
        by_points[k, :] = 0.0
        by_directions[k, :] = 0.0
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx != 0.0 or gy != 0.0:
            x, y, z = place_back(frame, points[k])
            dx, dy, dz = turn_back(frame, directions[k])
            t = to_sphere(x, y, z, dx, dy, dz, radius)
            x, y, z = (x + t * dx) / radius, (y + t * dy) / radius, (z + t * dz) / radius
            gx, gy, gz = equal_area_adjoint(x, y, z, gx, gy)
            write_ray((gx, gy, gz), (x, y, z), (dx, dy, dz), t, frame, by_points[k], by_directions[k])


@inline
def to_cylinder(x, z, dx, dz, radius):
    """Path length to where a ray leaves a cylinder about the y axis; -1: it never meets it."""
    square = dx * dx + dz * dz
    half = x * dx + z * dz
    root = half * half - square * (x * x + z * z - radius * radius)
    return -1.0 if root < 0.0 or square < LEAST_RISE * LEAST_RISE else (sqrt(root) - half) / square


@kernel
def cylinder(points, directions, frame, radius, hits, paths, reached):
    """Arc length from the pose's z axis, and height along its y axis (mm), where rays leave a cylinder about it."""
    for k in range(len(points)):
        hits[k, 0] = 0.0
        hits[k, 1] = 0.0
        paths[k] = -1.0
        x, y, z = place_back(frame, points[k])
        dx, dy, dz = turn_back(frame, directions[k])
        t = to_cylinder(x, z, dx, dz, radius)
        reached[k] = t > 0.0
        if reached[k]:
            paths[k] = t
            hits[k, 0] = radius * atan2(x + t * dx, z + t * dz)
            hits[k, 1] = y + t * dy


@kernel
def cylinder_adjoint(points, directions, frame, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to arc length and height on a cylinder."""
    for k in range(len(points)):
        by_points[k, :] = 0.0
        by_directions[k, :] = 0.0
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx != 0.0 or gy != 0.0:
            x, _, z = place_back(frame, points[k])
            dx, dy, dz = turn_back(frame, directions[k])
            t = to_cylinder(x, z, dx, dz, radius)
            nx, nz = (x + t * dx) / radius, (z + t * dz) / radius
            write_ray((gx * nz, gy, -gx * nx), (nx, 0.0, nz), (dx, dy, dz), t, frame, by_points[k], by_directions[k])
