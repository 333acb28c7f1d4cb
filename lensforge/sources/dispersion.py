"""Wavelengths of a source's rays, and whether the lens's index is known at them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError
from lensforge.optics.material import Material
from lensforge.sources.ray_bundle import ChangedSource, RayBundle, Rays, Source, blocks_of, changed
from lensforge.sources.source_spectrum import ColourSums, Spectrum, usable_wavelengths
from lensforge.sources.source_summary import IndexRange

_MOST_CLAMPED = 0.01
"""Largest share of the flux whose index may be taken at the end of the range: it bounds the error of the efficiency by
as much, and a design is not decided by it; measured LEDs have less than that in their tails."""
_MENTIONED = 0.01  # share of the flux with an extrapolated index above which a warning says so


def index_range_of(
    low_nm: float, high_nm: float, material: Material, extrapolated: float = 0.0, clamped: float = 0.0
) -> IndexRange:
    """Look up the indices of ``material`` at the ends of the wavelengths of light with the given shares."""
    low, high = material.nearest_index(np.array([low_nm, high_nm])).tolist()
    return IndexRange(
        wavelengths_nm=(low_nm, high_nm),
        refractive_indices=(low, high),
        extrapolated_index_share=extrapolated,
        clamped_index_share=clamped,
    )


def index_warnings(indices: IndexRange, material: Material) -> Iterator[str]:
    """Warnings on the share of the flux whose index is extrapolated."""
    extrapolated = indices.extrapolated_index_share or 0.0
    clamped = indices.clamped_index_share or 0.0
    if extrapolated > _MENTIONED:
        low, high = material.range_nm
        yield (
            f"{100.0 * extrapolated:.3g} % of the flux is outside {low:g} to {high:g} nm, where the "
            f"index of {material.name} was measured: it is extrapolated, to about {material.extrapolation_error:g}"
        )
    if clamped > 0.0:
        low, high = material.trusted_nm
        yield (
            f"{100.0 * clamped:.3g} % of the flux is outside {low:g} to {high:g} nm, where the index "
            f"of {material.name} is known: it is traced with the index at the end of that range"
        )


def coloured(rays: Rays, material: Material, name: str) -> tuple[Rays, IndexRange]:
    """Rays, those without a usable wavelength given the mean one, and the range of indices of ``material`` at them.

    ``name`` is the source in errors. Raises :class:`InputError` if more than 1 % of the flux is beyond the trusted
    range of ``material``.
    """
    sums = ColourSums()
    flux = 0.0
    clamped = 0.0
    extrapolated = 0.0
    for block in blocks_of(rays):
        waves = _wavelengths(block)
        outside = ~_within(waves, material.trusted_nm) | ~usable_wavelengths(waves)
        sums.add(block.flux, waves)
        flux += float(block.flux.sum())
        clamped += float(block.flux[outside].sum())
        extrapolated += float(block.flux[~outside & ~_within(waves, material.range_nm)].sum())
    mean_nm = sums.mean_nm
    if mean_nm is None:
        raise InputError(f"{name}: no ray has a usable wavelength; give a spectrum, or a constant refractive index")
    _require_few(clamped / flux, sums.low_nm, sums.high_nm, material, name)
    indices = index_range_of(sums.low_nm, sums.high_nm, material, extrapolated / flux, clamped / flux)

    def usable(some: RayBundle) -> RayBundle:
        waves = _wavelengths(some)
        return some.with_wavelengths(np.where(usable_wavelengths(waves), waves, mean_nm))

    return changed(rays, usable), indices


def _wavelengths(rays: RayBundle) -> Float[np.ndarray, " n"]:
    assert rays.wavelengths_nm is not None
    return rays.wavelengths_nm


def index_of_spectrum(spectrum: Spectrum, material: Material) -> IndexRange:
    """Range of indices of ``material`` over ``spectrum``; shares of power are exact integrals.

    Raises :class:`InputError` if more than 1 % of the power is beyond the material's trusted range.
    """
    lit = np.flatnonzero(spectrum.power_density)
    first = max(int(lit[0]) - 1, 0)
    last = min(int(lit[-1]) + 1, len(spectrum.wavelengths_nm) - 1)
    low = float(spectrum.wavelengths_nm[first])
    high = float(spectrum.wavelengths_nm[last])
    trusted, measured = (
        1.0
        if ends[0] <= low and high <= ends[1]
        else spectrum.share_up_to(ends[1]) - spectrum.share_up_to(np.nextafter(ends[0], 0.0))
        for ends in (material.trusted_nm, material.range_nm)
    )
    clamped = max(1.0 - trusted, 0.0)
    extrapolated = max(trusted - measured, 0.0)
    _require_few(clamped, low, high, material, spectrum.name)
    return index_range_of(low, high, material, extrapolated, clamped)


def joined_range(parts: Sequence[tuple[IndexRange, float]]) -> IndexRange:
    """Extreme wavelengths of all parts, the indices there, and shares weighted by each part's flux (W)."""
    ends = sorted(
        end for part, _ in parts for end in zip(part.wavelengths_nm or (), part.refractive_indices or (), strict=True)
    )
    total = sum(flux for _, flux in parts)
    return IndexRange(
        wavelengths_nm=(ends[0][0], ends[-1][0]),
        refractive_indices=(ends[0][1], ends[-1][1]),
        extrapolated_index_share=sum((part.extrapolated_index_share or 0.0) * flux for part, flux in parts) / total,
        clamped_index_share=sum((part.clamped_index_share or 0.0) * flux for part, flux in parts) / total,
    )


