"""Statistics of a ray file, the numbers that an engineer checks before using it, and warnings on them.

Sums over the usable rays are gathered in one pass over any number of parts, among them the virtual focus: the point
nearest to all rays, by least squares weighted with their flux. Warnings are one line each, the same for a summary, a
conversion and a design: :func:`file_warnings` are about the content of one file; :func:`ray_set_warnings` are about all
rays in the coordinates in which they are used, those of the file in a summary, those of the lens in a design.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.photopic import LARGEST_LM_PER_W, efficacy_at, luminous_efficacy
from lensforge.sources.ray_bundle import total_of
from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.ray_file import FluxUnit, RayFile, UsableRays, causes, no_usable_ray, usable_chunks
from lensforge.sources.rayfiles.ray_file_bytes import HUGE
from lensforge.sources.rayfiles.ray_file_summary import (
    Box,
    FileFlux,
    FileUnits,
    HeaderFlux,
    RayFileHeader,
    RayFileSummary,
    WavelengthRange,
)
from lensforge.sources.rayfiles.stored_rays import StoredRays
from lensforge.sources.source_spectrum import usable_wavelengths
from lensforge.sources.source_summary import RaysDropped, as_point

_PARALLEL = 1e-9  # smallest over largest eigenvalue below which rays count as parallel


@dataclass
class FocusFit:
    """Normal equations of ``min_p sum_i flux_i |(1 - k_i k_i^T)(p - x_i)|^2``, gathered from any number of blocks."""

    matrix: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.zeros((3, 3)))
    moment: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))

    def add(
        self,
        positions: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        flux: Float[np.ndarray, " n"],
    ) -> None:
        """Add ``n`` rays: positions in mm, unit directions, flux above 0 in any unit.

        Sums of columns, not products of matrices: the threads of these spin from one block to the next.
        """
        along = sum((positions[:, axis] * directions[:, axis] for axis in range(3)), np.zeros(len(flux)))
        for row in range(3):
            weighted = flux * directions[:, row]
            self.moment[row] += (flux * positions[:, row]).sum() - (weighted * along).sum()
            for column in range(row, 3):
                self.matrix[row, column] -= (weighted * directions[:, column]).sum()
                self.matrix[column, row] = self.matrix[row, column]
            self.matrix[row, row] += flux.sum()

    def point(self) -> Float[np.ndarray, " 3"] | None:
        """Solve for the virtual focus (mm); None where the rays are parallel."""
        eigenvalues = np.linalg.eigvalsh(self.matrix)
        if not eigenvalues[0] > _PARALLEL * eigenvalues[2]:
            return None
        return np.linalg.solve(self.matrix, self.moment)


def virtual_focus(
    positions: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    flux: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " 3"] | None:
    """Compute the virtual focus (mm) of rays with unit directions; None where they are parallel."""
    fit = FocusFit()
    fit.add(positions, directions, flux)
    return fit.point()


@dataclass
class RaySums:
    """Sums of usable rays: fluxes as stored, lengths in mm, wavelengths in nm; ``dropped``: the others by cause.

    ``backward``: flux towards -z. ``coloured``: flux of the rays that have a wavelength; ``as_lumens``: that flux times
    the lm/W of each, ``as_watts``: divided by it, infinite where a ray is invisible.
    """

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
    coloured: float = 0.0
    as_lumens: float = 0.0
    as_watts: float = 0.0

    @classmethod
    def of(cls, rayfile: RayFile) -> "RaySums":
        """Gather the rays of a file block by block. Raises :class:`InputError` if none is usable."""
        sums = cls()
        for part in usable_chunks(rayfile):
            sums.add(part)
        if sums.rays == 0:
            raise no_usable_ray(rayfile, sums.dropped)
        return sums.possible(rayfile)

    def possible(self, rayfile: RayFile) -> "RaySums":
        """Return these sums. Raises :class:`InputError` where the rays add up to more than any light has."""
        if self.flux > HUGE:
            raise InputError(
                f"{rayfile.path}: its rays add up to {self.flux:.3g} {rayfile.flux_unit}, must be at most {HUGE:g}; "
                "export it again"
            )
        return self

    @classmethod
    def of_rays(cls, rays: UsableRays | StoredRays) -> "RaySums":
        """Gather the usable rays of a file; their flux has the bits of the sum over all at once."""
        sums, fluxes = cls(), []
        for block in rays.blocks():
            sums.add(block)
            fluxes.append(float(block.flux.sum()))
        sums.dropped = dict(rays.dropped)
        sums.flux = total_of(len(rays), fluxes)
        return sums

    def add(self, rays: UsableRays) -> None:
        """Add the rays of one part."""
        for cause, count in rays.dropped.items():
            self.dropped[cause] = self.dropped.get(cause, 0) + count
        if len(rays) == 0:
            return
        self.rays += len(rays)
        self.flux += float(rays.flux.sum())
        self.flux_squared += float(np.square(rays.flux).sum())
        self.backward += float(rays.flux[rays.directions[:, 2] < 0.0].sum())
        for axis in range(3):  # sums of columns: three times as fast as along the long axis of both
            self.direction[axis] += float((rays.flux * rays.directions[:, axis]).sum())
            self.low[axis] = min(self.low[axis], rays.positions_mm[:, axis].min())
            self.high[axis] = max(self.high[axis], rays.positions_mm[:, axis].max())
        self.focus.add(rays.positions_mm, rays.directions, rays.flux)
        if rays.wavelengths_nm is not None:
            self._add_wavelengths(rays.wavelengths_nm, rays.flux)

    def _add_wavelengths(self, wavelengths: np.ndarray, flux: np.ndarray) -> None:
        usable = usable_wavelengths(wavelengths)
        if not usable.any():
            return
        waves, power = wavelengths[usable], flux[usable]
        self.wavelength_low = min(self.wavelength_low, float(waves.min()))
        self.wavelength_high = max(self.wavelength_high, float(waves.max()))
        self.wavelength_flux += float((power * waves).sum())
        self.coloured += float(power.sum())
        efficacy = efficacy_at(waves)
        self.as_lumens += float((power * efficacy).sum())
        with np.errstate(divide="ignore"):
            self.as_watts += float((power / efficacy).sum())

    @property
    def effective_rays(self) -> float:
        """Number of rays of equal flux that would have the same noise."""
        return self.flux**2 / self.flux_squared

    @property
    def mean_wavelength_nm(self) -> float | None:
        """Mean by flux of the rays that have a wavelength; None where none has."""
        return self.wavelength_flux / self.coloured if self.coloured > 0.0 else None

    def luminous_efficacy(self, unit: FluxUnit) -> float | None:
        """Compute the lm/W of the rays by their wavelengths, their flux being in ``unit``; None without wavelengths."""
        if not self.coloured > 0.0:
            return None
        return self.as_lumens / self.coloured if unit == "W" else self.coloured / self.as_watts


FEWEST_EFFECTIVE_RAYS = 25_000
"""Below this a lens fits the noise of its rays: designed on 25,000 rays of a measured LED its NMSE is 16 % worse on
other rays of that LED than on its own, on 16,000 of another 20 % (docs/rayfiles.md, `benchmarks/overfit.py`)."""
_FLUX_TOLERANCE = 0.01  # header and rays that disagree by more than this get a warning
_EFFICACY_TOLERANCE = 0.02  # V in steps of 5 nm and a table of 1 nm agree this well with a vendor's own figure
_PLAUSIBLE_MM = (0.05, 100.0)  # largest side of an LED's bounding box; outside, the unit is probably wrong
_PLAUSIBLE_NM = (200.0, 3000.0)  # of LEDs and lasers; outside, wavelengths are probably in another unit
_BACKWARD_SHARE = 0.01  # of the flux: reflections inside a package send less than this away from the lens


def file_warnings(rayfile: RayFile, sums: RaySums, given_flux: bool = False) -> tuple[str, ...]:
    """List what is odd in the content of a file; with ``given_flux`` the user states its power, the file does not."""
    return (*rayfile.warnings, *_content_warnings(rayfile, sums, given_flux))


def _content_warnings(rayfile: RayFile, sums: RaySums, given_flux: bool) -> Iterator[str]:
    unit, header = rayfile.flux_unit, rayfile.header_flux
    if sums.rays < len(rayfile):
        yield f"{len(rayfile) - sums.rays} of {len(rayfile)} rays dropped: {causes(sums.dropped)}"
    if header and rayfile.header_role != "scale" and abs(sums.flux / header - 1.0) > _FLUX_TOLERANCE:
        used = "sum over the rays" if rayfile.header_role == "ignored" else "header"
        used = "given flux" if given_flux else used
        yield f"rays add up to {sums.flux:.6g} {unit}, the header says {header:.6g} {unit}: the {used} is used"
    yield from _wavelength_warnings(rayfile, sums)
    yield from _efficacy_warnings(rayfile, sums)


def _wavelength_warnings(rayfile: RayFile, sums: RaySums) -> Iterator[str]:
    if rayfile.wavelengths_nm is not None and sums.coloured < sums.flux * (1.0 - 1e-12):
        yield f"{100.0 * (1.0 - sums.coloured / sums.flux):.3g} % of the flux has no usable wavelength"
    tables = np.concatenate([np.zeros(0), *(table.wavelengths_nm for table in rayfile.spectral_tables)])
    low = min([sums.wavelength_low, *tables])
    high = max([sums.wavelength_high, *tables])
    if low <= high and not _PLAUSIBLE_NM[0] <= low <= high <= _PLAUSIBLE_NM[1]:
        yield f"wavelengths from {low:.6g} to {high:.6g} nm: check their unit"


def _efficacy_warnings(rayfile: RayFile, sums: RaySums) -> Iterator[str]:
    """Compare the lm/W of the file's totals with that of its wavelengths or of its one common table."""
    watts, lumens = rayfile.flux_in("W", sums.flux), rayfile.flux_in("lm", sums.flux)
    if not watts or not lumens:
        return
    stated, expected = lumens / watts, efficacy_of(rayfile, sums)
    if expected is not None and abs(stated - expected) > _EFFICACY_TOLERANCE * max(expected, 1.0):
        yield f"the header has {stated:.4g} lm/W, its spectrum {expected:.4g} lm/W: check W and lm"
    elif stated > LARGEST_LM_PER_W * (1.0 + _EFFICACY_TOLERANCE):
        yield f"the header has {stated:.4g} lm/W, light has {LARGEST_LM_PER_W:.0f} lm/W at most: check W and lm"


