"""Tracing: rays through both surfaces and out of the lens, packet by packet; see ``kernels.first_hit``.

``scene`` is ``(Fresnel losses?, index in the cavity, index outside, table origin, 1/table step)``; ``indices`` has the
body's refractive index for each ray, or one for all; ``absorptions`` its absorption (1/mm) likewise, or nothing where
the body is clear. ``inner_coating`` and ``outer_coating``: table of the reflectance of a coated face, or None: numba
compiles the kernels for each, without a branch. ``rows`` has the place of each ray among their rows, or one for all.
``placed`` and ``rough`` likewise: where the faces stand and how rough they are, or None.
The path lengths that were found are kept, so that the adjoint need not search again. ``axial`` is None but
for a cover glass, whose transmittance depends on the polarisation of what comes to it.

``placed`` is ``(frames, factor in, factor out)``. ``frames`` (3, 3, 4): a rotation and, in its last column, a shift
(mm), each from one frame into the next: from that of the source into the inner face's own, from there into the outer
face's, and from there back. ``factor in`` is that of lengths on the way into the inner face's frame, ``factor out`` on
the way back: those of a lens that has shrunk, and of a source of another size. ``rough`` is ``(noise, inner slope,
outer slope)``: ``noise`` (n, 6) has three independent standard normal numbers for each ray at either face, and the
slopes are rms along any line on the face.
"""

from math import exp, sqrt

from lensforge.kernels.bicubic import jet
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.fate import Fate
from lensforge.kernels.first_hit import (
    AXIAL,
    BEHIND,
    BELOW,
    COSINE,
    DX,
    DY,
    DZ,
    EXCESS,
    FOUND,
    LENGTH,
    MX,
    MY,
    MZ,
    PX,
    PY,
    PZ,
    RATIO,
    RAY,
    RHO_X,
    RHO_Y,
    SIZE,
    STATUS,
    T_P,
    T_S,
    THROUGH,
    first_hits,
    in_whole_vectors,
    tile_of,
)
from lensforge.kernels.fresnel import axial_share, outward_normal, polarised_share, refract, through_face, unit


@inline
def turn(frame, x, y, z):
    """The direction in the next frame."""
    return (
        frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z,
        frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z,
        frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z,
    )


@inline
def place(frame, factor, x, y, z):
    """The point in the next frame."""
    x, y, z = turn(frame, x, y, z)
    return factor * x + frame[0, 3], factor * y + frame[1, 3], factor * z + frame[2, 3]


@inline
def turn_back(frame, x, y, z):
    """The direction, or a sensitivity, in the frame before."""
    return (
        frame[0, 0] * x + frame[1, 0] * y + frame[2, 0] * z,
        frame[0, 1] * x + frame[1, 1] * y + frame[2, 1] * z,
        frame[0, 2] * x + frame[1, 2] * y + frame[2, 2] * z,
    )


@inline
def z_axis(placed):
    """The axis z in the outer face's frame."""
    if placed is None:
        return 0.0, 0.0, 1.0
    return turn_back(placed[0][2], 0.0, 0.0, 1.0)


@inline
def tilted(nx, ny, nz, a, b, c, slope):
    """Normal n of a rough face, not normalised: tilted by ``slope`` times the noise (a, b, c).

    The noise along n changes its length alone, a tilt by no more than the slope squared.
    """
    scale = slope * sqrt(nx * nx + ny * ny + nz * nz)
    return nx + scale * a, ny + scale * b, nz + scale * c


@inline
def tilted_adjoint(nx, ny, nz, noise, slope, hx, hy, hz):
    """Sensitivity to n from that to the tilted normal (h)."""
    along = slope * (noise[0] * hx + noise[1] * hy + noise[2] * hz) / sqrt(nx * nx + ny * ny + nz * nz)
    return hx + along * nx, hy + along * ny, hz + along * nz


@inline
def rough_normal(nx, ny, nz, rough, k, face):
    """Normal of a rough face (0: inner, 1: outer) where it meets ray k; n itself where ``rough`` is None."""
    if rough is None:
        return nx, ny, nz
    noise = rough[0][k, 3 * face : 3 * face + 3]
    return tilted(nx, ny, nz, noise[0], noise[1], noise[2], rough[1] if face == 0 else rough[2])


@inline
def rough_normal_adjoint(nx, ny, nz, rough, k, face, hx, hy, hz):
    """Adjoint of :func:`rough_normal`: sensitivity to n from that to the normal (h)."""
    if rough is None:
        return hx, hy, hz
    return tilted_adjoint(
        nx, ny, nz, rough[0][k, 3 * face : 3 * face + 3], rough[1] if face == 0 else rough[2], hx, hy, hz
    )


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
    near = r >= bounds.least and r >= tile_of(X, Y, origin, bounds)[0]
    if near and r >= jet(table, origin, inverse_step, X, Y)[0]:
        return Fate.OUTSIDE_CAVITY, start
    return Fate.LEFT_LENS, start


