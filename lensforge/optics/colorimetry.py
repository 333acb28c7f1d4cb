"""Light as it is seen: its luminous efficacy, and by the CIE 1931 observer tristimulus values, u', v', and sRGB.

The tables of colours, and the laws that need them, are those of the package colour-science, which takes a second to
load: it is, where colour is asked for. Tristimulus values are in lm, so that Y is the luminous flux.
"""

import warnings
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.optics.arrays import Array

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


MOST_DUV = 0.05  # from Planck's locus: light farther away has no correlated colour temperature (CIE 15:2018, 9.5)
_CCT_K = 1000.0, 25_000.0  # outside, the isotherms are so close that a temperature says nothing


@cache
def _observer() -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k 3"]]:
    """Wavelengths (nm), 360 to 830 in steps of 1, and the colour matching functions there."""
    from colour.colorimetry import MSDS_CMFS

    functions = MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    return np.asarray(functions.wavelengths, dtype=np.float64), np.asarray(functions.values, dtype=np.float64)


def tristimulus_at(wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """X, Y, Z (lm) of 1 W of monochromatic light, linear between whole nm; 0 outside the visible range."""
    nodes, functions = _observer()
    columns = [np.interp(wavelengths_nm, nodes, column, left=0.0, right=0.0) for column in functions.T]
    return LARGEST_LM_PER_W * np.stack(columns, axis=1)


def tristimulus_of(
    wavelengths_nm: Float[np.ndarray, " k"], power_density: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " 3"]:
    """X, Y, Z (lm) of 1 W of a spectral table that is linear between rising wavelengths; one alone is a line.

    By trapezoids of 1 nm or less.
    """
    if len(wavelengths_nm) == 1:
        return np.asarray(tristimulus_at(wavelengths_nm)[0])
    nodes, _ = _observer()
    within = (nodes > wavelengths_nm[0]) & (nodes < wavelengths_nm[-1])
    fine = np.union1d(wavelengths_nm, nodes[within])
    density = np.interp(fine, wavelengths_nm, power_density)
    power = np.trapezoid(power_density, wavelengths_nm)
    return np.asarray(np.trapezoid(density[:, None] * tristimulus_at(fine), fine, axis=0) / power)


def denominator(tristimulus: Float[Array, "*n 3"]) -> Float[Array, "*n"]:
    """``X + 15 Y + 3 Z``, over which 4 X is u' and 9 Y is v' (CIE 1976)."""
    return tristimulus[..., 0] + 15.0 * tristimulus[..., 1] + 3.0 * tristimulus[..., 2]


def uv_of(tristimulus: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
    """u', v' of tristimulus values; NaN where there is no light."""
    below = denominator(tristimulus)
    above = tristimulus[..., :2] * np.array([4.0, 9.0])
    lit = (below > 0.0)[..., None]
    uv: Float[np.ndarray, "*n 2"] = np.divide(above, below[..., None], out=np.full(above.shape, np.nan), where=lit)
    return uv


def away_from(uv: Float[np.ndarray, " 2"], tristimulus: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
    """Colour differences from ``uv`` (u', v') times :func:`denominator`: ``4 X - u0 D`` and ``9 Y - v0 D``.

    They are linear in the light, and 0 where it has that colour.
    """
    above = tristimulus[..., :2] * np.array([4.0, 9.0])
    return np.asarray(above - denominator(tristimulus)[..., None] * uv)


class ColourTemperature(NamedTuple):
    """Correlated colour temperature (K), and the distance Duv from Planck's locus, positive towards green."""

    cct_k: float
    duv: float


def colour_temperature(uv: Float[np.ndarray, " 2"]) -> ColourTemperature | None:
    """Correlated colour temperature of u', v' (Ohno 2013); None for light too far from Planck's locus."""
    from colour.temperature import uv_to_CCT_Ohno2013

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of light far from the locus, which is left out below
        cct_and_duv = np.asarray(uv_to_CCT_Ohno2013(uv * np.array([1.0, 2.0 / 3.0])))  # of CIE 1960 u, v
    cct_k, duv = float(cct_and_duv[0]), float(cct_and_duv[1])
    known = np.isfinite([cct_k, duv]).all() and abs(duv) <= MOST_DUV and _CCT_K[0] <= cct_k <= _CCT_K[1]
    return ColourTemperature(cct_k, duv) if known else None


def srgb_of(tristimulus: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Values from 0 to 1 of sRGB (IEC 61966-2-1), the brightest of all at 1; what a screen cannot show is clipped."""
    from colour.models import XYZ_to_sRGB, eotf_inverse_sRGB

    linear = np.maximum(np.asarray(XYZ_to_sRGB(tristimulus, apply_cctf_encoding=False)), 0.0)
    return np.asarray(eotf_inverse_sRGB(linear / (float(linear.max()) or 1.0)))
