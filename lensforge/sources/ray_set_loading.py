"""Loading of a ray set: ray files or given arrays become one emitter, with a summary of what was done to them.

Rays of a large file stay in it: they are in W, and have what the lens's material has at their wavelengths.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError, remedy
from lensforge.optics.material import Material
from lensforge.results import Point
from lensforge.sources.dispersion import IndexAccount, IndexRange, dispersed, in_material, known_or
from lensforge.sources.ray_bundle import RayBundle, Rays, blocks_of, changed, joined
from lensforge.sources.ray_set import RaySetEmitter, placed
from lensforge.sources.ray_set_figures import LightFigures, PlacedFigures, part_flux
from lensforge.sources.rayfiles.ray_file import RayFile, UsableRays, as_float64, causes, no_usable_ray
from lensforge.sources.rayfiles.ray_file_io import read_rayfile
from lensforge.sources.rayfiles.ray_file_statistics import RaySums, file_warnings, ray_set_warnings
from lensforge.sources.rayfiles.stored_rays import StoredRays, drawn_wavelengths, loaded_or_stored, wavelengths_of
from lensforge.sources.source_flux import SourceFlux, joined_flux, spectral_efficacy, with_spectrum_compared
from lensforge.sources.source_pose import SourcePose
from lensforge.sources.source_spectrum import spectrum_of
from lensforge.sources.source_summary import AppliedPlacement, LoadedRayFile, RaysDropped, SourceSummary, as_point
from lensforge.spec.emitter_section import FluxSection, SpectrumSpec
from lensforge.spec.source_sections import (
    Placement,
    RayfilePart,
    RayfileSource,
    RayfilesSource,
    RaySetSource,
    RaySource,
)


@dataclass(frozen=True, eq=False)
class Colours:
    """Wavelengths (nm) of rays, ``mean_nm`` for those without a usable one, and the ``material`` of the lens."""

    wavelengths_nm: Float[np.ndarray, " n"]
    mean_nm: float
    material: Material


@dataclass(frozen=True, eq=False)
class RaysOfFile:
    """The ``stored`` rays of a file, ``factor`` times their flux; with ``colours`` each has its index in a lens."""

    stored: StoredRays
    factor: float
    colours: Colours | None = None

    def __len__(self) -> int:
        return len(self.stored)

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> RayBundle:
        """Read some of the rays."""
        found, colours = self.stored.take(rows), self.colours
        rays = RayBundle(found.positions_mm, found.directions, found.flux * self.factor)
        if colours is None:
            return rays
        waves = known_or(colours.mean_nm, as_float64(colours.wavelengths_nm[rows]))
        return in_material(rays, waves, colours.material)

    def dispersed(
        self, wavelengths_nm: Float[np.ndarray, " n"], material: Material, name: str
    ) -> tuple["RaysOfFile", IndexRange]:
        """The same rays with their index in ``material``; ``name`` is the source in errors.

        Raises :class:`InputError` where more than 1 % of the flux is beyond the material's trusted range.
        """
        account, start = IndexAccount(material), 0
        for block in blocks_of(self):
            account.add(block.flux, as_float64(wavelengths_nm[start : start + len(block)]))
            start += len(block)
        found = account.index_range(name)
        return RaysOfFile(self.stored, self.factor, Colours(wavelengths_nm, account.mean_nm, material)), found


_LEAST_SHARE = 1e-9  # of the flux of several files; one with less is mistaken, such as W beside lm


@dataclass(frozen=True, eq=False)
class _Loaded:
    """Usable rays of one file or array in its coordinates (mm), flux in W; ``count`` includes unusable ones."""

    rays: Rays
    flux: SourceFlux
    figures: LightFigures
    count: int
    index_range: IndexRange | None
    warnings: tuple[str, ...]
    file: LoadedRayFile | None = None

    @property
    def name(self) -> str:
        return "source.rays" if self.file is None else self.file.file


def load_ray_set(spec: RaySetSource, material: Material | None = None) -> RaySetEmitter:
    """Load the emitter that ``spec`` describes; with ``material`` each ray carries its refractive index there.

    Several files keep their powers, or with ``spec.flux_w`` their ratio. Raises :class:`InputError`, one line,
    for files or arrays that cannot be used.
    """
    match spec:
        case RayfileSource():
            part = RayfilePart(file=spec.file, flux_w=spec.flux_w, flux_lm=spec.flux_lm)
            return _emitter([_load_file(part, spec, material)], spec)
        case RayfilesSource():
            parts = [_load_file(part, spec, material) for part in spec.files]
            _require_same_dispersion(parts)
            return _emitter([replace(part, warnings=_with_name(part)) for part in parts], spec)
        case RaySource():
            return _emitter([_load_arrays(spec, material)], spec)


def _load_file(part: RayfilePart, spec: RaySetSource, material: Material | None) -> _Loaded:
    rayfile, spectrum = read_rayfile(part.file), part.spectrum or spec.spectrum
    rays = loaded_or_stored(rayfile)
    if len(rays) == 0:
        raise no_usable_ray(rayfile, rays.dropped)
    sums = RaySums.of_rays(rays).possible(rayfile)
    flux = part_flux(part, spec, spectrum, rayfile, rays, sums.flux)
    bundle, index_range = _bundle(rayfile, rays, flux.flux_w / sums.flux, spectrum, material)
    figures = LightFigures.of(bundle)
    warnings = _warnings(rayfile, sums, part, index_range, material)
    file = LoadedRayFile(
        file=Path(part.file).name,
        format=rayfile.format,
        rays=len(rayfile),
        rays_dropped=RaysDropped.model_validate(rays.dropped),
        effective_rays=figures.effective_rays,
        file_flux=rayfile.total_flux(sums.flux),
        file_ray_sum=sums.flux,
        file_flux_unit=rayfile.flux_unit,
        flux_w=flux.flux_w,
        virtual_focus_mm=figures.focus_mm,
        warnings=warnings,
    )
    if index_range is not None:
        file = file.model_copy(update=index_range.fields())
    return _Loaded(bundle, flux, figures, len(rayfile), index_range, warnings, file)


def _load_arrays(spec: RaySource, material: Material | None) -> _Loaded:
    count = len(spec.positions_mm)
    relative = np.ones(count) if spec.ray_flux is None else spec.ray_flux
    given = RayFile(spec.positions_mm, spec.directions, relative, "W", spec.wavelengths_nm, path="source.rays")
    rays = loaded_or_stored(given)
    if len(rays) == 0:
        raise InputError(f"source: none of the {count} rays is usable ({causes(rays.dropped)}); give others")
    sums = RaySums.of_rays(rays)
    flux = part_flux(spec, spec, spec.spectrum, given, rays, sums.flux)
    bundle, index_range = _bundle(given, rays, flux.flux_w / sums.flux, spec.spectrum, material)
    warnings = _warnings(given, sums.possible(given), spec, index_range, material)
    return _Loaded(bundle, flux, LightFigures.of(bundle), count, index_range, warnings)


def _warnings(
    rayfile: RayFile, sums: RaySums, stated: FluxSection, found: IndexRange | None, material: Material | None
) -> tuple[str, ...]:
    """Warnings on one file or array, apart from its place in the lens."""
    given_flux = stated.flux_w is not None or stated.flux_lm is not None
    dispersion = () if found is None or material is None else found.warnings(material)
    return (*file_warnings(rayfile, sums, given_flux), *dispersion)


def _bundle(
    rayfile: RayFile,
    rays: UsableRays | StoredRays,
    factor: float,
    spectrum: SpectrumSpec | None,
    material: Material | None,
) -> tuple[Rays, IndexRange | None]:
    """Scale the flux by ``factor`` and look up the index of each ray; ``spectrum`` replaces the file's wavelengths."""
    wavelengths_nm, name = None, rayfile.path if spectrum is None else "source.spectrum"
    if material is not None and spectrum is not None:
        wavelengths_nm = drawn_wavelengths(spectrum_of(spectrum), rays)
    elif material is not None:
        with remedy("give source.spectrum"):
            wavelengths_nm = wavelengths_of(rayfile, rays)
    found: RaysOfFile | RayBundle
    if isinstance(rays, StoredRays):
        found = RaysOfFile(rays, factor)
    else:
        found = RayBundle(rays.positions_mm, rays.directions, rays.flux * factor)
    if material is None or wavelengths_nm is None:
        return found, None
    if isinstance(found, RaysOfFile):
        return found.dispersed(wavelengths_nm, material, name)
    return dispersed(found, wavelengths_nm, material, name)


