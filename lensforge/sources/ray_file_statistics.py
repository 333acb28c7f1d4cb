"""Statistics of a ray file, the numbers that an engineer checks before using it, and warnings on them.

Sums over the usable rays are gathered in one pass over any number of parts, among them the virtual focus: the point
nearest to all rays, by least squares weighted with their flux. Warnings are one line each, the same for a summary, a
conversion and a design: :func:`file_warnings` are about the content of one file; :func:`ray_set_warnings` are about all
rays in the coordinates in which they are used, those of the file in a summary, those of the lens in a design.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from lensforge.errors import InputError
from lensforge.optics.colorimetry import LARGEST_LM_PER_W, luminous_efficacy
from lensforge.results import Point
from lensforge.sources.ray_bundle import RayBundle, Rays, blocks_of, total_of
from lensforge.sources.ray_file_summary import Box, FileFlux, RayFileSummary, WavelengthRange
from lensforge.sources.rayfiles.formats import FORMATS
from lensforge.sources.rayfiles.ray_file import RayFile, causes, column_product, no_usable_ray
from lensforge.sources.rayfiles.ray_file_rows import HUGE
from lensforge.sources.source_spectrum import ColourSums
from lensforge.sources.source_summary import RaysDropped, as_point
from lensforge.sources.stored_rays import usable_blocks

_PARALLEL = 1e-9  # smallest over largest eigenvalue below which rays count as parallel


@dataclass
class RaySums:
    """Sums over usable rays, lengths in mm, fluxes in the unit of the rays; ``dropped``: the others by cause.

    ``backward``: flux towards -z; ``lost``: of that, what starts at z = 0 or below; ``below``: starts below z = 0.
    ``matrix`` and ``moment``: normal equations of ``min_p sum_i flux_i |(1 - k_i k_i^T)(p - x_i)|^2``.
    """

    rays: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    flux: float = 0.0
    flux_squared: float = 0.0
    backward: float = 0.0
    lost: float = 0.0
    below: float = 0.0
    direction: np.ndarray = field(default_factory=lambda: np.zeros(3))
    low: np.ndarray = field(default_factory=lambda: np.full(3, np.inf))
    high: np.ndarray = field(default_factory=lambda: np.full(3, -np.inf))
    matrix: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    moment: np.ndarray = field(default_factory=lambda: np.zeros(3))
    colours: ColourSums = field(default_factory=ColourSums)

    @classmethod
    def of_file(cls, rayfile: RayFile) -> "RaySums":
        """Gather the rays of a file in one pass, flux as stored. Raises :class:`InputError` if none is usable."""
        sums = cls()
        for block, dropped in usable_blocks(rayfile):
            for cause, count in dropped.items():
                sums.dropped[cause] = sums.dropped.get(cause, 0) + count
            sums.add(block)
        return sums.possible(rayfile)

    @classmethod
    def of(cls, rays: Rays) -> "RaySums":
        """Gather rays; their flux has the bits of the sum over all at once."""
        sums = cls()
        fluxes = []
        for block in blocks_of(rays):
            sums.add(block)
            fluxes.append(float(block.flux.sum()))
        sums.flux = total_of(len(rays), fluxes)
        return sums

    def possible(self, rayfile: RayFile) -> "RaySums":
        """Return these sums. Raises :class:`InputError` for no ray at all, and for more flux than any light has."""
        if self.rays == 0:
            raise no_usable_ray(rayfile, self.dropped)
        if self.flux > HUGE:
            raise InputError(
                f"{rayfile.path}: its rays add up to {self.flux:.3g} {rayfile.flux_unit}, must be at most {HUGE:g}; "
                "export it again"
            )
        return self

    def add(self, rays: RayBundle) -> None:
        """Add some rays."""
        if len(rays) == 0:
            return
        self.rays += len(rays)
        self.flux += float(rays.flux.sum())
        self.flux_squared += float(np.square(rays.flux).sum())
        down = rays.directions[:, 2] < 0.0
        height = rays.origins[:, 2]
        self.backward += float(rays.flux[down].sum())
        self.lost += float(rays.flux[down & (height <= 0.0)].sum())
        self.below += float(rays.flux[height < 0.0].sum())
        for axis in range(3):  # sums of columns: three times as fast as along the long axis of both
            self.direction[axis] += float((rays.flux * rays.directions[:, axis]).sum())
            self.low[axis] = min(self.low[axis], rays.origins[:, axis].min())
            self.high[axis] = max(self.high[axis], rays.origins[:, axis].max())
        self._add_to_focus(rays)
        if rays.wavelengths_nm is not None:
            self.colours.add(rays.flux, rays.wavelengths_nm)

    def _add_to_focus(self, rays: RayBundle) -> None:
        """Add to the focus's equations by sums of columns: threads of matrix products would spin between blocks."""
        positions = rays.origins
        directions = rays.directions
        flux = rays.flux
        along = column_product(positions, directions)
        for row in range(3):
            weighted = flux * directions[:, row]
            self.moment[row] += (flux * positions[:, row]).sum() - (weighted * along).sum()
            for column in range(row, 3):
                self.matrix[row, column] -= (weighted * directions[:, column]).sum()
                self.matrix[column, row] = self.matrix[row, column]
            self.matrix[row, row] += flux.sum()

    @property
    def effective_rays(self) -> float:
        """Number of rays of equal flux that would have the same noise."""
        return self.flux**2 / self.flux_squared

    @property
    def focus_mm(self) -> Point | None:
        """Virtual focus; None if the rays are parallel."""
        eigenvalues = np.linalg.eigvalsh(self.matrix)
        if not eigenvalues[0] > _PARALLEL * eigenvalues[2]:
            return None
        return as_point(np.linalg.solve(self.matrix, self.moment))


