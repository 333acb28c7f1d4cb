"""Snell's law at a dielectric surface, and its adjoint.

``ratio`` is n_before / n_after; normals point along the ray, ``c = d.n > 0``.
"""

from math import sqrt

from lensforge.kernels.jit import inline


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
