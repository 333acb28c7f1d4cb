"""Receivers of a spec: a plane in any pose, the far field, a cylinder or a sphere."""

from math import cos, pi, radians, sin
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from lensforge.spec.emitter import Degrees
from lensforge.spec.receiver_section import ReceiverSection
from lensforge.spec.section import Coordinate, Millimetres
from lensforge.spec.target import HalfAngle, Unit

_Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Direction = tuple[_Number, _Number, _Number]
_LEAST_ACROSS = 1e-3  # sine of the angle at which a plane may be seen from the lens: 0.06 degrees


class PlaneReceiver(ReceiverSection):
    """A rectangle in a plane in any pose.

    Either side may face the lens: the light comes from there. Its x and y are the lens's own, tilted the shortest way,
    then turned by ``rotation_deg``.
    """

    kind: Literal["plane"] = "plane"
    centre_mm: tuple[Coordinate, Coordinate, Coordinate]
    """Centre (x, y, z)."""
    normal: Direction | None = None
    """Direction (x, y, z) of the normal; or give ``tilt_deg``."""
    tilt_deg: tuple[Degrees, Degrees] | None = None
    """Tilt of the normal from +z: about x, then about y."""
    width_mm: Millimetres
    """Width."""
    height_mm: Millimetres
    """Height."""
    window_mm: tuple[Millimetres, Millimetres] | None = None
    """Width and height of the centred rectangle in which flux counts as detected; by default all of it."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height (mm)."""
        return self.width_mm, self.height_mm

    @property
    def facing(self) -> Direction:
        """Direction of the normal, away from the lens."""
        a, b = (radians(angle) for angle in self.tilt_deg or (0.0, 0.0))
        x, y, z = self.normal or (cos(a) * sin(b), -sin(a), cos(a) * cos(b))
        away = x * self.centre_mm[0] + y * self.centre_mm[1] + z * self.centre_mm[2]
        return (x, y, z) if away >= 0.0 else (-x, -y, -z)

    @property
    def distance_mm(self) -> float:
        """Distance of the plane from the lens origin."""
        x, y, z = self.facing
        length: float = (x * x + y * y + z * z) ** 0.5
        return (x * self.centre_mm[0] + y * self.centre_mm[1] + z * self.centre_mm[2]) / length

    @model_validator(mode="after")
    def _is_seen_from_the_lens(self) -> "PlaneReceiver":
        if self.normal is not None and self.tilt_deg is not None:
            raise ValueError("normal and tilt_deg are both given; leave out one")
        if self.normal is not None and not any(self.normal):
            raise ValueError("normal = (0, 0, 0) is no direction")
        away = sum(value**2 for value in self.centre_mm) ** 0.5
        if away == 0.0:
            raise ValueError("centre_mm = (0, 0, 0) is the source; move the plane away")
        if self.distance_mm < _LEAST_ACROSS * away:
            raise ValueError(
                f"the plane is seen edge-on: it passes the lens origin at {self.distance_mm:.3g} mm, its centre is "
                f"{away:.4g} mm away; turn its normal, or move its centre"
            )
        return self

    @property
    def place(self) -> str:
        """Its place in a few words."""
        if self.centre_mm[:2] == (0.0, 0.0) and self.facing[:2] == (0.0, 0.0):
            return f"at {self.centre_mm[2]:g} mm"
        return f"centred at ({', '.join(f'{value:g}' for value in self.centre_mm)}) mm"


class FarFieldReceiver(ReceiverSection):
    """Intensity by direction, around an axis."""

    unit: ClassVar[Unit] = "deg"

    kind: Literal["far_field"] = "far_field"
    axis: Direction = (0.0, 0.0, 1.0)
    """Direction (x, y, z) of its centre."""
    half_angle_deg: HalfAngle
    """Largest angle from the axis."""

    @property
    def size(self) -> tuple[float, float]:
        """Sides of the equal-area chart, on which a direction lies 2 sin(gamma / 2) from the centre."""
        side = 4.0 * sin(0.5 * radians(self.half_angle_deg))
        return side, side

    @property
    def extent(self) -> tuple[float, float]:
        """Twice the half angle, in degrees."""
        return 2.0 * self.half_angle_deg, 2.0 * self.half_angle_deg

    @property
    def facing(self) -> Direction:
        """Direction of the axis."""
        return self.axis

    @model_validator(mode="after")
    def _has_an_axis(self) -> "FarFieldReceiver":
        if not any(self.axis):
            raise ValueError("axis = (0, 0, 0) is no direction")
        return self

    @property
    def place(self) -> str:
        """Its place in a few words."""
        return f"in the far field, to {self.half_angle_deg:g}°"


class _CurvedReceiver(ReceiverSection):
    """A screen around the lens, whose chart is centred on the direction ``facing``."""

    centre_mm: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    """Centre (x, y, z) of the screen's curvature."""
    facing: Direction = (0.0, 0.0, 1.0)
    """Direction (x, y, z) from the centre to the middle of the chart."""
    radius_mm: Millimetres
    """Radius of the screen."""

    @model_validator(mode="after")
    def _faces_somewhere(self) -> "_CurvedReceiver":
        if not any(self.facing):
            raise ValueError("facing = (0, 0, 0) is no direction")
        return self


class CylinderReceiver(_CurvedReceiver):
    """A cylindrical screen, unrolled.

    Its axis is the y axis of a frame that faces ``facing``: the lens's own, tilted the shortest way, then turned by
    ``rotation_deg``.
    """

    kind: Literal["cylinder"] = "cylinder"
    width_mm: Millimetres
    """Width along the arc."""
    height_mm: Millimetres
    """Height along the axis of the cylinder."""

    @property
    def size(self) -> tuple[float, float]:
        """Length of the arc, and height (mm)."""
        return self.width_mm, self.height_mm

    @model_validator(mode="after")
    def _goes_round_once(self) -> "CylinderReceiver":
        if self.width_mm > 2.0 * pi * self.radius_mm * (1.0 + 1e-9):
            raise ValueError(
                f"width_mm = {self.width_mm:g} is more than once around a radius_mm of {self.radius_mm:g}, "
                f"{2.0 * pi * self.radius_mm:.6g}"
            )
        return self

    @property
    def place(self) -> str:
        """Its place in a few words."""
        return f"on a cylinder of radius {self.radius_mm:g} mm"


class SphereReceiver(_CurvedReceiver):
    """A spherical screen up to ``half_angle_deg`` from the direction that it faces, seen from its centre.

    Charted so that areas are kept: a place lies 2 ``radius_mm`` sin(angle / 2) from the chart's centre.
    """

    kind: Literal["sphere"] = "sphere"
    half_angle_deg: Annotated[float, Field(ge=0.01, le=150.0)]
    """Largest angle from the direction that it faces, seen from its centre."""

    @property
    def size(self) -> tuple[float, float]:
        """Sides of the equal-area chart (mm)."""
        side = 4.0 * self.radius_mm * sin(0.5 * radians(self.half_angle_deg))
        return side, side

    @property
    def place(self) -> str:
        """Its place in a few words."""
        return f"on a sphere of radius {self.radius_mm:g} mm"


AnyReceiver = PlaneReceiver | FarFieldReceiver | CylinderReceiver | SphereReceiver
