"""Statistics of a ray file: the numbers that an engineer checks before using it."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.rayfile import RayFile, UsableRays, causes, no_usable_ray, usable_chunks
from lensforge.sources.rayfiles.spectra import luminous_efficacy
from lensforge.sources.rayfiles.summary import (
    Box,
    FileFlux,
    FileUnits,
    HeaderFlux,
    RayFileHeader,
    RayFileSummary,
    WavelengthRange,
)
from lensforge.sources.rayfiles.virtual_focus import FocusFit
from lensforge.sources.source_summary import RaysDropped, as_point

_FLUX_TOLERANCE = 0.01  # header and rays that disagree by more than this get a warning
_EFFICACY_TOLERANCE = 0.02
_PLAUSIBLE_MM = (0.05, 100.0)  # largest side of an LED's bounding box; outside, the unit is probably wrong


@dataclass
class _Sums:
    """Sums that one pass over the rays gathers."""

    rays: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    flux: float = 0.0
    flux_squared: float = 0.0
    backward: float = 0.0
    direction: np.ndarray = field(default_factory=lambda: np.zeros(3))
    low: np.ndarray = field(default_factory=lambda: np.full(3, np.inf))
    high: np.ndarray = field(default_factory=lambda: np.full(3, -np.inf))
    focus: FocusFit = field(default_factory=FocusFit)
    wavelength_low: float = np.inf
    wavelength_high: float = -np.inf
    wavelength_flux: float = 0.0

    def add(self, rays: UsableRays) -> None:
        for cause, count in rays.dropped.items():
            self.dropped[cause] = self.dropped.get(cause, 0) + count
        if len(rays) == 0:
            return
        self.rays += len(rays)
        self.flux += float(rays.flux.sum())
        self.flux_squared += float(rays.flux @ rays.flux)
        self.backward += float(rays.flux[rays.directions[:, 2] < 0.0].sum())
        self.direction += rays.flux @ rays.directions
        self.low = np.minimum(self.low, rays.positions_mm.min(axis=0))
        self.high = np.maximum(self.high, rays.positions_mm.max(axis=0))
        self.focus.add(rays.positions_mm, rays.directions, rays.flux)
        if rays.wavelengths_nm is not None:
            self._add_wavelengths(rays.wavelengths_nm, rays.flux)

    def _add_wavelengths(self, wavelengths: np.ndarray, flux: np.ndarray) -> None:
        usable = (wavelengths > 0.0) & (wavelengths < 1e7)
        if usable.any():
            self.wavelength_low = min(self.wavelength_low, float(wavelengths[usable].min()))
            self.wavelength_high = max(self.wavelength_high, float(wavelengths[usable].max()))
        self.wavelength_flux += float(flux[usable] @ wavelengths[usable])


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
    sums = _Sums()
    for part in usable_chunks(rayfile):
        sums.add(part)
    if sums.rays == 0:
        raise no_usable_ray(rayfile, sums.dropped)
    focus = sums.focus.point()
    summary = RayFileSummary(
        format=rayfile.format,
        title=_title(rayfile),
        rays=len(rayfile),
        units=_units(rayfile),
        rays_used=sums.rays,
        rays_dropped=RaysDropped.model_validate(sums.dropped),
        effective_rays=sums.flux**2 / sums.flux_squared,
        flux=_flux(rayfile, sums),
        bounding_box_mm=Box(min=as_point(sums.low), max=as_point(sums.high)),
        virtual_focus_mm=None if focus is None else as_point(focus),
        mean_direction=as_point(sums.direction / sums.flux),
        wavelengths_nm=_wavelengths(sums) or _header_wavelengths(rayfile),
        header=dict(rayfile.header),
        warnings=(*rayfile.warnings, *_warnings(rayfile, sums)),
    )
    return summary.holding(rayfile)


def _title(rayfile: RayFile) -> str | None:
    return FORMATS[rayfile.format].title if rayfile.format in FORMATS else None


def _units(rayfile: RayFile) -> FileUnits:
    length = rayfile.header.get("mm_per_unit")
    return FileUnits(length_in_file_mm=length if isinstance(length, float | int) else 1.0, flux=rayfile.flux_unit)


def _flux(rayfile: RayFile, sums: _Sums) -> FileFlux:
    return FileFlux(
        unit=rayfile.flux_unit,
        header_w=rayfile.header_flux_w,
        header_lm=rayfile.header_flux_lm,
        total=rayfile.stated_flux or sums.flux,
        total_from="header" if rayfile.stated_flux else "rays",
        ray_sum=sums.flux,
        ray_sum_over_header=sums.flux / rayfile.header_flux if rayfile.header_flux else None,
        backward_share=sums.backward / sums.flux,
    )


def _wavelengths(sums: _Sums) -> WavelengthRange | None:
    if not np.isfinite(sums.wavelength_low):
        return None
    mean = sums.wavelength_flux / sums.flux
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


def _warnings(rayfile: RayFile, sums: _Sums) -> Iterator[str]:
    unit, header = rayfile.flux_unit, rayfile.header_flux
    if sums.rays < len(rayfile):
        yield f"{len(rayfile) - sums.rays} of {len(rayfile)} rays dropped: {causes(sums.dropped)}"
    if header and rayfile.header_role != "scale" and abs(sums.flux / header - 1.0) > _FLUX_TOLERANCE:
        used = "sum over the rays" if rayfile.header_role == "ignored" else "header"
        yield f"rays add up to {sums.flux:.6g} {unit}, the header says {header:.6g} {unit}: the {used} is used"
    side = float((sums.high - sums.low).max())
    if not _PLAUSIBLE_MM[0] <= side <= _PLAUSIBLE_MM[1]:
        yield f"rays start within {side:.3g} mm: check the length unit"
    if sums.backward > 0.01 * sums.flux:
        yield f"{100.0 * sums.backward / sums.flux:.3g} % of the flux goes towards -z: check the axes"
    yield from _efficacy_warnings(rayfile)


def _efficacy_warnings(rayfile: RayFile) -> Iterator[str]:
    """Compare the lm/W of the header with that of the file's spectrum, where it has one common table."""
    tables = rayfile.spectral_tables
    if len(tables) != 1 or not (rayfile.header_flux_w and rayfile.header_flux_lm):
        return
    stated = rayfile.header_flux_lm / rayfile.header_flux_w
    expected = luminous_efficacy(tables[0].wavelengths_nm, tables[0].power_density)
    if expected is not None and abs(stated / expected - 1.0) > _EFFICACY_TOLERANCE:
        yield f"the header has {stated:.4g} lm/W, its spectrum {expected:.4g} lm/W: check W and lm"
