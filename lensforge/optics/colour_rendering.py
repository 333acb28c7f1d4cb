"""Rendering of colours by light: Ra of CIE 13.3:1995, Rf and Rg of ANSI/IES TM-30-18, by colour-science."""

import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.optics.colorimetry import colour_temperature, tristimulus_of, uv_of

_VISIBLE_NM = np.arange(360.0, 831.0)


class ColourRendering(NamedTuple):
    """Colour rendering index Ra, colour fidelity Rf and gamut index Rg."""

    ra: float
    rf: float
    rg: float


def colour_rendering(
    wavelengths_nm: Float[np.ndarray, " k"], power_density: Float[np.ndarray, " k"]
) -> ColourRendering | None:
    """Rendering by light of a spectral table; None for light without a colour temperature, to which none compares."""
    if colour_temperature(uv_of(tristimulus_of(wavelengths_nm, power_density))) is None:
        return None
    from colour import SpectralDistribution
    from colour.quality import colour_fidelity_index_ANSIIESTM3018, colour_rendering_index

    density = np.interp(_VISIBLE_NM, wavelengths_nm, power_density, left=0.0, right=0.0)
    light = SpectralDistribution(density / density.max(), _VISIBLE_NM)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of hues that none of the test colours has
        by_many = colour_fidelity_index_ANSIIESTM3018(light, additional_data=True)
        return ColourRendering(float(np.asarray(colour_rendering_index(light))), float(by_many.R_f), float(by_many.R_g))
