"""Facets of rough faces: each ray of a packet has their slope along two lines on the face that it meets.

The lines are x and y, taken to the face by the rotation that takes z to its normal the shortest way. To the slope that
is drawn comes what light sees more of the facets that face it. Slopes are found by a loop of their own, so that a tilt
is one of vector instructions.
"""

from math import cos, log1p, pi, sin, sqrt

from lensforge.kernels.compiled import inline
from lensforge.kernels.drawn_faces import across
from lensforge.kernels.fresnel import outward_normal
from lensforge.kernels.ray_draws import drawn
from lensforge.kernels.ray_packet import DX, FACET, LENGTH, PX, RAY, RHO_X, RHO_Y, SIZE, three, write
from lensforge.kernels.seen_slopes import added_slope
from lensforge.kernels.vectors import add_scaled, dot, linear_combination, scaled, unit


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
def seen_slope(x, y, rms, normal, d):
    """``added_slope`` of a facet as light along d sees it on a face with this normal."""
    u = unit(normal)
    along, _ = on_face(x, y, u)
    return added_slope(rms, dot(u, d), dot(along, d))


@inline
def fetch_facet(packet, lane, face, times, noise, keys, slopes, grid):
    """The facet that a ray of a packet meets at its crossing, if faces are rough."""
    if noise is not None:  # known to the compiler
        x, y = drawn_slope(int(packet[RAY + lane]), face, times, noise, keys, slopes)
        d = three(packet, DX + lane)
        p = add_scaled(three(packet, PX + lane), packet[LENGTH + lane], d)
        normal = outward_normal(across(p, grid.half_mm), packet[RHO_X + lane], packet[RHO_Y + lane])
        write(packet, FACET + lane, (x, y, seen_slope(x, y, slopes[face], normal, d)[0]))


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
