"""Fields of every source: how much light it gives, by which angle and wavelength, and where it sits in the lens."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from lensforge.optics.colorimetry import LARGEST_LM_PER_W
from lensforge.optics.pose import Pose
from lensforge.public import public
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.spec_section import Coordinate, FilePath, Lumens, Section, Watts, Weight, check

MOST_ENTRIES = 100_000  # of a table in a spec: 0.01 nm or 0.002 degrees
_FINEST_DEG = 1e-4  # between two entries
_FINEST_NM = 1e-6  # slopes over less are rounding
LEAST_PEAK = 1e-30  # of a table in any unit: what has less is dark
Nanometres = Annotated[float, Field(ge=100.0, le=20_000.0)]


@public
class CosineIntensity(Section):
    """Intensity in proportion to ``cos(gamma)^power``; power 1 is Lambertian."""

    kind: Literal["cosine"] = "cosine"
    power: Annotated[float, Field(ge=0.0, le=1e4)] = Field(
        default=1.0, description="Power of the cosine; 1 is Lambertian."
    )


def _require_function(
    places: tuple[float, ...], name: str, finest: float, values: tuple[float, ...], of_values: str
) -> None:
    if len(places) < 2 or any(b - a < finest for a, b in pairwise(places)):
        raise ValueError(f"{name} must be two numbers or more, each larger than the one before, by {finest:g} at least")
    if len(values) != len(places) or max(values) < LEAST_PEAK:
        raise ValueError(f"{of_values} must be {len(places)} numbers, one for each {name}, not all zero")


@public
class TableIntensity(Section):
    """Intensity (W/sr or relative) at angles ``gamma_deg`` from the axis, linear in between, none beyond them."""

    kind: Literal["table"] = "table"
    gamma_deg: Annotated[tuple[Annotated[float, Field(ge=0.0, le=180.0)], ...], Field(max_length=MOST_ENTRIES)] = Field(
        description="Angles from the axis, rising."
    )
    intensity: Annotated[tuple[Weight, ...], Field(max_length=MOST_ENTRIES)] = Field(
        description="Intensity (W/sr or relative) at each of these angles."
    )

    @check
    def _is_a_function(self) -> None:
        _require_function(self.gamma_deg, "gamma_deg", _FINEST_DEG, self.intensity, "intensity")


@public
class PhotometricIntensity(Section):
    """Far field in an IES LM-63 or EULUMDAT file; its gamma = 0 is the lens axis, C = 0 +x, C = 90 -y."""

    kind: Literal["photometric"] = "photometric"
    file: FilePath = Field(description="IES LM-63 or EULUMDAT file.")


IntensitySpec = Annotated[CosineIntensity | TableIntensity | PhotometricIntensity, Field(discriminator="kind")]


@public
class LineSpectrum(Section):
    """Light of one wavelength."""

    kind: Literal["line"] = "line"
    wavelength_nm: Nanometres = Field(description="Wavelength of all light.")


@public
class TableSpectrum(Section):
    """Power density (relative, per nm) at each wavelength, linear in between, none beyond them."""

    kind: Literal["table"] = "table"
    wavelength_nm: Annotated[tuple[Nanometres, ...], Field(max_length=MOST_ENTRIES)] = Field(
        description="Wavelengths, rising."
    )
    weight: Annotated[tuple[Weight, ...], Field(max_length=MOST_ENTRIES)] = Field(
        description="Power density (relative, per nm) at each wavelength."
    )

    @check
    def _is_a_function(self) -> None:
        _require_function(self.wavelength_nm, "wavelength_nm", _FINEST_NM, self.weight, "weight")


@public
class FileSpectrum(Section):
    """Spectral table as a text file: wavelength (nm) and relative power density in two columns, OPTIS or LightTools."""

    kind: Literal["file"] = "file"
    file: FilePath = Field(
        description="Text file of wavelength (nm) and relative power density in two columns, OPTIS or LightTools."
    )


@public
class GaussianSpectrum(Section):
    """Normal distribution of power over wavelength, as of a chip without a phosphor."""

    kind: Literal["gaussian"] = "gaussian"
    peak_nm: Nanometres = Field(description="Wavelength of the largest power density.")
    fwhm_nm: Annotated[float, Field(ge=0.1, le=2000.0)] = Field(description="Full width at half of that.")


SpectrumSpec = Annotated[LineSpectrum | TableSpectrum | FileSpectrum | GaussianSpectrum, Field(discriminator="kind")]


NOTHING_LIT = "dimming: no light is left; give a number above 0"
_SAME_EFFICACY = 0.01  # relative: figures of a data sheet, rounded to three digits each, agree this well

Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
Turn = Annotated[float, Field(ge=-36_000.0, le=36_000.0)]  # degrees; beyond 100 turns digits of the angle are lost
LumensPerWatt = Annotated[float, Field(ge=1e-9, le=LARGEST_LM_PER_W)]  # light of 830 nm, where V ends, has 3e-4


@public
class FluxSection(Section):
    """Flux of a source or of a part of it; both fluxes together state its lm/W."""

    flux_w: Watts | None = Field(default=None, description="Radiant flux.")
    flux_lm: Lumens | None = Field(default=None, description="Luminous flux.")

    @check
    def _lumens_fit_the_watts(self) -> None:
        efficacy = self.stated_lm_per_w
        if efficacy is not None and efficacy > LARGEST_LM_PER_W:
            raise ValueError(
                f"flux_lm = {self.flux_lm:g} of flux_w = {self.flux_w:g} is {efficacy:.4g} lm/W: no light has more "
                f"than {LARGEST_LM_PER_W:g}; correct one of them, or leave out flux_w"
            )

    @property
    def stated_lm_per_w(self) -> float | None:
        """Luminous efficacy (lm/W) by both fluxes; None unless both are stated."""
        return None if self.flux_w is None or self.flux_lm is None else self.flux_lm / self.flux_w

    def fluxes_times(self, factor: float) -> dict[str, float]:
        """Fields of the fluxes that are stated, each times ``factor``."""
        stated = {name: getattr(self, name) for name in FluxSection.model_fields}
        return {name: factor * flux for name, flux in stated.items() if flux is not None}


@public
class EmitterSection(OfSeveralKinds, FluxSection):
    """Fields of every source. A kind of source is a class that extends this one: it registers itself.

    ``flux_w``, ``flux_lm``: of the whole source; with neither it has 1 W, or what its file states.

    ``rotate_z_deg``, ``tilt_deg`` and ``position_mm`` say where the source sits, in lens coordinates, and apply in
    this order. So its axis, +z before, points along (cos a sin b, -sin a, cos a cos b) for ``tilt_deg`` = (a, b), and
    its centre is at ``position_mm``.
    """

    phrase: ClassVar[str]  # for the source, by its fields
    in_a_word: ClassVar[tuple[str, ...]] = ()  # fields that `lensforge new` takes in one, rectangle:WIDTHxHEIGHT

    luminous_efficacy_lm_per_w: LumensPerWatt | None = Field(
        default=None,
        description="Luminous efficacy of the light: with it, with both fluxes or with a spectrum reports show "
        "lux, without it W/m^2.",
    )
    spectrum: SpectrumSpec | None = Field(
        default=None,
        description="Spectrum, used where the lens material is dispersive, for colour, and for the luminous "
        "efficacy; for a ray file it replaces the file's own.",
    )
    rotate_z_deg: Turn = Field(default=0.0, description="Turn about the z axis, before the tilt.")
    tilt_deg: tuple[Degrees, Degrees] = Field(
        default=(0.0, 0.0),
        description="Tilt about the x axis, then about the y axis, each about the lens origin by the right-hand rule.",
    )
    position_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(
        default=(0.0, 0.0, 0.0), description="Shift (x, y, z), after turn and tilt."
    )

    @check
    def _efficacy_is_that_of_the_fluxes(self) -> None:
        stated = self.stated_lm_per_w
        efficacy = self.luminous_efficacy_lm_per_w
        if stated is not None and efficacy is not None and abs(stated / efficacy - 1.0) > _SAME_EFFICACY:
            raise ValueError(
                f"luminous_efficacy_lm_per_w = {efficacy:g}, but flux_lm = {self.flux_lm:g} of flux_w = "
                f"{self.flux_w:g} is {stated:.4g} lm/W; give two of the three"
            )

    @property
    def pose(self) -> Pose:
        """Place in the lens."""
        return Pose.of_tilts(self.position_mm, self.tilt_deg, self.rotate_z_deg)

    @property
    def extent_mm(self) -> float | None:
        """Radius of the circle about its own axis that holds the emitting area; None for a source without a size."""
        return None

    @property
    def spectra(self) -> tuple[SpectrumSpec | None, ...]:
        """Spectrum of each part of a source whose parts have spectra of their own; else empty."""
        return ()

    def at_wavelength(self, wavelength_nm: float) -> Self:
        """The source with all of its light at one wavelength."""
        return self.changed(spectrum=LineSpectrum(wavelength_nm=wavelength_nm))

    def dimmed(self, shares: Sequence[float]) -> "EmitterSection":
        """The source whose parts give these ``shares`` of their flux. Raises ``ValueError`` for other numbers of them.

        A source without parts has one share, of a flux that the spec states.
        """
        if len(shares) != 1:
            raise ValueError(f"dimming: {len(shares)} numbers, must be 1: a {self.description} has no chips")
        if not shares[0] > 0.0:
            raise ValueError(NOTHING_LIT)
        fluxes = self.fluxes_times(shares[0])
        if not fluxes:
            raise ValueError("dimming: the flux of the LED is not stated; give source.flux_lm or source.flux_w")
        return self.changed(**fluxes)

    def mirrored(self, axis: Literal["x", "y"]) -> Self:
        """The source where the mirror that maps ``axis`` to minus itself puts it: itself, unless its own parts move."""
        about_x, about_y = self.tilt_deg
        signs = np.where(np.array(("x", "y", "z")) == axis, -1.0, 1.0)
        tilt_deg = (about_x, -about_y) if axis == "x" else (-about_x, about_y)
        position_mm = tuple((signs * self.position_mm).tolist())
        return self.changed(position_mm=position_mm, tilt_deg=tilt_deg, rotate_z_deg=-self.rotate_z_deg)

    @property
    def description(self) -> str:
        """The source in a few words, without its place."""
        return self.phrase.format(self)

    @property
    def title(self) -> str:
        """The source in a few words, and where it sits unless that is at the lens origin."""
        return " ".join(filter(None, (self.description, self.place_words)))

    @property
    def place_words(self) -> str:
        """Words for its place; empty at the lens origin."""
        parts = []
        if any(self.position_mm):
            parts.append(f"at ({', '.join(f'{value:g}' for value in self.position_mm)}) mm")
        if any(self.tilt_deg):
            parts.append(f"tilted by ({', '.join(f'{value:g}' for value in self.tilt_deg)})°")
        return " ".join(parts)
