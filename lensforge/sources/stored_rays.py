"""Usable rays of a file, left in it and read when they are needed, and the wavelength of each.

A wavelength is the ray's own, or drawn from a table.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.optics.media import Wavelengths
from lensforge.sources.ray_bundle import BLOCK_RAYS, RayBundle, Rays, block_slices
from lensforge.sources.rayfiles.ray_file import RayFile, SpectralTable, column_product, usable_rows
from lensforge.sources.rayfiles.ray_file_rows import FileState, as_float64
from lensforge.sources.source_spectrum import Spectrum, WavelengthDraw

LOADED_RAYS = 2**20  # rays of a file that are loaded (60 MB); those of a larger one stay in it
WAVELENGTH_SEED = 11  # of the wavelengths drawn: they belong to the rays, whatever is then sampled from these
# Wavelengths (nm) of the next rays of a file, by their numbers; called with part after part of them, in their order.
_NextWavelengths: TypeAlias = Callable[[slice], Float[np.ndarray, " n"]]


def as_bundle(rayfile: RayFile) -> RayBundle:
    """Copy rays that can all be traced as float64, directions normalised; flux as stored."""
    directions = as_float64(rayfile.directions)
    return RayBundle(
        origins=as_float64(rayfile.positions_mm),
        directions=directions / np.sqrt(column_product(directions, directions))[:, None],
        flux=as_float64(rayfile.flux),
        waves=None if rayfile.wavelengths_nm is None else Wavelengths(as_float64(rayfile.wavelengths_nm)),
    )


def usable_blocks(rayfile: RayFile) -> Iterator[tuple[RayBundle, dict[str, int]]]:
    """Yield the usable rays block by block, and the number of the others by cause."""
    for block in rayfile.blocks():
        keep, dropped = usable_rows(block)
        yield as_bundle(block.rows(keep)), dropped


@dataclass(frozen=True, eq=False)
class StoredRays:
    """Rays of ``rayfile`` that can be traced, in its order; ``skipped``: rows of the others, ``dropped``: by cause.

    ``state``: of a file whose numbers are mapped; None if they are copies. ``drawn_nm``: a wavelength for each ray that
    replaces the file's own.
    """

    rayfile: RayFile
    skipped: Int[np.ndarray, " k"]
    dropped: dict[str, int]
    state: FileState | None = None
    drawn_nm: Float[np.ndarray, " n"] | None = None

    @staticmethod
    def of(rayfile: RayFile) -> "StoredRays":
        """Find the rays of a file that can be traced, block by block."""
        mapped = rayfile.verbatim is not None and np.may_share_memory(rayfile.verbatim, rayfile.directions)
        state = FileState.of(Path(rayfile.path)) if mapped else None
        skipped = [np.zeros(0, dtype=np.int64)]
        dropped = dict[str, int]()
        start = 0
        for block in rayfile.blocks():
            keep, counts = usable_rows(block)
            skipped.append(start + np.flatnonzero(~keep))
            dropped = {cause: dropped.get(cause, 0) + count for cause, count in counts.items()}
            start += len(block)
        return StoredRays(rayfile, np.concatenate(skipped), dropped, state)

    def __len__(self) -> int:
        return len(self.rayfile) - len(self.skipped)

    @property
    def has_wavelengths(self) -> bool:
        """True if each ray has a wavelength, its own or a drawn one."""
        return self.drawn_nm is not None or self.rayfile.wavelengths_nm is not None

    def take(self, chosen: slice | Int[np.ndarray, " k"]) -> RayBundle:
        """Read some of the rays, flux as stored: a slice without step, or any numbers.

        Raises :class:`InputError` if the file was written to since it was opened.
        """
        if self.state is not None:
            self.state.require_same()
        bundle = as_bundle(self.rayfile.rows(self._rows_of(chosen)))
        if len(bundle) >= BLOCK_RAYS // 2:  # of so many nearly every page was read
            self.rayfile.release_pages()
        return bundle if self.drawn_nm is None else bundle.with_wavelengths(self.drawn_nm[chosen])

    def loaded(self) -> Rays:
        """The rays in memory if they are few."""
        return self.take(slice(None)) if len(self.rayfile) <= LOADED_RAYS else self

    def coloured(self, spectrum: Spectrum | None = None) -> "StoredRays":
        """Rays with a wavelength drawn from ``spectrum`` for each; without it their own, or the file's.

        A file's spectral table is drawn from evenly over its power. Rays of a file that states no wavelengths have
        none. Raises :class:`InputError` for an invalid spectral table, and for several tables without a valid spectrum
        number for each ray.
        """
        following = self._of_file() if spectrum is None else _from_table(spectrum, len(self))
        if following is None:
            return self
        return replace(self, drawn_nm=np.concatenate([following(part) for part in block_slices(len(self))]))

    def _rows_of(self, chosen: slice | Int[np.ndarray, " k"]) -> slice | Int[np.ndarray, " k"]:
        """Rows in the file of the usable rays ``chosen``."""
        if len(self.skipped) == 0:
            return chosen
        before = self.skipped - np.arange(len(self.skipped))  # usable rays in front of each row that is skipped
        numbers = np.arange(*chosen.indices(len(self))) if isinstance(chosen, slice) else chosen
        return numbers + np.searchsorted(before, numbers, side="right")

    def _of_file(self) -> _NextWavelengths | None:
        """Wavelengths drawn from the tables of the file; None if the rays have their own, or there are no tables."""
        rayfile = self.rayfile
        tables = self.rayfile.spectral_tables
        if rayfile.wavelengths_nm is not None:
            return None
        if rayfile.spectrum_numbers is not None and tables:
            return self._by_number(tables)
        if len(tables) > 1:
            raise InputError(f"{rayfile.path}: {len(tables)} spectral tables, and no spectrum number for each ray")
        return _from_table(_table(rayfile.path, tables[0], 1), len(self)) if tables else None

    def _by_number(self, tables: list[SpectralTable]) -> _NextWavelengths:
        path = self.rayfile.path
        counts = Counter[float]()
        for part in block_slices(len(self)):
            numbers = self._spectrum_numbers(part)
            wrong = ~np.isin(numbers, np.arange(1, len(tables) + 1))
            if wrong.any():
                raise InputError(f"{path}: spectrum number {numbers[wrong][0]:g} of a ray: 1 to {len(tables)}")
            counts.update(numbers.tolist())
        draws = {
            number: WavelengthDraw.of(_table(path, tables[int(number) - 1], int(number)), count, WAVELENGTH_SEED)
            for number, count in sorted(counts.items())
        }

        def following(part: slice) -> Float[np.ndarray, " n"]:
            numbers = self._spectrum_numbers(part)
            wavelengths = np.zeros(len(numbers))
            for number, draw in draws.items():
                with_number = numbers == number
                wavelengths[with_number] = draw.take(int(np.count_nonzero(with_number)))
            return wavelengths

        return following

    def _spectrum_numbers(self, part: slice) -> Float[np.ndarray, " n"]:
        assert self.rayfile.spectrum_numbers is not None
        return as_float64(self.rayfile.spectrum_numbers[self._rows_of(part)])


def _from_table(spectrum: Spectrum, count: int) -> _NextWavelengths:
    draw = WavelengthDraw.of(spectrum, count, WAVELENGTH_SEED)
    return lambda part: draw.take(part.stop - part.start)


def _table(path: str, table: SpectralTable, number: int) -> Spectrum:
    return Spectrum(table.wavelengths_nm, table.power_density, f"{path}: spectral table {number}")
