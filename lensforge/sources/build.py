"""From a spec's ``[source]`` to an emitter; a spec that names no ray file loads no ray-file code."""

from importlib import import_module

from lensforge.sources.bundle import Source
from lensforge.sources.square import SquareEmitter
from lensforge.spec import Source as SourceSpec
from lensforge.spec import SquareSource

# The kinds that are loaded only where they are asked for, and what makes their emitter.
_BUILDERS = {
    "rayfile": "lensforge.sources.rayfile_loading:load_rayfile",
    "rayfiles": "lensforge.sources.rayfile_loading:load_rayfiles",
}


def build_source(spec: SourceSpec) -> Source:
    """The emitter that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used."""
    if isinstance(spec, SquareSource):
        return SquareEmitter(spec.side_mm, spec.flux_w)
    module, function = _BUILDERS[spec.kind].split(":")
    emitter: Source = getattr(import_module(module), function)(spec)
    return emitter
