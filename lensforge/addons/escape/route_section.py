"""Escape routes that a lens is for: ``[[routes]]`` of a spec, each with a row of emergency luminaires (EN 1838)."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from lensforge.public import public
from lensforge.spec.application import Application

# Largest intensity (cd) from 60 to 90 degrees by the height up to which it holds: EN 1838, table 1.
_GLARE_CD = ((2.5, 500.0), (3.0, 900.0), (3.5, 1600.0), (4.0, 2500.0), (4.5, 3500.0))
_MOST_GLARE_CD = 5000.0
_Share = Annotated[float, Field(ge=1e-9, le=1.0)]


@public
class RouteSection(Application):
    """A straight escape route below a row of equal luminaires, whose x lies along it.

    EN 1838 asks for light on its centre line and on the band about it that is half as wide as the route.
    """

    table: ClassVar[str] = "routes"
    of_table: ClassVar[str] = (
        "Escape routes that a row of lamps with the lens lights in an emergency: limits on the light, too."
    )
    noun: ClassVar[str] = "route"

    lighting_class: Literal["escape route"] = Field(
        default="escape route", description="Emergency lighting of EN 1838."
    )
    lamp_height_m: Annotated[float, Field(ge=0.5, le=50.0)] = Field(description="Height of the lamps above the floor.")
    spacing_m: Annotated[float, Field(ge=0.1, le=500.0)] = Field(description="Distance between lamps along the route.")
    width_m: Annotated[float, Field(ge=0.1, le=2.0)] = Field(
        default=2.0, description="Width of the route; wider ones count as several of 2 m side by side."
    )
    line_lx: Annotated[float, Field(ge=1e-6, le=1e6)] = Field(
        default=1.0, description="Minimum illuminance of the centre line; half of it on the central band."
    )
    maintenance_factor: _Share = Field(default=1.0, description="Share of the light at the end of its rated duration.")

    @property
    def height_m(self) -> float:
        """Height of the lamps."""
        return self.lamp_height_m

    @property
    def most_cd(self) -> float:
        """Largest intensity that its height allows from 60 degrees on."""
        return next((most for below_m, most in _GLARE_CD if self.height_m < below_m), _MOST_GLARE_CD)

    @property
    def summary(self) -> str:
        """Its class, and where the lamps are."""
        return f"{self.lighting_class}, lamps {self.spacing_m:g} m apart, {self.height_m:g} m high"
