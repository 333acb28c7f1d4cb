"""A plane-parallel plate across z in front of the lens: rays behind it, and the adjoint."""

from math import exp, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.kernels.compiled import inline, kernel
from lensforge.kernels.fate import Fate
from lensforge.kernels.fresnel import through_face, transmitted_cosine_squared
from lensforge.kernels.traced_body import own_or_shared


class GlassPlate(NamedTuple):
    """The plate as the kernels take it.

    ``ratio``: of the indices around it and in it; ``film``: the table of both faces, None for bare ones.
    """

    fresnel: bool
    ratio: float
    thickness_mm: float
    absorption_per_mm: float
    film: Float[np.ndarray, "*rows m 2"] | None


@inline
def _passed(c, plate, row):
    """Apparent shift (mm) and transmittance of the plate for a ray of cosine ``c``, with derivatives by c.

    The shift of a plate of thickness d is ``d (1 - ratio c / q)``, the light that it absorbs ``1 - exp(-a d / q)``
    (Beer and Lambert). The transmittance is of the flux, and of the flux along z. ``row``: of the ray in the tables of
    the film.
    """
    ratio = plate.ratio
    thickness = plate.thickness_mm
    absorption = plate.absorption_per_mm
    q = sqrt(transmitted_cosine_squared(c, ratio))
    dq = ratio * ratio * c / q
    nearer = thickness * (1.0 - ratio * c / q)
    by_nearer = -thickness * ratio * (q - c * dq) / (q * q)
    clear = exp(-absorption * thickness / q)
    by_clear = clear * absorption * thickness * dq / (q * q)
    if not plate.fresnel:
        return nearer, by_nearer, (clear, 0.0), (by_clear, 0.0)
    (t_s, t_p, excess), (by_s, by_p, by_excess) = through_face(c, q, ratio, plate.film, row)
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
def behind_plate(rays, plate, rows, lost):
    """Move the points of ``rays`` (a ``RaysOut``) along z, and take the flux ``lost`` in the plate from them.

    ``rows``: row of each ray in the table of the film, or one for all.
    """
    for k in range(len(rays.flux)):
        lost[k] = 0.0
        c = rays.directions[k, 2]
        if rays.fates[k] != Fate.LEFT_LENS or not c > 0.0:
            continue
        nearer, _, share, _ = _passed(c, plate, own_or_shared(rows, k))
        rays.points[k, 2] += nearer
        passed = rays.flux[k] * share[0] + rays.axial[k] * share[1]
        lost[k] = rays.flux[k] - passed
        rays.flux[k] = passed


@kernel
def behind_plate_adjoint(rays, plate, rows, by):
    """Take the sensitivities ``by`` (a ``ByRaysOut``) to the rays behind the plate to those before it, ``rays``.

    Those to points are the same on both sides; those to the axial flux are filled.
    """
    for k in range(len(by.by_flux)):
        by.by_axial[k] = 0.0
        c = rays.directions[k, 2]
        if rays.fates[k] != Fate.LEFT_LENS or not c > 0.0:
            continue
        _, by_nearer, share, by_share = _passed(c, plate, own_or_shared(rows, k))
        by_passed = rays.flux[k] * by_share[0] + rays.axial[k] * by_share[1]
        by.by_directions[k, 2] += by.by_points[k, 2] * by_nearer + by.by_flux[k] * by_passed
        by.by_axial[k] = by.by_flux[k] * share[1]
        by.by_flux[k] *= share[0]
