"""Photopic vision: the luminous efficiency V of the CIE, and the luminous efficacy of light by its spectrum."""

import numpy as np
from jaxtyping import Float

LARGEST_LM_PER_W = 683.002  # of light at 555 nm, the peak of V (K_cd of the SI is 683 lm/W at 540 THz in air)
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
_STEP_NM = 1.0  # of the integral: V has steps of 5 nm, and the density is linear between its own wavelengths


def efficacy_at(wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Luminous efficacy (lm/W) of monochromatic light: 683.002 V, V interpolated in its logarithm; 0 beyond V."""
    sensitivity = np.exp(np.interp(wavelengths_nm, _V_NM, np.log(_V)))
    seen = (wavelengths_nm >= _V_NM[0]) & (wavelengths_nm <= _V_NM[-1])
    return np.where(seen, LARGEST_LM_PER_W * sensitivity, 0.0)


def luminous_efficacy(wavelengths_nm: Float[np.ndarray, " n"], power_density: Float[np.ndarray, " n"]) -> float | None:
    """Compute the lm/W of a spectral table, linear between rising wavelengths (trapezoids of 1 nm or less).

    One wavelength alone is a line. None if the table has no power.
    """
    if len(wavelengths_nm) == 1 and power_density[0] > 0.0:
        return float(efficacy_at(wavelengths_nm)[0])
    power = np.trapezoid(power_density, wavelengths_nm)
    if not power > 0.0:
        return None
    steps = np.arange(_V_NM[0], _V_NM[-1] + 0.5 * _STEP_NM, _STEP_NM)
    within = (steps > wavelengths_nm[0]) & (steps < wavelengths_nm[-1])
    fine = np.union1d(wavelengths_nm, steps[within])
    density = np.interp(fine, wavelengths_nm, power_density)
    return float(np.trapezoid(density * efficacy_at(fine), fine) / power)
