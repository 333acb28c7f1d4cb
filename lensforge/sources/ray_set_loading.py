"""Loading of a ray set: ray files or given arrays become one emitter, with a summary of what was done to them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError, remedy
from lensforge.optics.materials import Material
from lensforge.records import Point
from lensforge.sources.bundle import RayBundle
from lensforge.sources.ray_set import RaySetEmitter, placed
from lensforge.sources.rayfiles.rayfile import RayFile, UsableRays, causes, no_usable_ray, usable_rays
from lensforge.sources.rayfiles.reading import read_rayfile
from lensforge.sources.rayfiles.spectra import WAVELENGTH_SEED, wavelengths_of
from lensforge.sources.rayfiles.virtual_focus import virtual_focus
from lensforge.sources.source_summary import AppliedPlacement, LoadedRayFile, RaysDropped, SourceSummary, as_point
from lensforge.sources.spectrum import IndexRange, spectrum_of
from lensforge.spec.emission import SpectrumSpec
from lensforge.spec.ray_source import Placement, RayfilePart, RayfileSource, RayfilesSource, RaySetSource, RaySource


@dataclass(frozen=True, eq=False)
class _Loaded:
    """Usable rays of one file or array in its coordinates (mm), flux in W; ``count`` includes unusable ones."""

    rays: RayBundle
    flux_w: float
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
            part = RayfilePart(file=spec.file, flux_w=spec.flux_w)
            return _emitter([_load_file(part, spec.spectrum, material)], spec)
        case RayfilesSource():
            parts = [_load_file(part, part.spectrum or spec.spectrum, material) for part in spec.files]
            _require_same_dispersion(parts)
            return _emitter([replace(part, warnings=_with_name(part)) for part in parts], spec)
        case RaySource():
            return _emitter([_load_arrays(spec, material)], spec)


def _load_file(part: RayfilePart, spectrum: SpectrumSpec | None, material: Material | None) -> _Loaded:
    rayfile = read_rayfile(part.file)
    rays = usable_rays(rayfile)
    if len(rays) == 0:
        raise no_usable_ray(rayfile, rays.dropped)
    flux_w = _flux_w(part, rayfile, float(rays.flux.sum()))
    bundle, index_range = _bundle(rayfile, rays, flux_w, spectrum, material)
    file = LoadedRayFile(
        file=Path(part.file).name,
        format=rayfile.format,
        rays=len(rayfile),
        rays_dropped=RaysDropped.model_validate(rays.dropped),
        effective_rays=_effective_rays(bundle),
        file_flux=rayfile.total_flux(),
        file_ray_sum=float(rays.flux.sum()),
        file_flux_unit=rayfile.flux_unit,
        flux_w=flux_w,
        virtual_focus_mm=_focus_mm(bundle),
        warnings=rayfile.warnings,
        wavelengths_nm=index_range.wavelengths_nm if index_range else None,
        refractive_indices=index_range.refractive_indices if index_range else None,
    )
    return _Loaded(bundle, flux_w, len(rayfile), index_range, rayfile.warnings, file)


def _load_arrays(spec: RaySource, material: Material | None) -> _Loaded:
    count = len(spec.positions_mm)
    flux = np.ones(count) if spec.ray_flux is None else spec.ray_flux
    given = RayFile(spec.positions_mm, spec.directions, flux, "W", spec.wavelengths_nm, path="source.rays")
    rays = usable_rays(given)
    if len(rays) == 0:
        raise InputError(f"source: none of the {count} rays is usable ({causes(rays.dropped)}); give others")
    flux_w = float(rays.flux.sum()) if spec.flux_w is None else spec.flux_w
    bundle, index_range = _bundle(given, rays, flux_w, spec.spectrum, material)
    left_out = count - len(rays)
    warnings = (f"{left_out} of {count} rays dropped: {causes(rays.dropped)}",) if left_out else ()
    return _Loaded(bundle, flux_w, count, index_range, warnings)


def _flux_w(part: RayfilePart, rayfile: RayFile, ray_sum: float) -> float:
    """Power (W) of a file: of the spec, or the file's own; lumens are never taken as watts."""
    if part.flux_w is not None:
        return part.flux_w
    if rayfile.flux_unit == "W":
        return rayfile.stated_flux or ray_sum
    if rayfile.header_flux_w is not None:
        return rayfile.header_flux_w
    raise InputError(f"{part.file}: its flux is in lm; give the source's power in W as source.flux_w")


