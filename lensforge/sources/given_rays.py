"""Rays given as arrays, such as those of another program, as a source: cleaned, powered and placed like a file's."""

import numpy as np

from lensforge.errors import InputError
from lensforge.optics.materials import Material
from lensforge.sources.bundle import RayBundle
from lensforge.sources.dispersed import colours
from lensforge.sources.measured import measured_emitter
from lensforge.sources.rayfile_source import RayfileEmitter
from lensforge.sources.rayfiles.cleaning import causes, valid_rays
from lensforge.sources.rayfiles.record import RayFile
from lensforge.sources.rayfiles.wavelengths import wavelengths_of
from lensforge.spec.source import RaySource


def load_rays(spec: RaySource, material: Material | None = None) -> RayfileEmitter:
    """The emitter of the rays in ``spec``, dispersed by ``material``. Raises :class:`InputError` if none is usable."""
    count = len(spec.positions_mm)
    flux = np.ones(count) if spec.ray_flux is None else spec.ray_flux
    given = RayFile(spec.positions_mm, spec.directions, flux, "W", spec.wavelengths_nm, path="source.wavelengths_nm")
    rays = valid_rays(given)
    if len(rays) == 0:
        raise InputError(f"source: none of the {count} rays is usable ({causes(rays.dropped)}); give others")
    ray_sum = float(rays.flux.sum())
    flux_w = ray_sum if spec.flux_w is None else spec.flux_w
    waves = wavelengths_of(given, rays, spec.spectrum) if material else None
    indices = None if waves is None or material is None else material.index(waves)
    bundle = RayBundle(rays.positions, rays.directions, rays.flux * (flux_w / ray_sum), indices)
    left_out = count - len(rays)
    return measured_emitter(
        bundle,
        flux_w,
        spec,
        count,
        warnings=[f"{left_out} of {count} rays dropped: {causes(rays.dropped)}"] if left_out else [],
        colours=None if waves is None or material is None else colours(waves, material),
    )
