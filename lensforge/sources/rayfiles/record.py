"""What a ray file says, whatever its format: rays in mm, their flux, and the header in plain words."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from lensforge.sources.rayfiles.mapped import give_back

Unit = Literal["W", "lm"]
# Of a field of a header: a number, a text, or lists of them, such as spectral tables.
HeaderValue: TypeAlias = (
    str | int | float | Sequence[str] | Sequence[float | None] | Sequence[Mapping[str, Sequence[float]]] | None
)
HeaderRole = Literal["total", "scale", "ignored"]
CHUNK_ROWS = 2**18  # rays handled at a time: bounds the memory whatever the size of the file
HUGE = 1e12  # no length in mm, no flux: what is larger comes from a damaged file
SAME_FLUX = 1e-5  # totals of float32 numbers that agree this well are the same total


@dataclass(frozen=True, eq=False)
class SpectralTable:
    """Power density (relative, per nm) at each wavelength."""

    wavelength_nm: Float[np.ndarray, " k"]
    weight: Float[np.ndarray, " k"]


@dataclass(frozen=True, eq=False)
class RayFile:
    """``n`` rays as a file holds them: nothing dropped, nothing normalised.

    ``positions`` in mm, ``directions`` as given, ``flux`` in ``unit`` or only relative to it, ``wavelengths`` in nm or
    None, ``spectrum_numbers``, from 1, into the header's ``spectral_tables``, or None. The arrays are read-only float32
    views of the mapped file wherever its layout allows, so that a file of any size opens at once;
    ``cleaning.valid_rays`` turns them into float64.

    ``header_flux_w`` and ``header_flux_lm`` are the totals that the header states, None where it states none.
    ``header_role`` says what such a total is: the ``total`` that ray fluxes should add up to (it outranks their sum,
    because LightTools does not divide by the number of rays), the ``scale`` of ray fluxes that are weights by design
    (SPEOS), or a number that is ``ignored`` by the program whose format it is (Zemax).

    ``header`` holds the fields of the header as JSON can hold them; ``path`` and ``verbatim`` are the file it was read
    from, and its bytes. ``verbatim`` is no argument of the constructor, so ``dataclasses.replace`` drops it: changed
    rays never meet old bytes.
    """

    positions: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    unit: Unit
    wavelengths: Float[np.ndarray, " n"] | None = None
    spectrum_numbers: Float[np.ndarray, " n"] | None = None
    format: str = ""
    header_flux_w: float | None = None
    header_flux_lm: float | None = None
    header_role: HeaderRole = "total"
    header: Mapping[str, HeaderValue] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    path: str = ""
    verbatim: np.ndarray | None = field(default=None, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.flux)

    @property
    def header_flux(self) -> float | None:
        """The total of the header in the unit of the rays, None where it states none."""
        return self.header_flux_w if self.unit == "W" else self.header_flux_lm

    @property
    def stated_flux(self) -> float | None:
        """The header's total where it outranks the sum over the rays; None where that sum is the truth."""
        return None if self.header_role == "ignored" else self.header_flux

    @property
    def spectral_tables(self) -> list[SpectralTable]:
        """The spectral tables of the header; spectrum number 1 is the first."""
        tables = self.header.get("spectral_tables")
        if tables is None or isinstance(tables, str | int | float):
            return []
        return [
            SpectralTable(np.array(table["wavelength_nm"]), np.array(table["weight"]))
            for table in tables
            if isinstance(table, Mapping)
        ]

    def blocks(self) -> Iterator["RayFile"]:
        """The rays some at a time, each block's pages of a mapped file given back once the next one is asked for."""
        for start in range(0, len(self), CHUNK_ROWS):
            some = slice(start, start + CHUNK_ROWS)
            yield replace(
                self,
                positions=self.positions[some],
                directions=self.directions[some],
                flux=self.flux[some],
                wavelengths=None if self.wavelengths is None else self.wavelengths[some],
                spectrum_numbers=None if self.spectrum_numbers is None else self.spectrum_numbers[some],
            )
            give_back(self.positions, self.directions, self.flux, self.wavelengths, self.spectrum_numbers)

    def ray_sum(self) -> float:
        """Sum of the usable ray fluxes, as stored."""
        total = 0.0
        for block in self.blocks():
            flux = as_float64(block.flux)
            total += float(flux[(flux > 0.0) & (flux < HUGE)].sum())
        return total

    def total_flux(self) -> float:
        """The flux of the source in ``unit``: the stated total, or what the rays add up to."""
        return self.stated_flux or self.ray_sum()

    def blocks_adding_up_to(self, total: float) -> Iterator["RayFile"]:
        """The blocks, fluxes scaled to ``total``; the stored numbers, bit by bit, where they add up to it already."""
        stored = self.ray_sum()
        if stored == 0.0 or abs(total / stored - 1.0) < SAME_FLUX:
            yield from self.blocks()
            return
        for block in self.blocks():
            with np.errstate(invalid="ignore", over="ignore"):
                flux = (as_float64(block.flux) * (total / stored)).astype(self.flux.dtype)
            yield replace(block, flux=flux)

    @property
    def single_wavelength(self) -> float | None:
        """The wavelength (nm) that all rays share because the header gave only one; None otherwise."""
        if self.wavelengths is None or len(self) == 0 or self.wavelengths.strides[0] != 0:
            return None
        return float(self.wavelengths[0])


def as_float64(values: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """A float64 copy; signalling NaNs, which vendors write, pass without a warning."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def shared_wavelength(nanometres: float, count: int) -> Float[np.ndarray, " n"]:
    """One wavelength for ``count`` rays, as a view that takes no memory."""
    return np.broadcast_to(np.float32(nanometres), (count,))
