"""Figures of all rays of a ray set: their flux, noise and focus, and where they start and go.

The flux is what the file says of it, and the spec's word on it. The others are gathered block by block.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lensforge.errors import InputError
from lensforge.optics.photopic import efficacy_at, luminous_efficacy
from lensforge.results import Point
from lensforge.sources.ray_bundle import RayBundle, Rays, blocks_of, total_of
from lensforge.sources.rayfiles.ray_file import RayFile, UsableRays
from lensforge.sources.rayfiles.ray_file_statistics import FocusFit
from lensforge.sources.rayfiles.stored_rays import StoredRays, with_wavelengths
from lensforge.sources.source_flux import OwnFlux, SourceFlux, settled_flux, spectral_efficacy
from lensforge.sources.source_summary import as_point
from lensforge.spec.emitter_section import EmitterSection, FluxSection, SpectrumSpec
from lensforge.spec.source_sections import RayfilesSource


def part_flux(
    stated: FluxSection,
    spec: EmitterSection,
    spectrum: SpectrumSpec | None,
    rayfile: RayFile,
    rays: UsableRays | StoredRays,
    ray_sum: float,
) -> SourceFlux:
    """Settle the flux of ``rayfile``, a part or all of the source ``spec``, of which ``rays`` are the usable rays.

    ``spectrum``: of the spec, in place of the file's own. ``ray_sum``: of the rays' flux, in the file's unit. The
    luminous efficacy of a source of several files is that of their light together; it is taken for a single one only
    where nothing else is known of it.
    """
    own, spectral = own_flux(rayfile, rays, ray_sum), spectral_efficacy(spectrum)
    efficacy = spec.luminous_efficacy_lm_per_w
    found = settled_flux(stated, None if isinstance(spec, RayfilesSource) else efficacy, spectral, own)
    return settled_flux(stated, efficacy, spectral, own) if found.efficacy is None or found.least_power else found


def own_flux(rayfile: RayFile, rays: UsableRays | StoredRays, ray_sum: float) -> OwnFlux:
    """Totals (W, lm) that ``rayfile`` states or that its rays add up to, and the lm/W of its spectrum."""
    stated = rayfile.stated_flux or ray_sum
    trusted = rayfile.header_role != "ignored"
    if rayfile.flux_unit == "W":
        return OwnFlux(stated, rayfile.header_flux_lm if trusted else None, _spectral(rayfile, rays))
    return OwnFlux(rayfile.header_flux_w if trusted else None, stated, _spectral(rayfile, rays))


def _spectral(rayfile: RayFile, rays: UsableRays | StoredRays) -> float | None:
    """Luminous efficacy (lm/W) by the spectral table, or by the wavelengths of the rays; None where it has neither."""
    tables = rayfile.spectral_tables
    if rayfile.wavelengths_nm is None and len(tables) == 1:
        return luminous_efficacy(tables[0].wavelengths_nm, tables[0].power_density)
    try:
        blocks = with_wavelengths(rayfile, rays)
        return None if blocks is None else _mean_efficacy(blocks, len(rays), rayfile.flux_unit == "W")
    except InputError:  # spectral tables that cannot be used: an error where the material is dispersive, and only there
        return None


def _mean_efficacy(
    blocks: Iterator[tuple[UsableRays, Float[np.ndarray, " n"]]], count: int, in_watts: bool
) -> float | None:
    """Mean lm/W of ``count`` rays with their wavelengths; None for rays in lm of which some are invisible."""
    flux, converted = list[float](), list[float]()
    for part, wavelengths_nm in blocks:
        efficacy = efficacy_at(wavelengths_nm)
        if not in_watts and not efficacy.all():
            return None
        converted.append(float((part.flux * (efficacy if in_watts else 1.0 / efficacy)).sum()))
        flux.append(float(part.flux.sum()))
    ratio = total_of(count, converted) / total_of(count, flux)
    return ratio if in_watts else 1.0 / ratio


@dataclass(frozen=True)
class LightFigures:
    """Noise and focus of rays, wherever they are: ``effective_rays`` of equal flux would have the same noise.

    ``focus_mm``: their virtual focus, None where they are parallel.
    """

    effective_rays: float
    focus_mm: Point | None

    @staticmethod
    def of(rays: Rays) -> "LightFigures":
        """Gather them from all rays."""
        focus, sums, squares = FocusFit(), [], 0.0
        for block in blocks_of(rays):
            focus.add(block.origins, block.directions, block.flux)
            sums.append(block.flux.sum())
            squares += np.square(block.flux).sum()
        point = focus.point()
        return LightFigures(float(total_of(len(rays), sums) ** 2 / squares), None if point is None else as_point(point))


@dataclass(frozen=True)
class PlacedFigures:
    """Start points and directions in lens coordinates: the largest side (mm) of the box of the first, and flux.

    ``flux``: of all (W); ``backward``: towards -z; ``lost``: of that, what starts at z = 0 or below; ``below``: starts
    below z = 0.
    """

    side_mm: float
    flux: float
    backward: float
    lost: float
    below: float

    @staticmethod
    def of(rays: Rays) -> "PlacedFigures":
        """Gather them from all rays."""
        low, high, sums = np.full(3, np.inf), np.full(3, -np.inf), []
        for block in blocks_of(rays):
            for axis in range(3):
                low[axis] = min(low[axis], block.origins[:, axis].min())
                high[axis] = max(high[axis], block.origins[:, axis].max())
            sums.append([block.flux.sum(), *(block.flux[those].sum() for those in _groups(block))])
        flux, backward, lost, below = (float(total_of(len(rays), column)) for column in zip(*sums, strict=True))
        return PlacedFigures(float((high - low).max()), flux, backward, lost, below)


def _groups(rays: RayBundle) -> Iterator[Bool[np.ndarray, " n"]]:
    down, height = rays.directions[:, 2] < 0.0, rays.origins[:, 2]
    yield from (down, down & (height <= 0.0), height < 0.0)
