"""Rays of a packet at the faces that they have found: moved there, refracted, and their polarisation behind.

Of a double lens in unpolarised light the polarisation has a closed form, all in vector instructions; else each ray
carries its fields (``kernels.fields``).
"""

from math import sqrt

from lensforge.kernels.compiled import inline
from lensforge.kernels.drawn_faces import across
from lensforge.kernels.facet_normals import facet_normal, meet_any_facets, meet_facets
from lensforge.kernels.fields import FieldTurn, field_behind, passing, reflect, reflecting
from lensforge.kernels.first_hit import FOUND
from lensforge.kernels.frames import BACK, turned, z_axis
from lensforge.kernels.fresnel import (
    SecondFace,
    axial_share,
    outward_normal,
    polarised_share,
    refract,
    through,
    through_face,
)
from lensforge.kernels.nearest_face import BENT, CLEAR, FACE, FIELDS, LEAVING, MIRROR, SHARE, SIDE
from lensforge.kernels.ray_packet import (
    AXIAL,
    BEHIND,
    COSINE,
    DX,
    EXCESS,
    FACET,
    LENGTH,
    MX,
    PX,
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
    three,
    write,
)
from lensforge.kernels.traced_body import own_or_shared
from lensforge.kernels.vectors import add_scaled, dot, length_of, scaled, unit


@inline
def refract_in_order(packet, count, face, film, rays, body, axis):
    """Move all rays of a packet to their crossings with a ``face`` of a double lens, 0 or 1, and refract them there.

    Rays without a crossing only move. Fills the cosine before, the squared one behind, and the transmittance; at the
    inner face the polarisation data that the outer one needs, at the outer one the share along ``axis``.
    """
    for k in range(count):
        number = int(packet[RAY + k])
        d = three(packet, DX + k)
        ratio = packet[RATIO + k]
        p = add_scaled(three(packet, PX + k), packet[LENGTH + k], d)
        write(packet, PX + k, p)
        n = outward_normal(across(p, body.grid.half_mm), packet[RHO_X + k], packet[RHO_Y + k])
        n = unit(facet_normal(packet, FACET + k, n, d, rays.noise))
        b, c, q_squared = refract(d, n, ratio)
        met = packet[STATUS + k] == FOUND and p[2] >= 0.0
        write(packet, DX + k, (b[0] if met else d[0], b[1] if met else d[1], b[2] if met else d[2]))
        packet[COSINE + k] = c
        packet[BEHIND + k] = q_squared
        if body.fresnel:
            q = sqrt(q_squared)
            passed, _ = through_face(c, q, ratio, film, own_or_shared(rays.film_rows, number))
            if face == 0:
                mean = 0.5 * (passed[0] + passed[1])
                packet[THROUGH + k] = mean
                packet[T_S + k] = passed[0] / mean
                packet[T_P + k] = passed[1] / mean
                packet[EXCESS + k] = passed[2] / (mean * ratio * ratio)
                write(packet, MX + k, n)
            else:
                first = (packet[T_S + k], packet[T_P + k], packet[EXCESS + k])
                m = three(packet, MX + k)
                y = dot(m, n) - dot(m, d) * c
                packet[THROUGH + k] = polarised_share(first, passed, y)[0]
                if axis is not None:
                    packet[AXIAL + k] = axial_share(first, passed, m, SecondFace(ratio, c, q, n, d, b), axis)[0]
        if face == 1 and rays.shifts is not None:  # light is spread about it, once the polarisation is known
            write(packet, MX + k, n)


@inline
def refract_at(packet, count, face, films, rays, body, axis):
    """:func:`refract_in_order` for the whole vectors of a packet, at a face that may have a film."""
    whole = in_whole_vectors(count)
    meet_facets(packet, count, face, rays.noise, rays.keys, body)
    if films is None:  # known to the compiler
        refract_in_order(packet, whole, face, None, rays, body, axis)
    else:
        if films.sizes[face] == 0:
            refract_in_order(packet, whole, face, None, rays, body, axis)
        else:
            refract_in_order(packet, whole, face, films.tables[face, ..., : films.sizes[face], :], rays, body, axis)


@inline
def refract_second(packet, count, axial, rays, body):
    """:func:`refract_at` at the outer face of a double-freeform lens."""
    if axial is None:
        refract_at(packet, count, 1, body.films, rays, body, None)
    else:
        refract_at(packet, count, 1, body.films, rays, body, z_axis(body.placement))


@inline
def refract_any(packet, count, event, rays, body, met):
    """Move all rays of a packet to their crossings, and refract them there, also if some are reflected."""
    meet_any_facets(packet, count, event, met, rays.noise, rays.keys, body)
    for k in range(count):
        packet[MIRROR + k] = body.sides.mirrors[int(packet[FACE + k])]
    for k in range(in_whole_vectors(count)):
        d = three(packet, DX + k)
        p = add_scaled(three(packet, PX + k), packet[LENGTH + k], d)
        write(packet, PX + k, p)
        n = outward_normal(across(p, body.grid.half_mm), packet[RHO_X + k], packet[RHO_Y + k])
        n = scaled(packet[SIDE + k], unit(facet_normal(packet, FACET + k, n, d, rays.noise)))
        b, packet[COSINE + k], packet[BEHIND + k] = refract(d, n, packet[RATIO + k])
        write(packet, MX + k, n)
        write(packet, BENT + k, b)


