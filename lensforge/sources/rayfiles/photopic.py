"""Luminous efficacy of a spectrum, to cross-check the lm of a file against its W."""

import numpy as np
from jaxtyping import Float

_LUMENS_PER_WATT = 683.002  # at 555 nm, K_cd of the SI
# CIE 1924 photopic luminous efficiency V, 380 to 780 nm in steps of 5 nm.
_V_NM = np.arange(380.0, 781.0, 5.0)
_V = np.array([
    0.000039, 0.000064, 0.00012, 0.000217, 0.000396, 0.00064, 0.00121, 0.00218, 0.004, 0.0073, 0.0116, 0.01684,
    0.023, 0.0298, 0.038, 0.048, 0.06, 0.0739, 0.09098, 0.1126, 0.13902, 0.1693, 0.20802, 0.2586,
    0.323, 0.4073, 0.503, 0.6082, 0.71, 0.7932, 0.862, 0.91485, 0.954, 0.9803, 0.99495, 1.0,
    0.995, 0.9786, 0.952, 0.9154, 0.87, 0.8163, 0.757, 0.6949, 0.631, 0.5668, 0.503, 0.4412,
    0.381, 0.321, 0.265, 0.217, 0.175, 0.1382, 0.107, 0.0816, 0.061, 0.04458, 0.032, 0.0232,
    0.017, 0.01192, 0.00821, 0.005723, 0.004102, 0.002929, 0.002091, 0.001484, 0.001047, 0.00074, 0.00052, 0.000361,
    0.000249, 0.000172, 0.00012, 0.000085, 0.000060, 0.000042, 0.000030, 0.000021, 0.000015,
])  # fmt: skip


def luminous_efficacy(wavelengths_nm: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"]) -> float | None:
    """lm/W of a tabulated spectral density (trapezoids, V interpolated in its logarithm); None if it has no area."""
    power = np.trapezoid(weights, wavelengths_nm)
    if len(weights) < 2 or not power > 0.0:
        return None
    sensitivity = np.exp(np.interp(wavelengths_nm, _V_NM, np.log(_V)))
    sensitivity[(wavelengths_nm < _V_NM[0]) | (wavelengths_nm > _V_NM[-1])] = 0.0
    return float(_LUMENS_PER_WATT * np.trapezoid(weights * sensitivity, wavelengths_nm) / power)
