"""Roads that a lens is for: ``[[roads]]`` of a spec, and of a file by which a lamp's photometry is judged.

A road is straight, and seen along its direction of travel: left and right are those of a driver in lane 1. All lamps of
a road are equal, and stand in rows at equal steps.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field

from lensforge.public import public
from lensforge.spec.application import MOST_APPLICATIONS, Application
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.receiver_sections import PlaneReceiver
from lensforge.spec.spec_files import NamedFrom, read_toml
from lensforge.spec.spec_section import FilePath, Section, check, section_of

# Nominal average luminance coefficient Q0 (cd/m^2 per lx) of the classes of the CIE: CIE 144:2001; of wet ones CIE 47.
STANDARD_SURFACES = {"R1": 0.10, "R2": 0.07, "R3": 0.07, "R4": 0.08, "C1": 0.10, "C2": 0.07, "W4": 0.247}
LEAST_Q0 = 0.02  # of any road: fresh black asphalt has 0.04
MOST_Q0 = 0.5  # a wet surface 0.25


@dataclass(frozen=True)
class LuminanceClass:
    """Minimum mean luminance (cd/m^2), U0 and Ul, maximum threshold increment (%), minimum edge ratio R_EI."""

    mean: float
    uniformity: float
    along: float
    glare_percent: float
    edge_ratio: float


M_CLASSES = {
    "M1": LuminanceClass(2.0, 0.40, 0.70, 10.0, 0.35),
    "M2": LuminanceClass(1.5, 0.40, 0.70, 10.0, 0.35),
    "M3": LuminanceClass(1.0, 0.40, 0.60, 15.0, 0.30),
    "M4": LuminanceClass(0.75, 0.40, 0.60, 15.0, 0.30),
    "M5": LuminanceClass(0.50, 0.35, 0.40, 15.0, 0.30),
    "M6": LuminanceClass(0.30, 0.35, 0.40, 20.0, 0.30),
}
WET_UNIFORMITY = 0.15  # least U0 of a wet road, of all classes M
# Mean and minimum illuminance (lx); the mean of a P class may be at most 1.5 times what it requires.
P_CLASSES = {
    "P1": (15.0, 3.0), "P2": (10.0, 2.0), "P3": (7.5, 1.5), "P4": (5.0, 1.0), "P5": (3.0, 0.6), "P6": (2.0, 0.4),
}  # fmt: skip
P_MOST = 1.5


@dataclass(frozen=True)
class RatioClass:
    """Minimum mean luminance (cd/m^2), maximum ratios mean/min, max/min and veiling/mean."""

    mean: float
    mean_over_least: float
    largest_over_least: float
    veiling: float


# ANSI/IES RP-8-14, highways, and streets by the conflict of traffic with pedestrians; a freeway A is the busier one.
RP8_CLASSES = {
    "freeway A": RatioClass(0.6, 3.5, 6.0, 0.3),
    "freeway B": RatioClass(0.4, 3.5, 6.0, 0.3),
    "expressway": RatioClass(1.0, 3.0, 5.0, 0.3),
    "major high": RatioClass(1.2, 3.0, 5.0, 0.3),
    "major medium": RatioClass(0.9, 3.0, 5.0, 0.3),
    "major low": RatioClass(0.6, 3.5, 6.0, 0.3),
    "collector high": RatioClass(0.8, 3.0, 5.0, 0.4),
    "collector medium": RatioClass(0.6, 3.5, 6.0, 0.4),
    "collector low": RatioClass(0.4, 4.0, 8.0, 0.4),
    "local high": RatioClass(0.6, 6.0, 10.0, 0.4),
    "local medium": RatioClass(0.5, 6.0, 10.0, 0.4),
    "local low": RatioClass(0.3, 6.0, 10.0, 0.4),
}
# Mean illuminance (lx); the least must be 0.4 of the mean.
C_CLASSES = {"C0": 50.0, "C1": 30.0, "C2": 20.0, "C3": 15.0, "C4": 10.0, "C5": 7.5}
C_UNIFORMITY = 0.4  # all: EN 13201-2:2015

_Motor = Literal["M1", "M2", "M3", "M4", "M5", "M6"]
_Conflict = Literal["C0", "C1", "C2", "C3", "C4", "C5"]
_Pedestrian = Literal["P1", "P2", "P3", "P4", "P5", "P6"]
_Highway = Literal["freeway A", "freeway B", "expressway", "major high", "major medium", "major low"]
_Street = Literal["collector high", "collector medium", "collector low", "local high", "local medium", "local low"]
ClassName = Literal[_Motor, _Conflict, _Pedestrian, _Highway, _Street]
Edition = Literal["RP-8-00", "RP-8-14"]
Width = Annotated[float, Field(ge=0.5, le=200.0)]  # m: from a footpath to all lanes of a motorway
Height = Annotated[float, Field(ge=0.3, le=100.0)]  # m: from a light in a handrail to a high mast
Surface = Literal["R1", "R2", "R3", "R4", "C1", "C2"]
WetSurface = Literal["W4"]
Arrangement = Literal["left", "right", "opposite", "staggered", "median"]
Share = Annotated[float, Field(ge=1e-9, le=1.0)]
_LEAST_SPACING = 0.1  # of the pole height: lamps of a tunnel that nearly touch; work grows by one over it
_LEAST_LANE_M = 2.0
_SAME = 0.01  # relative: heights that are stated twice agree this well
_OF_M = ("uniformity_along", "glare_percent", "wet_surface", "wet_surface_file", "wet_uniformity")
_BY_LUMINANCE = ("mean_cd_per_m2", "uniformity", "luminance_per_lux", *_OF_M)


@public
class RoadSection(Application):
    """A straight road, its lamps, and the class of EN 13201-2 or of RP-8 that it is to reach.

    Its field of calculation is the road between two lamps of a row. Its observers are those of EN 13201-3, 60 m before
    the field in the middle of each lane; for a class of RP-8 there is one 83.07 m before each point.
    """

    table: ClassVar[str] = "roads"
    of_table: ClassVar[str] = (
        "Roads that rows of lamps with the lens light, each with its class: limits on the light, too."
    )
    noun: ClassVar[str] = "road"

    lighting_class: ClassName = Field(
        description="Class of EN 13201-2: M by luminance, C and P by illuminance; or of RP-8 by luminance: "
        "highways, and streets by how many pedestrians there are."
    )
    edition: Edition | None = Field(
        default=None,
        description='Edition of RP-8 by whose law glare is summed; by default "RP-8-14", whose law later ones '
        "have, too.",
    )
    width_m: Width = Field(description="Width of the road.")
    lanes: Annotated[int, Field(ge=1, le=12)] = Field(
        default=2, description="Lanes side by side, the first at the edge of `driving_side`."
    )
    driving_side: Literal["left", "right"] = Field(default="right", description="Side of the road on which one drives.")
    oncoming_lanes: Annotated[int, Field(ge=0, le=11)] = Field(
        default=0,
        description="Lanes whose drivers come the other way: the last of `lanes`, at the edge opposite to "
        "`driving_side`.",
    )
    surface: Surface = Field(default="R3", description="Class of the surface by the CIE.")
    surface_file: FilePath | None = Field(
        default=None,
        description="CSV file with a table of its own in place of the class: a row of beta, then rows of tan "
        "gamma and 10^4 r.",
    )
    surface_q0: Annotated[float, Field(ge=LEAST_Q0, le=MOST_Q0)] | None = Field(
        default=None,
        description="Average luminance coefficient to which the table is scaled; by default the nominal one of "
        "the class.",
    )
    wet_surface: WetSurface | None = Field(
        default=None,
        description="Class of the surface when it is wet, for which a class M requires uniformity, too; by "
        "default it is dry.",
    )
    wet_surface_file: FilePath | None = Field(
        default=None, description="CSV file of a wet surface in place of its class."
    )
    pole_height_m: Height = Field(description="Height of the lamps above the road.")
    pole_spacing_m: Annotated[float, Field(ge=0.2, le=1200.0)] = Field(
        description="Distance between the lamps of a row, from a tenth of the pole height to 12 of it."
    )
    overhang_m: Annotated[float, Field(ge=-100.0, le=100.0)] = Field(
        default=0.0,
        description="Distance of a lamp from the edge beside which it stands, over the road; below 0 beside it.",
    )
    tilt_deg: Annotated[float, Field(ge=-45.0, le=45.0)] = Field(
        default=0.0, description="Tilt of a lamp, upwards on the side of the road."
    )
    arrangement: Arrangement = Field(
        default="right",
        description='Rows of lamps: at the left or at the right edge, at both edges "opposite" each other or '
        '"staggered" by half the spacing, or two on poles in a "median" opposite to `driving_side`, '
        "of which the second lights the other carriageway.",
    )
    median_m: Annotated[float, Field(ge=0.0, le=100.0)] = Field(
        default=0.0, description="Width of the median, in whose middle the poles stand."
    )
    mean_cd_per_m2: Annotated[float, Field(ge=1e-9, le=1000.0)] | None = Field(
        default=None, description="Minimum mean luminance; by default of the class, as the four that follow."
    )
    uniformity: Share | None = Field(
        default=None, description="Minimum of the overall uniformity U0, min/mean luminance."
    )
    wet_uniformity: Share | None = Field(
        default=None, description="Minimum U0 of the wet road; by default 0.15, as every class M requires."
    )
    uniformity_along: Share | None = Field(
        default=None,
        description="Minimum of the longitudinal uniformity Ul, min/max luminance on the middle of a lane.",
    )
    glare_percent: Annotated[float, Field(ge=1e-9, le=1000.0)] | None = Field(
        default=None, description="Maximum threshold increment TI."
    )
    luminance_per_lux: Annotated[float, Field(ge=1e-9, le=1.0)] | None = Field(
        default=None, description="Minimum mean luminance/mean illuminance Q; by default none."
    )
    edge_ratio: Share | None = Field(
        default=None,
        description="Least ratio of the illuminance beside an edge to that within; by default of a class M, for C "
        "and P none.",
    )
    maintenance_factor: Share = Field(
        default=1.0, description="Share of the light that dirt and age leave; glare is that of new lamps."
    )
    lamp_w: Annotated[float, Field(ge=1e-9, le=1e6)] | None = Field(
        default=None,
        description="Electrical power of a lamp; with it the power density and the yearly energy are stated.",
    )
    hours: Annotated[float, Field(ge=1e-9, le=8784.0)] = Field(
        default=4000.0, description="Hours of full light in a year."
    )

    @property
    def by_rp8(self) -> bool:
        """True for the classes of RP-8."""
        return self.lighting_class in RP8_CLASSES

    @property
    def by_luminance(self) -> bool:
        """True for the classes M and those of RP-8."""
        return self.lighting_class in M_CLASSES or self.by_rp8

    @property
    def standard(self) -> str:
        """Name of the class's standard."""
        return (self.edition or "RP-8-14") if self.by_rp8 else "EN 13201"

    @property
    def least_edge_ratio(self) -> float | None:
        """Required edge ratio; None if not required."""
        of_class = M_CLASSES.get(self.lighting_class)
        return self.edge_ratio or (None if of_class is None else of_class.edge_ratio)

    @property
    def lane_m(self) -> float:
        """Width of a lane."""
        return self.width_m / self.lanes

    @property
    def traffic(self) -> str:
        """Directions of its lanes in words."""
        lanes = "1 lane" if self.lanes == 1 else f"{self.lanes} lanes"
        if not self.by_luminance:  # no driver looks along it
            return lanes
        one_way = "one way" if self.lanes == 1 else "both one way" if self.lanes == 2 else "all one way"
        return f"{lanes}, {f'{self.oncoming_lanes} oncoming' if self.oncoming_lanes else one_way}"

    @property
    def height_m(self) -> float:
        """Height of the poles."""
        return self.pole_height_m

    @property
    def summary(self) -> str:
        """Its class and its traffic."""
        return f"{self.lighting_class}, {self.traffic}"

    @classmethod
    def warnings(cls, table: Sequence[Self], receivers: Sequence[ReceiverSection]) -> Iterator[str]:
        """Warn if all planes lie at another distance than the poles' height."""
        heights = {road.pole_height_m for road in table if not road.tilt_deg}
        planes = [plane for plane in receivers if isinstance(plane, PlaneReceiver) and plane.facing[:2] == (0.0, 0.0)]
        if not planes or len(heights) != 1:
            return
        height = max(heights)
        away = [1e-3 * plane.distance_mm for plane in planes]
        if all(abs(distance / height - 1.0) > _SAME for distance in away):
            yield (
                f"receivers: {planes[0].name} lies {away[0]:g} m below the lamps, pole_height_m of roads is "
                f"{height:g}; give it centre_mm with z = {1e3 * height:g}, unless another plane is meant"
            )

    @property
    def has_wet_surface(self) -> bool:
        """True where the wet road counts, too."""
        return self.wet_surface is not None or self.wet_surface_file is not None

    def from_right(self, lane: int) -> int:
        """Number of ``lane`` counted from the right edge; both count from 0."""
        return lane if self.driving_side == "right" else self.lanes - 1 - lane

    @check
    def _is_a_road(self) -> None:
        if self.lane_m < _LEAST_LANE_M and self.by_luminance:
            raise ValueError(
                f"lanes = {self.lanes} on width_m = {self.width_m:g} are {self.lane_m:.2f} m each, below "
                f"{_LEAST_LANE_M:g} m: no class by luminance has lanes as narrow; give fewer, or a class P for a path"
            )
        if self.oncoming_lanes >= self.lanes:
            raise ValueError(
                f"oncoming_lanes = {self.oncoming_lanes} leave none of lanes = {self.lanes} for those who drive with "
                "the road; give at most one less"
            )
        if self.median_m and self.arrangement != "median":
            raise ValueError(
                f'median_m = {self.median_m:g} is for arrangement = "median", this one is "{self.arrangement}"; leave '
                "it out, or name the median"
            )
        if self.arrangement == "median" and self.overhang_m < -0.5 * self.median_m:
            raise ValueError(
                f"overhang_m = {self.overhang_m:g} with median_m = {self.median_m:g}: the poles of a median stand in "
                "its middle, so that one of its two lamps would be inside the lane of the other; give the median its "
                "width, or an overhang_m of 0 or more"
            )
        if self.overhang_m > self.width_m:
            raise ValueError(
                f"overhang_m = {self.overhang_m:g} is beyond width_m = {self.width_m:g}: the lamp hangs over the other "
                "side; name the other edge by arrangement"
            )
        if self.pole_spacing_m > 12.0 * self.pole_height_m:
            raise ValueError(
                f"pole_spacing_m = {self.pole_spacing_m:g} is above 12 pole heights, {12.0 * self.pole_height_m:g} m: "
                "the r-tables of road surfaces end there; put the poles closer, or make them higher"
            )
        least_m = _LEAST_SPACING * self.pole_height_m
        if self.pole_spacing_m < least_m:
            raise ValueError(
                f"pole_spacing_m = {self.pole_spacing_m:g} is below a tenth of pole_height_m = {self.pole_height_m:g}, "
                f"{least_m:g} m: give the spacing in metres, or join so many lamps into one"
            )
        if self.wet_uniformity is not None and not self.has_wet_surface:
            raise ValueError(
                f"wet_uniformity = {self.wet_uniformity:g} is of a wet road; name its wet_surface, or leave it out"
            )
        self._require_fields_of_its_class()

    def _require_fields_of_its_class(self) -> None:
        of_others = () if self.lighting_class in M_CLASSES else _OF_M if self.by_rp8 else _BY_LUMINANCE
        beyond = [name for name in of_others if getattr(self, name) is not None]
        if beyond:
            raise ValueError(
                f"{beyond[0]} is of a class M, the class is {self.lighting_class}; leave it out, or give a class M"
            )
        if self.edition is not None and not self.by_rp8:
            raise ValueError(
                f"edition = {self.edition} is of a class of RP-8, the class is {self.lighting_class}; leave it out, or "
                f"give one of {', '.join(RP8_CLASSES)}"
            )


class RoadFile(Section):
    """File of roads: those of a spec, without the rest."""

    roads: Annotated[tuple[RoadSection, ...], Field(min_length=1, max_length=MOST_APPLICATIONS)] = Field(
        description="Roads, each with its class."
    )


def load_roads(path: Path) -> tuple[RoadSection, ...]:
    """The ``[[roads]]`` of a TOML file, a spec or one of roads alone. Raises :class:`InputError`."""
    content = read_toml(path, missing="give a TOML file with [[roads]], such as a spec")
    roads = {name: content[name] for name in content if name == "roads"}
    return section_of(RoadFile, roads, str(path), NamedFrom(path.parent, there=True)).roads
