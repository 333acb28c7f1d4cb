"""Adjoint of a chain of events: a ray again, forward by the paths that were kept, and backward face by face.

A ray that would meet another face, were a face moved, has no derivative: light that so crosses a crease is left out.
A ray that ends at a tangent adds nothing: its squared sine is at its largest there.
Rays go one by one, unlike those of ``kernels.adjoint``: their number of events differs, and the work at each is three
times as much.
``begun``: as in ``kernels.trace``. ``by_ended`` (n, 12): sensitivities to the fields with which rays leave, or None. Of
light that comes from another body ``by_begun`` (n, 18) is filled: sensitivities to the start, the direction and the
fields of each ray, in the place of gradients by the tables; None for light of a source.
"""

from math import exp, sqrt

import numpy as np
from jaxtyping import Float

from lensforge.kernels.bicubic import cell_at, jet, scatter
from lensforge.kernels.chain import FROM_BEHIND, REFLECTED, amplitudes, index_in, is_side_way
from lensforge.kernels.compiled import inline
from lensforge.kernels.fate import Fate
from lensforge.kernels.fields import field_adjoint, field_behind, reflect, unpolarised
from lensforge.kernels.frames import place, rough_normal, rough_normal_adjoint, turn, turn_back, z_axis
from lensforge.kernels.fresnel import dot, mixed, outward_normal, refract, scaled, unit
from lensforge.kernels.hit_adjoint import hit_adjoint
from lensforge.kernels.nearest_face import BODY, OUTSIDE

# Of each event: hit, direction before it, normal away from the origin, unit normal along the ray, fields before it; the
# table's cell and derivatives; cosine, index ratio, and path.
P, D, RAW, N, E, CELL, JET, COSINE, RATIO, PATH, NUMBERS = 0, 3, 6, 9, 12, 24, 28, 33, 34, 35, 36


def empty_chain(events: int) -> Float[np.ndarray, "e k"]:
    """Memory of one ray of at most ``events`` events."""
    return np.zeros((events + 1, NUMBERS))


@inline
def read(row, first):
    """Three numbers of a row."""
    return row[first], row[first + 1], row[first + 2]


@inline
def store(row, first, vector):
    """Write three numbers into a row."""
    row[first], row[first + 1], row[first + 2] = vector


@inline
def jet_of(table, origin, inverse_step, p, row):
    """The table's cell and first and second derivatives at a hit, into a row of the memory."""
    shift = 1.0 / (sqrt(dot(p, p)) + p[2])
    X, Y = p[0] * shift, p[1] * shift
    row[CELL], row[CELL + 1], row[CELL + 2], row[CELL + 3] = cell_at(X, Y, float(len(table)), origin, inverse_step)
    _, row[JET], row[JET + 1], row[JET + 2], row[JET + 3], row[JET + 4] = jet(table, origin, inverse_step, X, Y)


@inline
def media_at(code, chain):
    """Face of an event, media before and behind it for the ray, whether that was reflected, and came from behind."""
    face, from_behind, mirrored = code // 4, code % 2 == FROM_BEHIND, code % 4 >= REFLECTED
    one, other = chain[0][face], chain[1][face]
    return face, other if from_behind else one, one if from_behind else other, mirrored, from_behind


