"""Fields of every source: how much light it gives, its spectrum, and where it sits in the lens."""

from typing import Annotated

from pydantic import Field, model_validator

from lensforge.optics.photopic import LARGEST_LM_PER_W
from lensforge.spec.emission import SpectrumSpec
from lensforge.spec.section import Coordinate, Lumens, Section, Watts

_SAME_EFFICACY = 0.01  # relative: figures of a data sheet, rounded to three digits each, agree this well

Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
Turn = Annotated[float, Field(ge=-36_000.0, le=36_000.0)]  # degrees; beyond 100 turns digits of the angle are lost
LumensPerWatt = Annotated[float, Field(ge=1e-9, le=LARGEST_LM_PER_W)]  # light of 830 nm, where V ends, has 3e-4


class FluxSection(Section):
    """Flux of a source or of a part of it; both fluxes together state its lm/W."""

    flux_w: Watts | None = None
    """Radiant flux."""
    flux_lm: Lumens | None = None
    """Luminous flux."""

    @model_validator(mode="after")
    def _lumens_fit_the_watts(self) -> "FluxSection":
        efficacy = self.stated_lm_per_w
        if efficacy is not None and efficacy > LARGEST_LM_PER_W:
            raise ValueError(
                f"flux_lm = {self.flux_lm:g} of flux_w = {self.flux_w:g} is {efficacy:.4g} lm/W: no light has more "
                f"than {LARGEST_LM_PER_W:g}; correct one of them, or leave out flux_w"
            )
        return self

    @property
    def stated_lm_per_w(self) -> float | None:
        """Luminous efficacy (lm/W) by both fluxes; None unless both are stated."""
        return None if self.flux_w is None or self.flux_lm is None else self.flux_lm / self.flux_w


class EmitterSection(FluxSection):
    """Fields of every source.

    ``flux_w``, ``flux_lm``: of the whole source; with neither it has 1 W, or what its file states.

    ``rotate_z_deg``, ``tilt_deg`` and ``position_mm`` say where the source sits, in lens coordinates, and apply in
    this order: the source is turned about the z axis, then about the x axis by the first angle of ``tilt_deg``, then
    about the y axis by the second, each about the lens origin by the right-hand rule, and then shifted by
    ``position_mm`` = (x, y, z). So its axis, +z before, points along (cos a sin b, -sin a, cos a cos b) for
    ``tilt_deg`` = (a, b), and its centre is at ``position_mm``.
    """

    luminous_efficacy_lm_per_w: LumensPerWatt | None = None
    """Luminous efficacy of the light: with it, with both fluxes or with a spectrum reports show lux, without it W/m^2.
    """
    spectrum: SpectrumSpec | None = None
    """Spectrum, used where the lens material is dispersive, and for the luminous efficacy; for a ray file it replaces
    the file's own.
    """
    rotate_z_deg: Turn = 0.0
    """Turn about the z axis, before the tilt."""
    tilt_deg: tuple[Degrees, Degrees] = (0.0, 0.0)
    """Tilt about the x axis, then about the y axis, each about the lens origin by the right-hand rule."""
    position_mm: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    """Shift (x, y, z), after turn and tilt."""

    @model_validator(mode="after")
    def _efficacy_is_that_of_the_fluxes(self) -> "EmitterSection":
        stated, efficacy = self.stated_lm_per_w, self.luminous_efficacy_lm_per_w
        if stated is not None and efficacy is not None and abs(stated / efficacy - 1.0) > _SAME_EFFICACY:
            raise ValueError(
                f"luminous_efficacy_lm_per_w = {efficacy:g}, but flux_lm = {self.flux_lm:g} of flux_w = "
                f"{self.flux_w:g} is {stated:.4g} lm/W; give two of the three"
            )
        return self

    @property
    def description(self) -> str:
        """The source in a few words, without its place."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """The source in a few words, and where it sits unless that is at the lens origin."""
        found = [self.description]
        if any(self.position_mm):
            found.append(f"at ({', '.join(f'{value:g}' for value in self.position_mm)}) mm")
        if any(self.tilt_deg):
            found.append(f"tilted by ({', '.join(f'{value:g}' for value in self.tilt_deg)})°")
        return " ".join(found)
