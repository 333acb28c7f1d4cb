"""Loading of a ray set: ray files or given arrays become one emitter, with a summary of what was done to them.

Rays of a large file stay in it: they are in W, and have wavelengths where the lens's index depends on them.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, remedy
from lensforge.optics.material import Material
from lensforge.results import Point
from lensforge.sources.dispersion import coloured, index_warnings, joined_range
from lensforge.sources.light_files import read_rayfile
from lensforge.sources.ray_bundle import RayBundle, Rays, changed, joined
from lensforge.sources.ray_colours import coloured_set
from lensforge.sources.ray_file_statistics import RaySums, efficacy_of, file_warnings, ray_set_warnings
from lensforge.sources.ray_set import RaySetEmitter, placed
from lensforge.sources.rayfiles.ray_file import RayFile, no_usable_ray
from lensforge.sources.source_flux import (
    OwnFlux,
    SourceFlux,
    joined_flux,
    settled_flux,
    spectral_efficacy,
    with_spectrum_compared,
)
from lensforge.sources.source_spectrum import spectrum_of, usable_wavelengths
from lensforge.sources.source_summary import (
    AppliedPlacement,
    IndexRange,
    LoadedRayFile,
    RaysDropped,
    SourceSummary,
    as_point,
)
from lensforge.sources.stored_rays import StoredRays
from lensforge.spec.emitter_section import EmitterSection, FluxSection, SpectrumSpec
from lensforge.spec.source_sections import (
    Placement,
    RayfilePart,
    RayfileSource,
    RayfilesSource,
    RaySetSource,
    RaySource,
)

_LEAST_SHARE = 1e-9  # of the flux of several files; one with less is mistaken, such as W beside lm


@dataclass(frozen=True, eq=False)
class _Loaded:
    """Usable rays of one file or array in its coordinates (mm), flux in W; ``count`` includes unusable ones.

    ``sums``: over the rays as stored, ``figures``: over these.
    """

    rays: Rays
    flux: SourceFlux
    sums: RaySums
    figures: RaySums
    count: int
    index_range: IndexRange | None
    warnings: tuple[str, ...]
    file: LoadedRayFile | None = None

    @property
    def name(self) -> str:
        return "source.rays" if self.file is None else self.file.file


@dataclass(frozen=True)
class _Requested:
    """Requested properties of rays: wavelengths for a lens of ``material``, and ``colours``."""

    material: Material | None
    colours: bool


def load_ray_set(spec: RaySetSource, material: Material | None = None, *, colours: bool = False) -> RaySetEmitter:
    """Load the emitter that ``spec`` describes; with ``material``, of a dispersive lens, rays carry their wavelengths.

    With ``colours`` they carry X, Y and Z per W.

    Several files keep their powers, or with ``spec.flux_w`` their ratio. Raises :class:`InputError`, one line,
    for files or arrays that cannot be used.
    """
    requested = _Requested(material, colours)
    match spec:
        case RayfileSource():
            part = RayfilePart(file=spec.file, flux_w=spec.flux_w, flux_lm=spec.flux_lm)
            return _emitter([_load_file(part, spec, requested)], spec)
        case RayfilesSource():
            parts = [_load_file(part, spec, requested) for part in spec.files]
            _require_same_dispersion(parts)
            named = (tuple(f"{part.name}: {warning}" for warning in part.warnings) for part in parts)
            return _emitter(
                [replace(part, warnings=warnings) for part, warnings in zip(parts, named, strict=True)], spec
            )
        case RaySource():
            relative = np.ones(len(spec.positions_mm)) if spec.ray_flux is None else spec.ray_flux
            given = RayFile(spec.positions_mm, spec.directions, relative, "W", spec.wavelengths_nm, path="source.rays")
            return _emitter([_loaded(given, spec, spec, spec.spectrum, requested)], spec)


def _load_file(part: RayfilePart, spec: RaySetSource, requested: _Requested) -> _Loaded:
    rayfile = read_rayfile(part.file)
    loaded = _loaded(rayfile, part, spec, part.spectrum or spec.spectrum, requested)
    file = LoadedRayFile(
        file=Path(part.file).name,
        format=rayfile.format,
        rays=loaded.count,
        rays_dropped=RaysDropped.model_validate(loaded.sums.dropped),
        effective_rays=loaded.figures.effective_rays,
        file_flux=rayfile.total_flux(loaded.sums.flux),
        file_ray_sum=loaded.sums.flux,
        file_flux_unit=rayfile.flux_unit,
        flux_w=loaded.flux.flux_w,
        virtual_focus_mm=loaded.figures.focus_mm,
        warnings=loaded.warnings,
        **({} if loaded.index_range is None else loaded.index_range.fields()),
    )
    return replace(loaded, file=file)


def _loaded(
    rayfile: RayFile, stated: FluxSection, spec: RaySetSource, spectrum: SpectrumSpec | None, requested: _Requested
) -> _Loaded:
    """Load the usable rays of a file, in W, with the ``requested`` properties.

    ``stated``: the flux by the spec. ``spectrum``: of the spec, in place of the file's own.
    """
    stored = StoredRays.of(rayfile)
    if len(stored) == 0:
        raise no_usable_ray(rayfile, stored.dropped)
    rays = stored.loaded()
    sums = replace(RaySums.of(rays), dropped=stored.dropped).possible(rayfile)
    flux = _flux(rayfile, stored, sums, stated, spec, spectrum)
    factor = flux.flux_w / sums.flux
    rays = changed(rays, lambda some: replace(some, flux=some.flux * factor, waves=None))
    figures = RaySums.of(rays)
    index_range = None
    dispersion = tuple[str, ...]()
    material = requested.material
    name = rayfile.path if spectrum is None else "source.spectrum"
    if material is not None:
        with remedy("give source.spectrum"):
            stored = stored.coloured(None if spectrum is None else spectrum_of(spectrum))
        if stored.has_wavelengths:
            rays = changed(stored.loaded(), lambda some: replace(some, flux=some.flux * factor))
            rays, index_range = coloured(rays, material, name)
            dispersion = tuple(index_warnings(index_range, material))
    if requested.colours:
        rays = _with_colours(rays, stored, factor, spectrum, rayfile.path)
    given_flux = stated.flux_w is not None or stated.flux_lm is not None
    warnings = (*file_warnings(rayfile, sums, given_flux), *dispersion)
    return _Loaded(rays, flux, sums, figures, len(rayfile), index_range, warnings)


def _with_colours(rays: Rays, stored: StoredRays, factor: float, spectrum: SpectrumSpec | None, name: str) -> Rays:
    """``rays`` with X, Y and Z per W; ``stored``: the same, and ``factor`` takes their flux to W.

    Where no lens disperses them and no spectrum is given, they follow the file: each its own wavelength, or one drawn
    from the file's tables; those without a usable one are of the mean wavelength.
    """
    coloured_rays = stored if stored.drawn_nm is not None or spectrum is not None else stored.coloured()
    if rays.take(slice(0, 1)).wavelengths_nm is not None or spectrum is not None or not coloured_rays.has_wavelengths:
        return coloured_set(rays, spectrum, name)
    mean_nm = RaySums.of(coloured_rays.loaded()).colours.mean_nm
    if mean_nm is None:
        raise InputError(f"{name}: no ray has a usable wavelength; give source.spectrum, or leave out [colour]")

    def usable(some: RayBundle) -> RayBundle:
        assert some.wavelengths_nm is not None
        waves = np.where(usable_wavelengths(some.wavelengths_nm), some.wavelengths_nm, mean_nm)
        return replace(some, flux=some.flux * factor).with_wavelengths(waves)

    coloured = coloured_set(changed(coloured_rays.loaded(), usable), None, name)
    return changed(coloured, lambda some: replace(some, waves=None))


def _flux(
    rayfile: RayFile,
    stored: StoredRays,
    sums: RaySums,
    stated: FluxSection,
    spec: EmitterSection,
    spectrum: SpectrumSpec | None,
) -> SourceFlux:
    """Settle the flux of ``rayfile``, a part or all of the source ``spec``.

    The luminous efficacy of a source of several files is that of their light together; it is taken for a single one
    only where nothing else is known of it.
    """
    colours = sums.colours
    if rayfile.spectrum_numbers is not None:
        with suppress(InputError):  # tables that cannot be used are an error where the material is dispersive
            colours = RaySums.of(stored.coloured().loaded()).colours
    file_lm_per_w = efficacy_of(rayfile, colours)
    efficacy = spec.luminous_efficacy_lm_per_w
    total = rayfile.stated_flux or sums.flux
    trusted = rayfile.header_role != "ignored"
    if rayfile.flux_unit == "W":
        own_flux = OwnFlux(total, rayfile.header_flux_lm if trusted else None, file_lm_per_w)
    else:
        own_flux = OwnFlux(rayfile.header_flux_w if trusted else None, total, file_lm_per_w)
    spectral = spectral_efficacy(spectrum)
    settled = settled_flux(stated, None if isinstance(spec, RayfilesSource) else efficacy, spectral, own_flux)
    return (
        settled_flux(stated, efficacy, spectral, own_flux)
        if settled.efficacy is None or settled.least_power
        else settled
    )


def _require_same_dispersion(parts: Sequence[_Loaded]) -> None:
    """Refuse files of which only some have wavelengths: the lens would disperse only their light."""
    without = [part.name for part in parts if part.index_range is None]
    if 0 < len(without) < len(parts):
        raise InputError(
            f"{', '.join(without)}: no wavelengths, as the other files have; add a spectrum to that entry of "
            "source.files, or give lens.refractive_index instead of a dispersive material"
        )


def _emitter(parts: Sequence[_Loaded], spec: RaySetSource) -> RaySetEmitter:
    """Join ``parts``, with the power of ``spec`` if it states one, and place them in lens coordinates."""
    names = [f"source.files[{number}] ({part.name})" for number, part in enumerate(parts)]
    fluxes = [part.flux for part in parts]
    flux = joined_flux(spec, fluxes, spec.luminous_efficacy_lm_per_w, names)
    flux = with_spectrum_compared(flux, spec, spectral_efficacy(spec.spectrum), fluxes)
    total = sum(part.flux_w for part in fluxes)
    flux_w = flux.flux_w
    for name, part in zip(names, parts, strict=True):
        if part.flux.flux_w < _LEAST_SHARE * total:
            raise InputError(f"{name}: {part.flux.flux_w / total:.3g} of the flux of all: correct it, or leave it out")
    rays = parts[0].rays
    figures = parts[0].figures
    if len(parts) > 1 or flux_w != total:
        together = joined([part.rays for part in parts])
        rays = changed(together, lambda some: replace(some, flux=some.flux * (flux_w / total)))
        figures = RaySums.of(rays)
    origin_mm = _origin_mm(spec, figures.focus_mm, ", ".join(part.name for part in parts))
    rays = changed(rays, lambda some: placed(some, origin_mm, spec))
    at_place = RaySums.of(rays)
    ranges = [(part.index_range, part.flux.flux_w) for part in parts if part.index_range is not None]
    index_range = joined_range(ranges) if ranges else None
    files = [part.file for part in parts if part.file is not None]
    summary = SourceSummary(
        title=spec.title,
        flux_w=flux_w,
        lumens_per_watt=flux.lumens_per_watt,
        symmetry="none",
        rays=sum(part.count for part in parts),
        effective_rays=figures.effective_rays,
        virtual_focus_mm=figures.focus_mm,
        warnings=(
            *(warning for part in parts for warning in part.warnings),
            *flux.warnings,
            *ray_set_warnings(at_place, placed=True),
        ),
        files=tuple(file.changed(flux_w=file.flux_w * (flux_w / total)) for file in files),
        placement=AppliedPlacement(
            origin_mm=as_point(origin_mm),
            backward_share=at_place.backward / flux_w,
            below_plane_share=at_place.below / flux_w,
        ),
    )
    if index_range is not None:
        summary = summary.changed(**index_range.fields())
    return RaySetEmitter(rays, flux_w, summary, pose=spec.pose)


def _origin_mm(spec: Placement, focus_mm: Point | None, name: str) -> Float[np.ndarray, " 3"]:
    if spec.origin == "file":
        return np.zeros(3)
    if spec.origin != "virtual_focus":
        return np.array(spec.origin, dtype=np.float64)
    if focus_mm is None:
        raise InputError(f"{name}: its rays are parallel and have no virtual focus; give source.origin as a point")
    return np.array(focus_mm)
