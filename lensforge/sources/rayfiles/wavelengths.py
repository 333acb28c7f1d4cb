"""What wavelength each ray of a file has: its own, that of all, or one drawn from the file's spectral tables."""

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.rayfiles.cleaning import ValidRays
from lensforge.sources.rayfiles.record import RayFile, SpectralTable
from lensforge.sources.spectrum import Spectrum, spectrum_of
from lensforge.spec.spectrum import Spectrum as SpectrumSpec

_SEED = 11  # of the wavelengths drawn: they belong to the rays, whatever is then sampled from these


def wavelengths_of(rayfile: RayFile, rays: ValidRays, instead: SpectrumSpec | None) -> Float[np.ndarray, " n"] | None:
    """Wavelengths (nm) of ``rays``, the usable ones of ``rayfile``; None where nothing says anything of them.

    ``instead`` takes the place of what the file says. Tables are power densities, so every ray of a table has an equal
    chance; the wavelengths drawn fill the table evenly. Raises :class:`InputError` for wavelengths that are none, and
    for several tables of which nothing says which is whose.
    """
    if instead is not None:
        return spectrum_of(instead).draw(len(rays), _SEED)
    if rays.wavelengths is not None:
        return rays.wavelengths
    tables = rayfile.spectral_tables
    if rays.spectrum_numbers is not None and tables:
        return _by_number(rayfile.path, rays.spectrum_numbers, tables)
    if len(tables) > 1:
        raise InputError(
            f"{rayfile.path}: {len(tables)} spectral tables, and nothing says which is whose; give source.spectrum"
        )
    return _table(rayfile.path, tables[0], 1).draw(len(rays), _SEED) if tables else None


def _by_number(path: str, numbers: Float[np.ndarray, " n"], tables: list[SpectralTable]) -> Float[np.ndarray, " n"]:
    wavelengths = np.zeros(len(numbers))
    wrong = ~np.isin(numbers, np.arange(1, len(tables) + 1))
    if wrong.any():
        raise InputError(
            f"{path}: spectrum number {numbers[wrong][0]:g} of a ray: 1 to {len(tables)}; give source.spectrum"
        )
    for number in np.unique(numbers).astype(int).tolist():
        rows = np.flatnonzero(numbers == number)
        wavelengths[rows] = _table(path, tables[number - 1], number).draw(len(rows), _SEED)
    return wavelengths


def _table(path: str, table: SpectralTable, number: int) -> Spectrum:
    return Spectrum(table.wavelength_nm, table.weight, f"{path}: spectral table {number}")
