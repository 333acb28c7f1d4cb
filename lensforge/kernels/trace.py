"""Tracing: rays from face to face and out of the body, packet by packet; see ``kernels.ray_packet``.

An event is what happens where a ray meets a face: it is refracted, or reflected. ``tables`` (f, side, side) are the
faces, ``bounds`` theirs. ``chain`` is None where every ray meets the faces in their order and is refracted at each,
once at both faces of the usual lens: then the polarisation has a closed form, and light that is reflected counts as
lost. Else it is ``(before, behind, mirrors)``: the media before and behind each face (0 cavity, 1 body, 2 outside), and
the share that a mirror on it reflects, below 0 where it has none. A ray then meets the nearest of the faces that bound
the medium in which it is, at most as many as ``lengths`` and ``met`` have columns; see ``kernels.chain``.

``scene`` is ``(Fresnel losses?, index in the cavity, index outside, table origin, 1/table step)``; ``indices`` has the
body's refractive index for each ray, or one for all; ``absorptions`` its absorption (1/mm) likewise, or nothing where
the body is clear. ``coatings``: None where no face is coated, else the tables of the reflectance of all faces, and the
length of each, 0 for a bare face. ``rows`` has the place of each ray among their rows, or one for all.
``placed`` and ``rough`` likewise: where the faces stand and how rough they are, or None.
The path lengths that were found are kept, so that the adjoint need not search again. ``axial`` is None but
for a cover glass, whose transmittance depends on the polarisation of what comes to it.

``placed`` is ``(frames, factor in, factor out)``. ``frames`` (f + 1, 3, 4): a rotation and, in its last column, a shift
(mm), each from one frame into the next: from that of the source into the first face's own, from there into the next
face's, and from the last back; in a chain all faces stand in one frame. ``factor in`` is that of lengths on the way
into the first frame, ``factor out`` on the way back: those of a lens that has shrunk, and of a source of another size.
``begun`` (n, 12): of polarised light the fields with which each ray of a chain begins (``kernels.fields``: real and
imaginary parts of both), in the frame of the faces; None for unpolarised light, as from a source. ``ended`` likewise:
filled with those of the rays that leave, which with ``emitted`` and the absorption make the flux; or None.
``rough`` is ``(noise, slopes)``: ``noise`` (n, 3 e) has three independent standard normal numbers for each ray at each
event, and the slopes (f) are rms along any line on the face.
"""

from math import exp, sqrt