@inline
def put(rays, lane, number, px, py, pz, dx, dy, dz, ratio):
    """Put a ray into a packet; ``ratio``: of the indices before and behind the face to which it goes."""
    rays[RAY + lane], rays[RATIO + lane] = float(number), ratio
    rays[PX + lane], rays[PY + lane], rays[PZ + lane] = px, py, pz
    rays[DX + lane], rays[DY + lane], rays[DZ + lane] = dx, dy, dz


@inline
def refract_packet(rays, count, fresnel, coating, rows, rough, face, axis):
    """Move all rays of a packet to the face that they have found, and refract them there; ``face``: 0 or 1.

    Those that have found none only move. Fills the cosine before, the squared one behind, and the transmittance; at the
    inner face what the outer one needs to know of the polarisation, at the outer one the share along ``axis``.
    """
    for k in range(count):
        t, dx, dy, dz = rays[LENGTH + k], rays[DX + k], rays[DY + k], rays[DZ + k]
        px, py, pz = rays[PX + k] + t * dx, rays[PY + k] + t * dy, rays[PZ + k] + t * dz
        rays[PX + k], rays[PY + k], rays[PZ + k] = px, py, pz
        nx, ny, nz = outward_normal(px, py, pz, rays[RHO_X + k], rays[RHO_Y + k])
        nx, ny, nz = rough_normal(nx, ny, nz, rough, int(rays[RAY + k]), face)
        nx, ny, nz = unit(nx, ny, nz)
        ratio = rays[RATIO + k]
        ax, ay, az, c, q_squared = refract(dx, dy, dz, nx, ny, nz, ratio)
        met = rays[STATUS + k] == FOUND and pz >= 0.0
        rays[DX + k], rays[DY + k], rays[DZ + k] = ax if met else dx, ay if met else dy, az if met else dz
        rays[COSINE + k], rays[BEHIND + k] = c, q_squared
        if fresnel:
            q = sqrt(q_squared)
            found, _ = through_face(c, q, ratio, coating, rows, int(rays[RAY + k]))
            if face == 0:
                mean = 0.5 * (found[0] + found[1])
                rays[THROUGH + k], rays[T_S + k], rays[T_P + k] = mean, found[0] / mean, found[1] / mean
                rays[EXCESS + k] = found[2] / (mean * ratio * ratio)
                rays[MX + k], rays[MY + k], rays[MZ + k] = nx, ny, nz
            else:
                first = rays[T_S + k], rays[T_P + k], rays[EXCESS + k]
                mx, my, mz = rays[MX + k], rays[MY + k], rays[MZ + k]
                y = mx * nx + my * ny + mz * nz - (mx * dx + my * dy + mz * dz) * c
                rays[THROUGH + k] = polarised_share(first, found, y)[0]
                if axis is not None:
                    rays[AXIAL + k] = axial_share(
                        first, found, ratio, c, q, (mx, my, mz), (nx, ny, nz), (dx, dy, dz), (ax, ay, az), axis
                    )[0]


@inline
def enter(origins, directions, indices, first, last, table, scene, bounds, placed, lengths, fates, rays):
    """Put the rays ``first`` to ``last`` that enter the cavity into a packet. Returns their number."""
    entered = 0
    for k in range(first, last):
        px, py, pz = origins[k, 0], origins[k, 1], origins[k, 2]
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        if placed is not None:
            px, py, pz = place(placed[0][0], placed[1], px, py, pz)
            dx, dy, dz = turn(placed[0][0], dx, dy, dz)
        fates[k], start = entry(px, py, pz, dx, dy, dz, table, scene[3], scene[4], bounds)
        if fates[k] == Fate.LEFT_LENS:
            lengths[k, 0] = start
            into = scene[1] / indices[min(k, len(indices) - 1)]
            put(rays, entered, k, px + start * dx, py + start * dy, max(pz, 0.0), dx, dy, dz, into)
            entered += 1
    return entered


