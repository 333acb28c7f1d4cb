"""Chains of events: rays that meet the nearest of several faces, are refracted or reflected there, and go on.

Arguments as in ``kernels.trace``. A ray in a medium meets the faces that it bounds from inside, and from outside those
that it surrounds; a mirror reflects its share and absorbs the rest, a flange ends the ray, any other face reflects what
total reflection leaves no other way. What a face reflects beside the light that passes is not followed; what the last
event left is the flux of the ray, whatever its fate. ``met`` keeps the face of each event, times four; 2 more where
the ray was reflected, 1 more where it came from behind the face; below 0 there was none.
"""

from math import exp, sqrt

from lensforge.kernels.compiled import inline
from lensforge.kernels.fate import Fate
from lensforge.kernels.fields import field_behind, passing, reflect, reflecting, squared_lengths, unpolarised
from lensforge.kernels.first_hit import FOUND, LOST
from lensforge.kernels.frames import place, rough_normal, turn, z_axis
from lensforge.kernels.fresnel import dot, mixed, outward_normal, refract, scaled, through, unit
from lensforge.kernels.nearest_face import (
    BODY,
    CAVITY,
    CLEAR,
    FACE,
    FIELDS,
    LAST,
    LEAVING,
    MEDIUM,
    NEXT,
    NEXT_STATUS,
    NEXT_X,
    NEXT_Y,
    OUTSIDE,
)
from lensforge.kernels.ray_packet import DX, PX, PY, PZ, RAY, SIZE, three, write

REFLECTED, FROM_BEHIND = 2, 1


@inline
def begin_chain(rays, lane, d, begun, k):
    """Ray k, in this lane of the packet, as it enters the cavity."""
    rays[MEDIUM + lane], rays[LAST + lane], rays[CLEAR + lane] = CAVITY, -1.0, 1.0
    if begun is not None:
        for part in range(12):
            rays[FIELDS + part * SIZE + lane] = begun[k, part]
    else:
        one, other = unpolarised(d)
        write(rays, FIELDS + lane, one)
        write(rays, FIELDS + 3 * SIZE + lane, scaled(0.0, one))
        write(rays, FIELDS + 6 * SIZE + lane, other)
        write(rays, FIELDS + 9 * SIZE + lane, scaled(0.0, one))


@inline
def index_in(medium, k, scene, indices):
    """Refractive index of a medium for ray k."""
    if medium == CAVITY:
        return scene[1]
    return scene[2] if medium == OUTSIDE else indices[min(k, len(indices) - 1)]


@inline
def is_side_way(face, chain):
    """True for a face by which no light is to leave: all but the last one, the exit."""
    return face + 1 < len(chain[0])


@inline
def exit_sine(face, behind, q_squared, chain):
    """Squared exit sine s, 0 within the lens; 2 - s at a face that is to reflect: the farther from that, the larger."""
    if behind != OUTSIDE:
        return 0.0
    return 1.0 + q_squared if is_side_way(face, chain) else 1.0 - q_squared


@inline
def amplitudes(c, q_squared, ratio, mirror, fresnel, coatings, rows, face, k):
    """Amplitude a and k of light behind a face, and derivatives by c (``kernels.fields``); whether it is reflected."""
    if mirror >= 0.0:
        return (sqrt(mirror), 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), True
    if q_squared <= 0.0:
        a, more, by_a, by_more = reflecting(c, ratio)
        return a, more, by_a, by_more, True
    if coatings is None:
        passed, slopes = through(c, sqrt(q_squared), ratio, fresnel, None, rows, k)
    else:
        if coatings[1][face] == 0:
            passed, slopes = through(c, sqrt(q_squared), ratio, fresnel, None, rows, k)
        else:
            passed, slopes = through(
                c, sqrt(q_squared), ratio, fresnel, coatings[0][face, ..., : coatings[1][face], :], rows, k
            )
    a, more, by_a, by_more = passing(passed, slopes)
    return a, more, by_a, by_more, False


@inline
def lost_fate(status, medium, dz):
    """Fate of a ray that meets no face at z >= 0."""
    if status == LOST:
        return Fate.NOT_CONVERGED
    return Fate.BACKWARD if medium == CAVITY and dz <= 0.0 else Fate.BASE


@inline
def turn_fields(rays, lane, a, more, n, c, d, b, mirrored):
    """Take both fields of a ray through a face. Returns half of the sum of their squared lengths."""
    u = mixed(1.0, n, -c, d, 0.0, n)
    for field in range(2):
        place_of = FIELDS + 6 * field * SIZE + lane
        real, imaginary = field_behind(
            three(rays, place_of), three(rays, place_of + 3 * SIZE), a, more, n, u, d, b, mirrored
        )
        write(rays, place_of, real)
        write(rays, place_of + 3 * SIZE, imaginary)
    return 0.5 * squared_lengths(
        three(rays, FIELDS + lane), three(rays, FIELDS + 3 * SIZE + lane),
        three(rays, FIELDS + 6 * SIZE + lane), three(rays, FIELDS + 9 * SIZE + lane),
    )  # fmt: skip


