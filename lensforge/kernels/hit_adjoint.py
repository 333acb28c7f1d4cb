"""Derivatives of a hit and of the normal there, by the ray and by the table of the face.

Differentiating ``|p| = rho`` at the hit gives Eq. (9) of the paper; the change of the normal with the hit needs the
Hessian of ``|p| - rho``, contracted with one vector. Both are exact for the table.
"""

from math import sqrt

from lensforge.kernels.compiled import inline


@inline
def hessian_times(x, y, z, vx, vy, vz, jet):
    """Hessian of ``|p| - rho`` times v, and the sensitivities of ``v . normal`` to the slopes of the table."""
    rho_x, rho_y, xx, xy, yy = jet
    r = sqrt(x * x + y * y + z * z)
    ux, uy, uz = x / r, y / r, z / r
    shift = r + z
    X, Y = x / shift, y / shift
    gx, gy, gz = ux, uy, uz + 1.0  # gradient of shift
    ax, ay, az = (1.0 - X * gx) / shift, -X * gy / shift, -X * gz / shift  # gradient of X
    bx, by, bz = -Y * gx / shift, (1.0 - Y * gy) / shift, -Y * gz / shift  # gradient of Y
    radial = ux * vx + uy * vy + uz * vz
    hx, hy, hz = (vx - ux * radial) / r, (vy - uy * radial) / r, (vz - uz * radial) / r  # Hessian of |p| times v
    av = ax * vx + ay * vy + az * vz
    bv = bx * vx + by * vy + bz * vz
    gv = gx * vx + gy * vy + gz * vz
    # Hessian of X times v = -(av g + X h + gv a) / shift, and likewise for Y.
    to_a = -(xx * av + xy * bv) + rho_x * gv / shift
    to_b = -(xy * av + yy * bv) + rho_y * gv / shift
    to_g = (rho_x * av + rho_y * bv) / shift
    to_h = 1.0 + (rho_x * X + rho_y * Y) / shift
    return (
        to_h * hx + to_a * ax + to_b * bx + to_g * gx,
        to_h * hy + to_a * ay + to_b * by + to_g * gy,
        to_h * hz + to_a * az + to_b * bz + to_g * gz,
        -av,
        -bv,
    )


@inline
def hit_adjoint(x, y, z, dx, dy, dz, nx, ny, nz, ex, ey, ez, mx, my, mz, jet):
    """Adjoint of a hit p and its normal: from sensitivities to p (e) and to the normal (m) to those of the ray's start.

    That to the direction is the path length times it. Then come the sensitivities to the table's value and slopes at
    the hit.
    """
    hx, hy, hz, by_slope_x, by_slope_y = hessian_times(x, y, z, mx, my, mz, jet)
    ex, ey, ez = ex + hx, ey + hy, ez + hz
    by_radius = (ex * dx + ey * dy + ez * dz) / (nx * dx + ny * dy + nz * dz)
    start = ex - by_radius * nx, ey - by_radius * ny, ez - by_radius * nz
    return start, (by_radius, by_slope_x, by_slope_y)