@inline
def into_body(
    rays, count, indices, scene, table, bounds, coating, rows, placed, rough, lengths, flux, fates
):  # fmt: skip
    """Refract the rays of a packet at the inner surface. Returns the number of those on their way to the outer one."""
    fresnel, _, outside_index, origin, inverse_step = scene
    whole = in_whole_vectors(count)
    refract_packet(rays, whole, fresnel, coating, rows, rough, 0, None)
    going = 0
    for lane in range(count):
        k, start = int(rays[RAY + lane]), 0.0
        px, py, pz = rays[PX + lane], rays[PY + lane], rays[PZ + lane]
        dx, dy, dz = rays[DX + lane], rays[DY + lane], rays[DZ + lane]
        lengths[k, 0] += rays[LENGTH + lane]
        if rays[STATUS + lane] != FOUND or pz < 0.0:
            out = Fate.BACKWARD if dz <= 0.0 else Fate.BASE  # a ray that rises: at the rim, by rounding
            fates[k] = out if rays[STATUS + lane] == BELOW or pz < 0.0 else Fate.NOT_CONVERGED
            continue
        if rays[BEHIND + lane] <= 0.0 or rays[COSINE + lane] <= 0.0:
            fates[k] = Fate.TOTAL_REFLECTION
            continue
        if fresnel:
            flux[k] *= rays[THROUGH + lane]
        if placed is not None:
            px, py, pz = place(placed[0][1], 1.0, px, py, pz)
            dx, dy, dz = turn(placed[0][1], dx, dy, dz)
            if pz < 0.0:  # at the rim, below the plane in which a lowered or tilted outer face ends
                fate, start = entry(px, py, pz, dx, dy, dz, table, origin, inverse_step, bounds)
                if fate != Fate.LEFT_LENS:
                    fates[k] = Fate.BASE
                    continue
                px, py, pz = px + start * dx, py + start * dy, 0.0
        lengths[k, 1] = start
        mx, my, mz = rays[MX + lane], rays[MY + lane], rays[MZ + lane]
        if placed is not None:
            mx, my, mz = turn(placed[0][1], mx, my, mz)
        rays[MX + going], rays[MY + going], rays[MZ + going] = mx, my, mz
        rays[T_S + going], rays[T_P + going] = rays[T_S + lane], rays[T_P + lane]
        rays[EXCESS + going] = rays[EXCESS + lane]
        put(rays, going, k, px, py, pz, dx, dy, dz, indices[min(k, len(indices) - 1)] / outside_index)
        going += 1
    return going


@inline
def out_of_body(
    rays, count, absorptions, scene, coating, rows, placed, rough,
    lengths, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates,
):  # fmt: skip
    """Refract the rays of a packet at the outer surface."""
    fresnel = scene[0]
    whole = in_whole_vectors(count)
    if axial is None:  # known to the compiler
        refract_packet(rays, whole, fresnel, coating, rows, rough, 1, None)
    else:
        refract_packet(rays, whole, fresnel, coating, rows, rough, 1, z_axis(placed))
    for lane in range(count):
        k, t = int(rays[RAY + lane]), rays[LENGTH + lane]
        px, py, pz = rays[PX + lane], rays[PY + lane], rays[PZ + lane]
        dx, dy, dz = rays[DX + lane], rays[DY + lane], rays[DZ + lane]
        t += lengths[k, 1]
        lengths[k, 1] = t
        if rays[STATUS + lane] != FOUND or pz < 0.0:
            lost = Fate.SURFACES_INTERSECT if t == 0.0 else Fate.NOT_CONVERGED
            fates[k] = Fate.BASE if rays[STATUS + lane] == BELOW or pz < 0.0 else lost
            continue
        if len(absorptions) > 0:
            arrived = flux[k] * exp(-absorptions[min(k, len(absorptions) - 1)] * t)
            absorbed[k] = flux[k] - arrived
            flux[k] = arrived
        sin2_exit[k] = 1.0 - rays[BEHIND + lane]
        if rays[BEHIND + lane] <= 0.0 or rays[COSINE + lane] <= 0.0:
            fates[k] = Fate.TOTAL_REFLECTION
            continue
        if axial is not None:
            axial[k] = flux[k] * rays[AXIAL + lane]
        if fresnel:
            flux[k] *= rays[THROUGH + lane]
        if placed is not None:
            px, py, pz = place(placed[0][2], placed[2], px, py, pz)
            dx, dy, dz = turn(placed[0][2], dx, dy, dz)
        exit_points[k, 0], exit_points[k, 1], exit_points[k, 2] = px, py, pz
        exit_directions[k, 0], exit_directions[k, 1], exit_directions[k, 2] = dx, dy, dz


@kernel
def trace(
    origins, directions, emitted, indices, absorptions, inner, outer, inner_bounds, outer_bounds, scene,
    inner_coating, outer_coating, rows, placed, rough,
    lengths, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates, rays,
):  # fmt: skip
    """Trace rays; fills, per ray, path lengths to both surfaces (2), and the fields of ``ExitRays``.

    Points, directions and, where the body absorbs, ``absorbed`` come as zeros, and stay so where a ray does not leave
    the lens, or does not reach the outer surface. ``rays``: memory of a packet.
    """
    _, _, _, origin, inverse_step = scene
    for first in range(0, len(emitted), SIZE):
        last = min(first + SIZE, len(emitted))
        for k in range(first, last):
            flux[k], sin2_exit[k], lengths[k, 0], lengths[k, 1] = emitted[k], 0.0, 0.0, 0.0
        count = enter(
            origins, directions, indices, first, last, inner, scene, inner_bounds, placed, lengths, fates, rays
        )
        first_hits(rays, count, inner, origin, inverse_step, inner_bounds)
        count = into_body(
            rays, count, indices, scene, outer, outer_bounds, inner_coating, rows, placed, rough, lengths, flux, fates
        )
        first_hits(rays, count, outer, origin, inverse_step, outer_bounds)
        out_of_body(
            rays, count, absorptions, scene, outer_coating, rows, placed, rough,
            lengths, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates,
        )  # fmt: skip
