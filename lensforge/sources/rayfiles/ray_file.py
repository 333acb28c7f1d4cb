"""Rays of a file in mm and nm: all of them as stored, those that can be traced, and the interface of a format."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.errors import InputError
from lensforge.sources.rayfiles.ray_file_rows import CHUNK_ROWS, HUGE, SMALLEST, FileImage, as_float64, release_pages

FluxUnit = Literal["W", "lm"]
# Value of a header field: a number, a text, or lists of them, such as spectral tables.
HeaderValue: TypeAlias = (
    str | int | float | Sequence[str] | Sequence[float | None] | Sequence[Mapping[str, Sequence[float]]] | None
)
HeaderRole = Literal["total", "mean", "scale", "ignored"]
Rows: TypeAlias = Bool[np.ndarray, " n"]
SAME_FLUX = 1e-5  # totals of float32 numbers that agree this well are the same total
_NO_DIRECTION = 1e-12  # |k| below which a direction counts as zero


@dataclass(frozen=True, eq=False)
class SpectralTable:
    """Spectral power density (relative, per nm) at each wavelength."""

    wavelengths_nm: Float[np.ndarray, " k"]
    power_density: Float[np.ndarray, " k"]


@dataclass(frozen=True, eq=False)
class RayFile:
    """Rays as a file holds them: nothing dropped, nothing normalised.

    ``positions_mm`` are start points, ``directions`` of any length; ``flux`` is in ``flux_unit`` or, by
    ``header_role``, relative; ``spectrum_numbers`` count the header's ``spectral_tables`` from 1. The arrays are
    read-only float32 views of the mapped file wherever its layout allows, so that a file of any size opens at once.

    ``header_flux_w`` and ``header_flux_lm`` are the totals that the header states, None if it states none.
    ``header_role`` says what such a total is: the ``total`` that ray fluxes should add up to (it outranks their sum),
    their ``mean`` as well (LightTools does not divide by the number of rays), the ``scale`` of ray fluxes that are
    relative by design (SPEOS), or a number that is ``ignored`` by the program whose format it is (Zemax).

    ``header`` holds the fields of the header as JSON can hold them; ``path`` and ``verbatim`` are the file it was read
    from, and its bytes. ``verbatim`` is not a constructor argument, so ``dataclasses.replace`` drops it: changed
    rays never meet old bytes.
    """

    positions_mm: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    flux_unit: FluxUnit
    wavelengths_nm: Float[np.ndarray, " n"] | None = None
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
        """Total of the header in ``flux_unit``; None if it states none."""
        return self.header_flux_w if self.flux_unit == "W" else self.header_flux_lm

    @property
    def stated_flux(self) -> float | None:
        """Total of the header where it outranks the sum over the rays; None if that sum counts."""
        return None if self.header_role == "ignored" else self.header_flux

    @property
    def spectral_tables(self) -> list[SpectralTable]:
        """Spectral tables of the header; spectrum number 1 is the first."""
        tables = self.header.get("spectral_tables")
        if tables is None or isinstance(tables, str | int | float):
            return []
        return [
            SpectralTable(np.array(table["wavelength_nm"]), np.array(table["weight"]))
            for table in tables
            if isinstance(table, Mapping)
        ]

    def blocks(self) -> Iterator["RayFile"]:
        """Yield the rays in blocks; the pages of a mapped file are released before the next block."""
        for start in range(0, len(self), CHUNK_ROWS):
            yield self.rows(slice(start, start + CHUNK_ROWS))
            self.release_pages()

    def rows(self, chosen: slice | Rows | Int[np.ndarray, " k"]) -> "RayFile":
        """Select rays by ``chosen``: views for a slice, else copies."""
        return replace(
            self,
            positions_mm=self.positions_mm[chosen],
            directions=self.directions[chosen],
            flux=self.flux[chosen],
            wavelengths_nm=None if self.wavelengths_nm is None else self.wavelengths_nm[chosen],
            spectrum_numbers=None if self.spectrum_numbers is None else self.spectrum_numbers[chosen],
        )

    def release_pages(self) -> None:
        """Release the memory of the pages of a mapped file; they are read again when used."""
        release_pages(self.positions_mm, self.directions, self.flux, self.wavelengths_nm, self.spectrum_numbers)

    def ray_sum(self) -> float:
        """Sum of the stored fluxes of the usable rays."""
        total = 0.0
        for block in self.blocks():
            finite, directed, bright = _faultless(block)
            total += float(as_float64(block.flux[finite & directed & bright]).sum())
        return total

    def flux_factor(self, ray_sum: float | None = None, total: float | None = None) -> float:
        """Factor from the fluxes of the rays, as stored, to ``flux_unit``: the one scale of a ray file.

        With it the usable rays add up to ``total``; to the stated total where that is None, and where the file states
        none the factor is 1. ``ray_sum``: :meth:`ray_sum`, where the caller has it already.
        """
        wanted = self.stated_flux if total is None else total
        if wanted is None:
            return 1.0
        stored = self.ray_sum() if ray_sum is None else ray_sum
        return wanted / stored if stored > 0.0 else 1.0

    def total_flux(self, ray_sum: float | None = None) -> float:
        """Flux of the source in ``flux_unit``: the stated total, or the sum over the usable rays."""
        return self.stated_flux or (self.ray_sum() if ray_sum is None else ray_sum)

    def flux_in(self, unit: FluxUnit, ray_sum: float | None = None) -> float | None:
        """Flux of the source in ``unit``; None if that is not the unit of its rays and the header states none."""
        if unit == self.flux_unit:
            return self.total_flux(ray_sum)
        return self.header_flux_w if unit == "W" else self.header_flux_lm

    def absolute_blocks(self, total: float | None = None) -> Iterator["RayFile"]:
        """Yield the blocks with fluxes that add up to ``total``, or to the flux of the source.

        As stored, bit by bit, where they add up to it already.
        """
        factor = self.flux_factor(total=total)
        if abs(factor - 1.0) < SAME_FLUX:
            yield from self.blocks()
            return
        for block in self.blocks():
            with np.errstate(invalid="ignore", over="ignore"):
                flux = (as_float64(block.flux) * factor).astype(self.flux.dtype)
            yield replace(block, flux=flux)

    @property
    def single_wavelength(self) -> float | None:
        """Wavelength (nm) that all rays share because the header gave only one; None otherwise."""
        if self.wavelengths_nm is None or len(self) == 0 or self.wavelengths_nm.strides[0] != 0:
            return None
        return float(self.wavelengths_nm[0])


def column_product(first: Float[np.ndarray, "n k"], second: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
    """Scalar products of the rows, summed from left to right; five times as fast as a sum along the short axis."""
    products: Float[np.ndarray, " n"] = first[:, 0] * second[:, 0]
    for axis in range(1, first.shape[1]):
        products += first[:, axis] * second[:, axis]
    return products


def shared_wavelength(nanometres: float, count: int) -> Float[np.ndarray, " n"]:
    """Repeat one wavelength for ``count`` rays, as a view that takes no memory."""
    return np.broadcast_to(np.float32(nanometres), (count,))


def usable_rows(rayfile: RayFile) -> tuple[Rows, dict[str, int]]:
    """Mask of the rays that can be traced, and the number of the others by cause.

    Dropped, each ray for the first cause that applies: ``not_finite`` (a NaN or an absurd number), ``zero_direction``,
    ``no_flux`` (zero, negative, or so little that it is a damaged number).
    """
    finite, directed, bright = _faultless(rayfile)
    return finite & directed & bright, {
        "not_finite": int(np.count_nonzero(~finite)),
        "zero_direction": int(np.count_nonzero(finite & ~directed)),
        "no_flux": int(np.count_nonzero(finite & directed & ~bright)),
    }


def _faultless(rayfile: RayFile) -> tuple[Rows, Rows, Rows]:
    """Masks of the rays with finite numbers, with a direction, and with flux, from the stored numbers."""
    with np.errstate(invalid="ignore", over="ignore"):
        finite = (np.abs(rayfile.flux) < HUGE) & np.ones(len(rayfile), dtype=bool)
        squared = np.zeros(len(rayfile))
        for axis in range(3):
            along = rayfile.directions[:, axis]
            finite &= (np.abs(along) < HUGE) & (np.abs(rayfile.positions_mm[:, axis]) < HUGE)
            squared += np.square(along, dtype=np.float64)
        return finite, squared > _NO_DIRECTION**2, rayfile.flux > SMALLEST


def no_usable_ray(rayfile: RayFile, dropped: dict[str, int]) -> InputError:
    """Error for a file without a usable ray."""
    return InputError(f"{rayfile.path}: none of its {len(rayfile)} rays is usable ({causes(dropped)}); export it again")


def causes(dropped: dict[str, int]) -> str:
    """Counts and causes, as a phrase."""
    return ", ".join(f"{count} {cause.replace('_', ' ')}" for cause, count in dropped.items() if count)


@dataclass(frozen=True)
class Format:
    """Ray-file format: ``matches(head, size)`` by content alone, ``decode`` a mapped file, ``encode`` in pieces.

    ``suffixes`` are merely the usual ones of this format; they help to choose a format for writing. ``decode`` raises
    :class:`InputError` for a damaged file, ``encode`` for rays that the format cannot hold.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    matches: Callable[[bytes, int], bool]
    decode: Callable[[FileImage], RayFile]
    encode: Callable[[RayFile], Iterator[bytes]]


class UnknownRayFormat(InputError):
    """A file whose content is none of the known formats."""


FORMATS: dict[str, Format] = {}  # by name; files are offered to them in this order


def register(entry: Format) -> Format:
    """Register a format for reading, writing and recognition; return it."""
    FORMATS[entry.name] = entry
    return entry


def require_watts_with_wavelengths(rayfile: RayFile, title: str) -> None:
    """Refuse lumens with a wavelength for each ray where the format stores spectral flux in W only."""
    if rayfile.flux_unit == "lm" and rayfile.wavelengths_nm is not None:
        raise InputError(
            f"{title} holds wavelengths only with W, these rays are in lm; convert to lighttools_text or csv instead"
        )
