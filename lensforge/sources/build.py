"""From a spec's ``[source]`` to an emitter; what one kind needs is loaded for that kind only."""

from importlib import import_module
from typing import Any

from lensforge.sources.bundle import Source
from lensforge.sources.square import SquareEmitter
from lensforge.spec.source import Source as SourceSpec
from lensforge.spec.source import SquareSource

# The kinds that are loaded only where they are asked for, and what makes their emitter.
_BUILDERS = {
    "rayfile": "lensforge.sources.rayfile_loading:load_rayfile",
    "rayfiles": "lensforge.sources.rayfile_loading:load_rayfiles",
    "rectangle": "lensforge.sources.planar:planar_emitter",
    "disc": "lensforge.sources.planar:planar_emitter",
    "chips": "lensforge.sources.planar:planar_emitter",
    "chip_array": "lensforge.sources.planar:planar_emitter",
    "luminance": "lensforge.sources.planar:planar_emitter",
}


def build_source(spec: SourceSpec) -> Source:
    """The emitter that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used."""
    if isinstance(spec, SquareSource):
        return SquareEmitter(spec.side_mm, spec.flux_w)
    module, function = _BUILDERS[spec.kind].split(":")
    emitter: Source = getattr(import_module(module), function)(spec)
    return emitter


def account_of(source: Source, spec: SourceSpec) -> dict[str, Any]:
    """What ``source`` is, its power and symmetry; of a measured one also its files and all that was done to them."""
    account: dict[str, Any] = getattr(source, "account", {})
    return {"title": spec.title, "flux_w": source.flux_w, "symmetry": source.symmetry, **account}
