"""Emitters built from the ``[source]`` of a spec; modules that one kind needs are loaded for that kind only."""

from lensforge.materials.material import Material
from lensforge.sources.bundle import Source
from lensforge.sources.dispersion import DispersedSource
from lensforge.sources.flux import emitter_flux
from lensforge.sources.placement import PlacedSource, placed_source
from lensforge.sources.source_summary import SourceSummary
from lensforge.sources.spectrum import spectrum_of
from lensforge.sources.square import SquareEmitter
from lensforge.spec.ray_source import RayfileSource, RayfilesSource, RaySource
from lensforge.spec.source import RadianceSource, SourceSpec, SquareSource


def build_source(spec: SourceSpec, material: Material | None = None) -> Source:
    """Build the emitter that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used.

    ``material``: of the lens if it is dispersive; then rays whose wavelength is known carry their index in it.
    """
    match spec:
        case RayfileSource() | RayfilesSource() | RaySource():
            from lensforge.sources.ray_set_loading import load_ray_set

            return load_ray_set(spec, material)
        case SquareSource():
            emitter: Source = SquareEmitter(spec.side_mm, emitter_flux(spec).flux_w)
        case RadianceSource():
            from lensforge.sources.radiance import radiance_emitter

            emitter = radiance_emitter(spec)
        case _:
            from lensforge.sources.planar import planar_emitter

            emitter = planar_emitter(spec)
    emitter = placed_source(emitter, spec)
    if material is None or spec.spectrum is None:
        return emitter
    return DispersedSource(emitter, spectrum_of(spec.spectrum), material)


def summarise(source: Source, spec: SourceSpec) -> SourceSummary:
    """Summarise ``source``, built from ``spec``; of a ray set also its files, and all that was done to them."""
    if isinstance(source, DispersedSource):
        found, plain = source.index_range, summarise(source.source, spec)
        warnings = (*plain.warnings, *found.warnings(source.material))
        return plain.model_copy(update={**found.fields(), "warnings": warnings})
    known = getattr(source, "summary", None)  # ray sets have one; their module is loaded for them alone
    if isinstance(known, SourceSummary):
        return known
    flux = emitter_flux(spec, source.flux_w)
    return SourceSummary(
        title=spec.title,
        flux_w=source.flux_w,
        lumens_per_watt=flux.lumens_per_watt,
        symmetry=source.symmetry,
        warnings=(*_file_warnings(source), *flux.warnings),
    )


def _file_warnings(source: Source) -> tuple[str, ...]:
    """Warnings on the file of an intensity profile; none for a source without one."""
    if isinstance(source, PlacedSource):
        return _file_warnings(source.source)
    found: tuple[str, ...] = getattr(source, "warnings", ())  # of a planar emitter; its module is loaded for it alone
    return found