@inline
def forward(k, origin, direction, number, indices, absorptions, tables, scene, coatings, rows, placed, rough, chain,
            begun, lengths, met, memory):  # fmt: skip
    """The events of a ray again, into the memory. Returns the share that absorption leaves of its flux."""
    p, d = (origin[0], origin[1], origin[2]), (direction[0], direction[1], direction[2])
    if placed is not None:
        p = place(placed[0][0], placed[1], p[0], p[1], p[2])
        d = turn(placed[0][0], d[0], d[1], d[2])
    if begun is not None:
        for part in range(4):
            store(memory[0], E + 3 * part, read(begun[k], 3 * part))
    else:
        one, other = unpolarised(d)
        for part, field in enumerate((one, scaled(0.0, one), other, scaled(0.0, one))):
            store(memory[0], E + 3 * part, field)
    clear = 1.0
    for event in range(number):
        row, t = memory[event], lengths[k, event]
        face, medium, behind, mirrored, from_behind = media_at(met[k, event], chain)
        p = mixed(1.0, p, t, d, 0.0, d)
        if medium == BODY and len(absorptions) > 0:
            clear *= exp(-absorptions[min(k, len(absorptions) - 1)] * t)
        jet_of(tables[face], scene[3], scene[4], p, row)
        raw = outward_normal(p[0], p[1], p[2], row[JET], row[JET + 1])
        n = unit(*rough_normal(raw[0], raw[1], raw[2], rough, k, event, face))
        n = scaled(-1.0, n) if from_behind else n
        ratio = index_in(medium, k, scene, indices) / index_in(behind, k, scene, indices)
        bx, by, bz, c, q_squared = refract(d[0], d[1], d[2], n[0], n[1], n[2], ratio)
        store(row, P, p)
        store(row, D, d)
        store(row, RAW, raw)
        store(row, N, n)
        row[COSINE], row[RATIO], row[PATH] = c, ratio, t
        a, more, _, _, _ = amplitudes(c, q_squared, ratio, chain[2][face], scene[0], coatings, rows, face, k)
        b = reflect(d, n, c) if mirrored else (bx, by, bz)
        after, u = memory[event + 1], mixed(1.0, n, -c, d, 0.0, n)
        for field in range(2):
            first = E + 6 * field
            real, imaginary = field_behind(read(row, first), read(row, first + 3), a, more, n, u, d, b, mirrored)
            store(after, first, real)
            store(after, first + 3, imaginary)
        d = b
    store(memory[number], D, d)
    return clear


@inline
def back_at_face(k, event, e, f, by_sin2, followed, by_t, scene, coatings, rows, rough, chain, code, row, by_fields):
    """Adjoint of one event: from sensitivities to the hit (e), to the direction and the fields behind it.

    Returns those to the start of the ray and its direction, and to the table. ``by_fields`` (12) is renewed.
    """
    face, _, behind, mirrored, from_behind = media_at(code, chain)
    p, d, raw, n = read(row, P), read(row, D), read(row, RAW), read(row, N)
    c, ratio, t = row[COSINE], row[RATIO], row[PATH]
    bx, by, bz, _, q_squared = refract(d[0], d[1], d[2], n[0], n[1], n[2], ratio)
    mirror = chain[2][face]
    on_n, on_d, on_c = scaled(0.0, n), scaled(0.0, n), 0.0
    if behind == OUTSIDE and mirror < 0.0:
        on_c += (2.0 if is_side_way(face, chain) else -2.0) * ratio * ratio * c * by_sin2
    if followed:
        a, more, by_a, by_more, _ = amplitudes(c, q_squared, ratio, mirror, scene[0], coatings, rows, face, k)
        b, u = reflect(d, n, c) if mirrored else (bx, by, bz), mixed(1.0, n, -c, d, 0.0, n)
        for field in range(2):
            first = 6 * field
            real, imaginary, also_n, on_u, also_d, also_b, on_a, on_more = field_adjoint(
                read(row, E + first), read(row, E + first + 3), read(by_fields, first), read(by_fields, first + 3),
                a, more, n, u, d, b, mirrored,
            )  # fmt: skip
            store(by_fields, first, real)
            store(by_fields, first + 3, imaginary)
            on_n, on_d = mixed(1.0, on_n, 1.0, also_n, 1.0, on_u), mixed(1.0, on_d, 1.0, also_d, -c, on_u)
            f = mixed(1.0, f, 1.0, also_b, 0.0, f)
            on_c += on_a[0] * by_a[0] + on_a[1] * by_a[1] + on_more[0] * by_more[0] + on_more[1] * by_more[1]
            on_c -= dot(d, on_u)
        if mirrored:
            on_n, on_d, on_c = (
                mixed(1.0, on_n, -2.0 * c, f, 0.0, n),
                mixed(1.0, on_d, 1.0, f, 0.0, n),
                on_c - 2.0 * dot(n, f),
            )
        else:
            q = sqrt(q_squared)
            on_n, on_d = mixed(1.0, on_n, q - ratio * c, f, 0.0, n), mixed(1.0, on_d, ratio, f, 0.0, n)
            on_c += dot(n, f) * (ratio * ratio * c / q - ratio)
    on_n, on_d = mixed(1.0, on_n, on_c, d, 0.0, n), mixed(1.0, on_d, on_c, n, 0.0, n)
    tilted = rough_normal(raw[0], raw[1], raw[2], rough, k, event, face)
    size = sqrt(dot(tilted, tilted))
    h = scaled((-1.0 if from_behind else 1.0) / size, mixed(1.0, on_n, -dot(on_n, n), n, 0.0, n))
    h = rough_normal_adjoint(raw[0], raw[1], raw[2], rough, k, event, face, h[0], h[1], h[2])
    e = mixed(1.0, e, by_t, d, 0.0, d)
    bend = row[JET], row[JET + 1], row[JET + 2], row[JET + 3], row[JET + 4]
    start, by_table = hit_adjoint(
        p[0], p[1], p[2], d[0], d[1], d[2], raw[0], raw[1], raw[2], e[0], e[1], e[2], h[0], h[1], h[2], bend
    )
    return mixed(1.0, start, -by_t, d, 0.0, d), mixed(1.0, on_d, t, start, 0.0, d), by_table


