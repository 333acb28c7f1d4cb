"""Derivatives of a hit and of the normal there, by the ray and by the table of the face.

Differentiating ``|p| = rho`` at the hit gives Eq. (9) of the paper; the change of the normal with the hit needs the
Hessian of ``|p| - rho``, contracted with one vector. Both are exact for the table.
"""

from math import sqrt

from lensforge.kernels.compiled import inline
from lensforge.kernels.vectors import add_scaled, dot


@inline
def hessian_times(p, v, jet):
    """Hessian of ``|p| - rho`` times v, and the sensitivities of ``v . normal`` to the slopes of the table."""
    x, y, z = p
    vx, vy, vz = v
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
    product = (
        to_h * hx + to_a * ax + to_b * bx + to_g * gx,
        to_h * hy + to_a * ay + to_b * by + to_g * gy,
        to_h * hz + to_a * az + to_b * bz + to_g * gz,
    )
    return product, -av, -bv


@inline
def hit_adjoint(p, d, n, e, m, jet):
    """Adjoint of a hit p and its normal n: from sensitivities to p (e) and to n (m) to those of the ray's start.

    That to the direction is the path length times it. Then come the sensitivities to the table's value and slopes at
    the hit.
    """
    h, by_slope_x, by_slope_y = hessian_times(p, m, jet)
    e = e[0] + h[0], e[1] + h[1], e[2] + h[2]
    by_radius = dot(e, d) / dot(n, d)
    return add_scaled(e, -by_radius, n), (by_radius, by_slope_x, by_slope_y)