def efficacy_of(rayfile: RayFile, sums: RaySums) -> float | None:
    """Compute the lm/W of the light of a file: by the wavelengths of its rays, or by its one common table."""
    tables = rayfile.spectral_tables
    if sums.coloured > 0.0:
        return sums.luminous_efficacy(rayfile.flux_unit)
    if len(tables) != 1 or len(tables[0].wavelengths_nm) == 0 or not (np.diff(tables[0].wavelengths_nm) > 0.0).all():
        return None
    return luminous_efficacy(tables[0].wavelengths_nm, tables[0].power_density)


def ray_set_warnings(
    side_mm: float, backward_share: float, effective_rays: float, lost_share: float | None = None
) -> Iterator[str]:
    """List what is odd in the rays of a source: largest side of the box of their start points, flux towards -z, noise.

    ``lost_share``: of the flux that goes towards -z from z = 0 or below in the lens; None in the file's coordinates,
    where that says nothing.
    """
    placed = lost_share is not None
    if side_mm == 0.0:
        yield "all rays start at one point: no file of an LED does, unless it is of its far field alone"
    elif not _PLAUSIBLE_MM[0] <= side_mm <= _PLAUSIBLE_MM[1]:
        yield f"rays start within {side_mm:.3g} mm: check the length unit{', source.scale' if placed else ''}"
    if backward_share > _BACKWARD_SHARE:
        words = f"{100.0 * backward_share:.3g} % of the flux goes towards -z"
        if lost_share is not None:
            yield f"{words}, {100.0 * lost_share:.3g} % from z = 0 or below and so lost: check source.axis"
        else:
            yield f"{words}, away from a lens on +z: check the axes"
    if effective_rays < FEWEST_EFFECTIVE_RAYS:
        yield (
            f"{effective_rays:.0f} effective rays: a lens fits the noise of fewer than {FEWEST_EFFECTIVE_RAYS} and is "
            "worse in other light than in that of the rays it is designed with; ask for a larger file"
        )


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
