"""Emission of a source: intensity by angle, and spectrum."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from lensforge.spec.section import FilePath, Section, Weight

MOST_ENTRIES = 100_000  # of a table in a spec: 0.01 nm or 0.002 degrees
_FINEST_DEG, _FINEST_NM = 1e-4, 1e-6  # between two entries; slopes over less are rounding
LEAST_PEAK = 1e-30  # of a table in any unit: what has less is dark
Nanometres = Annotated[float, Field(ge=100.0, le=20_000.0)]


class CosineIntensity(Section):
    """Intensity in proportion to ``cos(gamma)^power``; power 1 is Lambertian."""

    kind: Literal["cosine"] = "cosine"
    power: Annotated[float, Field(ge=0.0, le=1e4)] = 1.0
    """Power of the cosine; 1 is Lambertian."""


class TableIntensity(Section):
    """Intensity (W/sr or relative) at angles ``gamma_deg`` from the axis, linear in between, none beyond them."""

    kind: Literal["table"] = "table"
    gamma_deg: Annotated[tuple[Annotated[float, Field(ge=0.0, le=180.0)], ...], Field(max_length=MOST_ENTRIES)]
    """Angles from the axis, rising."""
    intensity: Annotated[tuple[Weight, ...], Field(max_length=MOST_ENTRIES)]
    """Intensity (W/sr or relative) at each of these angles."""

    @model_validator(mode="after")
    def _is_a_function(self) -> "TableIntensity":
        angles = self.gamma_deg
        if len(angles) < 2 or any(b - a < _FINEST_DEG for a, b in pairwise(angles)):
            raise ValueError(
                f"gamma_deg must be two angles or more, each larger than the one before, by {_FINEST_DEG:g} at least"
            )
        if len(self.intensity) != len(angles) or max(self.intensity) < LEAST_PEAK:
            raise ValueError(f"intensity must be {len(angles)} numbers, one for each gamma_deg, not all zero")
        return self


class PhotometricIntensity(Section):
    """The far field in an IES LM-63 or EULUMDAT file; its gamma = 0 is the lens axis, C = 0 +x, C = 90 -y."""

    kind: Literal["photometric"] = "photometric"
    file: FilePath
    """IES LM-63 or EULUMDAT file."""


IntensitySpec = Annotated[CosineIntensity | TableIntensity | PhotometricIntensity, Field(discriminator="kind")]


class LineSpectrum(Section):
    """Light of one wavelength."""

    kind: Literal["line"] = "line"
    wavelength_nm: Nanometres
    """Wavelength of all light."""


class TableSpectrum(Section):
    """Power density (relative, per nm) at each wavelength, linear in between, none beyond them."""

    kind: Literal["table"] = "table"
    wavelength_nm: Annotated[tuple[Nanometres, ...], Field(max_length=MOST_ENTRIES)]
    """Wavelengths, rising."""
    weight: Annotated[tuple[Weight, ...], Field(max_length=MOST_ENTRIES)]
    """Power density (relative, per nm) at each wavelength."""

    @model_validator(mode="after")
    def _is_a_function(self) -> "TableSpectrum":
        waves = self.wavelength_nm
        if len(waves) < 2 or any(b - a < _FINEST_NM for a, b in pairwise(waves)):
            raise ValueError(
                "wavelength_nm must be two wavelengths or more, each longer than the one before, by "
                f"{_FINEST_NM:g} at least"
            )
        if len(self.weight) != len(waves) or max(self.weight) < LEAST_PEAK:
            raise ValueError(f"weight must be {len(waves)} numbers, one for each wavelength_nm, not all zero")
        return self


class FileSpectrum(Section):
    """Spectral table as a text file: wavelength (nm) and relative power density in two columns, OPTIS or LightTools."""

    kind: Literal["file"] = "file"
    file: FilePath
    """Text file of wavelength (nm) and relative power density in two columns, OPTIS or LightTools."""


SpectrumSpec = Annotated[LineSpectrum | TableSpectrum | FileSpectrum, Field(discriminator="kind")]
