"""Usable rays of a file, loaded or left in it and read when they are needed, and the wavelength of each.

A wavelength is the ray's own, or drawn from a table.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.sources.ray_bundle import BLOCK_RAYS, block_slices
from lensforge.sources.rayfiles.ray_file import RayFile, SpectralTable, UsableRays, as_usable, usable_rays, usable_rows
from lensforge.sources.rayfiles.ray_file_bytes import FileState, spooled
from lensforge.sources.source_spectrum import Spectrum, WavelengthDraw

LOADED_RAYS = 2**20  # rays of a file that are loaded (60 MB); those of a larger one stay in it


@dataclass(frozen=True, eq=False)
class StoredRays:
    """Rays of ``rayfile`` that can be traced, in its order; ``skipped``: rows of the others, ``dropped``: by cause.

    ``state``: of a file whose numbers are mapped; None where they are copies.
    """

    rayfile: RayFile
    skipped: Int[np.ndarray, " k"]
    dropped: dict[str, int]
    state: FileState | None = None

    @staticmethod
    def of(rayfile: RayFile) -> "StoredRays":
        """Find the rays of a file that can be traced, block by block."""
        state = FileState.of(Path(rayfile.path)) if _is_mapped(rayfile) else None
        skipped, dropped, start = [np.zeros(0, dtype=np.int64)], dict[str, int](), 0
        for block in rayfile.blocks():
            keep, counts = usable_rows(block)
            skipped.append(start + np.flatnonzero(~keep))
            dropped = {cause: dropped.get(cause, 0) + count for cause, count in counts.items()}
            start += len(block)
        return StoredRays(rayfile, np.concatenate(skipped), dropped, state)

    def __len__(self) -> int:
        return len(self.rayfile) - len(self.skipped)

    def blocks(self) -> Iterator[UsableRays]:
        """Yield the rays block by block, in their order."""
        for some in block_slices(len(self)):
            yield self.take(some)

    def take(self, chosen: slice | Int[np.ndarray, " k"]) -> UsableRays:
        """Read some of the rays: from one to another without a step, or any by their numbers.

        Raises :class:`InputError` where the file was written to since it was opened.
        """
        if self.state is not None:
            self.state.require_same()
        if isinstance(chosen, slice):
            chosen = self._rows_between(*chosen.indices(len(self))[:2])
        else:
            chosen = self._rows_of(chosen)
        found = as_usable(self.rayfile.rows(chosen), {})
        if len(found) >= BLOCK_RAYS // 2:  # of so many nearly every page was read
            self.rayfile.release_pages()
        return found

    def _rows_between(self, start: int, stop: int) -> slice | Int[np.ndarray, " k"]:
        first, last = self._rows_of(np.array([start, stop - 1]))
        if last - first == stop - 1 - start:
            return slice(first, last + 1)
        return self._rows_of(np.arange(start, stop))

    def _rows_of(self, numbers: Int[np.ndarray, " k"]) -> Int[np.ndarray, " k"]:
        """Rows of the file in which the usable rays of these numbers are."""
        if len(self.skipped) == 0:
            return numbers
        before = self.skipped - np.arange(len(self.skipped))  # usable rays in front of each row that is skipped
        return numbers + np.searchsorted(before, numbers, side="right")


def _is_mapped(rayfile: RayFile) -> bool:
    return rayfile.verbatim is not None and np.may_share_memory(rayfile.verbatim, rayfile.directions)


def loaded_or_stored(rayfile: RayFile) -> UsableRays | StoredRays:
    """The usable rays of a file: in memory if they are few."""
    return usable_rays(rayfile) if len(rayfile) <= LOADED_RAYS else StoredRays.of(rayfile)


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