def _with_name(part: _Loaded) -> tuple[str, ...]:
    return tuple(f"{part.name}: {warning}" for warning in part.warnings)


def _require_same_dispersion(parts: Sequence[_Loaded]) -> None:
    """Refuse files of which only some have wavelengths: the lens would disperse the light of these alone."""
    without = [part.name for part in parts if part.index_range is None]
    if 0 < len(without) < len(parts):
        raise InputError(
            f"{', '.join(without)}: no wavelengths, as the other files have; add a spectrum to that entry of "
            "source.files, or give lens.refractive_index instead of a dispersive material"
        )


def _emitter(parts: Sequence[_Loaded], spec: RaySetSource) -> RaySetEmitter:
    """Join ``parts``, with the power of ``spec`` if it states one, and place them in lens coordinates."""
    names = [f"source.files[{number}] ({part.name})" for number, part in enumerate(parts)]
    flux = joined_flux(spec, [part.flux for part in parts], spec.luminous_efficacy_lm_per_w, names)
    flux = with_spectrum_compared(flux, spec, spectral_efficacy(spec.spectrum))
    total, flux_w = sum(part.flux.flux_w for part in parts), flux.flux_w
    for name, part in zip(names, parts, strict=True):
        if part.flux.flux_w < _LEAST_SHARE * total:
            raise InputError(f"{name}: {part.flux.flux_w / total:.3g} of the flux of all: correct it, or leave it out")
    rays = parts[0].rays if len(parts) == 1 else _joined(parts, flux_w / total)
    figures = parts[0].figures if len(parts) == 1 else LightFigures.of(rays)
    origin_mm = _origin_mm(spec, figures.focus_mm, ", ".join(part.name for part in parts))
    rays = changed(rays, lambda some: placed(some, origin_mm, spec))
    at_place = PlacedFigures.of(rays)
    index_range = _whole_range(parts)
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
            *_placed_warnings(at_place, figures.effective_rays),
        ),
        files=tuple(file.model_copy(update={"flux_w": file.flux_w * (flux_w / total)}) for file in files),
        placement=_applied(at_place, flux_w, spec, origin_mm),
    )
    if index_range is not None:
        summary = summary.model_copy(update=index_range.fields())
    pose = SourcePose.of(spec)
    return RaySetEmitter(rays, flux_w, summary, pose=pose if pose.moves else None)


