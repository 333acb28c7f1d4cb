"""The adjoint at the events of rays whose polarisation is followed by their fields.

All rays of a packet have taken the same way: they meet the same faces, from the same side, and are reflected or
refracted at each. So every step is one of vectors. What was before an event is kept, and recalled on the way back.
"""

from math import exp, sqrt

from lensforge.kernels.adjoint_packet import (
    ABSORPTION,
    BY_AXIAL,
    BY_FLUX,
    BY_PATH,
    BY_SIN2,
    CLEAR,
    EMITTED,
    EX,
    FIRST_EVENT,
    FX,
    INDEX_RATIO,
    LEFT,
    OF_POLARISATION,
    PATH,
    RAY,
    SMOOTH,
    ByEvent,
    D,
    P,
    back_to_ray,
    hit_at,
)
from lensforge.kernels.compiled import inline
from lensforge.kernels.fields import (
    FieldTurn,
    field_adjoint,
    field_behind,
    passing,
    reflect,
    reflecting,
    turn_vector,
    turn_vector_adjoint,
    unpolarised,
)
from lensforge.kernels.frames import BACK, BETWEEN, INTO, back_into_faces, to_next_face, turned, turned_back, z_axis
from lensforge.kernels.fresnel import refract, through
from lensforge.kernels.next_event import is_side_way
from lensforge.kernels.polarised_event import turn_field
from lensforge.kernels.ray_packet import SIZE, fields, three, write
from lensforge.kernels.ring_scatter import bounce, shift_at, spread, spread_adjoint, turn_between
from lensforge.kernels.traced_body import BODY, OUTSIDE, own_or_shared
from lensforge.kernels.vectors import add_scaled, dot, scaled, unit

# Both fields (real, imaginary) before an event, and the sensitivities to them. At the event: the cosine before the
# face, the squared one behind, the unit normal and the refracted direction, amplitudes a and k (complex) and their
# derivatives by the cosine.
E, BY_E = fields(OF_POLARISATION, 24)[::12]
C, Q_SQUARED, N, _, _, B, _, _, A, _, K, _, A_BY_C, _, K_BY_C, _ = fields(OF_POLARISATION + 24, 16)
OF_FIELDS = 24 + 16  # more than what the closed form takes there
FIELD = 3 * SIZE  # from one part of a field to the next


@inline
def begin_forward(packet, count, local_fields, placement):
    """Initial fields of all rays: their ``local_fields`` if any, else unpolarised; nothing is absorbed yet."""
    for lane in range(count):
        packet[CLEAR + lane] = 1.0
        packet[SMOOTH + lane] = 1.0
        if len(local_fields) == 0:
            first, second = unpolarised(three(packet, FIRST_EVENT + D + lane))
            write(packet, E + lane, first)
            write(packet, E + FIELD + lane, scaled(0.0, first))
            write(packet, E + 2 * FIELD + lane, second)
            write(packet, E + 3 * FIELD + lane, scaled(0.0, first))
        else:
            k = int(packet[RAY + lane])
            for part in range(4):
                field = local_fields[k, 3 * part], local_fields[k, 3 * part + 1], local_fields[k, 3 * part + 2]
                write(packet, E + part * FIELD + lane, turned(placement, INTO, field))


@inline
def absorb_on_way(packet, count):
    """Absorb a part of the flux of all rays on their path in the body."""
    for k in range(count):
        packet[CLEAR + k] *= exp(-packet[ABSORPTION + k] * packet[FIRST_EVENT + PATH + k])


@inline
def refract_all_at(packet, count, face, rays, grid):
    """Cosines, normals and refracted directions of all rays at an event."""
    for k in range(count):
        hit = hit_at(packet, k, FIRST_EVENT, face, rays, grid)
        n = unit(hit.tilted)
        b, c, q_squared = refract(hit.d, n, hit.ratio)
        packet[C + k] = c
        packet[Q_SQUARED + k] = q_squared
        write(packet, N + k, n)
        write(packet, B + k, b)


