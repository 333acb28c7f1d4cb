"""Playing fields that a lens is for: ``[[sports]]`` of a spec, each with its floodlights and its class of EN 12193."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from lensforge.public import public
from lensforge.spec.application import Application
from lensforge.spec.spec_section import Section, check


@dataclass(frozen=True)
class SportsClass:
    """Minimum mean horizontal illuminance (lx) and its min/mean U0, and the largest glare rating."""

    mean_lx: float
    uniformity: float
    glare: float


# EN 12193:2018, outdoors.
CLASSES = {
    "football I": SportsClass(500.0, 0.70, 50.0),
    "football II": SportsClass(200.0, 0.60, 50.0),
    "football III": SportsClass(75.0, 0.50, 55.0),
    "tennis I": SportsClass(500.0, 0.70, 50.0),
    "tennis II": SportsClass(300.0, 0.70, 50.0),
    "tennis III": SportsClass(200.0, 0.60, 55.0),
}
_Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
_Height = Annotated[float, Field(ge=2.0, le=200.0)]  # above the eyes
_Share = Annotated[float, Field(ge=1e-9, le=1.0)]
_Side = Annotated[float, Field(ge=1.0, le=500.0)]


@public
class FloodlightSection(Section):
    """Lamps in one place that are aimed at one point of the ground; their street lies beyond it."""

    place_m: tuple[_Metres, _Metres, _Height] = Field(
        description="Place, from the middle of the field: along it, across it and up."
    )
    aim_m: tuple[_Metres, _Metres] = Field(description="Point of the ground at which the axis of the lamps is aimed.")
    lamps: Annotated[int, Field(ge=1, le=1000)] = Field(default=1, description="Number of lamps.")

    @check
    def _leans(self) -> None:
        if self.place_m[:2] == self.aim_m:
            raise ValueError(
                f"aim_m = {list(self.aim_m)} is the foot of place_m: a lamp that hangs straight down has no street; "
                "aim it beside"
            )


@public
class SportsSection(Application):
    """A rectangular playing field, its floodlights, and the class of EN 12193 that it is to reach.

    Its glare is rated by CIE 112 for observers on the field in eight directions.
    """

    table: ClassVar[str] = "sports"
    of_table: ClassVar[str] = (
        "Playing fields that floodlights with the lens light, each with its class: limits on the light, too."
    )
    noun: ClassVar[str] = "field"

    lighting_class: Literal["football I", "football II", "football III", "tennis I", "tennis II", "tennis III"] = Field(
        description="Class of EN 12193 outdoors: mean illuminance, uniformity U0 and glare rating."
    )
    length_m: _Side = Field(description="Length of the field.")
    width_m: _Side = Field(description="Width of the field.")
    floodlights: Annotated[tuple[FloodlightSection, ...], Field(min_length=1, max_length=256)] = Field(
        description="All floodlights of the field."
    )
    reflectance: _Share = Field(default=0.25, description="Reflectance of the ground; 0.25 for grass.")
    maintenance_factor: _Share = Field(
        default=1.0, description="Share of the light that dirt and age leave; glare is that of new lamps."
    )

    @property
    def required(self) -> SportsClass:
        """Numbers of its class."""
        return CLASSES[self.lighting_class]

    @property
    def summary(self) -> str:
        """Its class and its size."""
        return f"{self.lighting_class} on {self.length_m:g} × {self.width_m:g} m"
