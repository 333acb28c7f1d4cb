"""The adjoint at both faces of a double-freeform lens in unpolarised light, whose polarisation has a closed form."""

from math import exp, sqrt

from lensforge.kernels.adjoint_packet import (
    ABSORPTION,
    BY_AXIAL,
    BY_FLUX,
    BY_SIN2,
    EMITTED,
    EX,
    FIRST_EVENT,
    FX,
    LEFT,
    OF_POLARISATION,
    PATH,
    SECOND_EVENT,
    SMOOTH,
    ByEvent,
    D,
    MetFace,
    P,
    back_to_ray,
    hit_at,
)
from lensforge.kernels.compiled import inline
from lensforge.kernels.frames import BETWEEN, back_into_faces, to_next_face, turned, turned_back, z_axis
from lensforge.kernels.fresnel import SecondFace, refract, through, through_both
from lensforge.kernels.ray_packet import fields, three, write
from lensforge.kernels.ring_scatter import before_last_spread
from lensforge.kernels.traced_body import BODY, CAVITY, OUTSIDE, own_or_shared
from lensforge.kernels.vectors import add_scaled, dot, scaled, unit

# At the inner face: the cosine before it, its transmittances with their excess, slopes of these; the unit normal in the
# outer face's frame, and the sensitivities to the cosine and to it.
COSINE, FIRST, _, _, SLOPES, _, _, NORMAL, _, _, BY_COSINE, BY_NORMAL, _, _ = fields(OF_POLARISATION, 14)


@inline
def inner_face():
    """The event at the inner face."""
    return MetFace(0, 0, 0, 1.0, False, CAVITY, BODY)


@inline
def outer_face():
    """The event at the outer face."""
    return MetFace(1, 1, 0, 1.0, False, BODY, OUTSIDE)


@inline
def refract_inner(packet, count, film, rays, body):
    """Refract all rays at the inner face, and put them on their way to the outer one."""
    face = inner_face()
    for k in range(count):
        hit = hit_at(packet, k, FIRST_EVENT, face, rays, body.grid)
        n = unit(hit.tilted)
        ratio = hit.ratio
        b, c, q_squared = refract(hit.d, n, ratio)
        row = own_or_shared(rays.film_rows, hit.number)
        (t_s, t_p, excess), slopes = through(c, sqrt(q_squared), ratio, body.fresnel, film, row)
        per_behind = 1.0 / (ratio * ratio)
        packet[COSINE + k] = c
        write(packet, FIRST + k, (t_s, t_p, excess * per_behind))
        write(packet, SLOPES + k, (slopes[0], slopes[1], slopes[2] * per_behind))
        p, b = to_next_face(body.placement, hit.p, b)
        write(packet, NORMAL + k, turned(body.placement, BETWEEN, n))
        write(packet, SECOND_EVENT + P + k, p)
        write(packet, SECOND_EVENT + D + k, b)


@inline
def back_through_outer(packet, count, film, absorbing, rays, body, axis):
    """Sensitivities at the outer face, and to the ray behind the inner one, in the frame of that."""
    face = outer_face()
    for k in range(count):
        hit = hit_at(packet, k, SECOND_EVENT, face, rays, body.grid)
        left = packet[LEFT + k] == 1.0
        n = unit(hit.tilted)
        ratio = hit.ratio
        b, c, q_squared = refract(hit.d, n, ratio)
        q = sqrt(q_squared if left else 1.0)  # reflected totally, it has no flux behind the face
        row = own_or_shared(rays.film_rows, hit.number)
        second, slopes = through(c, q, ratio, body.fresnel, film, row)
        value, by_first, by_c, by_m, by_n, by_d, by_b = through_both(
            three(packet, FIRST + k),
            second,
            slopes,
            three(packet, NORMAL + k),
            SecondFace(ratio, c, q, n, hit.d, b),
            axis,
            packet[BY_FLUX + k],
            packet[BY_AXIAL + k],
        )
        # tangent, or at the critical angle, to the last bit: there is no derivative
        smooth = packet[COSINE + k] > 0.0 and c > 0.0 and (q_squared > 0.0 or not left)
        packet[SMOOTH + k] = 1.0 if smooth else 0.0
        # flux without the losses at both faces
        arrived = packet[EMITTED + k] if left else 0.0
        by_path = 0.0
        if absorbing:
            arrived *= exp(-packet[ABSORPTION + k] * packet[SECOND_EVENT + PATH + k])
            by_path = -packet[ABSORPTION + k] * arrived * value
        packet[BY_COSINE + k] = arrived * dot(by_first, three(packet, SLOPES + k))
        by_cosine = arrived * by_c - 2.0 * ratio * ratio * c * packet[BY_SIN2 + k]
        e, f = back_into_faces(body.placement, three(packet, EX + k), three(packet, FX + k))
        by_n = scaled(arrived, by_n)
        to, f, by_n, by_cosine = before_last_spread(hit.number, n, b, c, rays.shifts, rays.keys, f, by_n, by_cosine)
        # a ray is a line: no receiver sees where on it its point lies, to the last bit of this direction
        e = add_scaled(e, -dot(e, to), to)
        f = add_scaled(f, arrived, by_b)
        by = ByEvent(e, f, by_cosine, by_n, scaled(arrived, by_d), by_path)
        e, f = back_to_ray(packet, k, SECOND_EVENT, face, hit, by, rays, body.grid)
        write(packet, BY_NORMAL + k, turned_back(body.placement, BETWEEN, scaled(arrived, by_m)))
        write(packet, EX + k, turned_back(body.placement, BETWEEN, e))
        write(packet, FX + k, turned_back(body.placement, BETWEEN, f))


@inline
def back_through_inner(packet, count, rays, body):
    """Sensitivities at the inner face."""
    face = inner_face()
    none = (0.0, 0.0, 0.0)
    for k in range(count):
        hit = hit_at(packet, k, FIRST_EVENT, face, rays, body.grid)
        f = three(packet, FX + k)
        normal = three(packet, BY_NORMAL + k)
        cosine = packet[BY_COSINE + k]
        by = ByEvent(three(packet, EX + k), f, cosine, normal, none, 0.0)
        back_to_ray(packet, k, FIRST_EVENT, face, hit, by, rays, body.grid)


@inline
def forward_at_inner(packet, count, rays, body, films):
    """:func:`refract_inner` at an inner face that may have a film."""
    if films is None:  # known to the compiler
        refract_inner(packet, count, None, rays, body)
    else:
        if films.sizes[0] == 0:
            refract_inner(packet, count, None, rays, body)
        else:
            refract_inner(packet, count, films.tables[0, ..., : films.sizes[0], :], rays, body)


@inline
def back_at_outer(packet, count, rays, body, films, axis):
    """:func:`back_through_outer` at an outer face that may have a film."""
    absorbing = len(rays.absorptions) > 0
    if films is None:  # known to the compiler
        back_through_outer(packet, count, None, absorbing, rays, body, axis)
    else:
        if films.sizes[1] == 0:
            back_through_outer(packet, count, None, absorbing, rays, body, axis)
        else:
            back_through_outer(packet, count, films.tables[1, ..., : films.sizes[1], :], absorbing, rays, body, axis)


@inline
def back_behind_outer(packet, count, rays, body, by_axial):
    """:func:`back_at_outer` with the flux along z where a cover glass asks for it."""
    if by_axial is None:  # known to the compiler
        back_at_outer(packet, count, rays, body, body.films, None)
    else:
        back_at_outer(packet, count, rays, body, body.films, z_axis(body.placement))
