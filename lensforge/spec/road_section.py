"""Roads that a lens is for: ``[[roads]]`` of a spec, and of a file by which a lamp's photometry is judged.

A road is straight, and seen along its direction of travel: left and right are those of a driver. All lamps of a road
are equal, and stand in rows at equal steps.
"""

from math import inf
from typing import Annotated, Literal

from pydantic import Field, model_validator

from lensforge.spec.spec_section import FilePath, Label, Section

# Nominal average luminance coefficient Q0 (cd/m^2 per lx) of the classes of the CIE: CIE 144:2001.
STANDARD_SURFACES = {"R1": 0.10, "R2": 0.07, "R3": 0.07, "R4": 0.08, "C1": 0.10, "C2": 0.07}

ClassName = Literal[
    "M1", "M2", "M3", "M4", "M5", "M6", "C0", "C1", "C2", "C3", "C4", "C5", "P1", "P2", "P3", "P4", "P5", "P6"
]
Metres = Annotated[float, Field(gt=0.0, le=1000.0)]
Surface = Literal["R1", "R2", "R3", "R4", "C1", "C2"]
Arrangement = Literal["left", "right", "opposite", "staggered", "median"]
Share = Annotated[float, Field(gt=0.0, le=1.0)]
_LEAST_LANE_M = 2.0


_BY_LUMINANCE = ("mean_cd_per_m2", "uniformity", "uniformity_along", "glare_percent")


class RoadSection(Section):
    """A straight road, its lamps, and the class of EN 13201-2 that it is to reach.

    Its field of calculation and its observers are those of EN 13201-3: the road between two lamps of a row, seen from
    60 m before it from the middle of each lane.
    """

    name: Label | None = None
    """Name in records and on pages."""
    lighting_class: ClassName
    """Class of EN 13201-2: M by luminance, C and P by illuminance."""
    width_m: Metres
    """Width of the road."""
    lanes: Annotated[int, Field(ge=1, le=12)] = 2
    """Lanes side by side, all of the same direction."""
    surface: Surface = "R3"
    """Class of the surface by the CIE."""
    surface_file: FilePath | None = None
    """CSV file with a table of its own in place of the class: a row of beta, then rows of tan gamma and 10^4 r."""
    surface_q0: Annotated[float, Field(ge=1e-3, le=1.0)] | None = None
    """Average luminance coefficient to which the table is scaled; by default the nominal one of the class."""
    pole_height_m: Metres
    """Height of the lamps above the road."""
    pole_spacing_m: Metres
    """Distance between the lamps of a row."""
    overhang_m: Annotated[float, Field(ge=-100.0, le=100.0)] = 0.0
    """Distance of a lamp from the edge beside which it stands, over the road; below 0 beside it."""
    tilt_deg: Annotated[float, Field(ge=-45.0, le=45.0)] = 0.0
    """Tilt of a lamp, upwards on the side of the road."""
    arrangement: Arrangement = "right"
    """Rows of lamps: at the left or at the right edge, at both edges "opposite" each other or "staggered" by half the
    spacing, or two on poles in a "median" at the left edge, of which the second lights the other carriageway.
    """
    mean_cd_per_m2: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    """Least mean luminance; by default of the class, as the three that follow."""
    uniformity: Share | None = None
    """Least over mean luminance U0 that is wanted at least."""
    uniformity_along: Share | None = None
    """Least over largest luminance Ul on the middle of a lane that is wanted at least."""
    glare_percent: Annotated[float, Field(gt=0.0, le=1000.0)] | None = None
    """Largest threshold increment TI."""
    maintenance_factor: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """Share of the light that dirt and age leave; glare is that of new lamps."""
    lamp_lm: Annotated[float, Field(gt=0.0, le=1e9)] | None = None
    """Luminous flux of the sources of a lamp; by default of the source times photometry.lenses, or as a file states."""
    lamp_w: Annotated[float, Field(gt=0.0, le=1e6)] | None = None
    """Electrical power of a lamp; with it the power density and the yearly energy are stated."""
    hours: Annotated[float, Field(gt=0.0, le=8784.0)] = 4000.0
    """Hours of full light in a year."""
    street_side_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 90.0
    """Direction from a lamp towards the street: azimuth of a lens from +x to +y, of a file its C."""

    @property
    def by_luminance(self) -> bool:
        """True for the classes M."""
        return self.lighting_class.startswith("M")

    @property
    def lane_m(self) -> float:
        """Width of a lane."""
        return self.width_m / self.lanes

    @model_validator(mode="after")
    def _is_a_road(self) -> "RoadSection":
        if self.lane_m < _LEAST_LANE_M and self.by_luminance:
            raise ValueError(
                f"lanes = {self.lanes} on width_m = {self.width_m:g} are {self.lane_m:.2f} m each, below "
                f"{_LEAST_LANE_M:g} m: no class M has lanes as narrow; give fewer lanes, or a class P for a path"
            )
        most = inf if self.overhang_m <= 0.0 else self.width_m
        if self.overhang_m > most:
            raise ValueError(
                f"overhang_m = {self.overhang_m:g} is beyond width_m = {self.width_m:g}: the lamp hangs over the other "
                "side; name the other edge by arrangement"
            )
        if self.pole_spacing_m > 12.0 * self.pole_height_m:
            raise ValueError(
                f"pole_spacing_m = {self.pole_spacing_m:g} is above 12 pole heights, {12.0 * self.pole_height_m:g} m: "
                "no table of a surface has light from so far; put the poles closer, or make them higher"
            )
        beyond = [name for name in _BY_LUMINANCE if getattr(self, name) is not None]
        if beyond and not self.by_luminance:
            raise ValueError(
                f"{beyond[0]} is of a class M, the class is {self.lighting_class}; leave it out, or give a class M"
            )
        return self