@inline
def put_amplitudes(packet, k, amplitudes):
    """Write amplitudes and their derivatives."""
    (packet[A + k], packet[A + SIZE + k]), (packet[K + k], packet[K + SIZE + k]), by_a, by_k = amplitudes
    packet[A_BY_C + k], packet[A_BY_C + SIZE + k] = by_a
    packet[K_BY_C + k], packet[K_BY_C + SIZE + k] = by_k


@inline
def amplitudes_of_film(packet, count, film, rays, fresnel):
    """Amplitudes of light that passes a face. At a tangent or a critical angle there is no derivative."""
    for k in range(count):
        c = packet[C + k]
        ratio = packet[FIRST_EVENT + INDEX_RATIO + k]
        passes = packet[Q_SQUARED + k] > 0.0
        q = sqrt(packet[Q_SQUARED + k] if passes else 1.0)
        packet[SMOOTH + k] = packet[SMOOTH + k] if passes and c > 0.0 else 0.0
        row = own_or_shared(rays.film_rows, int(packet[RAY + k]))
        passed, slopes = through(c, q, ratio, fresnel, film, row)
        put_amplitudes(packet, k, passing(passed, slopes))


@inline
def amplitudes_of_passing(packet, count, face, films, rays, fresnel):
    """:func:`amplitudes_of_film` of a face that may have none."""
    if films is None:  # known to the compiler
        amplitudes_of_film(packet, count, None, rays, fresnel)
    else:
        if films.sizes[face] == 0:
            amplitudes_of_film(packet, count, None, rays, fresnel)
        else:
            amplitudes_of_film(packet, count, films.tables[face, ..., : films.sizes[face], :], rays, fresnel)


@inline
def all_amplitudes(packet, count, face, rays, body):
    """Amplitudes of all rays at an event, that of a mirror, of total reflection, or of light that passes."""
    mirror = body.sides.mirrors[face.face]
    if mirror >= 0.0:
        for k in range(count):
            put_amplitudes(packet, k, ((sqrt(mirror), 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)))
    elif face.mirrored:
        for k in range(count):
            put_amplitudes(packet, k, reflecting(packet[C + k], packet[FIRST_EVENT + INDEX_RATIO + k]))
    else:
        amplitudes_of_passing(packet, count, face.face, body.films, rays, body.fresnel)


@inline
def field_turn(packet, k, mirrored):
    """The turn of the fields of a ray at the face of an event."""
    c = packet[C + k]
    d = three(packet, FIRST_EVENT + D + k)
    n = three(packet, N + k)
    a = (packet[A + k], packet[A + SIZE + k])
    more = (packet[K + k], packet[K + SIZE + k])
    b = reflect(d, n, c) if mirrored else three(packet, B + k)
    return FieldTurn(a, more, n, add_scaled(n, -c, d), d, b, mirrored)


@inline
def turn_all_fields(packet, count, mirrored):
    """Take the directions and fields of all rays through the face of an event."""
    for k in range(count):
        face = field_turn(packet, k, mirrored)
        turn_field(packet, E + k, face)
        turn_field(packet, E + 2 * FIELD + k, face)
        write(packet, FIRST_EVENT + D + k, face.b)


@inline
def spread_at(packet, k, face, b, shifts, keys):
    """Shift, bounce and direction of a ray that a polished face would send along b; whether it is spread."""
    shift, spreads = shift_at(int(packet[RAY + k]), face.face, face.times, packet[C + k], shifts, keys)
    at = bounce(three(packet, N + k), face.side, face.mirrored)
    return shift, at, spread(b, shift, at), spreads


@inline
def spreads_at(face, body):
    """True for events behind which light may be spread: not after total reflection."""
    return not face.mirrored or body.sides.mirrors[face.face] >= 0.0