FEWEST_EFFECTIVE_RAYS = 25_000
"""Below this a lens fits the noise of its rays: designed on 25,000 rays of a measured LED its NMSE is 16 % worse on
other rays of that LED than on its own, on 16,000 of another 20 % (`benchmarks/overfit.py`)."""
_FLUX_TOLERANCE = 0.01  # header and rays that disagree by more than this get a warning
_EFFICACY_TOLERANCE = 0.02  # V in steps of 5 nm and a table of 1 nm agree this well with a vendor's own figure
_PLAUSIBLE_MM = (0.05, 100.0)  # largest side of an LED's bounding box; outside, the unit is probably wrong
_PLAUSIBLE_NM = (200.0, 3000.0)  # of LEDs and lasers; outside, wavelengths are probably in another unit
_BACKWARD_SHARE = 0.01  # of the flux: reflections inside a package send less than this away from the lens


def file_warnings(rayfile: RayFile, sums: RaySums, given_flux: bool = False) -> Iterator[str]:
    """Warnings on the content of a file; ``given_flux``: the user states its power, the file does not."""
    yield from rayfile.warnings
    unit = rayfile.flux_unit
    header = rayfile.header_flux
    if sums.rays < len(rayfile):
        yield f"{len(rayfile) - sums.rays} of {len(rayfile)} rays dropped: {causes(sums.dropped)}"
    expected = {"scale": (), "mean": (1, len(rayfile))}.get(rayfile.header_role, (1,))
    if header and expected and all(abs(sums.flux / (flux * header) - 1.0) > _FLUX_TOLERANCE for flux in expected):
        used = "sum over the rays" if rayfile.header_role == "ignored" else "header"
        used = "given flux" if given_flux else used
        yield f"rays add up to {sums.flux:.6g} {unit}, the header says {header:.6g} {unit}: the {used} is used"
    yield from _wavelength_warnings(rayfile, sums)
    yield from _efficacy_warnings(rayfile, sums)


def _wavelength_warnings(rayfile: RayFile, sums: RaySums) -> Iterator[str]:
    if rayfile.wavelengths_nm is not None and sums.colours.coloured < sums.flux * (1.0 - 1e-12):
        yield f"{100.0 * (1.0 - sums.colours.coloured / sums.flux):.3g} % of the flux has no usable wavelength"
    tables = np.concatenate([np.zeros(0), *(table.wavelengths_nm for table in rayfile.spectral_tables)])
    low = min([sums.colours.low_nm, *tables])
    high = max([sums.colours.high_nm, *tables])
    if low <= high and not _PLAUSIBLE_NM[0] <= low <= high <= _PLAUSIBLE_NM[1]:
        yield f"wavelengths from {low:.6g} to {high:.6g} nm: check their unit"


def _efficacy_warnings(rayfile: RayFile, sums: RaySums) -> Iterator[str]:
    """Compare the lm/W of the file's totals with the lm/W of its wavelengths or of its one common table."""
    watts = rayfile.flux_in("W", sums.flux)
    lumens = rayfile.flux_in("lm", sums.flux)
    if not watts or not lumens:
        return
    stated = lumens / watts
    expected = efficacy_of(rayfile, sums.colours)
    if expected is not None and abs(stated - expected) > _EFFICACY_TOLERANCE * max(expected, 1.0):
        yield f"the header has {stated:.4g} lm/W, its spectrum {expected:.4g} lm/W: check W and lm"
    elif stated > LARGEST_LM_PER_W * (1.0 + _EFFICACY_TOLERANCE):
        yield f"the header has {stated:.4g} lm/W, light has {LARGEST_LM_PER_W:.0f} lm/W at most: check W and lm"


