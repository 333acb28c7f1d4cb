"""Adjoint of ``trace``: a packet of rays again, forward without a search, and backward. See ``kernels.ray_packet``.

Here two refractions, at both faces of the usual lens, in vectors; ``kernels.chain_adjoint`` has any chain of events.
"""

from math import exp, sqrt

import numpy as np
from jaxtyping import Float

from lensforge.kernels.bicubic import scatter
from lensforge.kernels.chain_adjoint import chain_adjoint
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.fate import Fate
from lensforge.kernels.frames import place, rough_normal, rough_normal_adjoint, turn, turn_back, z_axis
from lensforge.kernels.fresnel import (
    dot,
    outward_normal,
    refract,
    refract_adjoint,
    scaled,
    through,
    through_both,
    unit,
)
from lensforge.kernels.hit_adjoint import hit_adjoint
from lensforge.kernels.precision import DOUBLE_PRECISION, Precision
from lensforge.kernels.ray_packet import (
    COEFFICIENTS,
    SIZE,
    fetch_table,
    fields,
    in_whole_vectors,
    jet_at,
    mark_hit,
    three,
    write,
)

# A ray's number; its point and direction in the inner face's frame, and its path lengths; sensitivities to the exit
# point, the direction, the flux, that along z and the squared sine; whether it left the lens; flux, index ratios and
# absorption.
(
    RAY, PX, PY, PZ, AX, AY, AZ, T1, T2, EX, EY, EZ, FX, FY, FZ, BY_FLUX, BY_AXIAL, BY_SIN2, LEFT,
    EMITTED, INTO, OUT_OF, ABSORPTION,
) = fields(COEFFICIENTS, 23)  # fmt: skip
# At the inner face: the table's five derivatives, the cosine before it, its transmittances with their excess, slopes of
# these; the unit normal in the outer face's frame, and the sensitivities to the cosine and to it.
JET, _, _, _, _, COSINE, FIRST, _, _, SLOPES, _, _, NORMAL, _, _, BY_COSINE, BY_NORMAL, _, _ = fields(
    COEFFICIENTS + 23, 19
)
# In the outer face's frame: the hit there, and the direction before it; whether the ray has a derivative at all.
SX, SY, SZ, VX, VY, VZ, SMOOTH = fields(COEFFICIENTS + 42, 7)
# The table's cells at both hits, the sensitivities to its value and slopes there.
INNER_CELL, OUTER_CELL = fields(COEFFICIENTS + 49, 8)[::4]
BY_INNER, BY_OUTER = fields(COEFFICIENTS + 57, 6)[::3]
ADJOINT_NUMBERS = (COEFFICIENTS + 63) * SIZE


def empty_adjoint(precision: Precision = DOUBLE_PRECISION) -> Float[np.ndarray, " k"]:
    """Memory of a packet for the adjoint, for one thread."""
    return np.zeros(ADJOINT_NUMBERS, precision.kind)


@inline
def load(
    origins, directions, emitted, indices, absorptions, scene, placed, lengths, fates,
    by_points, by_directions, by_flux, by_axial, by_sin2, first, last, rays,
):  # fmt: skip
    """Put those of the rays ``first`` to ``last`` into a packet that matter to anything. Returns their number."""
    _, cavity_index, outside_index, _, _ = scene
    count = 0
    for k in range(first, last):
        left = fates[k] == Fate.LEFT_LENS
        if not left and not (fates[k] == Fate.TOTAL_REFLECTION and lengths[k, 1] > 0.0):
            continue
        matters = by_sin2[k] != 0.0 or (left and by_flux[k] != 0.0)
        for axis in range(3):
            ex, fx = (by_points[k, axis], by_directions[k, axis]) if left else (0.0, 0.0)
            rays[EX + axis * SIZE + count], rays[FX + axis * SIZE + count] = ex, fx
            matters = matters or ex != 0.0 or fx != 0.0
        if not matters:
            continue
        px, py, pz = origins[k, 0], origins[k, 1], origins[k, 2]
        ax, ay, az = directions[k, 0], directions[k, 1], directions[k, 2]
        if placed is not None:
            px, py, pz = place(placed[0][0], placed[1], px, py, pz)
            ax, ay, az = turn(placed[0][0], ax, ay, az)
        index = indices[min(k, len(indices) - 1)]
        rays[RAY + count], rays[LEFT + count], rays[EMITTED + count] = float(k), 1.0 if left else 0.0, emitted[k]
        rays[PX + count], rays[PY + count], rays[PZ + count] = px, py, pz
        rays[AX + count], rays[AY + count], rays[AZ + count] = ax, ay, az
        rays[T1 + count], rays[T2 + count] = lengths[k, 0], lengths[k, 1]
        rays[BY_FLUX + count], rays[BY_SIN2 + count] = by_flux[k] if left else 0.0, by_sin2[k]
        if by_axial is not None:
            rays[BY_AXIAL + count] = by_axial[k] if left else 0.0
        rays[INTO + count], rays[OUT_OF + count] = cavity_index / index, index / outside_index
        if len(absorptions) > 0:
            rays[ABSORPTION + count] = absorptions[min(k, len(absorptions) - 1)]
        count += 1
    return count