def _within(waves: Float[np.ndarray, " n"], ends: tuple[float, float]) -> Bool[np.ndarray, " n"]:
    return (waves >= ends[0]) & (waves <= ends[1])


def _require_few(clamped: float, low: float, high: float, material: Material, name: str) -> None:
    if clamped <= _MOST_CLAMPED:
        return
    raise InputError(
        f"{name}: wavelengths from {low:g} to {high:g} nm; the index of {material.name} is {material.known}, and "
        f"{100.0 * clamped:.3g} % of the flux is outside, at most {100.0 * _MOST_CLAMPED:g} % may be; give a constant "
        "lens.refractive_index instead of a material, or correct the spectrum"
    )


@dataclass(frozen=True, eq=False)
class ColouredSource(ChangedSource):
    """Source that emits ``spectrum`` from every point in every direction; None if its rays have their wavelengths.

    ``index_range`` and ``warnings``: what is known of the lens's index at its wavelengths.
    """

    spectrum: Spectrum | None
    index_range: IndexRange
    warnings: tuple[str, ...] = ()

    @staticmethod
    def of(source: Source, spectrum: Spectrum, material: Material) -> "ColouredSource":
        """``source`` in the light of ``spectrum``.

        Raises :class:`InputError` if more than 1 % of it is beyond the trusted range of ``material``.
        """
        indices = index_of_spectrum(spectrum, material)
        return ColouredSource(source, spectrum, indices, tuple(index_warnings(indices, material)))

    @staticmethod
    def of_parts(source: Source, parts: Sequence[tuple[Spectrum, float]], material: Material) -> "ColouredSource":
        """``source`` whose rays have wavelengths of the spectra of its ``parts``, each with its flux (W).

        Raises :class:`InputError` as :meth:`of`, for each part.
        """
        indices = joined_range([(index_of_spectrum(spectrum, material), flux) for spectrum, flux in parts])
        return ColouredSource(source, None, indices, tuple(index_warnings(indices, material)))

    def changed_rays(self, rays: RayBundle, seed: int) -> RayBundle:
        """The rays, each with a wavelength drawn by ``seed``."""
        return rays if self.spectrum is None else rays.with_wavelengths(self.spectrum.draw(len(rays), seed))
