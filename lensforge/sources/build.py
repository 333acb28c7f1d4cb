"""From a spec's ``[source]`` to an emitter; what one kind needs is loaded for that kind only."""

from lensforge.optics.materials import Material
from lensforge.sources.account import SourceAccount
from lensforge.sources.bundle import Source
from lensforge.sources.dispersed import DispersedSource
from lensforge.sources.spectrum import spectrum_of
from lensforge.sources.square import SquareEmitter
from lensforge.spec.source import (
    ChipArraySource,
    ChipsSource,
    DiscSource,
    LuminanceSource,
    RadianceSource,
    RayfileSource,
    RayfilesSource,
    RaySource,
    RectangleSource,
    SquareSource,
)
from lensforge.spec.source import (
    Source as SourceSpec,
)

_Measured = RayfileSource | RayfilesSource | RaySource
_Computed = (
    SquareSource | RectangleSource | DiscSource | ChipsSource | ChipArraySource | LuminanceSource | RadianceSource
)


def build_source(spec: SourceSpec, material: Material | None = None) -> Source:
    """The emitter that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used.

    ``material``: the dispersive one of the lens, if it is; then rays whose wavelength is known carry its index there.
    """
    if isinstance(spec, _Measured):
        return _measured(spec, material)
    emitter = _computed(spec)
    if material is None or spec.spectrum is None:
        return emitter
    return DispersedSource(emitter, spectrum_of(spec.spectrum), material)


def _measured(spec: _Measured, material: Material | None) -> Source:
    from lensforge.sources.given_rays import load_rays
    from lensforge.sources.rayfile_loading import load_rayfile, load_rayfiles

    match spec:
        case RayfileSource():
            return load_rayfile(spec, material)
        case RayfilesSource():
            return load_rayfiles(spec, material)
        case RaySource():
            return load_rays(spec, material)


def _computed(spec: _Computed) -> Source:
    match spec:
        case SquareSource():
            return SquareEmitter(spec.side_mm, spec.flux_w)
        case RadianceSource():
            from lensforge.sources.radiance import radiance_emitter

            return radiance_emitter(spec)
        case _:
            from lensforge.sources.planar import planar_emitter

            return planar_emitter(spec)


def account_of(source: Source, spec: SourceSpec) -> SourceAccount:
    """What ``source``, built from ``spec``, is; of a measured one also its files and all that was done to them."""
    if isinstance(source, DispersedSource):
        waves, indices = source.colours
        found = {"wavelengths_nm": waves, "refractive_indices": indices}
        return account_of(source.source, spec).model_copy(update=found)
    known = getattr(source, "account", None)  # measured rays have one; their module loads with them alone
    if isinstance(known, SourceAccount):
        return known
    return SourceAccount(title=spec.title, flux_w=source.flux_w, symmetry=source.symmetry)
