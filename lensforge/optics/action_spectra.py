"""Light as it acts on rods, on the inner clock and on plants: means over the power of a spectrum.

An action spectrum is linear between its nodes, and 0 beyond them; integrals are trapezoids of 1 nm or less.
"""

import numpy as np
from jaxtyping import Float

from lensforge.optics.melanopic import MELANOPIC, MELANOPIC_NM

LARGEST_SCOTOPIC_LM_PER_W = 1700.06  # by which both luminous efficacies are equal at 540 THz (CIE 018:2019)
MELANOPIC_OF_DAYLIGHT = 1.3262e-3  # W per lm of D65: CIE S 026/E:2018, 3.17
_NM_J_PER_UMOL = 119.62656  # Planck's constant times the speed of light times a micromole
_PHOTOSYNTHETIC_NM = np.arange(400.0, 701.0)

_Nodes = Float[np.ndarray, " k"]


def melanopic_per_watt(wavelengths_nm: _Nodes, power_density: _Nodes) -> float:
    """Melanopic power of 1 W of a spectral table; one wavelength alone is a line."""
    return _mean_action(wavelengths_nm, power_density, MELANOPIC_NM, MELANOPIC)


def scotopic_per_watt(wavelengths_nm: _Nodes, power_density: _Nodes) -> float:
    """Scotopic lumens of 1 W, by V' of the CIE 1951 observer."""
    from colour.colorimetry import SDS_LEFS_SCOTOPIC

    rods = SDS_LEFS_SCOTOPIC["CIE 1951 Scotopic Standard Observer"]
    action = LARGEST_SCOTOPIC_LM_PER_W * np.asarray(rods.values)
    return _mean_action(wavelengths_nm, power_density, np.asarray(rods.wavelengths), action)


def photons_per_watt(wavelengths_nm: _Nodes, power_density: _Nodes) -> float:
    """Photosynthetic photons from 400 to 700 nm (µmol/s) of 1 W."""
    return _mean_action(wavelengths_nm, power_density, _PHOTOSYNTHETIC_NM, _PHOTOSYNTHETIC_NM / _NM_J_PER_UMOL)


def _mean_action(
    wavelengths_nm: _Nodes, power_density: _Nodes, nodes: Float[np.ndarray, " a"], action: Float[np.ndarray, " a"]
) -> float:
    """Mean of an ``action`` spectrum, weighted by power."""
    if len(wavelengths_nm) == 1:
        return float(np.interp(wavelengths_nm[0], nodes, action, left=0.0, right=0.0))
    low, high = max(wavelengths_nm[0], nodes[0]), min(wavelengths_nm[-1], nodes[-1])
    if low >= high:
        return 0.0
    both = np.union1d(wavelengths_nm, nodes)
    fine = np.unique(np.concatenate([[low], both[(both > low) & (both < high)], [high]]))
    acting = np.interp(fine, wavelengths_nm, power_density) * np.interp(fine, nodes, action)
    return float(np.trapezoid(acting, fine) / np.trapezoid(power_density, wavelengths_nm))