@inline
def spread_all(packet, count, face, body, shifts, keys):
    """Spread all rays behind the face of an event, with their fields."""
    if shifts is not None and spreads_at(face, body):
        for k in range(count):
            b = three(packet, FIRST_EVENT + D + k)
            _, _, to, spreads = spread_at(packet, k, face, b, shifts, keys)
            if spreads:
                turn = turn_between(b, to)
                for first in range(E + k, E + 4 * FIELD + k, FIELD):
                    write(packet, first, turn_vector(three(packet, first), turn))
                write(packet, FIRST_EVENT + D + k, to)


@inline
def back_before_spread(packet, k, face, turned, body, shifts, keys):
    """Take the sensitivities to a ray back to before it was spread; ``turned``: by the face alone.

    Returns those to the cosine before the face and to its unit normal.
    """
    by_c = 0.0
    by_n = scaled(0.0, turned.n)
    if shifts is not None and spreads_at(face, body):
        shift, at, to, spreads = spread_at(packet, k, face, turned.b, shifts, keys)
        if spreads:
            turn = turn_between(turned.b, to)
            f = three(packet, FX + k)
            by_b = scaled(0.0, to)
            for field in (0, 2):
                place = E + field * FIELD + k
                by = BY_E + field * FIELD + k
                parts = field_behind(three(packet, place), three(packet, place + FIELD), turned)
                for part in range(2):
                    g, _, by_one, by_other = turn_vector_adjoint(parts[part], three(packet, by + part * FIELD), turn)
                    f = add_scaled(f, 1.0, by_other)
                    by_b = add_scaled(by_b, 1.0, by_one)
                    write(packet, by + part * FIELD, g)
            to_b, by_ahead, by_amount = spread_adjoint(turned.b, shift, at, f)
            write(packet, FX + k, add_scaled(to_b, 1.0, by_b))
            by_c = shift.by_cosine * by_amount
            by_n = scaled(-1.0 if face.mirrored else 1.0, by_ahead)
    return by_c, by_n


@inline
def forward_at(packet, count, face, rays, body):
    """Take all rays through the face of an event."""
    refract_all_at(packet, count, face, rays, body.grid)
    all_amplitudes(packet, count, face, rays, body)
    turn_all_fields(packet, count, face.mirrored)
    spread_all(packet, count, face, body, rays.shifts, rays.keys)


@inline
def to_next_frame(packet, count, placement):
    """Take all rays into the frame of the outer one of two faces."""
    if len(placement.frames) > 2:
        for k in range(count):
            p, d = to_next_face(placement, three(packet, FIRST_EVENT + P + k), three(packet, FIRST_EVENT + D + k))
            write(packet, FIRST_EVENT + P + k, p)
            write(packet, FIRST_EVENT + D + k, d)
            for first in range(E + k, E + 4 * FIELD + k, FIELD):
                write(packet, first, turned(placement, BETWEEN, three(packet, first)))


@inline
def from_next_frame(packet, count, placement):
    """Take all sensitivities from the frame of the outer one of two faces into that of the inner one."""
    if len(placement.frames) > 2:
        for k in range(count):
            write(packet, EX + k, turned_back(placement, BETWEEN, three(packet, EX + k)))
            write(packet, FX + k, turned_back(placement, BETWEEN, three(packet, FX + k)))
            for first in range(BY_E + k, BY_E + 4 * FIELD + k, FIELD):
                write(packet, first, turned_back(placement, BETWEEN, three(packet, first)))


@inline
def begin_back(packet, count, placement, by_fields):
    """Sensitivities to all rays behind their last event, in the frame of the faces, and to their paths in the body."""
    axis = z_axis(placement)
    for k in range(count):
        b = three(packet, FIRST_EVENT + D + k)
        e, f = back_into_faces(placement, three(packet, EX + k), three(packet, FX + k))
        e = add_scaled(e, -dot(e, b), b)  # a ray is a line: no receiver sees where on it its point lies
        write(packet, EX + k, e)
        write(packet, FX + k, f)
        arrived = packet[EMITTED + k] * packet[CLEAR + k] if packet[LEFT + k] == 1.0 else 0.0
        value = 0.0
        for part in range(4):
            field = three(packet, E + part * FIELD + k)
            onto = dot(axis, field)
            squared = dot(field, field)
            value += 0.5 * arrived * (packet[BY_FLUX + k] * squared + packet[BY_AXIAL + k] * onto * onto)
            by_axis = arrived * packet[BY_AXIAL + k] * onto
            write(
                packet, BY_E + part * FIELD + k, add_scaled(scaled(arrived * packet[BY_FLUX + k], field), by_axis, axis)
            )
        packet[BY_PATH + k] = -packet[ABSORPTION + k] * value
    add_by_fields(packet, count, placement, by_fields)


