"""Snell's law and Fresnel's transmittances of a face and of pairs of faces, and their adjoints.

``ratio`` is n_before / n_after; normals point along the ray, ``c = d.n > 0``; ``q`` is the cosine behind the face. What
a face transmits of light polarised across (s) and in (p) its plane of incidence comes as ``(t_s, t_p, excess)``:
``t_p - t_s`` is ``excess`` times the squared sine of the angle of incidence, so that nothing is singular at normal
incidence, where that plane is none.
"""

from math import sqrt
from typing import NamedTuple

from lensforge.kernels.bicubic import cubic_splines, index_at
from lensforge.kernels.compiled import inline
from lensforge.kernels.vectors import add_scaled, dot, length_of, linear_combination, scaled


@inline
def transmitted_cosine_squared(c, ratio):
    """Squared cosine behind the surface; 0 and below means total reflection.

    ``1 - ratio^2 (1 - c^2)`` without its cancellations: at a ratio of 1 even grazing rays are undeviated.
    """
    return (1.0 - ratio) * (1.0 + ratio) + (ratio * c) * (ratio * c)


@inline
def outward_normal(p, rho_x, rho_y):
    """Gradient of ``|p| - rho(p/|p|)`` from the table's slopes: not normalised, pointing away from the origin."""
    x, y, z = p
    r = sqrt(x * x + y * y + z * z)
    per_r = 1.0 / r
    per_shift = 1.0 / (r + z)
    radial = (rho_x * x + rho_y * y) * per_shift * per_shift
    along = (1.0 + radial) * per_r
    return x * along - rho_x * per_shift, y * along - rho_y * per_shift, z * along + radial


@inline
def refract(d, n, ratio):
    """Direction behind a surface with unit normal n, or that before it; cosines before and behind (squared).

    Snell's law as vectors: ``ratio d + (q - ratio c) n``.
    """
    c = dot(d, n)
    q_squared = transmitted_cosine_squared(c, ratio)
    if q_squared <= 0.0:
        return d, c, q_squared
    return linear_combination(ratio, d, sqrt(q_squared) - ratio * c, n), c, q_squared


@inline
def refract_adjoint(d, tilted, ratio, e, by_cosine, by_normal):
    """Adjoint of ``refract``: from sensitivities to the new direction (e) and to the cosine before, to those before.

    ``tilted``: the normal, not normalised; ``by_normal``: sensitivity to the unit normal beside that through these.
    Returns those to d and to ``tilted``.
    """
    length = length_of(tilted)
    n = tilted[0] / length, tilted[1] / length, tilted[2] / length
    c = dot(d, n)
    q_squared = transmitted_cosine_squared(c, ratio)
    if q_squared > 0.0:
        q = sqrt(q_squared)
        along = q - ratio * c
        by_cosine += dot(n, e) * (ratio * ratio * c / q - ratio)
    else:  # totally reflected: only the cosine matters
        ratio = 0.0
        along = 0.0
    m = add_scaled(linear_combination(along, e, by_cosine, d), 1.0, by_normal)
    across = add_scaled(m, -dot(m, n), n)
    return linear_combination(ratio, e, by_cosine, n), (across[0] / length, across[1] / length, across[2] / length)


@inline
def reflect_adjoint(d, tilted, e, by_cosine, by_normal):
    """:func:`refract_adjoint` of a reflection, to d - 2 (d.n) n."""
    length = length_of(tilted)
    n = tilted[0] / length, tilted[1] / length, tilted[2] / length
    by_cosine -= 2.0 * dot(n, e)
    m = add_scaled(linear_combination(-2.0 * dot(d, n), e, by_cosine, d), 1.0, by_normal)
    across = add_scaled(m, -dot(m, n), n)
    return add_scaled(e, by_cosine, n), (across[0] / length, across[1] / length, across[2] / length)


_DARK = 1e-12  # transmittance below which the slope of its root no longer counts


