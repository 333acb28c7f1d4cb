"""Rays through a plane-parallel plate at right angles to z, in front of the lens, and the adjoint.

``plate`` is ``(Fresnel losses?, n_around / n_plate, thickness in mm, absorption in 1/mm)``; ``coating`` the table of
the reflectance of its faces, or None; ``rows`` the place of each ray among its rows, or one for all. Rays that did not
leave the lens, or go sideways or back, never meet it.
"""

from math import exp, sqrt

from lensforge.kernels.fates import Fate
from lensforge.kernels.jit import inline, kernel
from lensforge.kernels.refraction import coated_transmittance, transmittance, transmitted_cosine_squared


@inline
def _passed(c, plate, coating, row):
    """Distance (mm) by which a ray of cosine ``c`` seems to start nearer, the share that passes; both with slopes."""
    fresnel, ratio, thickness, absorption = plate
    q = sqrt(transmitted_cosine_squared(c, ratio))
    dq = ratio * ratio * c / q
    nearer = thickness * (1.0 - ratio * c / q)
    by_nearer = -thickness * ratio * (q - c * dq) / (q * q)
    share = exp(-absorption * thickness / q)
    by_share = share * absorption * thickness * dq / (q * q)
    if fresnel:
        if coating is None:
            face, by_face = transmittance(c, q, ratio)
        else:
            face, by_face = coated_transmittance(c, q, ratio, coating, row)
        by_share = by_share * face * face + 2.0 * share * face * by_face
        share *= face * face
    return nearer, by_nearer, share, by_share


@kernel
def behind_plate(directions, fates, plate, coating, rows, heights, flux, lost):
    """Move the heights z (mm) of the rays' points, and take from their flux what is ``lost`` in the plate."""
    for k in range(len(flux)):
        lost[k] = 0.0
        c = directions[k, 2]
        if fates[k] != Fate.LEFT_LENS or not c > 0.0:
            continue
        row = rows[min(k, len(rows) - 1)] if coating is not None else 0.0
        nearer, _, share, _ = _passed(c, plate, coating, row)
        heights[k] += nearer
        lost[k] = flux[k] * (1.0 - share)
        flux[k] *= share


@kernel
def behind_plate_adjoint(directions, fates, emitted, plate, coating, rows, by_heights, by_flux, by_cosines):
    """Sensitivities by the cosine ``directions[:, 2]``, added up, and ``by_flux`` from that behind the plate to before.

    ``emitted``: flux before the plate.
    """
    for k in range(len(by_flux)):
        c = directions[k, 2]
        if fates[k] != Fate.LEFT_LENS or not c > 0.0:
            continue
        row = rows[min(k, len(rows) - 1)] if coating is not None else 0.0
        _, by_nearer, share, by_share = _passed(c, plate, coating, row)
        by_cosines[k] += by_heights[k] * by_nearer + by_flux[k] * emitted[k] * by_share
        by_flux[k] *= share
