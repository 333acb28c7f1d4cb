"""Spectra of ray files: the wavelength of each ray, its own or drawn from a table."""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.sources.rayfiles.rayfile import RayFile, SpectralTable, UsableRays
from lensforge.sources.rayfiles.spool import spooled
from lensforge.sources.rayfiles.stored import StoredRays
from lensforge.sources.spectrum import Spectrum, WavelengthDraw

WAVELENGTH_SEED = 11  # of the wavelengths drawn: they belong to the rays, whatever is then sampled from these
# Wavelengths (nm) of the next rays of a file; called with block after block of them, in their order.
_NextWavelengths: TypeAlias = Callable[[UsableRays], Float[np.ndarray, " n"]]


def wavelengths_of(rayfile: RayFile, rays: UsableRays | StoredRays) -> Float[np.ndarray, " n"] | None:
    """Wavelengths (nm) of ``rays``, the usable ones of ``rayfile``; None where the file states none.

    They are the rays' own, or drawn from the file's spectral table, evenly over its power. Raises :class:`InputError`
    for an invalid spectral table, and for several tables without a valid spectrum number for each ray.
    """
    following = _next_wavelengths(rayfile, rays)
    return None if following is None else _each(rays, following)


def drawn_wavelengths(spectrum: Spectrum, rays: UsableRays | StoredRays) -> Float[np.ndarray, " n"]:
    """Draw a wavelength (nm) from ``spectrum`` for each of ``rays``."""
    return _each(rays, _from_table(spectrum, len(rays)))


def with_wavelengths(
    rayfile: RayFile, rays: UsableRays | StoredRays
) -> Iterator[tuple[UsableRays, Float[np.ndarray, " n"]]] | None:
    """Blocks of ``rays`` with their wavelengths (nm), as :func:`wavelengths_of` has them for all."""
    following = _next_wavelengths(rayfile, rays)
    return None if following is None else ((block, following(block)) for block in rays.blocks())


def _each(rays: UsableRays | StoredRays, following: _NextWavelengths) -> Float[np.ndarray, " n"]:
    """Gather them where the rays are: in memory, or in a file, a temporary one unless they are that file's own."""
    if isinstance(rays, UsableRays):
        return following(rays)
    if following is _own and len(rays.skipped) == 0:
        assert rays.rayfile.wavelengths_nm is not None
        return rays.rayfile.wavelengths_nm
    return spooled((following(block) for block in rays.blocks()), rays.rayfile.path)


def _next_wavelengths(rayfile: RayFile, rays: UsableRays | StoredRays) -> _NextWavelengths | None:
    if rayfile.wavelengths_nm is not None:
        return _own
    tables = rayfile.spectral_tables
    if rayfile.spectrum_numbers is not None and tables:
        return _by_number(rayfile.path, rays, tables)
    if len(tables) > 1:
        raise InputError(f"{rayfile.path}: {len(tables)} spectral tables, and no spectrum number for each ray")
    return _from_table(_table(rayfile.path, tables[0], 1), len(rays)) if tables else None


def _own(rays: UsableRays) -> Float[np.ndarray, " n"]:
    assert rays.wavelengths_nm is not None
    return rays.wavelengths_nm


def _from_table(spectrum: Spectrum, count: int) -> _NextWavelengths:
    draw = WavelengthDraw.of(spectrum, count, WAVELENGTH_SEED)
    return lambda rays: draw.take(len(rays))


def _by_number(path: str, rays: UsableRays | StoredRays, tables: list[SpectralTable]) -> _NextWavelengths:
    counts = Counter[int]()
    for block in rays.blocks():
        numbers = _numbers(block)
        wrong = ~np.isin(numbers, np.arange(1, len(tables) + 1))
        if wrong.any():
            raise InputError(f"{path}: spectrum number {numbers[wrong][0]:g} of a ray: 1 to {len(tables)}")
        counts.update(dict(zip(*(each.tolist() for each in np.unique(numbers, return_counts=True)), strict=True)))
    draws = {
        number: WavelengthDraw.of(_table(path, tables[int(number) - 1], int(number)), count, WAVELENGTH_SEED)
        for number, count in sorted(counts.items())
    }

    def following(block: UsableRays) -> Float[np.ndarray, " n"]:
        wavelengths, numbers = np.zeros(len(block)), _numbers(block)
        for number, draw in draws.items():
            those = numbers == number
            wavelengths[those] = draw.take(int(np.count_nonzero(those)))
        return wavelengths

    return following


def _numbers(rays: UsableRays) -> Float[np.ndarray, " n"]:
    assert rays.spectrum_numbers is not None
    return rays.spectrum_numbers


def _table(path: str, table: SpectralTable, number: int) -> Spectrum:
    return Spectrum(table.wavelengths_nm, table.power_density, f"{path}: spectral table {number}")
