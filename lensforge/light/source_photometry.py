"""Luminous flux and spectrum of the source, for the photometric files of its lens.

Flux is as given, as spec or file say, or relative to 1000 lm. The spectrum behind the lens is the source's, because the
surfaces lose all colours alike: their Fresnel losses differ by 0.1 % over the visible range in PMMA. A body whose
absorption differs by wavelength takes its share of the flux of each ray at that ray's wavelength; that it changes the
colour of the rest is left out.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.light.spectral_figures import SpectralFigures
from lensforge.optics.action_spectra import (
    MELANOPIC_OF_DAYLIGHT,
    melanopic_per_watt,
    photons_per_watt,
    scotopic_per_watt,
)
from lensforge.optics.colorimetry import efficacy_at, luminous_efficacy
from lensforge.optics.colour_rendering import ColourRendering, colour_rendering
from lensforge.sources.light_files import read_rayfile
from lensforge.sources.ray_bundle import blocks_of
from lensforge.sources.source_flux import chip_fluxes
from lensforge.sources.source_spectrum import Spectrum, spectrum_of
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.light_limits import PhotometrySection
from lensforge.spec.source_sections import ChipsSource, RayfilePart, RayfileSource, RayfilesSource, RaySource

_RELATIVE_LM = 1000.0  # of the source where its flux is not known: cd/klm, as relative photometry has it


@dataclass(frozen=True)
class SourceLumens:
    """Flux (lm) of the source, and where it comes from."""

    lumens: float
    origin: Literal["given", "spec or source file", "not known"]

    @classmethod
    def of(cls, given_lm: float | None, summary: SourceSummary) -> "SourceLumens":
        """Take ``given_lm``, else the known flux of the source, else 1000 lm."""
        if given_lm is not None:
            return cls(float(given_lm), "given")
        if summary.flux_lm:
            return cls(summary.flux_lm, "spec or source file")
        return cls(_RELATIVE_LM, "not known")

    def require_known(self, section: PhotometrySection) -> None:
        """Raise :class:`InputError` if a lamp for an area or a road has no lumens by which to rate it."""
        if section.use != "general" and self.per_1000_lm:
            raise InputError(
                f'photometry.use = "{section.use}": its ratings count lumens, and the source\'s are not known; give '
                "source.flux_lm, a spectrum or luminous_efficacy_lm_per_w, or take the photometry with --lumens"
            )

    @property
    def per_1000_lm(self) -> bool:
        """True where intensities are relative."""
        return self.origin == "not known"


_Light: TypeAlias = tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]  # wavelengths (nm), power
_LM_PER_KLM = 1000.0
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


def figures_of_spectrum(spectrum: Spectrum) -> SpectralFigures:
    """Figures of light with this ``spectrum``."""
    table = spectrum.wavelengths_nm, spectrum.power_density
    lumens = luminous_efficacy(*table)
    photons = photons_per_watt(*table)

    def per_lumen(amount: float) -> float | None:
        return amount / lumens if lumens else None

    rendering = colour_rendering(*table) if lumens else None
    return SpectralFigures(
        **dict.fromkeys(ColourRendering._fields) if rendering is None else rendering._asdict(),
        scotopic_ratio=per_lumen(scotopic_per_watt(*table)),
        melanopic_der=per_lumen(melanopic_per_watt(*table) / MELANOPIC_OF_DAYLIGHT),
        ppf_umol_per_j=photons,
        ppfd_umol_per_m2_s_klx=per_lumen(_LM_PER_KLM * photons),
    )


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
    low, high = np.inf, -np.inf
    for waves, _ in blocks():
        low, high = np.minimum(low, waves.min()), np.maximum(high, waves.max())
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
