"""Spectrum of all LEDs of a source together, and what 1 W of its light is to eyes and plants."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from lensforge.optics.action_spectra import photons_per_watt
from lensforge.optics.colorimetry import efficacy_at
from lensforge.optics.efficacy import Efficacy
from lensforge.sources.build_source import summarise
from lensforge.sources.light_files import read_rayfile
from lensforge.sources.ray_bundle import Source, blocks_of
from lensforge.sources.source_flux import chip_fluxes
from lensforge.sources.source_spectrum import Spectrum, spectrum_of
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.source_sections import ChipsSource, RayfilePart, RayfileSource, RayfilesSource, RaySource

_Light: TypeAlias = tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]  # wavelengths (nm), power
_STEP_NM = 5.0  # of a table made from the wavelengths of rays: the step of the CIE's own tables


def spectrum_of_source(spec: EmitterSection, summary: SourceSummary) -> Spectrum | None:
    """Spectrum (relative power per nm) of all LEDs of ``spec`` together; None if one of their spectra is unknown.

    The spec's own, or that of its ray files; ``summary`` has the flux of each. Rays with individual wavelengths give a
    table in steps of 5 nm. Raises :class:`InputError` for a file that cannot be used.
    """
    if spec.spectrum is not None and not spec.spectra:
        return spectrum_of(spec.spectrum)
    match spec:
        case RayfileSource():
            return _of_file(RayfilePart(file=spec.file))
        case RayfilesSource():
            parts = [_of_file(part) for part in spec.files]
            known = [part for part in parts if part is not None]
            return _mixed(known, [file.flux_w for file in summary.files]) if len(known) == len(parts) else None
        case RaySource():
            waves = spec.wavelengths_nm
            flux = spec.ray_flux
            if waves is None:
                return None
            light = waves, np.ones(len(waves)) if flux is None else flux
            return _of_rays(lambda: [light])
        case ChipsSource(spectra=spectra) if spectra and None not in spectra:
            return _mixed(
                [spectrum_of(spectrum) for spectrum in spectra if spectrum], [flux.flux_w for flux in chip_fluxes(spec)]
            )
        case _:
            return None


def efficacy_of(source: Source, spec: EmitterSection, *, photons: bool) -> Efficacy:
    """Efficacy of the light of ``source``, built from ``spec``; ``photons`` only on demand: they may need a file.

    Raises :class:`InputError` for a file that cannot be used.
    """
    summary = summarise(source, spec)
    spectrum = spectrum_of_source(spec, summary) if photons else None
    if spectrum is None:
        return Efficacy(summary.lumens_per_watt)
    return Efficacy(summary.lumens_per_watt, photons_per_watt(spectrum.wavelengths_nm, spectrum.power_density))


def _of_file(part: RayfilePart) -> Spectrum | None:
    if part.spectrum is not None:
        return spectrum_of(part.spectrum)
    from lensforge.sources.stored_rays import StoredRays  # loaded where a scene asks for it

    rayfile = read_rayfile(part.file)
    tables = rayfile.spectral_tables
    if rayfile.wavelengths_nm is None and len(tables) == 1:
        return Spectrum(tables[0].wavelengths_nm, tables[0].power_density, f"{part.file}: spectral table 1")
    stored = StoredRays.of(rayfile).coloured()
    in_lumens = rayfile.flux_unit == "lm"
    if not stored.has_wavelengths:
        return None
    rays = stored.loaded()

    def light() -> Iterator[_Light]:
        for block in blocks_of(rays):
            assert block.wavelengths_nm is not None
            yield block.wavelengths_nm, block.flux

    if not in_lumens:
        return _of_rays(light)
    # of lumens: power is not known where the eye sees nothing
    if not all(efficacy_at(waves).all() for waves, _ in light()):
        return None
    return _of_rays(lambda: ((waves, flux / efficacy_at(waves)) for waves, flux in light()))


def _of_rays(blocks: Callable[[], Iterable[_Light]]) -> Spectrum:
    """Spectrum of rays with individual wavelengths, block by block: a line if they are all equal, else a table."""
    low = np.inf
    high = -np.inf
    for waves, _ in blocks():
        low = np.minimum(low, waves.min())
        high = np.maximum(high, waves.max())
    if low == high:
        return Spectrum(np.array([low]), np.ones(1))
    first = np.floor(low / _STEP_NM - 0.5) * _STEP_NM
    nodes = np.arange(first, high + 1.5 * _STEP_NM, _STEP_NM)
    edges = np.append(nodes - 0.5 * _STEP_NM, nodes[-1] + 0.5 * _STEP_NM)
    power = np.zeros(len(nodes))
    for waves, flux in blocks():
        power += np.histogram(waves, edges, weights=flux)[0]
    return Spectrum(nodes, power / power.max())


def _mixed(parts: Sequence[Spectrum], flux_w: Sequence[float]) -> Spectrum:
    """Spectrum of all ``parts`` together, weighted by flux; a line becomes a triangle of 5 nm."""
    tables = [_as_table(part) for part in parts]
    waves = np.unique(np.concatenate([table.wavelengths_nm for table in tables]))
    density = np.zeros(len(waves))
    for table, power in zip(tables, flux_w, strict=True):
        whole = float(np.trapezoid(table.power_density, table.wavelengths_nm))
        density += power / whole * np.interp(waves, table.wavelengths_nm, table.power_density, left=0.0, right=0.0)
    return Spectrum(waves, density / density.max())


def _as_table(part: Spectrum) -> Spectrum:
    if len(part.wavelengths_nm) > 1:
        return part
    line = float(part.wavelengths_nm[0])
    return Spectrum(np.array([line - _STEP_NM, line, line + _STEP_NM]), np.array([0.0, 1.0, 0.0]))
