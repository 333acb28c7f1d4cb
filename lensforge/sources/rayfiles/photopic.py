"""Luminous efficacy of a spectrum, to cross-check the lm of a file against its W."""

import numpy as np
from jaxtyping import Float

_LUMENS_PER_WATT = 683.002  # at 555 nm, K_cd of the SI
# CIE 1924 photopic luminous efficiency V, 380 to 780 nm in steps of 10 nm.
_V_NM = np.arange(380.0, 781.0, 10.0)
_V = np.array([
    0.000039, 0.00012, 0.000396, 0.00121, 0.0040, 0.0116, 0.023, 0.038, 0.060, 0.09098, 0.13902, 0.20802, 0.323, 0.503,
    0.710, 0.862, 0.954, 0.99495, 0.995, 0.952, 0.870, 0.757, 0.631, 0.503, 0.381, 0.265, 0.175, 0.107, 0.061, 0.032,
    0.017, 0.00821, 0.004102, 0.002091, 0.001047, 0.00052, 0.000249, 0.00012, 0.00006, 0.00003, 0.000015,
])  # fmt: skip


def luminous_efficacy(wavelengths_nm: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float | None:
    """lm/W of a tabulated spectral density (trapezoids, V interpolated in its logarithm); None if it has no area."""
    power = np.trapezoid(weights, wavelengths_nm)
    if len(weights) < 2 or not power > 0.0:
        return None
    sensitivity = np.exp(np.interp(wavelengths_nm, _V_NM, np.log(_V)))
    sensitivity[(wavelengths_nm < _V_NM[0]) | (wavelengths_nm > _V_NM[-1])] = 0.0
    return float(_LUMENS_PER_WATT * np.trapezoid(weights * sensitivity, wavelengths_nm) / power)