def _joined(parts: Sequence[_Loaded], factor: float) -> Rays:
    return changed(joined([part.rays for part in parts]), lambda some: replace(some, flux=some.flux * factor))


def _whole_range(parts: Sequence[_Loaded]) -> IndexRange | None:
    """Least and largest wavelength of all parts, the indices there, and shares of the flux of all."""
    known = [(part.index_range, part.flux.flux_w) for part in parts if part.index_range is not None]
    if not known:
        return None
    ends = sorted(end for each, _ in known for end in zip(each.wavelengths_nm, each.refractive_indices, strict=True))
    (low, at_low), (high, at_high) = ends[0], ends[-1]
    total = sum(flux for _, flux in known)
    extrapolated = sum(each.extrapolated_share * flux for each, flux in known) / total
    clamped = sum(each.clamped_share * flux for each, flux in known) / total
    return IndexRange((low, high), (at_low, at_high), extrapolated, clamped)


def _placed_warnings(found: PlacedFigures, effective_rays: float) -> tuple[str, ...]:
    """Warnings on the rays of a whole source at their place in the lens."""
    shares = found.backward / found.flux, effective_rays, found.lost / found.flux
    return tuple(ray_set_warnings(found.side_mm, *shares))


def _origin_mm(spec: Placement, focus_mm: Point | None, name: str) -> Float[np.ndarray, " 3"]:
    """Point of the file that ``spec`` puts at the lens origin."""
    if spec.origin == "file":
        return np.zeros(3)
    if spec.origin != "virtual_focus":
        return np.array(spec.origin, dtype=np.float64)
    if focus_mm is None:
        raise InputError(f"{name}: its rays are parallel and have no virtual focus; give source.origin as a point")
    return np.array(focus_mm)


def _applied(
    found: PlacedFigures, flux_w: float, spec: Placement, origin_mm: Float[np.ndarray, " 3"]
) -> AppliedPlacement:
    return AppliedPlacement(
        origin_mm=as_point(origin_mm),
        scale=spec.scale,
        axis=spec.axis,
        mirror=spec.mirror,
        rotate_z_deg=spec.rotate_z_deg,
        tilt_deg=spec.tilt_deg,
        position_mm=spec.position_mm,
        backward_share=found.backward / flux_w,
        below_plane_share=found.below / flux_w,
    )
