"""Luminous flux of the source for its photometric files: as given, as spec or file say, or relative to 1000 lm."""

from dataclasses import dataclass
from typing import Literal

from lensforge.errors import InputError
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.photometry import PhotometrySection

_RELATIVE_LM = 1000.0  # of the source where its flux is not known: cd/klm, as relative photometry has it


@dataclass(frozen=True)
class SourceLumens:
    """Flux (lm) of the source, and where it comes from."""

    lumens: float
    origin: Literal["given", "spec or source file", "not known"]

    @classmethod
    def of(cls, given_lm: float | None, summary: SourceSummary) -> "SourceLumens":
        """Take ``given_lm``, else what is known of the source, else 1000 lm."""
        if given_lm is not None:
            return cls(float(given_lm), "given")
        if summary.flux_lm:
            return cls(summary.flux_lm, "spec or source file")
        return cls(_RELATIVE_LM, "not known")

    def require_known(self, section: PhotometrySection) -> None:
        """Raise :class:`InputError` where a lamp for an area or a road has no lumens to be rated by."""
        if section.use != "general" and self.per_1000_lm:
            raise InputError(
                f'photometry.use = "{section.use}": its ratings count lumens, and the source\'s are not known; give '
                "source.flux_lm, a spectrum or luminous_efficacy_lm_per_w, or take the photometry with --lumens"
            )

    @property
    def per_1000_lm(self) -> bool:
        """True where intensities are relative."""
        return self.origin == "not known"
