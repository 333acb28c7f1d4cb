"""Offices that a lens is for: ``[[offices]]`` of a spec, each a standard room of CIE 190 with lamps in equal steps."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from lensforge.public import public
from lensforge.spec.application import Application
from lensforge.spec.spec_section import check

# Classes of EN 12464-1 by the largest rating that they allow.
CLASSES = {"UGR 13": 13.0, "UGR 16": 16.0, "UGR 19": 19.0, "UGR 22": 22.0, "UGR 25": 25.0, "UGR 28": 28.0}
_Narrow = Literal["2H 2H", "2H 3H", "2H 4H", "2H 6H", "2H 8H", "2H 12H"]
_Middle = Literal["4H 2H", "4H 3H", "4H 4H", "4H 6H", "4H 8H", "4H 12H"]
_Wide = Literal["8H 4H", "8H 6H", "8H 8H", "8H 12H", "12H 4H", "12H 6H", "12H 8H"]
_Metres = Annotated[float, Field(ge=1e-3, le=100.0)]


@public
class OfficeSection(Application):
    """A standard room with lamps in its ceiling, and the class of glare that it is to keep.

    It is seen from the middle of its wall, straight ahead, once along x of the lamps and once along y: the tabular
    method of CIE 190, for lamps with a flat luminous area.
    """

    table: ClassVar[str] = "offices"
    of_table: ClassVar[str] = "Offices that lamps with the lens light, each with its class of glare: limits on it, too."
    noun: ClassVar[str] = "office"

    lighting_class: Literal["UGR 13", "UGR 16", "UGR 19", "UGR 22", "UGR 25", "UGR 28"] = Field(
        description="Class of glare of EN 12464-1: the largest unified glare rating."
    )
    luminous_m: tuple[_Metres, _Metres] = Field(description="Width and length of the luminous area of a lamp.")
    room: Literal[_Narrow, _Middle, _Wide] = Field(
        default="4H 8H",
        description="Width across the line of sight and length along it of the room, in heights H of the lamps "
        "above the eyes.",
    )
    reflectances: Literal["70/50/20", "70/30/20", "50/50/20", "50/30/20", "30/30/20"] = Field(
        default="70/50/20", description="Reflectances of ceiling, walls and working plane, in per cent."
    )
    above_eyes_m: Annotated[float, Field(ge=0.1, le=100.0)] = Field(
        default=2.0, description="Height H of the lamps above the eyes; 2 m in tables of CIE 190."
    )
    spacing: Annotated[float, Field(ge=0.1, le=2.0)] = Field(
        default=0.25,
        description="Distance between lamps over H; 0.25 in tables of CIE 190. The largest whole number of lamps that "
        "fits shares the room.",
    )
    pitch_m: tuple[_Metres, _Metres] | None = Field(
        default=None,
        description="Distances between lamps along their x and y, of an endless ceiling; with them the direct light on "
        "the working plane is judged, 0.45 m below the eyes.",
    )
    mean_lx: Annotated[float, Field(ge=1e-9, le=1e6)] | None = Field(
        default=None, description="Minimum mean illuminance of the working plane, with `pitch_m`; by default none."
    )
    uniformity: Annotated[float, Field(ge=1e-9, le=1.0)] | None = Field(
        default=None, description="Minimum of the uniformity U0, min/mean, there; by default none."
    )

    @property
    def size(self) -> tuple[float, float]:
        """Width and length over H."""
        width, length = (float(word.removesuffix("H")) for word in self.room.split())
        return width, length

    @property
    def most(self) -> float:
        """Largest rating that its class allows."""
        return CLASSES[self.lighting_class]

    @property
    def summary(self) -> str:
        """Its class, room and reflectances."""
        return f"{self.lighting_class} in {self.room}, {self.reflectances}"

    @check
    def _has_a_plane(self) -> None:
        bounded = next((name for name in ("mean_lx", "uniformity") if getattr(self, name) is not None), None)
        if bounded is not None and self.pitch_m is None:
            raise ValueError(f"{bounded} is of the working plane below lamps in equal steps; give their pitch_m")
