"""Polarised light along a chain of faces: two fields of each ray, through refractions and reflections, and adjoints.

Unpolarised light is two fields across the ray and each other, vectors whose squared lengths add up to 2; half of their
sum is the share of the flux that is left (Yun, Crabtree and Chipman, Appl. Opt. 50, 2855 (2011)). With u = n - c d, the
part of the normal across the ray, a face makes of a field e

    M (a e + k (n.e) u),    k = (a_p - a_s) / sin^2

with the amplitude a = a_s across the plane of incidence and a_p in it; M turns d to the new direction b: the rotation
about their common normal where light is refracted, the reflection I - 2 n n where it is reflected. Nothing in it is
singular at normal incidence, where that plane is none. Amplitudes are roots of what a face transmits; in total
reflection they are complex, and their common phase stays in them.
"""

from math import sqrt
from typing import NamedTuple

from lensforge.kernels.compiled import inline
from lensforge.kernels.vectors import add_scaled, cross, dot, linear_combination, unit

_NONE = (0.0, 0.0, 0.0)
_DARK = 1e-12  # transmittance below which the slope of its root no longer counts


@inline
def unpolarised(d):
    """Two unit vectors perpendicular to the direction d and to each other."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    along_x = x <= y and x <= z  # the least component: the first vector has none there
    along_y = not along_x and y <= z
    first = unit(
        (
            0.0 if along_x else (-d[2] if along_y else d[1]),
            d[2] if along_x else (0.0 if along_y else -d[0]),
            -d[1] if along_x else (d[0] if along_y else 0.0),
        )
    )
    return first, cross(d, first)


@inline
def passing(transmittances, slopes):
    """Amplitude a and k of light that passes, as (a, 0), (k, 0), and their derivatives by the cosine before the face.

    ``transmittances``: ``(t_s, t_p, excess)`` as in ``kernels.fresnel``, with their ``slopes``.
    """
    a = sqrt(max(transmittances[0], _DARK))
    p = sqrt(max(transmittances[1], _DARK))
    by_a = 0.5 * slopes[0] / a
    by_p = 0.5 * slopes[1] / p
    k = transmittances[2] / (a + p)
    return (a, 0.0), (k, 0.0), (by_a, 0.0), ((slopes[2] - k * (by_a + by_p)) / (a + p), 0.0)


@inline
def reflecting(c, ratio):
    """Complex amplitude a and k of light that is reflected totally (Born and Wolf, 1.5.4), and their derivatives by c.

    With the evanescent cosine i Q behind the face: ``a_s = (r c - i Q) / (r c + i Q)``, ``a_p = -(c - i r Q) /
    (c + i r Q)`` with the sign by which both are equal at normal incidence.
    """
    r = ratio
    Q = sqrt(max(r * r * (1.0 - c * c) - 1.0, _DARK))
    by_Q = -r * r * c / Q
    over = 1.0 / (r * r - 1.0)
    P = c * c + r * r * Q * Q
    by_P = 2.0 * c * (1.0 - r * r * r * r)
    real_part = c * c - Q * Q
    by_one = 2.0 * c * (1.0 + r * r)
    two = c * Q
    by_two = Q + c * by_Q
    real = -2.0 * r * r / P
    imaginary = 2.0 * r * (r * r + 1.0) / P
    return (
        ((r * r * c * c - Q * Q) * over, -2.0 * r * two * over),
        (real * real_part, imaginary * two),
        (4.0 * r * r * c * over, -2.0 * r * by_two * over),
        (real * (by_one - real_part * by_P / P), imaginary * (by_two - two * by_P / P)),
    )


class FieldTurn(NamedTuple):
    """A face that turns fields: a and k (complex), unit normal, u, directions on both sides, whether it reflects."""

    a: tuple[float, float]
    k: tuple[float, float]
    n: tuple[float, float, float]
    u: tuple[float, float, float]
    d: tuple[float, float, float]
    b: tuple[float, float, float]
    mirrored: bool


@inline
def _before_turn(real, imaginary, face):
    """``a e + k (n.e) u`` of a field, and k (n.e)."""
    a = face.a
    k = face.k
    w, v = dot(face.n, real), dot(face.n, imaginary)
    p = k[0] * w - k[1] * v
    q = k[0] * v + k[1] * w
    return (
        add_scaled(linear_combination(a[0], real, -a[1], imaginary), p, face.u),
        add_scaled(linear_combination(a[0], imaginary, a[1], real), q, face.u),
        p,
        q,
    )


@inline
def turn_vector(y, face):
    """A vector perpendicular to the direction before a face, or a turn, as one perpendicular to that behind."""
    if face.mirrored:
        return add_scaled(y, -2.0 * dot(face.n, y), face.n)
    along = dot(face.b, y) / (1.0 + dot(face.d, face.b))
    return add_scaled(add_scaled(y, -along, face.d), -along, face.b)


@inline
def field_behind(real, imaginary, face):
    """A field behind a face, its real and its imaginary part; ``face``: a :class:`FieldTurn`."""
    along, across, _, _ = _before_turn(real, imaginary, face)
    return turn_vector(along, face), turn_vector(across, face)


@inline
def turn_vector_adjoint(y, g, face):
    """Adjoint of M y: from the sensitivity g to it, to y, n, d and b."""
    n = face.n
    d = face.d
    b = face.b
    if face.mirrored:
        onto = dot(n, g)
        along = dot(n, y)
        return add_scaled(g, -2.0 * onto, n), linear_combination(-2.0 * along, g, -2.0 * onto, y), _NONE, _NONE
    per_turn = 1.0 / (1.0 + dot(d, b))
    onto = (dot(d, g) + dot(b, g)) * per_turn
    along = dot(b, y) * per_turn
    return (
        add_scaled(g, -onto, b),
        _NONE,
        linear_combination(-along, g, onto * along, b),
        add_scaled(linear_combination(-along, g, onto * along, d), -onto, y),
    )


@inline
def field_adjoint(real, imaginary, g, h, face):
    """Adjoint of :func:`field_behind`: from the sensitivities g, h to both parts behind the face.

    Returns those to both parts before it, to n, u, d and b, and to a and k (complex).
    """
    a = face.a
    k = face.k
    n = face.n
    u = face.u
    along, across, p, q = _before_turn(real, imaginary, face)
    g, by_n, by_d, by_b = turn_vector_adjoint(along, g, face)
    h, also_n, also_d, also_b = turn_vector_adjoint(across, h, face)
    w, v = dot(n, real), dot(n, imaginary)
    on_p = dot(u, g)
    on_q = dot(u, h)
    on_w, on_v = k[0] * on_p + k[1] * on_q, k[0] * on_q - k[1] * on_p
    return (
        add_scaled(linear_combination(a[0], g, a[1], h), on_w, n),
        add_scaled(linear_combination(a[0], h, -a[1], g), on_v, n),
        add_scaled(add_scaled(add_scaled(by_n, 1.0, also_n), on_w, real), on_v, imaginary),
        linear_combination(p, g, q, h),
        add_scaled(by_d, 1.0, also_d),
        add_scaled(by_b, 1.0, also_b),
        (dot(g, real) + dot(h, imaginary), dot(h, real) - dot(g, imaginary)),
        (w * on_p + v * on_q, w * on_q - v * on_p),
    )


@inline
def reflect(d, n, c):
    """Direction after a reflection."""
    return add_scaled(d, -2.0 * c, n)
