"""Adjoint of ``trace``, ray by ray, without a second search.

Differentiating ``|p| = rho`` at the hit gives Eq. (9) of the paper; the change of the normal with the hit needs the
Hessian of ``|p| - rho``, contracted with one vector. Both are exact for the table.
"""

from math import exp, sqrt

from lensforge.kernels.fates import Fate
from lensforge.kernels.jit import inline, kernel
from lensforge.kernels.placement import place, tilted, tilted_adjoint, turn, turn_back
from lensforge.kernels.refraction import (
    coated_transmittance,
    outward_normal,
    refract,
    refract_adjoint,
    transmittance,
)
from lensforge.kernels.spline import scatter, slope_and_curvature


@inline
def derivatives(x, y, z, table, origin, inverse_step):
    """First and second derivatives of the table in the direction of a point: X, Y, XX, XY, YY."""
    shift = sqrt(x * x + y * y + z * z) + z
    return slope_and_curvature(table, origin, inverse_step, x / shift, y / shift)


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
def hit_adjoint(
    x, y, z, dx, dy, dz, nx, ny, nz, ex, ey, ez, mx, my, mz, jet, gradient, origin, inverse_step
):  # fmt: skip
    """Adjoint of a hit p and its normal: from sensitivities to p (e) and to the normal (m) to those to the ray's start.

    Adds the sensitivities to the table's coefficients to ``gradient``. Returns that to the start point; that to the
    direction is the path length times it.
    """
    hx, hy, hz, by_slope_x, by_slope_y = hessian_times(x, y, z, mx, my, mz, jet)
    ex, ey, ez = ex + hx, ey + hy, ez + hz
    by_radius = (ex * dx + ey * dy + ez * dz) / (nx * dx + ny * dy + nz * dz)
    r = sqrt(x * x + y * y + z * z)
    scatter(gradient, origin, inverse_step, x / (r + z), y / (r + z), by_radius, by_slope_x, by_slope_y)
    return ex - by_radius * nx, ey - by_radius * ny, ez - by_radius * nz