@inline
def transmittances(c, q, ratio):
    """Fresnel's transmittances (Born & Wolf 1.5.2), and their derivatives with respect to ``c``.

    ``t = 1 - r^2`` with ``r_s = (ratio c - q) / (ratio c + q)`` and ``r_p = (c - ratio q) / (c + ratio q)``.
    The sine of the turn is ``q - ratio c`` times that of the angle of incidence, and its squared cosine ``t_s / t_p``.
    """
    r_s = (ratio * c - q) / (ratio * c + q)
    r_p = (c - ratio * q) / (c + ratio * q)
    dq = ratio * ratio * c / q
    by_r_s = 2.0 * ratio * (q - c * dq) / ((ratio * c + q) * (ratio * c + q))
    by_r_p = 2.0 * ratio * (q - c * dq) / ((c + ratio * q) * (c + ratio * q))
    t_p = 1.0 - r_p * r_p
    by_t_p = -2.0 * r_p * by_r_p
    turn = q - ratio * c
    by_excess = turn * (by_t_p * turn + 2.0 * t_p * (dq - ratio))
    return (1.0 - r_s * r_s, t_p, t_p * turn * turn), (-2.0 * r_s * by_r_s, by_t_p, by_excess)


@inline
def coated_transmittances(c, q, ratio, table, row):
    """Transmittances of a coated face, and their derivatives with respect to ``c``.

    ``table``: as in ``optics.coatings.coating_tables``, of one wavelength or in rows; ``row``: place among the rows.
    """
    cells = table.shape[-2] - 3
    cosine = c if ratio < 1.0 else q
    position = cosine * cells
    i = int(index_at(position, cells - 1.0))  # a ray that is reflected totally has no cosine behind the face
    w, d, _ = cubic_splines(position - i)
    mean = 0.0
    by_mean = 0.0
    excess = 0.0
    by_excess = 0.0
    if table.ndim == 2:  # known to the compiler: it leaves out the other case
        for j in range(4):
            mean += w[j] * table[i + j, 0]
            by_mean += d[j] * table[i + j, 0]
            excess += w[j] * table[i + j, 1]
            by_excess += d[j] * table[i + j, 1]
    else:
        low = min(int(row), max(table.shape[0] - 2, 0))
        high = min(low + 1, table.shape[0] - 1)
        share = row - low
        for j in range(4):
            first = table[low, i + j, 0] + share * (table[high, i + j, 0] - table[low, i + j, 0])
            second = table[low, i + j, 1] + share * (table[high, i + j, 1] - table[low, i + j, 1])
            mean += w[j] * first
            by_mean += d[j] * first
            excess += w[j] * second
            by_excess += d[j] * second
    by_c = cells * (1.0 if ratio < 1.0 else ratio * ratio * c / q)
    by_mean = by_mean * by_c
    by_excess = by_excess * by_c
    wider = 1.0 if ratio < 1.0 else ratio * ratio  # squared sine in the less dense medium over that before the face
    excess = excess * wider
    by_excess = by_excess * wider
    half = 0.5 * excess * (1.0 - c * c)
    by_half = 0.5 * by_excess * (1.0 - c * c) - excess * c
    return (
        (1.0 - mean - half, 1.0 - mean + half, excess),
        (-by_mean - by_half, -by_mean + by_half, by_excess),
    )


class SecondFace(NamedTuple):
    """The second face on a ray's path: index ratio, cosines before and behind, unit normal, directions there."""

    ratio: float
    c: float
    q: float
    n: tuple[float, float, float]
    d: tuple[float, float, float]
    b: tuple[float, float, float]


@inline
def polarised_share(first, second, y):
    """Share of unpolarised light that passes two faces, and its derivatives by all arguments.

    Both are ``(t_s, t_p, excess)``, the excess of the first per squared sine behind it; ``y = m.n - (m.d)(n.d)`` of
    their normals m and n, and the direction d between them: the product of both sines and of the cosine of the angle
    between the planes of incidence.
    """
    s, p, g = first
    t_s, t_p, h = second
    share = 0.5 * (s * t_p + p * t_s + g * h * y * y)
    return share, (0.5 * t_p, 0.5 * t_s, 0.5 * h * y * y), (0.5 * p, 0.5 * s, 0.5 * g * y * y), g * h * y


