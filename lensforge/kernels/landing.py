"""Exit rays onto receivers: the chart coordinates of each, and the adjoint to the exit ray.

``pose`` (4, 3): the receiver's centre (mm) and its unit axes x, y, and z, which points away from the lens. A ray that
does not reach the receiver's surface gets the coordinates 0, and ``reached`` False.

A ray p + t d meets a surface of normal N at q: with the sensitivity g to q, tangential to the surface, those to the ray
are g - (g d) N / (N d) to p, and t times that to d.
"""

from math import atan2, sqrt

from lensforge.kernels.compiled import inline, kernel

# Least component of a direction along the normal of a plane that it reaches: below it the hit, or its square, could
# overflow.
LEAST_RISE = 1e-12
POLE = 1e-12  # of 1 + cos of the angle to the axis: a ray straight back has no place on an equal-area chart


@inline
def along(vector, axis):
    """Scalar product of a row of three numbers with another."""
    return vector[0] * axis[0] + vector[1] * axis[1] + vector[2] * axis[2]


@inline
def local_point(point, pose):
    """Coordinates of a point in the pose."""
    px, py, pz = point[0] - pose[0, 0], point[1] - pose[0, 1], point[2] - pose[0, 2]
    return (
        px * pose[1, 0] + py * pose[1, 1] + pz * pose[1, 2],
        px * pose[2, 0] + py * pose[2, 1] + pz * pose[2, 2],
        px * pose[3, 0] + py * pose[3, 1] + pz * pose[3, 2],
    )


@inline
def local_direction(direction, pose):
    """Components of a direction along the axes of the pose."""
    return along(direction, pose[1]), along(direction, pose[2]), along(direction, pose[3])


@inline
def write_global(x, y, z, pose, row):
    """Write a vector with these components along the axes of the pose into ``row``."""
    for i in range(3):
        row[i] = x * pose[1, i] + y * pose[2, i] + z * pose[3, i]


@inline
def write_ray(by_hit, normal, direction, t, pose, by_point, by_direction):
    """Write the sensitivities to a ray from those to its hit on a surface of this normal; all in the pose."""
    gx, gy, gz = by_hit
    nx, ny, nz = normal
    dx, dy, dz = direction
    across = (gx * dx + gy * dy + gz * dz) / (nx * dx + ny * dy + nz * dz)
    ex, ey, ez = gx - across * nx, gy - across * ny, gz - across * nz
    write_global(ex, ey, ez, pose, by_point)
    write_global(t * ex, t * ey, t * ez, pose, by_direction)


@kernel
def plane(points, directions, pose, radius, hits, reached):
    """Coordinates (mm) on a plane; ``radius`` has no meaning."""
    for k in range(len(points)):
        hits[k, 0], hits[k, 1] = 0.0, 0.0
        rise = along(directions[k], pose[3])
        reached[k] = rise > LEAST_RISE
        if reached[k]:
            x, y, z = local_point(points[k], pose)
            t = -z / rise
            hits[k, 0] = x + t * along(directions[k], pose[1])
            hits[k, 1] = y + t * along(directions[k], pose[2])