@inline
def to_inner(rays, count, side, scene):
    """Move the points of all rays to the inner face."""
    _, _, _, origin, inverse_step = scene
    for k in range(count):
        t = rays[T1 + k]
        x, y, z = rays[PX + k] + t * rays[AX + k], rays[PY + k] + t * rays[AY + k], rays[PZ + k] + t * rays[AZ + k]
        rays[PX + k], rays[PY + k], rays[PZ + k] = x, y, z
        mark_hit(rays, k, x, y, z, INNER_CELL, side, origin, inverse_step)


@inline
def jet_in(rays, k, cell, inverse_step):
    """The table's derivatives in the cell of a ray, whose coefficients have been fetched."""
    return jet_at(rays, k, rays[cell + 2 * SIZE + k], rays[cell + 3 * SIZE + k], inverse_step)


@inline
def to_outer(rays, count, side, scene, coating, rows, placed, rough):
    """Refract all rays at the inner face, and follow them to the outer one."""
    fresnel, _, _, origin, inverse_step = scene
    for k in range(count):
        number, ratio = int(rays[RAY + k]), rays[INTO + k]
        jet = jet_in(rays, k, INNER_CELL, inverse_step)
        write(rays, JET + k, jet[:3])
        write(rays, JET + 2 * SIZE + k, jet[2:])
        px, py, pz = rays[PX + k], rays[PY + k], rays[PZ + k]
        nx, ny, nz = outward_normal(px, py, pz, jet[0], jet[1])
        nx, ny, nz = rough_normal(nx, ny, nz, rough, number, 0, 0)
        nx, ny, nz = unit(nx, ny, nz)
        vx, vy, vz, c, q_squared = refract(rays[AX + k], rays[AY + k], rays[AZ + k], nx, ny, nz, ratio)
        (t_s, t_p, excess), slopes = through(c, sqrt(q_squared), ratio, fresnel, coating, rows, number)
        per_behind = 1.0 / (ratio * ratio)
        rays[COSINE + k] = c
        write(rays, FIRST + k, (t_s, t_p, excess * per_behind))
        write(rays, SLOPES + k, (slopes[0], slopes[1], slopes[2] * per_behind))
        if placed is not None:
            px, py, pz = place(placed[0][1], 1.0, px, py, pz)
            vx, vy, vz = turn(placed[0][1], vx, vy, vz)
            nx, ny, nz = turn(placed[0][1], nx, ny, nz)
        write(rays, NORMAL + k, (nx, ny, nz))
        t = rays[T2 + k]
        px, py, pz = px + t * vx, py + t * vy, pz + t * vz
        write(rays, SX + k, (px, py, pz))
        write(rays, VX + k, (vx, vy, vz))
        mark_hit(rays, k, px, py, pz, OUTER_CELL, side, origin, inverse_step)