@inline
def axial_share(first, second, m, at, axis):
    """Share of unpolarised light that passes two faces with its field along the unit vector ``axis``, and derivatives.

    That along an axis is the sum over both polarisations of the flux times the squared part of the unit field along
    it. Arguments as in :func:`polarised_share`; ``at``: a :class:`SecondFace`. Derivatives by the first, the second, c,
    y, and the vectors m, n, d and b.

    The axis is taken back through the second face to a vector v across d: the part across the plane of incidence times
    the root of t_s, that in it times the root of t_p. Behind the first face the field has ``t_s/2`` along each line
    across d, and ``excess/2`` more times the squared part of m along it.
    """
    s, _, g = first
    t_s, t_p, h = second
    ratio, c, q, n, d, b = at
    root_s = sqrt(max(t_s, _DARK))
    root_p = sqrt(max(t_p, _DARK))
    m_d = dot(m, d)
    m_b = dot(m, b)
    y = dot(m, n) - m_d * c
    onto = dot(axis, b)
    before = dot(axis, d)
    per_turn = 1.0 / (1.0 + dot(d, b))
    k = (onto + before) * per_turn
    e = dot(axis, n) - q * onto
    turned = dot(axis, m) - k * (m_d + m_b) + onto * m_d
    per_roots = 1.0 / (root_s + root_p)
    per_ratio = 1.0 / ratio
    f = h * per_roots * per_ratio
    squared = t_s * (1.0 - onto * onto) + h * (e * per_ratio) * (e * per_ratio)
    part = root_s * turned + f * e * y
    share = 0.5 * (s * squared + g * part * part)
    by_squared = 0.5 * s
    by_part = g * part
    by_f = by_part * e * y
    by_roots = -by_f * f * per_roots
    by_e = 2.0 * by_squared * h * e * per_ratio * per_ratio + by_part * f * y
    by_turned = by_part * root_s
    by_sum = -by_turned * k
    by_k = -by_turned * (m_d + m_b) * per_turn
    by_onto = -2.0 * by_squared * t_s * onto - by_e * q + by_turned * m_d + by_k
    by_turn = -by_k * k
    return (
        share,
        (0.5 * squared, 0.0, 0.5 * part * part),
        (
            by_squared * (1.0 - onto * onto) + 0.5 * (by_part * turned + by_roots) / root_s,
            0.5 * by_roots / root_p,
            by_squared * e * e * per_ratio * per_ratio + by_f * per_roots * per_ratio,
        ),
        -by_e * onto * ratio * ratio * c / q,
        by_part * f * e,
        add_scaled(linear_combination(by_turned, axis, by_sum + by_turned * onto, d), by_sum, b),
        scaled(by_e, axis),
        add_scaled(linear_combination(by_k, axis, by_sum + by_turned * onto, m), by_turn, b),
        add_scaled(linear_combination(by_onto, axis, by_sum, m), by_turn, d),
    )


@inline
def through_face(c, q, ratio, film, row):
    """Transmittances of a face, and their derivatives by c; ``row``: place among the rows of its ``film``, if any."""
    if film is None:
        return transmittances(c, q, ratio)
    return coated_transmittances(c, q, ratio, film, row)


@inline
def through(c, q, ratio, fresnel, film, row):
    """:func:`through_face`, or all light without ``fresnel``."""
    if not fresnel:
        return (1.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    return through_face(c, q, ratio, film, row)


@inline
def through_both(first, second, slopes, m, at, axis, by, by_axial):
    """Sensitivities of the light that passes two faces, from those to its flux and to that along ``axis``, if any.

    Arguments as in :func:`axial_share`; ``slopes``: of the second by c. Returns the sum of both, each times what passes
    of it, and sensitivities to the first, c, m, n, d and b; all for unit flux before the first face.
    """
    c = at.c
    n = at.n
    d = at.d
    along = dot(m, d)
    share, by_first, by_second, by_y = polarised_share(first, second, dot(m, n) - along * c)
    by_first = scaled(by, by_first)
    by_c = by * dot(by_second, slopes)
    by_y = by * by_y
    by_m = scaled(0.0, m)
    by_n = scaled(0.0, n)
    by_d = scaled(0.0, d)
    by_b = scaled(0.0, at.b)
    value = by * share
    if axis is not None:
        by = by_axial
        part, on_first, on_second, on_c, on_y, by_m, by_n, by_d, by_b = axial_share(first, second, m, at, axis)
        value += by * part
        by_first = add_scaled(by_first, by, on_first)
        by_c = by_c + by * (dot(on_second, slopes) + on_c)
        by_y = by_y + by * on_y
        by_m = scaled(by, by_m)
        by_n = scaled(by, by_n)
        by_d = scaled(by, by_d)
        by_b = scaled(by, by_b)
    by_m = add_scaled(add_scaled(by_m, by_y, n), -by_y * c, d)
    by_n = add_scaled(add_scaled(by_n, by_y, m), -by_y * along, d)
    by_d = add_scaled(add_scaled(by_d, -by_y * c, m), -by_y * along, n)
    return value, by_first, by_c, by_m, by_n, by_d, by_b