@inline
def begin_back(
    k, emitted, left, clear, placed, b, fields, by_point, by_direction, by_flux, by_axial, by_ended, by_fields
):  # fmt: skip
    """Sensitivities to the point, the direction and the fields of an exit ray in the frame of the faces.

    Returns the first two, and what the ray adds to the number that is differentiated.
    """
    e, f = (by_point[0], by_point[1], by_point[2]), (by_direction[0], by_direction[1], by_direction[2])
    if placed is not None:
        frame = placed[0][len(placed[0]) - 1]
        e = turn_back(frame, placed[2] * e[0], placed[2] * e[1], placed[2] * e[2])
        f = turn_back(frame, f[0], f[1], f[2])
    e = mixed(1.0, e, -dot(e, b), b, 0.0, b)  # a ray is a line: no receiver sees where on it its point lies
    arrived = emitted * clear if left else 0.0
    axis, value = z_axis(placed), 0.0
    for part in range(4):
        field = read(fields, E + 3 * part)
        onto = dot(axis, field)
        value += 0.5 * arrived * (by_flux * dot(field, field) + by_axial * onto * onto)
        on_field = mixed(arrived * by_flux, field, arrived * by_axial * onto, axis, 0.0, axis)
        if by_ended is not None:
            also = read(by_ended[k], 3 * part)
            if placed is not None:
                also = turn_back(placed[0][len(placed[0]) - 1], also[0], also[1], also[2])
            value += 0.5 * dot(also, field)
            on_field = mixed(1.0, on_field, 1.0, also, 0.0, also)
        store(by_fields, 3 * part, on_field)
    return e, f, value


@inline
def chain_adjoint(
    k, origin, direction, emitted, indices, absorptions, tables, scene, coatings, rows, placed, rough, chain,
    begun, lengths, met, fate, by_point, by_direction, by_flux, by_axial, by_sin2, by_ended, by_begun, gradients,
    memory, by_fields,
):  # fmt: skip
    """Add one ray's contribution to the gradients with respect to the coefficients of all tables."""
    left = fate == Fate.LEFT_LENS
    number = 0
    while number < lengths.shape[1] and met[k, number] >= 0:
        number += 1
    if not (left or (fate == Fate.TOTAL_REFLECTION and number == lengths.shape[1])):
        return  # one that met a face tangentially has no last event
    clear = forward(
        k, origin, direction, number, indices, absorptions, tables, scene, coatings, rows, placed, rough, chain, begun,
        lengths, met, memory,
    )  # fmt: skip
    e, f, value = begin_back(
        k, emitted, left, clear, placed, read(memory[number], D), memory[number], by_point, by_direction,
        by_flux, by_axial, by_ended, by_fields,
    )  # fmt: skip
    if not left:
        e, f = scaled(0.0, e), scaled(0.0, f)
    absorption = absorptions[min(k, len(absorptions) - 1)] if len(absorptions) > 0 else 0.0
    for event in range(number - 1, -1, -1):
        last, row, code = event == number - 1, memory[event], met[k, event]
        face, medium, _, _, _ = media_at(code, chain)
        e, f, by_table = back_at_face(
            k, event, e, f, by_sin2 if last else 0.0, left or not last, -absorption * value if medium == BODY else 0.0,
            scene, coatings, rows, rough, chain, code, row, by_fields,
        )  # fmt: skip
        if by_begun is None:
            scatter(
                gradients[face], int(row[CELL]), int(row[CELL + 1]), row[CELL + 2], row[CELL + 3], scene[4],
                by_table[0], by_table[1], by_table[2],
            )  # fmt: skip
    if by_begun is not None:
        store(by_begun[k], 0, e)
        store(by_begun[k], 3, f)
        for part in range(4):
            store(by_begun[k], 6 + 3 * part, read(by_fields, 3 * part))