@inline
def back_through_outer(rays, count, scene, coating, rows, absorbing, placed, rough, axis):
    """Sensitivities at the outer face, and to the ray behind the inner one, in the frame of that."""
    fresnel, inverse_step = scene[0], scene[4]
    for k in range(count):
        number, left, ratio, t = int(rays[RAY + k]), rays[LEFT + k] == 1.0, rays[OUT_OF + k], rays[T2 + k]
        x, y, z = three(rays, SX + k)
        vx, vy, vz = three(rays, VX + k)
        jet = jet_in(rays, k, OUTER_CELL, inverse_step)
        mx, my, mz = outward_normal(x, y, z, jet[0], jet[1])
        ux, uy, uz = rough_normal(mx, my, mz, rough, number, 1, 1)
        wx, wy, wz = unit(ux, uy, uz)
        cx, cy, cz, c, q_squared = refract(vx, vy, vz, wx, wy, wz, ratio)
        q = sqrt(q_squared if left else 1.0)  # reflected totally, it has no flux behind the face
        second, slopes = through(c, q, ratio, fresnel, coating, rows, number)
        value, by_first, by_c, by_m, by_n, by_d, by_b = through_both(
            three(rays, FIRST + k), second, slopes, ratio, c, q,
            three(rays, NORMAL + k), (wx, wy, wz), (vx, vy, vz), (cx, cy, cz), axis,
            rays[BY_FLUX + k], rays[BY_AXIAL + k],
        )  # fmt: skip
        # tangent, or at the critical angle, to the last bit: there is no derivative
        smooth = rays[COSINE + k] > 0.0 and c > 0.0 and (q_squared > 0.0 or not left)
        rays[SMOOTH + k] = 1.0 if smooth else 0.0
        arrived, by_t = rays[EMITTED + k] if left else 0.0, 0.0  # flux but for both faces; by the path length
        if absorbing:
            arrived *= exp(-rays[ABSORPTION + k] * t)
            by_t = -rays[ABSORPTION + k] * arrived * value
        rays[BY_COSINE + k] = arrived * dot(by_first, three(rays, SLOPES + k))
        by_cosine = arrived * by_c - 2.0 * ratio * ratio * c * rays[BY_SIN2 + k]
        ex, ey, ez = three(rays, EX + k)
        fx, fy, fz = three(rays, FX + k)
        if placed is not None:
            ex, ey, ez = turn_back(placed[0][2], placed[2] * ex, placed[2] * ey, placed[2] * ez)
            fx, fy, fz = turn_back(placed[0][2], fx, fy, fz)
        # a ray is a line: no receiver sees where on it its point lies, to the last bit of this direction
        along = ex * cx + ey * cy + ez * cz
        ex, ey, ez = ex - along * cx, ey - along * cy, ez - along * cz
        fx, fy, fz = fx + arrived * by_b[0], fy + arrived * by_b[1], fz + arrived * by_b[2]
        fx, fy, fz, hx, hy, hz = refract_adjoint(
            vx, vy, vz, ux, uy, uz, ratio, fx, fy, fz, by_cosine, *scaled(arrived, by_n)
        )
        fx, fy, fz = fx + arrived * by_d[0], fy + arrived * by_d[1], fz + arrived * by_d[2]
        gx, gy, gz = scaled(arrived, by_m)
        hx, hy, hz = rough_normal_adjoint(mx, my, mz, rough, number, 1, 1, hx, hy, hz)
        ex, ey, ez = ex + by_t * vx, ey + by_t * vy, ez + by_t * vz
        (ex, ey, ez), by_table = hit_adjoint(x, y, z, vx, vy, vz, mx, my, mz, ex, ey, ez, hx, hy, hz, jet)
        write(rays, BY_OUTER + k, by_table if smooth else (0.0, 0.0, 0.0))
        fx, fy, fz = fx + t * ex, fy + t * ey, fz + t * ez
        ex, ey, ez = ex - by_t * vx, ey - by_t * vy, ez - by_t * vz  # the path begins at the inner face
        if placed is not None:
            ex, ey, ez = turn_back(placed[0][1], ex, ey, ez)
            fx, fy, fz = turn_back(placed[0][1], fx, fy, fz)
            gx, gy, gz = turn_back(placed[0][1], gx, gy, gz)
        write(rays, BY_NORMAL + k, (gx, gy, gz))
        write(rays, EX + k, (ex, ey, ez))
        write(rays, FX + k, (fx, fy, fz))


@inline
def back_through_inner(rays, count, rough):
    """Sensitivities at the inner face."""
    for k in range(count):
        number = int(rays[RAY + k])
        x, y, z = three(rays, PX + k)
        ax, ay, az = three(rays, AX + k)
        rho_x, rho_y, _ = three(rays, JET + k)
        xx, xy, yy = three(rays, JET + 2 * SIZE + k)
        jet = rho_x, rho_y, xx, xy, yy
        nx, ny, nz = outward_normal(x, y, z, jet[0], jet[1])
        gx, gy, gz = rough_normal(nx, ny, nz, rough, number, 0, 0)
        fx, fy, fz = three(rays, FX + k)
        bx, by, bz = three(rays, BY_NORMAL + k)
        _, _, _, hx, hy, hz = refract_adjoint(
            ax, ay, az, gx, gy, gz, rays[INTO + k], fx, fy, fz, rays[BY_COSINE + k], bx, by, bz
        )
        hx, hy, hz = rough_normal_adjoint(nx, ny, nz, rough, number, 0, 0, hx, hy, hz)
        ex, ey, ez = three(rays, EX + k)
        _, by_table = hit_adjoint(x, y, z, ax, ay, az, nx, ny, nz, ex, ey, ez, hx, hy, hz, jet)
        write(rays, BY_INNER + k, by_table if rays[SMOOTH + k] == 1.0 else (0.0, 0.0, 0.0))


