"""Statistics of a ray file: the numbers that an engineer checks before using it."""

import numpy as np

from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.rayfile import RayFile
from lensforge.sources.rayfiles.summary import (
    Box,
    FileFlux,
    FileUnits,
    HeaderFlux,
    RayFileHeader,
    RayFileSummary,
    WavelengthRange,
)
from lensforge.sources.rayfiles.sums import RaySums
from lensforge.sources.rayfiles.warnings import file_warnings, ray_set_warnings
from lensforge.sources.source_summary import RaysDropped, as_point


def outline(rayfile: RayFile) -> RayFileHeader:
    """Describe the header without reading the rays: at once, whatever the size of the file."""
    return RayFileHeader(
        format=rayfile.format,
        title=_title(rayfile),
        rays=len(rayfile),
        units=_units(rayfile),
        flux=HeaderFlux(unit=rayfile.flux_unit, header_w=rayfile.header_flux_w, header_lm=rayfile.header_flux_lm),
        wavelengths_nm=_header_wavelengths(rayfile),
        header=dict(rayfile.header),
        warnings=rayfile.warnings,
    )


def describe(rayfile: RayFile) -> RayFileSummary:
    """Summarise the usable rays: lengths in mm, flux in the file's unit, wavelengths in nm.

    One pass in parts, so that memory stays bounded. Raises :class:`InputError` if no ray is usable.
    """
    sums = RaySums.of(rayfile)
    focus = sums.focus.point()
    summary = RayFileSummary(
        format=rayfile.format,
        title=_title(rayfile),
        rays=len(rayfile),
        units=_units(rayfile),
        rays_used=sums.rays,
        rays_dropped=RaysDropped.model_validate(sums.dropped),
        effective_rays=sums.effective_rays,
        flux=_flux(rayfile, sums),
        bounding_box_mm=Box(min=as_point(sums.low), max=as_point(sums.high)),
        virtual_focus_mm=None if focus is None else as_point(focus),
        mean_direction=as_point(sums.direction / sums.flux),
        wavelengths_nm=_wavelengths(sums) or _header_wavelengths(rayfile),
        header=dict(rayfile.header),
        warnings=(*file_warnings(rayfile, sums), *_as_stored(sums)),
    )
    return summary.holding(rayfile)


def _as_stored(sums: RaySums) -> tuple[str, ...]:
    """Warnings on the rays in the coordinates of the file."""
    side_mm = float((sums.high - sums.low).max())
    return tuple(ray_set_warnings(side_mm, sums.backward / sums.flux, sums.effective_rays))


def _title(rayfile: RayFile) -> str | None:
    return FORMATS[rayfile.format].title if rayfile.format in FORMATS else None


def _units(rayfile: RayFile) -> FileUnits:
    length = rayfile.header.get("mm_per_unit")
    return FileUnits(length_in_file_mm=length if isinstance(length, float | int) else 1.0, flux=rayfile.flux_unit)


def _flux(rayfile: RayFile, sums: RaySums) -> FileFlux:
    return FileFlux(
        unit=rayfile.flux_unit,
        header_w=rayfile.header_flux_w,
        header_lm=rayfile.header_flux_lm,
        total=rayfile.total_flux(sums.flux),
        total_from="header" if rayfile.stated_flux else "rays",
        ray_sum=sums.flux,
        ray_sum_over_header=sums.flux / rayfile.header_flux if rayfile.header_flux else None,
        backward_share=sums.backward / sums.flux,
    )


def _wavelengths(sums: RaySums) -> WavelengthRange | None:
    mean = sums.mean_wavelength_nm
    if mean is None:
        return None
    return WavelengthRange(min=sums.wavelength_low, max=sums.wavelength_high, mean=mean)


def _header_wavelengths(rayfile: RayFile) -> WavelengthRange | None:
    """Range of the wavelength that all rays share, or of all spectral tables; the mean where there is one table."""
    shared = rayfile.single_wavelength
    if shared is not None:
        return WavelengthRange(min=shared, max=shared, mean=shared)
    tables = rayfile.spectral_tables
    if not tables:
        return None
    waves = np.concatenate([table.wavelengths_nm for table in tables])
    power = np.trapezoid(tables[0].power_density, tables[0].wavelengths_nm)
    mean = None
    if len(tables) == 1 and power > 0.0:
        mean = float(np.trapezoid(tables[0].power_density * tables[0].wavelengths_nm, tables[0].wavelengths_nm) / power)
    return WavelengthRange(min=float(waves.min()), max=float(waves.max()), mean=mean)
