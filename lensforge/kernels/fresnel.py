"""Snell's law and Fresnel's transmittances of a face, of pairs of faces and of a plate, and their adjoints.

``ratio`` is n_before / n_after; normals point along the ray, ``c = d.n > 0``; ``q`` is the cosine behind the face. What
a face transmits of light polarised across (s) and in (p) its plane of incidence comes as ``(t_s, t_p, excess)``:
``t_p - t_s`` is ``excess`` times the squared sine of the angle of incidence, so that nothing is singular at normal
incidence, where that plane is none.

``plate`` is plane-parallel, at right angles to z and in front of the lens: ``(Fresnel losses?, n_around / n_plate,
thickness in mm, absorption in 1/mm)``.
"""

from math import exp, sqrt

from lensforge.kernels.bicubic import cubic_splines, index_at
from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.fate import Fate


@inline
def transmitted_cosine_squared(c, ratio):
    """Squared cosine behind the surface; 0 and below means total reflection.

    ``1 - ratio^2 (1 - c^2)`` without its cancellations: at a ratio of 1 even grazing rays are undeviated.
    """
    return (1.0 - ratio) * (1.0 + ratio) + (ratio * c) * (ratio * c)


@inline
def outward_normal(x, y, z, rho_x, rho_y):
    """Gradient of ``|p| - rho(p/|p|)`` from the table's slopes: not normalised, pointing away from the origin."""
    r = sqrt(x * x + y * y + z * z)
    per_r, per_shift = 1.0 / r, 1.0 / (r + z)
    radial = (rho_x * x + rho_y * y) * per_shift * per_shift
    along = (1.0 + radial) * per_r
    return x * along - rho_x * per_shift, y * along - rho_y * per_shift, z * along + radial


@inline
def unit(x, y, z):
    """The vector with length 1."""
    length = sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@inline
def refract(dx, dy, dz, nx, ny, nz, ratio):
    """Direction behind a surface with unit normal (nx, ny, nz); cosines before and behind (squared)."""
    c = dx * nx + dy * ny + dz * nz
    q_squared = transmitted_cosine_squared(c, ratio)
    if q_squared <= 0.0:
        return dx, dy, dz, c, q_squared
    along = sqrt(q_squared) - ratio * c
    return ratio * dx + along * nx, ratio * dy + along * ny, ratio * dz + along * nz, c, q_squared


@inline
def refract_adjoint(dx, dy, dz, nx, ny, nz, ratio, ex, ey, ez, by_cosine, ux, uy, uz):
    """Adjoint of ``refract``: from sensitivities to the new direction (e) and to the cosine before, to d and n.

    ``u``: sensitivity to the unit normal beside that through these.
    """
    length = sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    c = dx * nx + dy * ny + dz * nz
    q_squared = transmitted_cosine_squared(c, ratio)
    if q_squared > 0.0:
        q = sqrt(q_squared)
        along = q - ratio * c
        by_cosine += (nx * ex + ny * ey + nz * ez) * (ratio * ratio * c / q - ratio)
    else:  # totally reflected: only the cosine matters
        ratio = 0.0
        along = 0.0
    mx, my, mz = along * ex + by_cosine * dx + ux, along * ey + by_cosine * dy + uy, along * ez + by_cosine * dz + uz
    radial = mx * nx + my * ny + mz * nz
    return (
        ratio * ex + by_cosine * nx,
        ratio * ey + by_cosine * ny,
        ratio * ez + by_cosine * nz,
        (mx - radial * nx) / length,
        (my - radial * ny) / length,
        (mz - radial * nz) / length,
    )


_DARK = 1e-12  # transmittance below which the slope of its root no longer counts


@inline
def transmittances(c, q, ratio):
    """Fresnel's transmittances (Born & Wolf 1.5.2), and their derivatives with respect to ``c``.

    The sine of the turn is ``q - ratio c`` times that of the angle of incidence, and its squared cosine ``t_s / t_p``.
    """
    r_s = (ratio * c - q) / (ratio * c + q)
    r_p = (c - ratio * q) / (c + ratio * q)
    dq = ratio * ratio * c / q
    by_r_s = 2.0 * ratio * (q - c * dq) / ((ratio * c + q) * (ratio * c + q))
    by_r_p = 2.0 * ratio * (q - c * dq) / ((c + ratio * q) * (c + ratio * q))
    t_p, by_t_p, turn = 1.0 - r_p * r_p, -2.0 * r_p * by_r_p, q - ratio * c
    by_excess = turn * (by_t_p * turn + 2.0 * t_p * (dq - ratio))
    return (1.0 - r_s * r_s, t_p, t_p * turn * turn), (-2.0 * r_s * by_r_s, by_t_p, by_excess)


