"""Warnings on a ray file, one line each: the same for a summary, a conversion and a design.

:func:`file_warnings` are about the content of one file; :func:`ray_set_warnings` are about all rays in the coordinates
in which they are used: those of the file in a summary, those of the lens in a design.
"""

from collections.abc import Iterator

import numpy as np

from lensforge.optics.photopic import LARGEST_LM_PER_W, luminous_efficacy
from lensforge.sources.rayfiles.rayfile import RayFile, causes
from lensforge.sources.rayfiles.sums import RaySums

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
