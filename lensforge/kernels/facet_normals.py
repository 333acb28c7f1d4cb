"""Facets of rough faces: each ray of a packet has their slope along two lines on the face that it meets.

The lines are x and y, taken to the face by the rotation that takes z to its normal the shortest way. Light sees more of
the facets that face it: that moves their mean slope. Slopes are copied into the packet by a loop of its own, so that a
tilt is one of vector instructions.
"""

from math import pi, sqrt

import numpy as np

from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.ray_packet import SIZE
from lensforge.kernels.vectors import add_scaled, dot, length_of, scaled


@inline
def by_right_angles(x, y, count):
    """A vector across the axis, turned about it by so many right angles."""
    turn = count % 4
    sign = 1.0 if turn < 2 else -1.0
    return (sign * x, sign * y) if turn % 2 == 0 else (-sign * y, sign * x)


@inline
def fetch_facet(packet, place, k, event, face, noise, slopes):
    """The slopes of ray k at a face, where faces are rough; a right angle on each time that it meets it again."""
    if noise is not None:
        rms = slopes[face]
        x, y = rms * noise[k, 2 * face], rms * noise[k, 2 * face + 1]
        packet[place], packet[place + SIZE] = by_right_angles(x, y, event - face)
        packet[place + 2 * SIZE] = rms * rms


_LEAST = 1e-30  # squared: of light along a polished face


@inline
def seen_slope(squared, c):
    """Mean slope of the facets that light of cosine c sees, over the sine that it has along the face; its derivative.

    ``squared``: their squared rms slope. By the area of each that the light sees it is the slope of order one in c, and
    at grazing light that of Rayleigh's distribution; between them it is within 8 %.
    """
    grazing = 2.0 / pi * squared
    root = c * c + grazing * (1.0 - c * c) + _LEAST
    slope = (squared if c > 0.0 else -squared) / sqrt(root)
    return slope, -slope * (1.0 - grazing) * c / root


@inline
def facet_normal(packet, place, n, d, noise):
    """Normal of the facet, not normalised, that light along d meets on a face with normal n.

    n itself where ``noise`` is None: all faces are polished.

    The slopes are at this ``place`` of the packet.
    """
    if noise is None:
        return n
    x, y, length = packet[place], packet[place + SIZE], length_of(n)
    along = (x * n[0] + y * n[1]) / (length + n[2])  # of the slope's vector, over 1 + cos of the normal's angle
    c = dot(n, d) / length
    seen, _ = seen_slope(packet[place + 2 * SIZE], c)
    keep = 1.0 - along - seen * c
    return (
        keep * n[0] + length * (x + seen * d[0]),
        keep * n[1] + length * (y + seen * d[1]),
        keep * n[2] + length * (seen * d[2] - along),
    )


@inline
def facet_normal_adjoint(packet, place, n, d, noise, h, f):
    """Adjoint of :func:`facet_normal`: sensitivities to n, and to d beside f, from that to the facet's normal (h)."""
    if noise is None:
        return h, f
    x, y, length = packet[place], packet[place + SIZE], length_of(n)
    shift = length + n[2]
    along = (x * n[0] + y * n[1]) / shift
    u = scaled(1.0 / length, n)
    by_along = -(dot(h, n) + h[2] * length) / shift  # of the product above
    by_length = h[0] * x + h[1] * y - h[2] * along - by_along * along
    c, onto = dot(u, d), dot(h, u)
    seen, by_c = seen_slope(packet[place + 2 * SIZE], c)
    across = dot(h, d) - c * onto
    by_c = by_c * across - seen * onto
    by_n = add_scaled(scaled(1.0 - along - seen * c, h), by_length + seen * (across + c * onto) - by_c * c, u)
    by_n = add_scaled(by_n, by_c, d)
    f = add_scaled(add_scaled(f, length * seen, h), length * by_c, u)
    return (by_n[0] + by_along * x, by_n[1] + by_along * y, by_n[2] - by_along * along), f


_GOLDEN, _FIRST, _SECOND = (np.uint64(each) for each in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
_27, _30, _31, _11 = (np.uint64(each) for each in (27, 30, 31, 11))
_ULP = 2.0**-53


@inline
def mixed(key):
    """A number each bit of which depends on all bits of the key: SplitMix64 (Steele, Lea and Flood, 2014)."""
    key = (key ^ (key >> _30)) * _FIRST
    key = (key ^ (key >> _27)) * _SECOND
    return key ^ (key >> _31)


@kernel
def draw_by_rays(origins, directions, salt, numbers):
    """Fill ``numbers`` (n, 2), each in [0, 1), from the bits of each ray; others with another ``salt``."""
    for k in range(len(numbers)):
        key = salt
        for axis in range(3):
            key = mixed((key + _GOLDEN) ^ origins[k, axis])
            key = mixed((key + _GOLDEN) ^ directions[k, axis])
        numbers[k, 0] = float(mixed(key + _GOLDEN) >> _11) * _ULP
        numbers[k, 1] = float(mixed(key + _GOLDEN + _GOLDEN) >> _11) * _ULP