@inline
def add_by_fields(packet, count, placement, by_fields):
    """Add the sensitivities to the fields with which rays leave, where there are any."""
    if len(by_fields) > 0:
        for lane in range(count):
            k = int(packet[RAY + lane])
            value = 0.0
            for part in range(4):
                also = by_fields[k, 3 * part], by_fields[k, 3 * part + 1], by_fields[k, 3 * part + 2]
                also = turned_back(placement, BACK, also)
                value += 0.5 * dot(also, three(packet, E + part * FIELD + lane))
                by_field = add_scaled(three(packet, BY_E + part * FIELD + lane), 1.0, also)
                write(packet, BY_E + part * FIELD + lane, by_field)
            packet[BY_PATH + lane] -= packet[ABSORPTION + lane] * value


@inline
def by_exit_sine(face, last, sides):
    """Derivative of the exit sine at an event by half of the squared cosine before the face, over the squared ratio."""
    if not last or face.behind != OUTSIDE or sides.mirrors[face.face] >= 0.0:
        return 0.0
    return 2.0 if is_side_way(face.face, sides) else -2.0


@inline
def field_back(packet, k, part, face):
    """Take the sensitivities to a field back through a face. Returns those to cosine, normal and both directions."""
    place = E + part * FIELD + k
    to = BY_E + part * FIELD + k
    real, imaginary, by_n, by_u, by_d, by_b, by_a, by_k = field_adjoint(
        three(packet, place), three(packet, place + FIELD), three(packet, to), three(packet, to + FIELD), face
    )
    write(packet, to, real)
    write(packet, to + FIELD, imaginary)
    by_c = by_a[0] * packet[A_BY_C + k] + by_a[1] * packet[A_BY_C + SIZE + k] - dot(face.d, by_u)
    by_c += by_k[0] * packet[K_BY_C + k] + by_k[1] * packet[K_BY_C + SIZE + k]
    return by_c, add_scaled(by_n, 1.0, by_u), add_scaled(by_d, -packet[C + k], by_u), by_b


@inline
def back_through(packet, count, face, last, rays, body):
    """Sensitivities to all rays before an event from those behind it."""
    in_body = 1.0 if face.medium == BODY else 0.0
    at_exit = by_exit_sine(face, last, body.sides)
    for k in range(count):
        turned = field_turn(packet, k, face.mirrored)
        of_spread_c, of_spread_n = back_before_spread(packet, k, face, turned, body, rays.shifts, rays.keys)
        by_c, by_n, by_d, by_b = field_back(packet, k, 0, turned)
        also_c, also_n, also_d, also_b = field_back(packet, k, 2, turned)
        f = add_scaled(add_scaled(three(packet, FX + k), 1.0, by_b), 1.0, also_b)
        hit = hit_at(packet, k, FIRST_EVENT, face, rays, body.grid)
        by_c += of_spread_c + also_c + at_exit * hit.ratio * hit.ratio * packet[C + k] * packet[BY_SIN2 + k]
        by_n = add_scaled(add_scaled(by_n, 1.0, also_n), 1.0, of_spread_n)
        by_d = add_scaled(by_d, 1.0, also_d)
        by = ByEvent(three(packet, EX + k), f, by_c, by_n, by_d, in_body * packet[BY_PATH + k])
        e, f = back_to_ray(packet, k, FIRST_EVENT, face, hit, by, rays, body.grid)
        write(packet, EX + k, e)
        write(packet, FX + k, f)
