"""From a spec's ``[source]`` to an emitter; a spec that names no ray file loads no ray-file code."""

from importlib import import_module

from lensforge.sources.bundle import Source
from lensforge.sources.square import SquareEmitter
from lensforge.spec import RayfileSource, SquareSource


def build_source(spec: SquareSource | RayfileSource) -> Source:
    """The emitter that ``spec`` describes. Raises :class:`InputError` for a ray file that cannot be used."""
    if isinstance(spec, SquareSource):
        return SquareEmitter(spec.side_mm, spec.flux_w)
    emitter: Source = import_module("lensforge.sources.rayfile_source").RayfileEmitter.load(spec)
    return emitter
