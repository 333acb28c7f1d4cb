"""Limits of two refractions, into a body and out of it: how far they turn a ray, and how much of it they transmit.

Each face is that of a dielectric in air, the light at each unpolarised, as the tracers take it.
"""

from math import acos

import numpy as np
from jaxtyping import Float

Turns = Float[np.ndarray, "*n"]


def largest_deviation_rad(refractive_index: float) -> float:
    """Largest angle by which two refractions turn a ray, into a body and out of it: twice ``acos(1/n)``.

    Each turns it by at most the difference between grazing incidence and the critical angle.
    """
    return 2.0 * acos(1.0 / refractive_index)


def best_transmittance(deviation_rad: Turns, refractive_index: float | Turns) -> Turns:
    """Largest transmittance of two faces that turn a ray by ``deviation_rad`` at least; 0 beyond the largest deviation.

    The logarithm of one face's transmittance is concave in its deviation, so that both do best to turn the ray by half
    of it each, in one plane.
    """
    once = face_transmittance(0.5 * np.maximum(deviation_rad, 0.0), refractive_index)
    both: Turns = once * once
    return both


def face_transmittance(deviation_rad: Turns, refractive_index: float | Turns) -> Turns:
    """Transmittance of one face that turns unpolarised light by ``deviation_rad``; 0 where it cannot.

    ``i``, the angle in air, has ``sin i = n sin(i - d)``, so ``tan i = n sin d / (n cos d - 1)``; then Fresnel's
    formulas (Born and Wolf, Principles of Optics, 1.5.2).
    """
    index = np.asarray(refractive_index, dtype=np.float64)
    below = index * np.cos(deviation_rad) - 1.0
    air = np.arctan2(index * np.sin(deviation_rad), np.maximum(below, 0.0))
    cosine, inside = np.cos(air), np.cos(air - deviation_rad)
    with np.errstate(invalid="ignore", divide="ignore"):
        r_s = (cosine - index * inside) / (cosine + index * inside)
        r_p = (index * cosine - inside) / (index * cosine + inside)
        transmitted: Turns = 1.0 - 0.5 * (r_s**2 + r_p**2)
    turned: Turns = np.where((below > 0.0) | (deviation_rad == 0.0), transmitted, 0.0)
    return turned


def normal_transmittance(refractive_index: float) -> float:
    """Transmittance of one surface at normal incidence; two of them bound a lens's efficiency, 0.923 for PMMA."""
    return 1.0 - ((refractive_index - 1.0) / (refractive_index + 1.0)) ** 2
