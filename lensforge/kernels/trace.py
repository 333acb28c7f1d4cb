"""Tracing: rays through both surfaces and out of the lens, one loop over rays.

``scene`` is ``(Fresnel losses?, index in the cavity, index outside, table origin, 1/table step)``; ``indices`` has the
body's refractive index for each ray, or one for all; ``absorptions`` its absorption (1/mm) likewise, or nothing where
the body is clear. ``inner_coating`` and ``outer_coating``: table of the reflectance of a coated face, or None: numba
compiles the kernels for each, without a branch. ``rows`` has the place of each ray among their rows, or one for all.
``placed`` and ``rough`` likewise: where the faces stand and how rough they are, see ``kernels.placement``, or None.
The path lengths that were found are kept, so that the adjoint need not search again.
"""

from math import exp, sqrt

from lensforge.kernels.fates import Fate
from lensforge.kernels.first_hit import BELOW, FOUND, first_hit, tile_of
from lensforge.kernels.jit import inline, kernel
from lensforge.kernels.placement import place, tilted, turn
from lensforge.kernels.refraction import coated_transmittance, outward_normal, refract, transmittance
from lensforge.kernels.spline import value_and_slope


@inline
def entry(px, py, pz, dx, dy, dz, table, origin, inverse_step, bounds):
    """Entry of a source ray into the cavity: its fate, and the path (mm) to z = 0 for one that starts below.

    The fate is ``LEFT_LENS`` for a ray that enters.
    """
    if dz <= 0.0 and not pz > 0.0:
        return Fate.BACKWARD, 0.0
    start = -pz / dz if pz < 0.0 else 0.0
    x, y, z = px + start * dx, py + start * dy, max(pz, 0.0)
    r = sqrt(x * x + y * y + z * z)
    if not r <= bounds.most:  # in this form also where x is NaN
        return Fate.OUTSIDE_CAVITY, start
    X, Y = x / (r + z), y / (r + z)
    if r >= bounds.least and r >= tile_of(X, Y, origin, bounds)[0]:
        rho, _, _ = value_and_slope(table, origin, inverse_step, X, Y)
        if r >= rho:
            return Fate.OUTSIDE_CAVITY, start
    return Fate.LEFT_LENS, start


@kernel
def trace(
    origins, directions, emitted, indices, absorptions, inner, outer, inner_bounds, outer_bounds, scene,
    inner_coating, outer_coating, rows, placed, rough,
    lengths, exit_points, exit_directions, flux, absorbed, sin2_exit, fates,
):  # fmt: skip
    """Trace rays; fills, per ray, path lengths to both surfaces (2), and the fields of ``ExitRays``.

    Points, directions and, where the body absorbs, ``absorbed`` come as zeros, and stay so where a ray does not leave
    the lens, or does not reach the outer surface.
    """
    fresnel, cavity_index, outside_index, table_origin, inverse_step = scene
    for k in range(len(emitted)):
        index = indices[min(k, len(indices) - 1)]
        into, out_of = cavity_index / index, index / outside_index
        px, py, pz = origins[k, 0], origins[k, 1], origins[k, 2]
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        if placed is not None:
            px, py, pz = place(placed[0][0], placed[1], px, py, pz)
            dx, dy, dz = turn(placed[0][0], dx, dy, dz)
        lengths[k, 0] = 0.0
        lengths[k, 1] = 0.0
        sin2_exit[k] = 0.0
        flux[k] = emitted[k]
        fate, start = entry(px, py, pz, dx, dy, dz, inner, table_origin, inverse_step, inner_bounds)
        fates[k] = fate
        if fate != Fate.LEFT_LENS:
            continue
        px, py, pz = px + start * dx, py + start * dy, max(pz, 0.0)
        # the inner surface
        t, status, rho_x, rho_y = first_hit(px, py, pz, dx, dy, dz, inner, table_origin, inverse_step, inner_bounds)
        px, py, pz = px + t * dx, py + t * dy, pz + t * dz
        lengths[k, 0] = start + t
        if status != FOUND or pz < 0.0:
            out = Fate.BACKWARD if dz <= 0.0 else Fate.BASE  # a ray that rises: at the rim, by rounding
            fates[k] = out if status == BELOW or pz < 0.0 else Fate.NOT_CONVERGED
            continue
        nx, ny, nz = outward_normal(px, py, pz, rho_x, rho_y)
        if rough is not None:
            nx, ny, nz = tilted(nx, ny, nz, rough[0][k, 0], rough[0][k, 1], rough[0][k, 2], rough[1])
        dx, dy, dz, c, q_squared = refract(dx, dy, dz, nx, ny, nz, into)
        if q_squared <= 0.0 or c <= 0.0:
            fates[k] = Fate.TOTAL_REFLECTION
            continue
        if fresnel:
            if inner_coating is None:
                flux[k] *= transmittance(c, sqrt(q_squared), into)[0]
            else:
                row = rows[min(k, len(rows) - 1)]
                flux[k] *= coated_transmittance(c, sqrt(q_squared), into, inner_coating, row)[0]
        # the outer surface
        start = 0.0
        if placed is not None:
            px, py, pz = place(placed[0][1], 1.0, px, py, pz)
            dx, dy, dz = turn(placed[0][1], dx, dy, dz)
            if pz < 0.0:  # at the rim, below the plane in which a lowered or tilted outer face ends
                fate, start = entry(px, py, pz, dx, dy, dz, outer, table_origin, inverse_step, outer_bounds)
                if fate != Fate.LEFT_LENS:
                    fates[k] = Fate.BASE
                    continue
                px, py, pz = px + start * dx, py + start * dy, 0.0
        t, status, rho_x, rho_y = first_hit(px, py, pz, dx, dy, dz, outer, table_origin, inverse_step, outer_bounds)
        px, py, pz = px + t * dx, py + t * dy, pz + t * dz
        t += start
        lengths[k, 1] = t
        if status != FOUND or pz < 0.0:
            fates[k] = (
                Fate.BASE
                if status == BELOW or pz < 0.0
                else (Fate.SURFACES_INTERSECT if t == 0.0 else Fate.NOT_CONVERGED)
            )
            continue
        if len(absorptions) > 0:
            arrived = flux[k] * exp(-absorptions[min(k, len(absorptions) - 1)] * t)
            absorbed[k] = flux[k] - arrived
            flux[k] = arrived
        nx, ny, nz = outward_normal(px, py, pz, rho_x, rho_y)
        if rough is not None:
            nx, ny, nz = tilted(nx, ny, nz, rough[0][k, 3], rough[0][k, 4], rough[0][k, 5], rough[2])
        dx, dy, dz, c, q_squared = refract(dx, dy, dz, nx, ny, nz, out_of)
        sin2_exit[k] = 1.0 - q_squared
        if q_squared <= 0.0 or c <= 0.0:
            fates[k] = Fate.TOTAL_REFLECTION
            continue
        if fresnel:
            if outer_coating is None:
                flux[k] *= transmittance(c, sqrt(q_squared), out_of)[0]
            else:
                row = rows[min(k, len(rows) - 1)]
                flux[k] *= coated_transmittance(c, sqrt(q_squared), out_of, outer_coating, row)[0]
        if placed is not None:
            px, py, pz = place(placed[0][2], placed[2], px, py, pz)
            dx, dy, dz = turn(placed[0][2], dx, dy, dz)
        exit_points[k, 0], exit_points[k, 1], exit_points[k, 2] = px, py, pz
        exit_directions[k, 0], exit_directions[k, 1], exit_directions[k, 2] = dx, dy, dz
