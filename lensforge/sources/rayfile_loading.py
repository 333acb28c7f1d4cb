"""From ray files to one emitter: read, cleaned, powered, joined, placed, and everything done to them written down."""

from dataclasses import dataclass, replace
from pathlib import Path

from lensforge.errors import InputError
from lensforge.optics.materials import Material
from lensforge.sources.account import FileAccount, Range, RaysDropped
from lensforge.sources.bundle import RayBundle
from lensforge.sources.dispersed import colours
from lensforge.sources.measured import effective_rays, focus_of, measured_emitter
from lensforge.sources.rayfile_source import RayfileEmitter
from lensforge.sources.rayfiles.cleaning import no_usable_ray, valid_rays
from lensforge.sources.rayfiles.reading import read_rayfile
from lensforge.sources.rayfiles.record import RayFile
from lensforge.sources.rayfiles.wavelengths import wavelengths_of
from lensforge.spec.source import RayfilePart, RayfileSource, RayfilesSource
from lensforge.spec.spectrum import Spectrum as SpectrumSpec


@dataclass(frozen=True)
class _Colours:
    """What is known of a file's light besides the file: a spectrum that takes its place, and the lens's material."""

    spectrum: SpectrumSpec | None
    material: Material | None


@dataclass(frozen=True, eq=False)
class _Part:
    """The usable rays of one file, in its coordinates, with its power; and what is to be said of it."""

    rays: RayBundle
    account: FileAccount

    @property
    def colours(self) -> tuple[Range, Range] | None:
        """The range of its wavelengths (nm), and the indices there."""
        waves, indices = self.account.wavelengths_nm, self.account.refractive_indices
        return None if waves is None or indices is None else (waves, indices)


def load_rayfile(spec: RayfileSource, material: Material | None = None) -> RayfileEmitter:
    """The emitter of one file, dispersed by ``material``. Raises :class:`InputError`, one line, for what is no use."""
    part = _load(RayfilePart(file=spec.file, flux_w=spec.flux_w), _Colours(spec.spectrum, material))
    file = part.account
    return measured_emitter(
        part.rays, file.flux_w, spec, file.rays, files=[file], warnings=file.warnings, colours=part.colours
    )


def load_rayfiles(spec: RayfilesSource, material: Material | None = None) -> RayfileEmitter:
    """One emitter of all rays of several files: their powers, or with ``spec.flux_w`` the ratio of these, are kept."""
    parts = [_load(entry, _Colours(entry.spectrum or spec.spectrum, material)) for entry in spec.files]
    total = sum(part.account.flux_w for part in parts)
    flux_w = spec.flux_w or total
    _same_knowledge(parts)
    joined = RayBundle.joined([part.rays for part in parts])
    files = [part.account.model_copy(update={"flux_w": part.account.flux_w * (flux_w / total)}) for part in parts]
    return measured_emitter(
        replace(joined, weights=joined.weights * (flux_w / total)),
        flux_w,
        spec,
        sum(file.rays for file in files),
        files=files,
        warnings=[f"{file.file}: {warning}" for file in files for warning in file.warnings],
        colours=_all_colours(parts),
    )


def _all_colours(parts: list[_Part]) -> tuple[Range, Range] | None:
    """The least and the largest wavelength of all parts, and the indices there."""
    known = [part.colours for part in parts if part.colours is not None]
    if not known:
        return None
    ends = sorted((wave, index) for waves, indices in known for wave, index in zip(waves, indices, strict=True))
    (low, at_low), (high, at_high) = ends[0], ends[-1]
    return (low, high), (at_low, at_high)


def _same_knowledge(parts: list[_Part]) -> None:
    """A lens that disperses the light of one file and not that of the next is no lens."""
    without = [part.account.file for part in parts if part.rays.refractive_indices is None]
    if 0 < len(without) < len(parts):
        raise InputError(
            f"{', '.join(without)}: no wavelengths, as the other files have; add a spectrum to that entry of "
            "source.files, or give lens.refractive_index instead of a dispersive material"
        )


def _load(part: RayfilePart, light: _Colours) -> _Part:
    rayfile = read_rayfile(part.file)
    rays = valid_rays(rayfile)
    if len(rays) == 0:
        raise no_usable_ray(rayfile, rays.dropped)
    ray_sum = float(rays.flux.sum())
    flux_w = _flux_w(part, rayfile, ray_sum)
    wavelengths = wavelengths_of(rayfile, rays, light.spectrum) if light.material else None
    indices = None if wavelengths is None or light.material is None else light.material.index(wavelengths)
    bundle = RayBundle(rays.positions, rays.directions, rays.flux * (flux_w / ray_sum), indices)
    seen = None if wavelengths is None or light.material is None else colours(wavelengths, light.material)
    account = FileAccount(
        file=Path(part.file).name,
        format=rayfile.format,
        rays=len(rayfile),
        rays_dropped=RaysDropped.model_validate(rays.dropped),
        effective_rays=effective_rays(bundle),
        file_flux=rayfile.total_flux(),
        file_ray_sum=ray_sum,
        file_flux_unit=rayfile.unit,
        flux_w=flux_w,
        virtual_focus_mm=focus_of(bundle),
        warnings=rayfile.warnings,
        wavelengths_nm=seen[0] if seen else None,
        refractive_indices=seen[1] if seen else None,
    )
    return _Part(bundle, account)


def _flux_w(part: RayfilePart, rayfile: RayFile, ray_sum: float) -> float:
    """The power (W) of a file: of the spec, or the file's own, never lm taken as W."""
    if part.flux_w is not None:
        return part.flux_w
    if rayfile.unit == "W":
        return rayfile.stated_flux or ray_sum
    if rayfile.header_flux_w is not None:
        return rayfile.header_flux_w
    raise InputError(f"{part.file}: its flux is in lm; give the source's power in W as source.flux_w")
