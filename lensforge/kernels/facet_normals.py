"""Facets of rough faces: each ray of a packet has their slope along two lines on the face that it meets.

The lines are x and y, taken to the face by the rotation that takes z to its normal the shortest way. To the slope that
is drawn comes what light sees more of the facets that face it. Slopes are found by a loop of their own, so that a tilt
is one of vector instructions.
"""

from math import cos, log1p, pi, sin, sqrt

from lensforge.kernels.compiled import inline
from lensforge.kernels.drawn_faces import across
from lensforge.kernels.fresnel import outward_normal
from lensforge.kernels.nearest_face import FACE
from lensforge.kernels.ray_draws import drawn
from lensforge.kernels.ray_packet import (
    DX,
    FACET,
    LENGTH,
    PX,
    RAY,
    RHO_X,
    RHO_Y,
    SIZE,
    R,
    fetch_table,
    in_whole_vectors,
    three,
    write,
)
from lensforge.kernels.seen_slopes import CELL, RMS, added_slope, mark_incidence
from lensforge.kernels.traced_body import times_met
from lensforge.kernels.vectors import add_scaled, dot, linear_combination, scaled, unit

SEEN = R  # memory of rays that search: at their faces none does


@inline
def drawn_slope(k, face, times, noise, keys, slopes):
    """Slope along both lines of the facet that ray k meets on a face after ``times`` earlier hits."""
    rms = slopes[face]
    if times == 0:
        return rms * noise[k, 2 * face], rms * noise[k, 2 * face + 1]
    uniform, second_uniform = drawn(keys[k], face, times)
    # Box and Muller, 1958
    length = rms * sqrt(-2.0 * log1p(-uniform))
    turn = 2.0 * pi * second_uniform
    return length * cos(turn), length * sin(turn)


@inline
def on_face(x, y, u):
    """The vector along a face of this unit normal with components x and y; and its component along u + z, negated."""
    along = (x * u[0] + y * u[1]) / (1.0 + u[2])
    return (x - along * u[0], y - along * u[1], -along * (1.0 + u[2])), along


@inline
def note_incidence(packet, at, k, facet, rms, normal, d):
    """Note how light along d comes to the facet whose slopes are at ``facet``, on a face with this normal."""
    u = unit(normal)
    along, _ = on_face(packet[facet + k], packet[facet + SIZE + k], u)
    mark_incidence(packet, at, k, rms, dot(u, d), dot(along, d))


@inline
def draw_facet(packet, lane, face, times, noise, keys, slopes):
    """Draw the facet that a ray of a packet meets on a face after ``times`` earlier hits."""
    x, y = drawn_slope(int(packet[RAY + lane]), face, times, noise, keys, slopes)
    packet[FACET + lane] = x
    packet[FACET + SIZE + lane] = y
    packet[SEEN + RMS + lane] = slopes[face]


@inline
def see_facets(packet, count, body):
    """Find what light sees of the facets that were drawn, at the crossings of all rays of a packet."""
    whole = in_whole_vectors(count)
    for k in range(whole):
        d = three(packet, DX + k)
        p = add_scaled(three(packet, PX + k), packet[LENGTH + k], d)
        normal = outward_normal(across(p, body.grid.half_mm), packet[RHO_X + k], packet[RHO_Y + k])
        note_incidence(packet, SEEN, k, FACET, packet[SEEN + RMS + k], normal, d)
    fetch_table(packet, count, body.seen, SEEN + CELL)
    for k in range(whole):
        packet[FACET + 2 * SIZE + k] = added_slope(packet, SEEN, k)[0]


@inline
def meet_facets(packet, count, face, noise, keys, body):
    """The facets that the rays of a packet meet at their crossings with one face, where any face is rough."""
    if noise is not None:  # known to the compiler
        if body.slopes[face] > 0.0:
            for k in range(count):
                draw_facet(packet, k, face, 0, noise, keys, body.slopes)
            see_facets(packet, count, body)
        else:
            for k in range(in_whole_vectors(count)):
                write(packet, FACET + k, (0.0, 0.0, 0.0))


@inline
def meet_any_facets(packet, count, event, met, noise, keys, body):
    """:func:`meet_facets` of rays that each have found a face of their own."""
    if noise is not None:  # known to the compiler
        for k in range(count):
            face = int(packet[FACE + k])
            times = times_met(met, int(packet[RAY + k]), event, face)
            draw_facet(packet, k, face, times, noise, keys, body.slopes)
        see_facets(packet, count, body)


@inline
def facet_normal(packet, place, n, d, noise):
    """Normal of the facet, not normalised, that light along d meets on a face with normal n.

    n itself where ``noise`` is None: all faces are polished. The slopes are at this ``place`` of the packet.
    """
    if noise is None:
        return n
    u = unit(n)
    along, _ = on_face(packet[place], packet[place + SIZE], u)
    seen = packet[place + 2 * SIZE]
    return add_scaled(linear_combination(1.0 - seen * dot(u, d), u, seen, d), 1.0, along)


@inline
def facet_normal_adjoint(packet, place, n, d, noise, h, f):
    """Adjoint of :func:`facet_normal`: sensitivities to n, and to d beside f, from that to the facet's normal (h).

    The derivatives of the visible slope by cosine and by the slope along d are in the packet after the slopes.
    """
    if noise is None:
        return h, f
    x, y, seen = three(packet, place)
    u = unit(n)
    tilt, along = on_face(x, y, u)
    c = dot(u, d)
    onto = dot(h, u)
    by_seen = dot(h, d) - c * onto
    by_c = by_seen * packet[place + 3 * SIZE] - seen * onto
    by_along = by_seen * packet[place + 4 * SIZE]
    g = add_scaled(h, by_along, d)  # sensitivity to the tilt
    by_tilt = -(dot(g, u) + g[2]) / (1.0 + u[2])
    by_u = add_scaled(linear_combination(1.0 - seen * c, h, by_c, d), by_tilt, (x, y, -along))
    by_u = add_scaled(by_u, -along, g)
    f = add_scaled(add_scaled(f, seen, h), by_c, u)
    length = dot(n, u)
    return scaled(1.0 / length, add_scaled(by_u, -dot(by_u, u), u)), add_scaled(f, by_along, tilt)
