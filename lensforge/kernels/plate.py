"""Rays through a plane-parallel plate at right angles to z, in front of the lens, and the adjoint.

``plate`` is ``(Fresnel losses?, n_around / n_plate, thickness in mm, absorption in 1/mm)``; ``coating`` the table of
the reflectance of its faces, or None; ``rows`` the place of each ray among its rows, or one for all. Rays that did not
leave the lens, or go sideways or back, never meet it. Both of its faces have one plane of incidence, with z: of what
comes polarised in it, ``axial`` over the squared sine, each transmits t_p, of the rest t_s.
"""

from math import exp, sqrt

from lensforge.kernels.fates import Fate
from lensforge.kernels.jit import inline, kernel
from lensforge.kernels.polarisation import coated_transmittances, transmittances
from lensforge.kernels.refraction import transmitted_cosine_squared


@inline
def _passed(c, plate, coating, row):
    """Distance (mm) by which a ray of cosine ``c`` seems to start nearer, and its slope; what passes, and its slopes.

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
    if coating is None:
        (t_s, t_p, excess), (by_s, by_p, by_excess) = transmittances(c, q, ratio)
    else:
        (t_s, t_p, excess), (by_s, by_p, by_excess) = coated_transmittances(c, q, ratio, coating, row)
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
        row = rows[min(k, len(rows) - 1)] if coating is not None else 0.0
        nearer, _, share, _ = _passed(c, plate, coating, row)
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
        row = rows[min(k, len(rows) - 1)] if coating is not None else 0.0
        _, by_nearer, share, by_share = _passed(c, plate, coating, row)
        by_passed = emitted[k] * by_share[0] + axial[k] * by_share[1]
        by_cosines[k] += by_heights[k] * by_nearer + by_flux[k] * by_passed
        by_axial[k] = by_flux[k] * share[1]
        by_flux[k] *= share[0]
