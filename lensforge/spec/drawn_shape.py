"""Linear lenses of any kind: faces that are profiles drawn along y, over one LED or a row of them."""

from collections.abc import Mapping
from math import hypot, inf, sqrt
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from lensforge.optics.exit_space import DrawnBall, ExitSpace
from lensforge.public import public
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.lens_section import LensShape, LightShape
from lensforge.spec.processes import Process
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import Millimetres, check
from lensforge.surfaces.profile import LEAST_COEFFICIENTS
from lensforge.surfaces.srbf import SrbfBasis

_ENDLESS = 50.0  # of the largest radius: that far along y light goes in a lens without end
_OF_ERRORS = (25,)  # functions of form errors, of which a profile has the section


@public
class DrawnShape(LensShape):
    """A lens of faces that are profiles drawn along y."""

    parametrisation = "drawn"
    may_be_round = True
    largest_symmetry = "rectangle"
    is_advised = False
    lies_along_y = True
    without: ClassVar[Mapping[str, str]] = {
        "compare": "a linear lens is not compared with points of its faces yet; compare its light with a photograph",
        "correct": "a linear lens is cut by its profile, which points of its faces do not correct yet",
    }
    levels: Annotated[tuple[int, ...], Field(max_length=0)] = Field(
        default=(), description="Empty: a profile has coefficients alone, `profile`."
    )
    length_mm: Millimetres = Field(description="Length along y, half of it on each side of the LED.")
    ends: Literal["capped", "free"] = Field(
        default="capped",
        description='"capped": light that comes to an end is absorbed there. "free": the profile goes on without end '
        "for the light, as over a row of LEDs; `length_mm` is that of the part.",
    )
    profile: Annotated[int, Field(ge=LEAST_COEFFICIENTS, le=64)] = Field(
        default=24, description="Coefficients of the profile of each face."
    )

    @classmethod
    def first_tables(cls, shape: LightShape) -> dict[str, dict[str, object]]:
        """Fields of a lens of 100 mm, which goes on without end for the light; without a base."""
        return {"lens": {"length_mm": 100.0, "ends": "free"}, "base": {"kind": "none"}}

    @check
    def _has_free_profiles(self) -> None:
        for name, face in self.faces.items():
            if face.fixed is not None:
                raise ValueError(f"{name}.fixed: a given surface is drawn along no line; leave it out")
        if self.symmetry in ("diagonal", "square"):
            raise ValueError(f'symmetry = "{self.symmetry}": a linear lens has no diagonal; at most "rectangle"')

    @property
    def drawn_mm(self) -> float:
        """Length of the part."""
        return self.length_mm

    @property
    def drawn_half_mm(self) -> float:
        """Half of its length where its ends are capped; infinite where they are free."""
        return 0.5 * self.length_mm if self.ends == "capped" else inf

    def apart(self, lamps: Lamps) -> Lamps:
        """One lamp of each row along y, which lies below one lens. Raises ``ValueError`` for rows that cannot be."""
        if lamps.is_single:
            return lamps
        if self.ends == "capped":
            raise ValueError(
                f'lens.ends = "capped": each of {len(lamps)} lamps would see other ends; take "free", or one source '
                "of several chips"
            )
        if lamps.posed or lamps.kinds or any(turn % 180.0 for turn in lamps.turns_deg):
            raise ValueError("lamps: those below a linear lens are equal, and stand level along y; leave turns out")
        rows: dict[float, list[float]] = {}
        for x, y in lamps.places_mm:
            rows.setdefault(x, []).append(y)
        pitch_mm = max(float(np.diff(sorted(along)).max(initial=0.0)) for along in rows.values())
        if lamps.period_mm is not None:
            rows |= {x + lamps.period_mm[0]: along for x, along in rows.items()}
            pitch_mm = lamps.period_mm[1]
        if self.length_mm < pitch_mm:
            raise ValueError(
                f"lens.length_mm = {self.length_mm:g}: below the pitch of its row, {pitch_mm:g} mm; at least that"
            )
        return Lamps.level((x, 0.0) for x in rows)

    @property
    def is_round(self) -> bool:
        """False: faces are drawn, not turned."""
        return False

    @property
    def made_alone(self) -> Process:
        """Process by which it is made: drawn through a die."""
        return "extruded"

    @property
    def coarser(self) -> str:
        """Fewer coefficients of its profiles."""
        return "a smaller lens.profile"

    @property
    def basis(self) -> SrbfBasis:
        """The functions of form errors."""
        return SrbfBasis(_OF_ERRORS, self.sigma_c, self._own_symmetry)

    @property
    def shape_levels(self) -> tuple[int, ...]:
        """Parameters of a face: the coefficients of its profile."""
        return (self.profile,)

    def exit_space(self, limits: ConstraintsSection) -> ExitSpace:
        """The ball that holds it; of one without end that which all but 3e-6 of a Lambertian LED's light leaves."""
        endless_mm = 0.0 if self.ends == "capped" else _ENDLESS * limits.max_radius_mm
        section_mm = self._section_mm(limits)
        return DrawnBall(max(hypot(section_mm, 0.5 * self.length_mm), endless_mm), section_mm)

    def _section_mm(self, limits: ConstraintsSection) -> float:
        """Largest distance of the section from the y axis."""
        return hypot(limits.max_radius_mm, limits.tallest_mm) if self.radius_about_axis else limits.max_radius_mm

    def extent_mm(self, limits: ConstraintsSection, rise: float | None = None) -> float:
        """Distance from the origin to its farthest corner, or along the normal of a plane."""
        level_mm = hypot(limits.max_radius_mm, 0.5 * self.length_mm)
        high_mm = self.height_mm(limits) if self.radius_about_axis else limits.max_radius_mm
        farthest_mm = hypot(level_mm, high_mm) if self.radius_about_axis else level_mm
        if rise is None:
            return farthest_mm
        return min(farthest_mm, level_mm * sqrt(max(1.0 - rise**2, 0.0)) + high_mm * max(rise, 0.0))
