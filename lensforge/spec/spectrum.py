"""The ``spectrum`` of a source: what wavelengths it emits; counts where the lens's material disperses them."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from lensforge.spec.section import FilePath, Section

Nanometres = Annotated[float, Field(ge=100.0, le=20_000.0)]


class LineSpectrum(Section):
    """Light of one wavelength."""

    kind: Literal["line"] = "line"
    wavelength_nm: Nanometres


class TableSpectrum(Section):
    """Power density (relative, per nm) at each wavelength, linear in between, none beyond them."""

    kind: Literal["table"] = "table"
    wavelength_nm: tuple[Nanometres, ...]
    weight: tuple[Annotated[float, Field(ge=0.0)], ...]

    @model_validator(mode="after")
    def _is_a_function(self) -> "TableSpectrum":
        waves = self.wavelength_nm
        if len(waves) < 2 or any(b <= a for a, b in pairwise(waves)):
            raise ValueError("wavelength_nm must be two wavelengths or more, each longer than the one before")
        if len(self.weight) != len(waves) or not any(self.weight):
            raise ValueError(f"weight must be {len(waves)} numbers, one for each wavelength_nm, not all zero")
        return self


class FileSpectrum(Section):
    """The same table as a text file of two columns, nm and weight, as LED makers ship it."""

    kind: Literal["file"] = "file"
    file: FilePath


Spectrum = Annotated[LineSpectrum | TableSpectrum | FileSpectrum, Field(discriminator="kind")]