from lensforge.kernels.bicubic import bounds_of, jet, tile_of
from lensforge.kernels.chain import begin_chain, pass_on
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.fate import Fate
from lensforge.kernels.first_hit import BELOW, FOUND, first_hits, start_all
from lensforge.kernels.frames import place, rough_normal, turn, z_axis
from lensforge.kernels.fresnel import (
    axial_share,
    outward_normal,
    polarised_share,
    refract,
    through_face,
    unit,
)
from lensforge.kernels.nearest_face import meet_nearest
from lensforge.kernels.ray_packet import (
    AXIAL,
    BEHIND,
    COSINE,
    DX,
    DY,
    DZ,
    EXCESS,
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
    in_whole_vectors,
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
        nx, ny, nz = rough_normal(nx, ny, nz, rough, int(rays[RAY + k]), face, face)
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
def refract_at(rays, count, fresnel, coatings, rows, rough, face, axis):
    """:func:`refract_packet` for the whole vectors of a packet, at a face that may be coated."""
    whole = in_whole_vectors(count)
    if coatings is None:  # known to the compiler
        refract_packet(rays, whole, fresnel, None, rows, rough, face, axis)
    else:
        if coatings[1][face] == 0:
            refract_packet(rays, whole, fresnel, None, rows, rough, face, axis)
        else:
            refract_packet(
                rays, whole, fresnel, coatings[0][face, ..., : coatings[1][face], :], rows, rough, face, axis
            )


@inline
def enter(
    origins, directions, indices, first, last, tables, scene, bounds, placed, chain, begun, lengths, fates, rays
):  # fmt: skip
    """Put the rays ``first`` to ``last`` that enter the cavity into a packet. Returns their number."""
    entered = 0
    for k in range(first, last):
        px, py, pz = origins[k, 0], origins[k, 1], origins[k, 2]
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        if placed is not None:
            px, py, pz = place(placed[0][0], placed[1], px, py, pz)
            dx, dy, dz = turn(placed[0][0], dx, dy, dz)
        fates[k], start = entry(px, py, pz, dx, dy, dz, tables[0], scene[3], scene[4], bounds_of(bounds, 0))
        if chain is not None:
            for face in range(1, len(tables)):
                if chain[0][face] == 0 and fates[k] == Fate.LEFT_LENS:
                    fates[k], start = entry(
                        px, py, pz, dx, dy, dz, tables[face], scene[3], scene[4], bounds_of(bounds, face)
                    )
        if fates[k] == Fate.LEFT_LENS:
            lengths[k, 0] = start
            into = scene[1] / indices[min(k, len(indices) - 1)]
            put(rays, entered, k, px + start * dx, py + start * dy, max(pz, 0.0), dx, dy, dz, into)
            if chain is not None:
                begin_chain(rays, entered, (dx, dy, dz), begun, k)
            entered += 1
    return entered


@inline
def into_body(
    rays, count, indices, scene, table, bounds, coatings, rows, placed, rough, lengths, flux, fates
):  # fmt: skip
    """Refract the rays of a packet at the inner surface. Returns the number of those on their way to the outer one."""
    fresnel, _, outside_index, origin, inverse_step = scene
    refract_at(rays, count, fresnel, coatings, rows, rough, 0, None)
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
    rays, count, absorptions, scene, coatings, rows, placed, rough,
    lengths, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates,
):  # fmt: skip
    """Refract the rays of a packet at the outer surface."""
    fresnel = scene[0]
    if axial is None:  # known to the compiler
        refract_at(rays, count, fresnel, coatings, rows, rough, 1, None)
    else:
        refract_at(rays, count, fresnel, coatings, rows, rough, 1, z_axis(placed))
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
    origins, directions, emitted, indices, absorptions, tables, bounds, scene, coatings, rows, placed, rough, chain,
    begun, lengths, met, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates, ended, rays,
):  # fmt: skip
    """Trace rays; fills, per ray, the path lengths to its events, and the fields of ``ExitRays``.

    In a chain also what it ``met``. Points, directions and, where the body absorbs, ``absorbed`` come as zeros, and
    stay so where a ray does not leave the lens, or does not reach the last surface. ``rays``: memory of a packet.
    """
    _, _, _, origin, inverse_step = scene
    for first in range(0, len(emitted), SIZE):
        last = min(first + SIZE, len(emitted))
        for k in range(first, last):
            flux[k], sin2_exit[k] = emitted[k], 0.0
            lengths[k, :] = 0.0
        count = enter(
            origins, directions, indices, first, last, tables, scene, bounds, placed, chain, begun, lengths, fates, rays
        )
        for event in range(lengths.shape[1]):
            if chain is None:  # known to the compiler
                going = start_all(rays, count)
                first_hits(rays, going, tables[event], origin, inverse_step, bounds_of(bounds, event), False, False)
                if event == 0:
                    count = into_body(
                        rays, count, indices, scene, tables[1], bounds_of(bounds, 1), coatings, rows, placed, rough,
                        lengths, flux, fates,
                    )  # fmt: skip
                else:
                    out_of_body(
                        rays, count, absorptions, scene, coatings, rows, placed, rough,
                        lengths, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates,
                    )  # fmt: skip
            else:
                meet_nearest(rays, count, tables, bounds, scene, chain)
                count = pass_on(
                    rays, count, event, emitted, indices, absorptions, scene, coatings, rows, placed, rough, chain,
                    lengths, met, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates, ended,
                )  # fmt: skip
