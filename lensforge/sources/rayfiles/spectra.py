"""Spectra of ray files: the wavelength of each ray, and the luminous efficacy of a table."""

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.rayfiles.rayfile import RayFile, SpectralTable, UsableRays
from lensforge.sources.spectrum import Spectrum

WAVELENGTH_SEED = 11  # of the wavelengths drawn: they belong to the rays, whatever is then sampled from these
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


def wavelengths_of(rayfile: RayFile, rays: UsableRays) -> Float[np.ndarray, " n"] | None:
    """Wavelengths (nm) of ``rays``, the usable ones of ``rayfile``; None where the file states none.

    They are the rays' own, or drawn from the file's spectral table, evenly over its power. Raises :class:`InputError`
    for an invalid spectral table, and for several tables without a valid spectrum number for each ray.
    """
    if rays.wavelengths_nm is not None:
        return rays.wavelengths_nm
    tables = rayfile.spectral_tables
    if rays.spectrum_numbers is not None and tables:
        return _by_number(rayfile.path, rays.spectrum_numbers, tables)
    if len(tables) > 1:
        raise InputError(f"{rayfile.path}: {len(tables)} spectral tables, and no spectrum number for each ray")
    return _table(rayfile.path, tables[0], 1).draw(len(rays), WAVELENGTH_SEED) if tables else None


def _by_number(path: str, numbers: Float[np.ndarray, " n"], tables: list[SpectralTable]) -> Float[np.ndarray, " n"]:
    wavelengths = np.zeros(len(numbers))
    wrong = ~np.isin(numbers, np.arange(1, len(tables) + 1))
    if wrong.any():
        raise InputError(f"{path}: spectrum number {numbers[wrong][0]:g} of a ray: 1 to {len(tables)}")
    for number in np.unique(numbers).astype(int).tolist():
        rows = np.flatnonzero(numbers == number)
        wavelengths[rows] = _table(path, tables[number - 1], number).draw(len(rows), WAVELENGTH_SEED)
    return wavelengths


def _table(path: str, table: SpectralTable, number: int) -> Spectrum:
    return Spectrum(table.wavelengths_nm, table.power_density, f"{path}: spectral table {number}")


def luminous_efficacy(wavelengths_nm: Float[np.ndarray, " n"], power_density: Float[np.ndarray, " n"]) -> float | None:
    """Compute the lm/W of a spectral table (trapezoids, V interpolated in its logarithm); None if it has no area."""
    power = np.trapezoid(power_density, wavelengths_nm)
    if len(power_density) < 2 or not power > 0.0:
        return None
    sensitivity = np.exp(np.interp(wavelengths_nm, _V_NM, np.log(_V)))
    sensitivity[(wavelengths_nm < _V_NM[0]) | (wavelengths_nm > _V_NM[-1])] = 0.0
    return float(_LUMENS_PER_WATT * np.trapezoid(power_density * sensitivity, wavelengths_nm) / power)
