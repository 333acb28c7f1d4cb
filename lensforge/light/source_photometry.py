"""Luminous flux and spectrum of the source, for the photometric files of its lens.

Flux is as given, as spec or file say, or relative to 1000 lm. The spectrum behind the lens is the source's, because the
surfaces lose all colours alike: their Fresnel losses differ by 0.1 % over the visible range in PMMA. A body whose
absorption differs by wavelength takes its share of the flux of each ray at that ray's wavelength; that it changes the
colour of the rest is left out.
"""

from dataclasses import dataclass
from typing import Literal

from lensforge.errors import InputError
from lensforge.light.spectral_figures import SpectralFigures
from lensforge.optics.action_spectra import (
    MELANOPIC_OF_DAYLIGHT,
    melanopic_per_watt,
    photons_per_watt,
    scotopic_per_watt,
)
from lensforge.optics.colorimetry import luminous_efficacy
from lensforge.optics.colour_rendering import ColourRendering, colour_rendering
from lensforge.sources.source_spectrum import Spectrum
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.light_limits import PhotometrySection

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


_LM_PER_KLM = 1000.0


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