@inline
def refract_all(packet, count, event, rays, body, ways, exits, sides):
    """Move all rays of a packet to their faces, and refract them there."""
    if sides is None:  # known to the compiler
        if event == 0:
            refract_at(packet, count, 0, body.films, rays, body, None)
        else:
            refract_second(packet, count, exits.axial, rays, body)
    else:
        refract_any(packet, count, event, rays, body, ways.met)
        turn_all_fields(packet, count, body.films, rays, body)


@inline
def amplitudes(c, q_squared, ratio, mirror, film, fresnel, row):
    """Amplitude a and k of light behind a face (``kernels.fields``); whether it is reflected.

    All three ways are computed, and one is chosen, as a loop of vector instructions asks.
    """
    reflected, more_reflected, _, _ = reflecting(c, ratio)
    passed, slopes = through(c, sqrt(max(q_squared, 0.0)), ratio, fresnel, film, row)
    passes, more_passes, _, _ = passing(passed, slopes)
    is_mirror = mirror >= 0.0
    total = q_squared <= 0.0
    a = reflected[0] if total else passes[0]
    k = more_reflected[0] if total else more_passes[0]
    return (
        (sqrt(max(mirror, 0.0)) if is_mirror else a, reflected[1] if total and not is_mirror else 0.0),
        (0.0 if is_mirror else k, more_reflected[1] if total and not is_mirror else 0.0),
        total or is_mirror,
    )


@inline
def turn_field(packet, first, face):
    """Take one field of a ray through a face (``FieldTurn``). Returns its squared length."""
    real, imaginary = field_behind(three(packet, first), three(packet, first + 3 * SIZE), face)
    write(packet, first, real)
    write(packet, first + 3 * SIZE, imaginary)
    return dot(real, real) + dot(imaginary, imaginary)


@inline
def turn_fields(packet, lane, film, rays, body):
    """Turn direction and fields of a ray to those behind its face, and note how fast it leaves that."""
    c = packet[COSINE + lane]
    d = three(packet, DX + lane)
    n = three(packet, MX + lane)
    row = own_or_shared(rays.film_rows, int(packet[RAY + lane]))
    a, more, mirrored = amplitudes(
        c, packet[BEHIND + lane], packet[RATIO + lane], packet[MIRROR + lane], film, body.fresnel, row
    )
    bent = three(packet, BENT + lane)
    turned_about = reflect(d, n, c)
    b = (
        turned_about[0] if mirrored else bent[0],
        turned_about[1] if mirrored else bent[1],
        turned_about[2] if mirrored else bent[2],
    )
    write(packet, BENT + lane, b)
    p = across(three(packet, PX + lane), body.grid.half_mm)
    normal = outward_normal(p, packet[RHO_X + lane], packet[RHO_Y + lane])
    packet[LEAVING + lane] = dot(normal, b) / length_of(p)
    face = FieldTurn(a, more, n, add_scaled(n, -c, d), d, b, mirrored)
    squares = turn_field(packet, FIELDS + lane, face) + turn_field(packet, FIELDS + 6 * SIZE + lane, face)
    packet[SHARE + lane] = 0.5 * squares


@inline
def turn_all_fields(packet, count, films, rays, body):
    """:func:`turn_fields` of all rays of a packet, at faces that may have films."""
    if films is None:  # known to the compiler
        for lane in range(in_whole_vectors(count)):
            turn_fields(packet, lane, None, rays, body)
    else:
        for lane in range(count):
            face = int(packet[FACE + lane])
            if films.sizes[face] == 0:
                turn_fields(packet, lane, None, rays, body)
            else:
                turn_fields(packet, lane, films.tables[face, ..., : films.sizes[face], :], rays, body)


@inline
def behind_face(packet, lane, arrived, rays, body, sides):
    """Update the direction of a ray behind its face; returns whether it is reflected, and its flux.

    ``arrived``: its flux (W) before the face.
    """
    mirrored = packet[BEHIND + lane] <= 0.0
    if sides is None:
        return mirrored, arrived * packet[THROUGH + lane] if body.fresnel and not mirrored else arrived
    write(packet, DX + lane, three(packet, BENT + lane))
    flux = rays.emitted[int(packet[RAY + lane])] * packet[CLEAR + lane] * packet[SHARE + lane]
    return mirrored or packet[MIRROR + lane] >= 0.0, flux


@inline
def keep_fields(packet, lane, placement, fields):
    """Store the fields with which a ray leaves, in the frame of the receivers, if wanted."""
    if len(fields) > 0:
        k = int(packet[RAY + lane])
        for part in range(4):
            local = turned(placement, BACK, three(packet, FIELDS + 3 * part * SIZE + lane))
            fields[k, 3 * part], fields[k, 3 * part + 1], fields[k, 3 * part + 2] = local


@inline
def share_along(packet, lane, axis):
    """Share of the light whose field lies along a unit vector."""
    squared = 0.0
    for part in range(4):
        onto = dot(axis, three(packet, FIELDS + 3 * part * SIZE + lane))
        squared += onto * onto
    return 0.5 * squared


@inline
def keep_axial(packet, lane, arrived, rays, body, axial, sides):
    """Store the flux of a ray times the squared component of its field along z, for a cover glass."""
    if axial is not None:
        k = int(packet[RAY + lane])
        if sides is None:
            axial[k] = arrived * packet[AXIAL + lane]
        elif len(axial) > 0:
            axial[k] = rays.emitted[k] * packet[CLEAR + lane] * share_along(packet, lane, z_axis(body.placement))