@inline
def keep_fields(rays, lane, k, placed, ended):
    """Keep the fields with which ray k leaves, in the frame of the receivers."""
    for part in range(4):
        field = three(rays, FIELDS + 3 * part * SIZE + lane)
        if placed is not None:
            field = turn(placed[0][len(placed[0]) - 1], field[0], field[1], field[2])
        ended[k, 3 * part], ended[k, 3 * part + 1], ended[k, 3 * part + 2] = field


@inline
def along_axis(rays, lane, axis):
    """Share of the light whose field is along a unit vector."""
    squared = 0.0
    for part in range(4):
        onto = dot(axis, three(rays, FIELDS + 3 * part * SIZE + lane))
        squared += onto * onto
    return 0.5 * squared


@inline
def pass_on(
    rays, count, event, emitted, indices, absorptions, scene, coatings, rows, placed, rough, chain,
    lengths, met, exit_points, exit_directions, flux, absorbed, axial, sin2_exit, fates, ended,
):  # fmt: skip
    """Refract or reflect the rays of a packet at the faces that they meet. Returns the number of those that go on."""
    fresnel, going, last = scene[0], 0, event + 1 == lengths.shape[1]
    for lane in range(count):
        k, t, face, medium = int(rays[RAY + lane]), rays[NEXT + lane], int(rays[FACE + lane]), rays[MEDIUM + lane]
        d = three(rays, DX + lane)
        status = rays[NEXT_STATUS + lane]
        px, py, pz = rays[PX + lane] + t * d[0], rays[PY + lane] + t * d[1], rays[PZ + lane] + t * d[2]
        met[k, event] = -1
        if status != FOUND or pz < 0.0:
            fates[k] = lost_fate(status, medium, d[2])
            continue
        lengths[k, event] += t
        if chain[2][face] == 0.0:
            met[k, event], fates[k], sin2_exit[k] = 4 * face + REFLECTED, Fate.FLANGE, 0.0
            continue
        if medium == BODY and len(absorptions) > 0:
            left = exp(-absorptions[min(k, len(absorptions) - 1)] * t)
            absorbed[k] += flux[k] * (1.0 - left)
            flux[k], rays[CLEAR + lane] = flux[k] * left, rays[CLEAR + lane] * left
        from_behind = medium != chain[0][face]
        behind = chain[0][face] if from_behind else chain[1][face]
        n = outward_normal(px, py, pz, rays[NEXT_X + lane], rays[NEXT_Y + lane])
        n = unit(*rough_normal(n[0], n[1], n[2], rough, k, event, face))
        n = scaled(-1.0, n) if from_behind else n
        ratio = index_in(medium, k, scene, indices) / index_in(behind, k, scene, indices)
        bx, by, bz, c, q_squared = refract(d[0], d[1], d[2], n[0], n[1], n[2], ratio)
        mirror = chain[2][face]
        sin2_exit[k] = exit_sine(face, behind, q_squared, chain) if mirror < 0.0 else 0.0
        if c <= 0.0:  # tangent, to the last bit
            fates[k] = Fate.TOTAL_REFLECTION
            continue
        a, more, _, _, mirrored = amplitudes(c, q_squared, ratio, mirror, fresnel, coatings, rows, face, k)
        b = reflect(d, n, c) if mirrored else (bx, by, bz)
        met[k, event] = 4 * face + (REFLECTED if mirrored else 0) + (FROM_BEHIND if from_behind else 0)
        arrived = flux[k]
        flux[k] = emitted[k] * rays[CLEAR + lane] * turn_fields(rays, lane, a, more, n, c, d, b, mirrored)
        if mirror > 0.0:
            absorbed[k] += arrived * (1.0 - mirror)
        if not mirrored and behind == OUTSIDE:
            if axial is not None:
                axial[k] = emitted[k] * rays[CLEAR + lane] * along_axis(rays, lane, z_axis(placed))
            if ended is not None:
                keep_fields(rays, lane, k, placed, ended)
            p = (px, py, pz)
            if placed is not None:
                frame = placed[0][len(placed[0]) - 1]
                p, b = place(frame, placed[2], px, py, pz), turn(frame, b[0], b[1], b[2])
            exit_points[k, 0], exit_points[k, 1], exit_points[k, 2] = p
            exit_directions[k, 0], exit_directions[k, 1], exit_directions[k, 2] = b
            continue
        if last:
            fates[k] = Fate.TOTAL_REFLECTION if mirrored and mirror < 0.0 else Fate.MORE_EVENTS
            continue
        go_on(rays, lane, going, k, (px, py, pz), b, medium if mirrored else behind, face)
        raw = outward_normal(px, py, pz, rays[NEXT_X + lane], rays[NEXT_Y + lane])
        rays[LEAVING + going] = dot(raw, b) / sqrt(px * px + py * py + pz * pz)
        going += 1
    return going


@inline
def go_on(rays, lane, going, k, p, b, medium, face):
    """Move a ray of the packet from a lane to that of its next event."""
    rays[RAY + going], rays[CLEAR + going] = float(k), rays[CLEAR + lane]
    rays[MEDIUM + going], rays[LAST + going] = medium, float(face)
    write(rays, PX + going, p)
    write(rays, DX + going, b)
    for field in range(12):
        rays[FIELDS + field * SIZE + going] = rays[FIELDS + field * SIZE + lane]
