"""Spectra of ray files: the wavelength of each ray, its own or drawn from a table."""

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.rayfiles.rayfile import RayFile, SpectralTable, UsableRays
from lensforge.sources.spectrum import Spectrum

WAVELENGTH_SEED = 11  # of the wavelengths drawn: they belong to the rays, whatever is then sampled from these


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
