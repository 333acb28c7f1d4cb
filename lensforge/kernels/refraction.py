"""Snell's law and Fresnel's equations at a dielectric surface, and their adjoints.

``ratio`` is n_before / n_after; normals point along the ray, ``c = d.n > 0``.
"""

from math import sqrt

from lensforge.kernels.jit import inline
from lensforge.kernels.spline import cubic_splines, index_at


@inline
def transmitted_cosine_squared(c, ratio):
    """Squared cosine behind the surface; 0 and below means total reflection.

    ``1 - ratio^2 (1 - c^2)`` without its cancellations: at a ratio of 1 even grazing rays are undeviated.
    """
    return (1.0 - ratio) * (1.0 + ratio) + (ratio * c) * (ratio * c)


@inline
def transmittance(c, q, ratio):
    """Unpolarised Fresnel transmittance (Born & Wolf 1.5.2) and its derivative with respect to ``c``."""
    r_s = (ratio * c - q) / (ratio * c + q)
    r_p = (c - ratio * q) / (c + ratio * q)
    dq = ratio * ratio * c / q
    by_r_s = 2.0 * ratio * (q - c * dq) / ((ratio * c + q) * (ratio * c + q))
    by_r_p = 2.0 * ratio * (q - c * dq) / ((c + ratio * q) * (c + ratio * q))
    value = 1.0 - 0.5 * (r_s * r_s + r_p * r_p)
    return value, -(r_s * by_r_s + r_p * by_r_p)


@inline
def coated_transmittance(c, q, ratio, table, row):
    """Transmittance of a coated face, and its derivative with respect to ``c``.

    ``table``: coefficients of its reflectance, splines over the cosine in the less dense medium, from 0 to 1, of one
    wavelength or in rows; ``row``: place among the rows.
    """
    cells = table.shape[-1] - 3
    cosine = c if ratio < 1.0 else q
    position = cosine * cells
    i = int(index_at(position, cells - 1.0))  # a ray that is reflected totally has no cosine behind the face
    w, d, _ = cubic_splines(position - i)
    value, slope = 0.0, 0.0
    if table.ndim == 1:  # known to the compiler: it leaves out the other case
        for j in range(4):
            value += w[j] * table[i + j]
            slope += d[j] * table[i + j]
    else:
        low = min(int(row), max(table.shape[0] - 2, 0))
        high = min(low + 1, table.shape[0] - 1)
        share = row - low
        for j in range(4):
            coefficient = table[low, i + j] + share * (table[high, i + j] - table[low, i + j])
            value += w[j] * coefficient
            slope += d[j] * coefficient
    by_c = 1.0 if ratio < 1.0 else ratio * ratio * c / q
    return 1.0 - value, -slope * cells * by_c


@inline
def outward_normal(x, y, z, rho_x, rho_y):
    """Gradient of ``|p| - rho(p/|p|)`` from the table's slopes: not normalised, pointing away from the origin."""
    r = sqrt(x * x + y * y + z * z)
    per_r, per_shift = 1.0 / r, 1.0 / (r + z)
    radial = (rho_x * x + rho_y * y) * per_shift * per_shift
    along = (1.0 + radial) * per_r
    return x * along - rho_x * per_shift, y * along - rho_y * per_shift, z * along + radial


@inline
def refract(dx, dy, dz, nx, ny, nz, ratio):
    """Direction behind a surface with normal (nx, ny, nz) of any length; cosines before and behind (squared)."""
    length = sqrt(nx * nx + ny * ny + nz * nz)
    nx, ny, nz = nx / length, ny / length, nz / length
    c = dx * nx + dy * ny + dz * nz
    q_squared = transmitted_cosine_squared(c, ratio)
    if q_squared <= 0.0:
        return dx, dy, dz, c, q_squared
    along = sqrt(q_squared) - ratio * c
    return ratio * dx + along * nx, ratio * dy + along * ny, ratio * dz + along * nz, c, q_squared


@inline
def refract_adjoint(dx, dy, dz, nx, ny, nz, ratio, ex, ey, ez, by_cosine):
    """Adjoint of ``refract``: from sensitivities to the new direction (e) and to the cosine before, to d and n."""
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
    mx, my, mz = along * ex + by_cosine * dx, along * ey + by_cosine * dy, along * ez + by_cosine * dz
    radial = mx * nx + my * ny + mz * nz
    return (
        ratio * ex + by_cosine * nx,
        ratio * ey + by_cosine * ny,
        ratio * ez + by_cosine * nz,
        (mx - radial * nx) / length,
        (my - radial * ny) / length,
        (mz - radial * nz) / length,
    )
