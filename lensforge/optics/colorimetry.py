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
from lensforge.optics.photopic import V_NM, V

LARGEST_LM_PER_W = 683.002  # of light at 555 nm, the peak of V (K_cd of the SI is 683 lm/W at 540 THz in air)


def efficacy_at(wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Luminous efficacy (lm/W) of monochromatic light: 683.002 V, V linear between whole nm; 0 beyond 360 to 830 nm."""
    return np.asarray(LARGEST_LM_PER_W * np.interp(wavelengths_nm, V_NM, V, left=0.0, right=0.0))


def luminous_efficacy(wavelengths_nm: Float[np.ndarray, " n"], power_density: Float[np.ndarray, " n"]) -> float | None:
    """Compute the lm/W of a spectral table, linear between rising wavelengths (trapezoids of 1 nm or less).

    One wavelength alone is a line. None if the table has no power.
    """
    if len(wavelengths_nm) == 1 and power_density[0] > 0.0:
        return float(efficacy_at(wavelengths_nm)[0])
    power = np.trapezoid(power_density, wavelengths_nm)
    if not power > 0.0:
        return None
    fine = _with_whole_nm(wavelengths_nm)
    density = np.interp(fine, wavelengths_nm, power_density)
    return float(np.trapezoid(density * efficacy_at(fine), fine) / power)


def _with_whole_nm(wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
    """Rising ``wavelengths_nm`` with all whole nm between them at which the eye's functions bend."""
    within = (wavelengths_nm[0] < V_NM) & (wavelengths_nm[-1] > V_NM)
    return np.union1d(wavelengths_nm, V_NM[within])


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
    fine = _with_whole_nm(wavelengths_nm)
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
    cct_k = float(cct_and_duv[0])
    duv = float(cct_and_duv[1])
    known = np.isfinite([cct_k, duv]).all() and abs(duv) <= MOST_DUV and _CCT_K[0] <= cct_k <= _CCT_K[1]
    return ColourTemperature(cct_k, duv) if known else None


def srgb_of(tristimulus: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Values from 0 to 1 of sRGB (IEC 61966-2-1), the brightest of all at 1; what a screen cannot show is clipped."""
    from colour.models import XYZ_to_sRGB, eotf_inverse_sRGB

    linear = np.maximum(np.asarray(XYZ_to_sRGB(tristimulus, apply_cctf_encoding=False)), 0.0)
    return np.asarray(eotf_inverse_sRGB(linear / (float(linear.max()) or 1.0)))