@inline
def add(rays, count, cell, by, inverse_step, gradient):
    """Add the sensitivities of all rays to those of the coefficients that acted."""
    for k in range(count):
        i, j = int(rays[cell + k]), int(rays[cell + SIZE + k])
        scatter(
            gradient, i, j, rays[cell + 2 * SIZE + k], rays[cell + 3 * SIZE + k], inverse_step,
            rays[by + k], rays[by + SIZE + k], rays[by + 2 * SIZE + k],
        )  # fmt: skip


@inline
def forward_at_inner(rays, whole, side, scene, coatings, rows, placed, rough):
    """:func:`to_outer` at an inner face that may be coated."""
    if coatings is None:  # known to the compiler
        to_outer(rays, whole, side, scene, None, rows, placed, rough)
    else:
        if coatings[1][0] == 0:
            to_outer(rays, whole, side, scene, None, rows, placed, rough)
        else:
            to_outer(rays, whole, side, scene, coatings[0][0, ..., : coatings[1][0], :], rows, placed, rough)


@inline
def back_at_outer(rays, whole, scene, coatings, rows, absorbing, placed, rough, axis):
    """:func:`back_through_outer` at an outer face that may be coated."""
    if coatings is None:  # known to the compiler
        back_through_outer(rays, whole, scene, None, rows, absorbing, placed, rough, axis)
    else:
        if coatings[1][1] == 0:
            back_through_outer(rays, whole, scene, None, rows, absorbing, placed, rough, axis)
        else:
            back_through_outer(
                rays, whole, scene, coatings[0][1, ..., : coatings[1][1], :], rows, absorbing, placed, rough, axis
            )


@kernel
def trace_adjoint(
    origins, directions, emitted, indices, absorptions, tables, scene, coatings, rows, placed, rough, chain, begun,
    lengths, met, fates, by_points, by_directions, by_flux, by_axial, by_sin2, by_ended, by_begun, gradients, rays,
    memory, by_fields,
):  # fmt: skip
    """Add every ray's contribution to the gradients with respect to the tables' coefficients.

    Through a ray that left the lens: by its exit point, its direction, its flux, that along z and sin^2; through one
    that the last surface reflected totally: by sin^2. ``by_axial`` is None without a cover glass. Without Fresnel
    losses no face is coated. ``begun``, ``by_ended`` and ``by_begun``: of a chain, as in ``kernels.chain_adjoint``.
    ``rays``: memory of a packet; ``memory`` and ``by_fields``: of a ray in a chain.
    """
    if chain is not None:  # known to the compiler
        for k in range(len(emitted)):
            chain_adjoint(
                k, origins[k], directions[k], emitted[k], indices, absorptions, tables, scene, coatings, rows, placed,
                rough, chain, begun, lengths, met, fates[k], by_points[k], by_directions[k], by_flux[k],
                0.0 if by_axial is None else by_axial[k], by_sin2[k], by_ended, by_begun, gradients, memory, by_fields,
            )  # fmt: skip
        return
    side, inverse_step, absorbing = float(tables.shape[1]), scene[4], len(absorptions) > 0
    for first in range(0, len(emitted), SIZE):
        count = load(
            origins, directions, emitted, indices, absorptions, scene, placed, lengths, fates,
            by_points, by_directions, by_flux, by_axial, by_sin2, first, min(first + SIZE, len(emitted)), rays,
        )  # fmt: skip
        whole = in_whole_vectors(count)
        to_inner(rays, whole, side, scene)
        fetch_table(rays, count, tables[0], INNER_CELL)
        forward_at_inner(rays, whole, side, scene, coatings, rows, placed, rough)
        fetch_table(rays, count, tables[1], OUTER_CELL)
        if by_axial is None:  # known to the compiler
            back_at_outer(rays, whole, scene, coatings, rows, absorbing, placed, rough, None)
        else:
            back_at_outer(rays, whole, scene, coatings, rows, absorbing, placed, rough, z_axis(placed))
        back_through_inner(rays, whole, rough)
        add(rays, count, INNER_CELL, BY_INNER, inverse_step, gradients[0])
        add(rays, count, OUTER_CELL, BY_OUTER, inverse_step, gradients[1])