@inline
def coated_transmittances(c, q, ratio, table, row):
    """Transmittances of a coated face, and their derivatives with respect to ``c``.

    ``table``: as in ``optics.coating_tables``, of one wavelength or in rows; ``row``: place among the rows.
    """
    cells = table.shape[-2] - 3
    cosine = c if ratio < 1.0 else q
    position = cosine * cells
    i = int(index_at(position, cells - 1.0))  # a ray that is reflected totally has no cosine behind the face
    w, d, _ = cubic_splines(position - i)
    mean, by_mean, excess, by_excess = 0.0, 0.0, 0.0, 0.0
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
    by_mean, by_excess = by_mean * by_c, by_excess * by_c
    wider = 1.0 if ratio < 1.0 else ratio * ratio  # squared sine in the less dense medium over that before the face
    excess, by_excess = excess * wider, by_excess * wider
    half = 0.5 * excess * (1.0 - c * c)
    by_half = 0.5 * by_excess * (1.0 - c * c) - excess * c
    return (
        (1.0 - mean - half, 1.0 - mean + half, excess),
        (-by_mean - by_half, -by_mean + by_half, by_excess),
    )


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
def axial_share(first, second, ratio, c, q, m, n, d, b, axis):
    """Share of unpolarised light that passes two faces with its field along the unit vector ``axis``, and derivatives.

    That along an axis is the sum over both polarisations of the flux times the squared part of the unit field along
    it. Arguments as in :func:`polarised_share`; ``ratio``, ``c`` and ``q`` of the second face, ``b`` the direction
    behind it. Derivatives by the first, the second, c, y, and the vectors m, n, d and b.

    The axis is taken back through the second face to a vector v across d: the part across the plane of incidence times
    the root of t_s, that in it times the root of t_p. Behind the first face the field has ``t_s/2`` along each line
    across d, and ``excess/2`` more times the squared part of m along it.
    """
    s, _, g = first
    t_s, t_p, h = second
    root_s, root_p = sqrt(max(t_s, _DARK)), sqrt(max(t_p, _DARK))
    m_d = dot(m, d)
    m_b = dot(m, b)
    y = dot(m, n) - m_d * c
    onto, before = dot(axis, b), dot(axis, d)
    per_turn = 1.0 / (1.0 + dot(d, b))
    k = (onto + before) * per_turn
    e = dot(axis, n) - q * onto
    turned = dot(axis, m) - k * (m_d + m_b) + onto * m_d
    per_roots, per_ratio = 1.0 / (root_s + root_p), 1.0 / ratio
    f = h * per_roots * per_ratio
    squared, part = t_s * (1.0 - onto * onto) + h * (e * per_ratio) * (e * per_ratio), root_s * turned + f * e * y
    share = 0.5 * (s * squared + g * part * part)
    by_squared, by_part = 0.5 * s, g * part
    by_f = by_part * e * y
    by_roots = -by_f * f * per_roots
    by_e = 2.0 * by_squared * h * e * per_ratio * per_ratio + by_part * f * y
    by_turned = by_part * root_s
    by_sum, by_k = -by_turned * k, -by_turned * (m_d + m_b) * per_turn
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
        mixed(by_turned, axis, by_sum + by_turned * onto, d, by_sum, b),
        mixed(by_e, axis, 0.0, axis, 0.0, axis),
        mixed(by_k, axis, by_sum + by_turned * onto, m, by_turn, b),
        mixed(by_onto, axis, by_sum, m, by_turn, d),
    )


@inline
def through_face(c, q, ratio, coating, rows, k):
    """Transmittances of a face for ray k, coated or not, and their derivatives."""
    if coating is None:
        return transmittances(c, q, ratio)
    return coated_transmittances(c, q, ratio, coating, rows[min(k, len(rows) - 1)])


