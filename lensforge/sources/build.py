"""From a spec's ``[source]`` to an emitter; what one kind needs is loaded for that kind only."""

from importlib import import_module
from typing import Any

from lensforge.optics.materials import Material
from lensforge.sources.bundle import Source
from lensforge.sources.square import SquareEmitter
from lensforge.spec.source import RayfileSource, RayfilesSource, SquareSource
from lensforge.spec.source import Source as SourceSpec

# The kinds that are loaded only where they are asked for, and what makes their emitter.
_BUILDERS = {
    "rayfile": "lensforge.sources.rayfile_loading:load_rayfile",
    "rayfiles": "lensforge.sources.rayfile_loading:load_rayfiles",
    "rectangle": "lensforge.sources.planar:planar_emitter",
    "disc": "lensforge.sources.planar:planar_emitter",
    "chips": "lensforge.sources.planar:planar_emitter",
    "chip_array": "lensforge.sources.planar:planar_emitter",
    "luminance": "lensforge.sources.planar:planar_emitter",
    "radiance": "lensforge.sources.radiance:radiance_emitter",
}


def build_source(spec: SourceSpec, material: Material | None = None) -> Source:
    """The emitter that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used.

    ``material``: the dispersive one of the lens, if it is; then rays whose wavelength is known carry its index there.
    """
    if isinstance(spec, RayfileSource | RayfilesSource):
        return _made(spec, material)
    emitter = SquareEmitter(spec.side_mm, spec.flux_w) if isinstance(spec, SquareSource) else _made(spec)
    if material is None or spec.spectrum is None:
        return emitter
    spectrum = import_module("lensforge.sources.spectrum").spectrum_of(spec.spectrum)
    coloured: Source = import_module("lensforge.sources.dispersed").DispersedSource(emitter, spectrum, material)
    return coloured


def _made(spec: SourceSpec, *more: Any) -> Source:
    module, function = _BUILDERS[spec.kind].split(":")
    emitter: Source = getattr(import_module(module), function)(spec, *more)
    return emitter


def account_of(source: Source, spec: SourceSpec) -> dict[str, Any]:
    """What ``source`` is, its power and symmetry; of a measured one also its files and all that was done to them."""
    account: dict[str, Any] = getattr(source, "account", {})
    return {"title": spec.title, "flux_w": source.flux_w, "symmetry": source.symmetry, **account}