def efficacy_of(rayfile: RayFile, colours: ColourSums) -> float | None:
    """Compute the lm/W of the light of a file: by the wavelengths of its rays, or by its one common table."""
    tables = rayfile.spectral_tables
    if colours.coloured > 0.0:
        return colours.luminous_efficacy(rayfile.flux_unit == "W")
    if len(tables) != 1 or len(tables[0].wavelengths_nm) == 0 or not (np.diff(tables[0].wavelengths_nm) > 0.0).all():
        return None
    return luminous_efficacy(tables[0].wavelengths_nm, tables[0].power_density)


def ray_set_warnings(sums: RaySums, placed: bool) -> Iterator[str]:
    """Warnings on the rays of a source: size of the box of their start points, flux towards -z, noise.

    ``placed``: in the lens; in the file's coordinates light below z = 0 need not be lost.
    """
    side_mm = float((sums.high - sums.low).max())
    if side_mm == 0.0:
        yield "all rays start at one point: no file of an LED does, unless it is of its far field alone"
    elif not _PLAUSIBLE_MM[0] <= side_mm <= _PLAUSIBLE_MM[1]:
        yield f"rays start within {side_mm:.3g} mm: check the length unit{', source.scale' if placed else ''}"
    if sums.backward > _BACKWARD_SHARE * sums.flux:
        notice = f"{100.0 * sums.backward / sums.flux:.3g} % of the flux goes towards -z"
        if placed:
            lost = 100.0 * sums.lost / sums.flux
            yield f"{notice}, {lost:.3g} % from z = 0 or below and so lost: check source.axis"
        else:
            yield f"{notice}, away from a lens on +z: check the axes"
    if sums.effective_rays < FEWEST_EFFECTIVE_RAYS:
        yield (
            f"{sums.effective_rays:.0f} effective rays: with fewer than {FEWEST_EFFECTIVE_RAYS} a lens fits their "
            'noise, and is worse with other rays of the LED; ask for a larger file, and leave source.model at "auto"'
        )


def outline(rayfile: RayFile) -> RayFileSummary:
    """Describe the header without reading the rays: at once, whatever the size of the file."""
    return RayFileSummary(
        format=rayfile.format,
        title=FORMATS[rayfile.format].title if rayfile.format in FORMATS else None,
        rays=len(rayfile),
        flux=FileFlux(unit=rayfile.flux_unit, header_w=rayfile.header_flux_w, header_lm=rayfile.header_flux_lm),
        wavelengths_nm=_header_wavelengths(rayfile),
        header=dict(rayfile.header),
        warnings=rayfile.warnings,
    )


def describe(rayfile: RayFile) -> RayFileSummary:
    """Summarise header and usable rays: lengths in mm, flux in the file's unit, wavelengths in nm.

    One pass in parts, so that memory stays bounded. Raises :class:`InputError` if no ray is usable.
    """
    sums = RaySums.of_file(rayfile)
    header = outline(rayfile)
    flux = {
        "total": rayfile.total_flux(sums.flux),
        "total_from": "header" if rayfile.stated_flux else "rays",
        "ray_sum": sums.flux,
        "backward_share": sums.backward / sums.flux,
    }
    colours = sums.colours
    mean_nm = sums.colours.mean_nm
    of_rays = None if mean_nm is None else WavelengthRange(min=colours.low_nm, max=colours.high_nm, mean=mean_nm)
    summary = header.changed(
        rays_used=sums.rays,
        rays_dropped=RaysDropped.model_validate(sums.dropped),
        effective_rays=sums.effective_rays,
        flux=header.flux.changed(**flux),
        bounding_box_mm=Box(min=as_point(sums.low), max=as_point(sums.high)),
        virtual_focus_mm=sums.focus_mm,
        mean_direction=as_point(sums.direction / sums.flux),
        wavelengths_nm=of_rays or header.wavelengths_nm,
        warnings=(*file_warnings(rayfile, sums), *ray_set_warnings(sums, placed=False)),
    )
    summary._rayfile = rayfile  # for its plot: neither compared nor saved
    return summary


def _header_wavelengths(rayfile: RayFile) -> WavelengthRange | None:
    """Range of the wavelength that all rays share, or of all spectral tables; the mean where there is one table."""
    shared = rayfile.single_wavelength
    tables = rayfile.spectral_tables
    if shared is not None:
        return WavelengthRange(min=shared, max=shared, mean=shared)
    if not tables:
        return None
    waves = np.concatenate([table.wavelengths_nm for table in tables])
    power = np.trapezoid(tables[0].power_density, tables[0].wavelengths_nm)
    mean = None
    if len(tables) == 1 and power > 0.0:
        mean = float(np.trapezoid(tables[0].power_density * tables[0].wavelengths_nm, tables[0].wavelengths_nm) / power)
    return WavelengthRange(min=float(waves.min()), max=float(waves.max()), mean=mean)