@inline
def through(c, q, ratio, fresnel, coating, rows, k):
    """Transmittances of a face, coated or not, and their derivatives by the cosine before it."""
    if not fresnel:
        return (1.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    return through_face(c, q, ratio, coating, rows, k)


@inline
def dot(a, b):
    """The scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def scaled(a, x):
    """The vector a x."""
    return a * x[0], a * x[1], a * x[2]


@inline
def mixed(a, x, b, y, c, z):
    """The vector a x + b y + c z."""
    return a * x[0] + b * y[0] + c * z[0], a * x[1] + b * y[1] + c * z[1], a * x[2] + b * y[2] + c * z[2]


@inline
def through_both(first, second, slopes, ratio, c, q, m, n, d, b, axis, by, by_axial):
    """Sensitivities of the light that passes two faces, from those to its flux and to that along ``axis``, if any.

    Arguments as in :func:`axial_share`; ``slopes``: of the second by c. Returns the sum of both, each times what passes
    of it, and sensitivities to the first, c, m, n, d and b; all for unit flux before the first face.
    """
    along = dot(m, d)
    share, by_first, by_second, by_y = polarised_share(first, second, dot(m, n) - along * c)
    by_first, by_c, by_y = scaled(by, by_first), by * dot(by_second, slopes), by * by_y
    by_m, by_n, by_d, by_b = scaled(0.0, m), scaled(0.0, n), scaled(0.0, d), scaled(0.0, b)
    value = by * share
    if axis is not None:
        by = by_axial
        part, on_first, on_second, on_c, on_y, by_m, by_n, by_d, by_b = axial_share(
            first, second, ratio, c, q, m, n, d, b, axis
        )
        value += by * part
        by_first = mixed(1.0, by_first, by, on_first, 0.0, on_first)
        by_c, by_y = by_c + by * (dot(on_second, slopes) + on_c), by_y + by * on_y
        by_m, by_n, by_d, by_b = scaled(by, by_m), scaled(by, by_n), scaled(by, by_d), scaled(by, by_b)
    by_m, by_n = mixed(1.0, by_m, by_y, n, -by_y * c, d), mixed(1.0, by_n, by_y, m, -by_y * along, d)
    return value, by_first, by_c, by_m, by_n, mixed(1.0, by_d, -by_y * c, m, -by_y * along, n), by_b


@inline
def _passed(c, plate, coating, rows, k):
    """Distance (mm) by which ray k of cosine ``c`` seems to start nearer, and its slope; what passes, and its slopes.

    Of the flux, and of the flux along z.
    """
    fresnel, ratio, thickness, absorption = plate
    q = sqrt(transmitted_cosine_squared(c, ratio))
    dq = ratio * ratio * c / q
    nearer = thickness * (1.0 - ratio * c / q)
    by_nearer = -thickness * ratio * (q - c * dq) / (q * q)
    clear = exp(-absorption * thickness / q)
    by_clear = clear * absorption * thickness * dq / (q * q)
    if not fresnel:
        return nearer, by_nearer, (clear, 0.0), (by_clear, 0.0)
    (t_s, t_p, excess), (by_s, by_p, by_excess) = through_face(c, q, ratio, coating, rows, k)
    more = (t_s + t_p) * excess
    return (
        nearer,
        by_nearer,
        (clear * t_s * t_s, clear * more),
        (
            by_clear * t_s * t_s + 2.0 * clear * t_s * by_s,
            by_clear * more + clear * ((by_s + by_p) * excess + (t_s + t_p) * by_excess),
        ),
    )


@kernel
def behind_plate(directions, fates, axial, plate, coating, rows, heights, flux, lost):
    """Move the heights z (mm) of the rays' points, and take from their flux what is ``lost`` in the plate."""
    for k in range(len(flux)):
        lost[k] = 0.0
        c = directions[k, 2]
        if fates[k] != Fate.LEFT_LENS or not c > 0.0:
            continue
        nearer, _, share, _ = _passed(c, plate, coating, rows, k)
        heights[k] += nearer
        passed = flux[k] * share[0] + axial[k] * share[1]
        lost[k] = flux[k] - passed
        flux[k] = passed


@kernel
def behind_plate_adjoint(
    directions, fates, emitted, axial, plate, coating, rows, by_heights, by_flux, by_axial, by_cosines
):
    """Sensitivities by the cosine ``directions[:, 2]``, added up, and ``by_flux`` from that behind the plate to before.

    ``emitted``: flux before the plate. Fills ``by_axial``.
    """
    for k in range(len(by_flux)):
        by_axial[k] = 0.0
        c = directions[k, 2]
        if fates[k] != Fate.LEFT_LENS or not c > 0.0:
            continue
        _, by_nearer, share, by_share = _passed(c, plate, coating, rows, k)
        by_passed = emitted[k] * by_share[0] + axial[k] * by_share[1]
        by_cosines[k] += by_heights[k] * by_nearer + by_flux[k] * by_passed
        by_axial[k] = by_flux[k] * share[1]
        by_flux[k] *= share[0]