@kernel
def plane_adjoint(points, directions, pose, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to hits on a plane."""
    for k in range(len(points)):
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx == 0.0 and gy == 0.0:
            by_points[k, :], by_directions[k, :] = 0.0, 0.0
            continue
        dx, dy, dz = local_direction(directions[k], pose)
        t = -local_point(points[k], pose)[2] / dz
        write_ray((gx, gy, 0.0), (0.0, 0.0, 1.0), (dx, dy, dz), t, pose, by_points[k], by_directions[k])


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
def far_field(points, directions, pose, radius, hits, reached):
    """Chart coordinates of directions; ``radius`` has no meaning."""
    for k in range(len(points)):
        hits[k, 0], hits[k, 1] = 0.0, 0.0
        x, y, z = local_direction(directions[k], pose)
        reached[k] = 1.0 + z > POLE
        if reached[k]:
            hits[k, 0], hits[k, 1] = equal_area(x, y, z)


@kernel
def far_field_adjoint(points, directions, pose, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to the chart coordinates of their directions."""
    for k in range(len(points)):
        by_points[k, :], by_directions[k, :] = 0.0, 0.0
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx != 0.0 or gy != 0.0:
            x, y, z = local_direction(directions[k], pose)
            x, y, z = equal_area_adjoint(x, y, z, gx, gy)
            write_global(x, y, z, pose, by_directions[k])


@inline
def to_sphere(x, y, z, dx, dy, dz, radius):
    """Path length to where a ray leaves a sphere about the origin; -1: it never meets it."""
    half = x * dx + y * dy + z * dz
    root = half * half - (x * x + y * y + z * z - radius * radius)
    return -1.0 if root < 0.0 else sqrt(root) - half


@kernel
def sphere(points, directions, pose, radius, hits, reached):
    """Chart coordinates (mm) on a sphere of ``radius`` about the pose's centre, where rays leave it."""
    for k in range(len(points)):
        hits[k, 0], hits[k, 1] = 0.0, 0.0
        x, y, z = local_point(points[k], pose)
        dx, dy, dz = local_direction(directions[k], pose)
        t = to_sphere(x, y, z, dx, dy, dz, radius)
        x, y, z = (x + t * dx) / radius, (y + t * dy) / radius, (z + t * dz) / radius
        reached[k] = t > 0.0 and 1.0 + z > POLE
        if reached[k]:
            x, y = equal_area(x, y, z)
            hits[k, 0], hits[k, 1] = radius * x, radius * y


@kernel
def sphere_adjoint(points, directions, pose, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to the chart coordinates on a sphere."""
    for k in range(len(points)):
        by_points[k, :], by_directions[k, :] = 0.0, 0.0
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx != 0.0 or gy != 0.0:
            x, y, z = local_point(points[k], pose)
            dx, dy, dz = local_direction(directions[k], pose)
            t = to_sphere(x, y, z, dx, dy, dz, radius)
            x, y, z = (x + t * dx) / radius, (y + t * dy) / radius, (z + t * dz) / radius
            gx, gy, gz = equal_area_adjoint(x, y, z, gx, gy)
            write_ray((gx, gy, gz), (x, y, z), (dx, dy, dz), t, pose, by_points[k], by_directions[k])


@inline
def to_cylinder(x, z, dx, dz, radius):
    """Path length to where a ray leaves a cylinder about the y axis; -1: it never meets it."""
    square = dx * dx + dz * dz
    half = x * dx + z * dz
    root = half * half - square * (x * x + z * z - radius * radius)
    return -1.0 if root < 0.0 or square < LEAST_RISE * LEAST_RISE else (sqrt(root) - half) / square


@kernel
def cylinder(points, directions, pose, radius, hits, reached):
    """Arc length from the pose's z axis, and height along its y axis (mm), where rays leave a cylinder about it."""
    for k in range(len(points)):
        hits[k, 0], hits[k, 1] = 0.0, 0.0
        x, y, z = local_point(points[k], pose)
        dx, dy, dz = local_direction(directions[k], pose)
        t = to_cylinder(x, z, dx, dz, radius)
        reached[k] = t > 0.0
        if reached[k]:
            hits[k, 0], hits[k, 1] = radius * atan2(x + t * dx, z + t * dz), y + t * dy


@kernel
def cylinder_adjoint(points, directions, pose, radius, by_hits, by_points, by_directions):
    """Fill the sensitivities to exit rays from those to arc length and height on a cylinder."""
    for k in range(len(points)):
        by_points[k, :], by_directions[k, :] = 0.0, 0.0
        gx, gy = by_hits[k, 0], by_hits[k, 1]
        if gx != 0.0 or gy != 0.0:
            x, _, z = local_point(points[k], pose)
            dx, dy, dz = local_direction(directions[k], pose)
            t = to_cylinder(x, z, dx, dz, radius)
            nx, nz = (x + t * dx) / radius, (z + t * dz) / radius
            write_ray((gx * nz, gy, -gx * nx), (nx, 0.0, nz), (dx, dy, dz), t, pose, by_points[k], by_directions[k])