def _bundle(
    rayfile: RayFile, rays: UsableRays, flux_w: float, spectrum: SpectrumSpec | None, material: Material | None
) -> tuple[RayBundle, IndexRange | None]:
    """Scale the flux to ``flux_w`` and look up the index of each ray; ``spectrum`` replaces the file's wavelengths."""
    bundle = RayBundle(rays.positions_mm, rays.directions, rays.flux * (flux_w / float(rays.flux.sum())))
    wavelengths_nm = None
    if material is not None and spectrum is not None:
        wavelengths_nm = spectrum_of(spectrum).draw(len(rays), WAVELENGTH_SEED)
    elif material is not None:
        with remedy("give source.spectrum"):
            wavelengths_nm = wavelengths_of(rayfile, rays)
    if material is None or wavelengths_nm is None:
        return bundle, None
    indices = material.index(wavelengths_nm)
    return replace(bundle, refractive_indices=indices), IndexRange.of(wavelengths_nm, material)


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
    total = sum(part.flux_w for part in parts)
    flux_w = spec.flux_w or total
    rays = parts[0].rays if len(parts) == 1 else _joined(parts, flux_w / total)
    focus_mm = _focus_mm(rays)
    origin_mm = _origin_mm(spec, focus_mm, ", ".join(part.name for part in parts))
    bundle = placed(rays, origin_mm, spec)
    index_range = _whole_range(parts)
    files = [part.file for part in parts if part.file is not None]
    summary = SourceSummary(
        title=spec.title,
        flux_w=flux_w,
        symmetry="none",
        rays=sum(part.count for part in parts),
        effective_rays=_effective_rays(rays),
        virtual_focus_mm=focus_mm,
        warnings=tuple(warning for part in parts for warning in part.warnings),
        wavelengths_nm=index_range.wavelengths_nm if index_range else None,
        refractive_indices=index_range.refractive_indices if index_range else None,
        files=tuple(file.model_copy(update={"flux_w": file.flux_w * (flux_w / total)}) for file in files),
        placement=_applied(bundle, flux_w, spec, origin_mm),
    )
    return RaySetEmitter(bundle, flux_w, summary)


def _joined(parts: Sequence[_Loaded], factor: float) -> RayBundle:
    rays = RayBundle.joined([part.rays for part in parts])
    return replace(rays, flux=rays.flux * factor)


def _whole_range(parts: Sequence[_Loaded]) -> IndexRange | None:
    """Least and largest wavelength of all parts, and the indices there."""
    ranges = [part.index_range for part in parts if part.index_range is not None]
    if not ranges:
        return None
    ends = sorted(end for each in ranges for end in zip(each.wavelengths_nm, each.refractive_indices, strict=True))
    (low, at_low), (high, at_high) = ends[0], ends[-1]
    return IndexRange((low, high), (at_low, at_high))


def _origin_mm(spec: Placement, focus_mm: Point | None, name: str) -> Float[np.ndarray, " 3"]:
    """Point of the file that ``spec`` puts at the lens origin."""
    if spec.origin == "file":
        return np.zeros(3)
    if spec.origin != "virtual_focus":
        return np.array(spec.origin, dtype=np.float64)
    if focus_mm is None:
        raise InputError(f"{name}: its rays are parallel and have no virtual focus; give source.origin as a point")
    return np.array(focus_mm)


def _applied(rays: RayBundle, flux_w: float, spec: Placement, origin_mm: Float[np.ndarray, " 3"]) -> AppliedPlacement:
    return AppliedPlacement(
        origin_mm=as_point(origin_mm),
        scale=spec.scale,
        axis=spec.axis,
        mirror=spec.mirror,
        rotate_z_deg=spec.rotate_z_deg,
        backward_share=float(rays.flux[rays.directions[:, 2] < 0.0].sum() / flux_w),
        below_plane_share=float(rays.flux[rays.origins[:, 2] < 0.0].sum() / flux_w),
    )


def _effective_rays(rays: RayBundle) -> float:
    """Number of rays of equal flux that would have the same noise."""
    return float(rays.flux.sum() ** 2 / (rays.flux @ rays.flux))


def _focus_mm(rays: RayBundle) -> Point | None:
    focus = virtual_focus(rays.origins, rays.directions, rays.flux)
    return None if focus is None else as_point(focus)
