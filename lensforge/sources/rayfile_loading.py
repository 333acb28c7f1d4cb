"""From ray files to one emitter: read, cleaned, powered, joined, placed, and everything done to them written down."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.optics.materials import Material
from lensforge.sources.bundle import RayBundle
from lensforge.sources.dispersed import colours
from lensforge.sources.placement import origin_of, placed
from lensforge.sources.rayfile_source import RayfileEmitter
from lensforge.sources.rayfiles.cleaning import no_usable_ray, valid_rays
from lensforge.sources.rayfiles.reading import read_rayfile
from lensforge.sources.rayfiles.record import RayFile
from lensforge.sources.rayfiles.virtual_focus import virtual_focus
from lensforge.sources.rayfiles.wavelengths import wavelengths_of
from lensforge.spec.source import Placement, RayfilePart, RayfileSource, RayfilesSource
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
    account: dict[str, Any]


def load_rayfile(spec: RayfileSource, material: Material | None = None) -> RayfileEmitter:
    """The emitter of one file, dispersed by ``material``. Raises :class:`InputError`, one line, for what is no use."""
    part = _load(RayfilePart(file=spec.file, flux_w=spec.flux_w), _Colours(spec.spectrum, material))
    return _emitter(part.rays, part.account["flux_w"], spec, part.account)


def load_rayfiles(spec: RayfilesSource, material: Material | None = None) -> RayfileEmitter:
    """One emitter of all rays of several files: their powers, or with ``spec.flux_w`` the ratio of these, are kept."""
    parts = [_load(entry, _Colours(entry.spectrum or spec.spectrum, material)) for entry in spec.files]
    total = sum(part.account["flux_w"] for part in parts)
    flux_w = spec.flux_w or total
    for part in parts:
        part.account["flux_w"] *= flux_w / total
    _same_knowledge(parts)
    joined = RayBundle.joined([part.rays for part in parts])
    joined = replace(joined, weights=joined.weights * (flux_w / total))
    accounts = [part.account for part in parts]
    warnings = [f"{account['file']}: {warning}" for account in accounts for warning in account["warnings"]]
    account = {
        "file": ", ".join(account["file"] for account in accounts),
        "files": accounts,
        "rays": sum(account["rays"] for account in accounts),
        "effective_rays": _effective_rays(joined),
        "virtual_focus_mm": _focus(joined),
        "warnings": warnings,
    }
    return _emitter(joined, flux_w, spec, account)


def _same_knowledge(parts: list[_Part]) -> None:
    """A lens that disperses the light of one file and not that of the next is no lens."""
    without = [part.account["file"] for part in parts if part.rays.refractive_indices is None]
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
    account = {
        "file": Path(part.file).name,
        "format": rayfile.format,
        "rays": len(rayfile),
        "rays_dropped": rays.dropped,
        "effective_rays": _effective_rays(bundle),
        "file_flux": rayfile.total_flux(),
        "file_ray_sum": ray_sum,
        "file_flux_unit": rayfile.unit,
        "flux_w": flux_w,
        "virtual_focus_mm": _focus(bundle),
        "warnings": list(rayfile.warnings),
    }
    if wavelengths is not None and light.material is not None:
        account |= colours(wavelengths, light.material)
    return _Part(bundle, account)


def _emitter(rays: RayBundle, flux_w: float, spec: Placement, account: dict[str, Any]) -> RayfileEmitter:
    origin = origin_of(rays, spec, account["file"])
    bundle = placed(rays, origin, spec)
    placement = {
        "flux_w": flux_w,
        "origin_mm": origin.tolist(),
        "scale": spec.scale,
        "axis": spec.axis,
        "mirror": spec.mirror,
        "rotate_z_deg": spec.rotate_z_deg,
        "backward_share": float(bundle.weights[bundle.directions[:, 2] < 0.0].sum() / flux_w),
        "below_plane_share": float(bundle.weights[bundle.origins[:, 2] < 0.0].sum() / flux_w),
    }
    return RayfileEmitter(bundle, flux_w, account | placement)


def _flux_w(part: RayfilePart, rayfile: RayFile, ray_sum: float) -> float:
    """The power (W) of a file: of the spec, or the file's own, never lm taken as W."""
    if part.flux_w is not None:
        return part.flux_w
    if rayfile.unit == "W":
        return rayfile.stated_flux or ray_sum
    if rayfile.header_flux_w is not None:
        return rayfile.header_flux_w
    raise InputError(f"{part.file}: its flux is in lm; give the source's power in W as source.flux_w")


def _effective_rays(rays: RayBundle) -> float:
    return float(rays.weights.sum() ** 2 / (rays.weights @ rays.weights))


def _focus(rays: RayBundle) -> list[float] | None:
    focus = virtual_focus(rays.origins, rays.directions, rays.weights)
    return None if focus is None else focus.tolist()