@kernel
def trace_adjoint(
    origins, directions, emitted, indices, absorptions, inner, outer, scene, inner_coating, outer_coating, rows,
    placed, rough, lengths, fates,
    by_points, by_directions, by_flux, by_sin2, inner_gradient, outer_gradient,
):  # fmt: skip
    """Add every ray's contribution to the gradients with respect to the tables' coefficients.

    Through a ray that left the lens: by its exit point, its direction, its flux and sin^2; through one that the outer
    surface reflected totally: by sin^2. Without Fresnel losses both coatings are None.
    """
    fresnel, cavity_index, outside_index, table_origin, inverse_step = scene
    for k in range(len(emitted)):
        index = indices[min(k, len(indices) - 1)]
        into, out_of = cavity_index / index, index / outside_index
        left = fates[k] == Fate.LEFT_LENS
        if not left and not (fates[k] == Fate.TOTAL_REFLECTION and lengths[k, 1] > 0.0):
            continue
        ex, ey, ez, fx, fy, fz, gw, gs = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, by_sin2[k]
        if left:
            ex, ey, ez, gw = by_points[k, 0], by_points[k, 1], by_points[k, 2], by_flux[k]
            fx, fy, fz = by_directions[k, 0], by_directions[k, 1], by_directions[k, 2]
        lands = ex != 0.0 or ey != 0.0 or ez != 0.0 or fx != 0.0 or fy != 0.0 or fz != 0.0
        if not lands and gw == 0.0 and gs == 0.0:
            continue
        # the ray again, forward
        ax, ay, az = directions[k, 0], directions[k, 1], directions[k, 2]
        px, py, pz = origins[k, 0], origins[k, 1], origins[k, 2]
        if placed is not None:
            px, py, pz = place(placed[0][0], placed[1], px, py, pz)
            ax, ay, az = turn(placed[0][0], ax, ay, az)
        t1, t2 = lengths[k, 0], lengths[k, 1]
        px, py, pz = px + t1 * ax, py + t1 * ay, pz + t1 * az
        jet1 = derivatives(px, py, pz, inner, table_origin, inverse_step)
        nx, ny, nz = outward_normal(px, py, pz, jet1[0], jet1[1])
        gx, gy, gz = nx, ny, nz
        if rough is not None:
            gx, gy, gz = tilted(nx, ny, nz, rough[0][k, 0], rough[0][k, 1], rough[0][k, 2], rough[1])
        bx, by, bz, c1, q1_squared = refract(ax, ay, az, gx, gy, gz, into)
        if inner_coating is None:
            through1, slope1 = transmittance(c1, sqrt(q1_squared), into) if fresnel else (1.0, 0.0)
        else:
            row = rows[min(k, len(rows) - 1)]
            through1, slope1 = coated_transmittance(c1, sqrt(q1_squared), into, inner_coating, row)
        sx, sy, sz, vx, vy, vz = px, py, pz, bx, by, bz
        if placed is not None:
            sx, sy, sz = place(placed[0][1], 1.0, px, py, pz)
            vx, vy, vz = turn(placed[0][1], bx, by, bz)
        sx, sy, sz = sx + t2 * vx, sy + t2 * vy, sz + t2 * vz
        jet2 = derivatives(sx, sy, sz, outer, table_origin, inverse_step)
        mx, my, mz = outward_normal(sx, sy, sz, jet2[0], jet2[1])
        ux, uy, uz = mx, my, mz
        if rough is not None:
            ux, uy, uz = tilted(mx, my, mz, rough[0][k, 3], rough[0][k, 4], rough[0][k, 5], rough[2])
        cx, cy, cz, c2, q2_squared = refract(vx, vy, vz, ux, uy, uz, out_of)
        if c1 <= 0.0 or c2 <= 0.0 or (left and q2_squared <= 0.0):
            continue  # tangent, or at the critical angle, to the last bit: there is no derivative
        # and backward: behind the lens, outer surface, inner surface
        by_c2 = -2.0 * out_of * out_of * c2 * gs
        through2, slope2 = 1.0, 0.0
        if left and fresnel:
            if outer_coating is None:
                through2, slope2 = transmittance(c2, sqrt(q2_squared), out_of)
            else:
                row = rows[min(k, len(rows) - 1)]
                through2, slope2 = coated_transmittance(c2, sqrt(q2_squared), out_of, outer_coating, row)
        arrived, by_t2 = emitted[k], 0.0  # the flux but for both surfaces; its sensitivity to the path in the body
        if len(absorptions) > 0:
            absorption = absorptions[min(k, len(absorptions) - 1)]
            arrived *= exp(-absorption * t2)
            by_t2 = -absorption * gw * arrived * through1 * through2
        by_c2 += gw * arrived * through1 * slope2
        if placed is not None:
            ex, ey, ez = turn_back(placed[0][2], placed[2] * ex, placed[2] * ey, placed[2] * ez)
            fx, fy, fz = turn_back(placed[0][2], fx, fy, fz)
        # a ray is a line: no receiver sees where on it its point lies, to the last bit of this direction
        along = ex * cx + ey * cy + ez * cz
        ex, ey, ez = ex - along * cx, ey - along * cy, ez - along * cz
        by_c1 = gw * arrived * through2 * slope1
        fx, fy, fz, hx, hy, hz = refract_adjoint(vx, vy, vz, ux, uy, uz, out_of, fx, fy, fz, by_c2)
        if rough is not None:
            noise = rough[0][k, 3], rough[0][k, 4], rough[0][k, 5]
            hx, hy, hz = tilted_adjoint(mx, my, mz, noise, rough[2], hx, hy, hz)
        ex, ey, ez = ex + by_t2 * vx, ey + by_t2 * vy, ez + by_t2 * vz
        ex, ey, ez = hit_adjoint(
            sx, sy, sz, vx, vy, vz, mx, my, mz, ex, ey, ez, hx, hy, hz,
            jet2, outer_gradient, table_origin, inverse_step,
        )  # fmt: skip
        fx, fy, fz = fx + t2 * ex, fy + t2 * ey, fz + t2 * ez
        ex, ey, ez = ex - by_t2 * vx, ey - by_t2 * vy, ez - by_t2 * vz  # the path begins at the inner surface
        if placed is not None:
            ex, ey, ez = turn_back(placed[0][1], ex, ey, ez)
            fx, fy, fz = turn_back(placed[0][1], fx, fy, fz)
        _, _, _, hx, hy, hz = refract_adjoint(ax, ay, az, gx, gy, gz, into, fx, fy, fz, by_c1)
        if rough is not None:
            noise = rough[0][k, 0], rough[0][k, 1], rough[0][k, 2]
            hx, hy, hz = tilted_adjoint(nx, ny, nz, noise, rough[1], hx, hy, hz)
        hit_adjoint(
            px, py, pz, ax, ay, az, nx, ny, nz, ex, ey, ez, hx, hy, hz,
            jet1, inner_gradient, table_origin, inverse_step,
        )  # fmt: skip
