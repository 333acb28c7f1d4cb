"""Receivers of a spec: a plane in any pose, the far field, a cylinder or a sphere, with the targets on them.

A target may imply a receiver. Receivers lie outside the lens and, where it has a cover glass, behind it.
"""

from math import atan2, cos, degrees, dist, hypot, inf, pi, radians, sin
from typing import Annotated, ClassVar, Literal, TypeVar

from pydantic import Field

from lensforge.errors import InputError
from lensforge.optics.pose import ORIGIN, Pose, Vector
from lensforge.public import public
from lensforge.spec.emitter_section import Degrees
from lensforge.spec.lens_section import LensShape
from lensforge.spec.receiver_fields import Direction, ReceiverSection, largest_of
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import Coordinate, Millimetres, check
from lensforge.spec.target_sections import HalfAngle, TargetSection, Unit

_LEAST_ACROSS = 1e-3  # sine of the angle at which a plane may be seen from the lens: 0.06 degrees


@public
class PlaneReceiver(ReceiverSection):
    """A rectangle in a plane in any pose.

    The side that faces the lens receives the light, whichever that is. The plane takes the axes x and y of the lens
    with it: tilted by the smallest rotation, then turned about its normal by ``rotation_deg``.
    """

    faces_by: ClassVar[str] = "normal"

    kind: Literal["plane"] = "plane"
    centre_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(description="Centre (x, y, z).")
    normal: Direction | None = Field(default=None, description="Direction (x, y, z) of the normal; or give `tilt_deg`.")
    tilt_deg: tuple[Degrees, Degrees] | None = Field(
        default=None, description="Tilt of the normal from +z: about x, then about y."
    )
    width_mm: Millimetres = Field(description="Width.")
    height_mm: Millimetres = Field(description="Height.")
    window_mm: tuple[Millimetres, Millimetres] | None = Field(
        default=None,
        description="Width and height of the centred rectangle in which flux counts as detected; by default all of it.",
    )

    @property
    def size(self) -> tuple[float, float]:
        """Width and height (mm)."""
        return self.width_mm, self.height_mm

    @property
    def facing(self) -> Direction:
        """Direction of the normal, away from the lens."""
        x, y, z = self.normal or Pose.of_tilts(tilt_deg=self.tilt_deg or (0.0, 0.0)).axis
        away = x * self.centre_mm[0] + y * self.centre_mm[1] + z * self.centre_mm[2]
        return (x, y, z) if away >= 0.0 else (-x, -y, -z)

    @property
    def distance_mm(self) -> float:
        """Distance of the plane from the lens origin."""
        return self.clear_mm(ORIGIN)

    def clear_mm(self, place_mm: Vector) -> float:
        """Distance of the plane from a place before it."""
        x, y, z = self.facing
        length: float = (x * x + y * y + z * z) ** 0.5
        across, up, away = (centre - place for centre, place in zip(self.centre_mm, place_mm, strict=True))
        return (x * across + y * up + z * away) / length

    def require_outside(self, lens: LensShape, limits: ConstraintsSection, distance: str) -> None:
        """Raise ``ValueError`` for a plane that the largest lens would meet, or that lies behind it."""
        largest = lens.extent_mm(limits, self.facing[2] / hypot(*self.facing))
        if self.distance_mm <= largest:
            least = f"{largest_of(lens)} = {largest:.6g}"
            raise ValueError(f"{distance} = {self.distance_mm:g} is inside the lens: it must exceed {least}")
        _require_ahead(self.facing, 0.0, self.centre_mm[2] < 0.0)

    @check
    def _is_seen_from_the_lens(self) -> None:
        if self.normal is not None and self.tilt_deg is not None:
            raise ValueError("normal and tilt_deg are both given; leave out one")
        away = sum(value**2 for value in self.centre_mm) ** 0.5
        if away == 0.0:
            raise ValueError("centre_mm = (0, 0, 0) is the source; move the plane away")
        if self.distance_mm < _LEAST_ACROSS * away:
            raise ValueError(
                f"the plane is seen edge-on: it passes the lens origin at {self.distance_mm:.3g} mm, its centre is "
                f"{away:.4g} mm away; turn its normal, or move its centre"
            )

    @property
    def place(self) -> str:
        """Its place in a few words, and the angle of its normal to the lens's axis."""
        turned = degrees(atan2(hypot(*self.facing[:2]), self.facing[2]))
        tilt = f", tilted by {turned:.3g}°" if turned else ""
        if self.centre_mm[:2] == (0.0, 0.0):
            return f"at {self.centre_mm[2]:g} mm{tilt}"
        return f"centred at ({', '.join(f'{value:g}' for value in self.centre_mm)}) mm{tilt}"


@public
class FarFieldReceiver(ReceiverSection):
    """Intensity by direction, around an axis."""

    unit: ClassVar[Unit] = "deg"
    phrase: ClassVar[str] = "in the far field, to {0.half_angle_deg:g}°"
    centre_mm: ClassVar[Vector] = ORIGIN
    is_round: ClassVar[bool] = True
    faces_by: ClassVar[str] = "axis"

    kind: Literal["far_field"] = "far_field"
    axis: Direction = Field(default=(0.0, 0.0, 1.0), description="Direction (x, y, z) of its centre.")
    half_angle_deg: HalfAngle = Field(description="Largest angle from the axis.")

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

    def pixel_rad(self, pixels: int) -> float:
        """Side of a pixel on the chart."""
        return max(self.size) / pixels

    def clear_mm(self, place_mm: Vector) -> float:
        """Infinite: it is far away."""
        return inf

    def require_outside(self, lens: LensShape, limits: ConstraintsSection, distance: str) -> None:
        """Raise ``ValueError`` where all of it lies behind the source."""
        _require_ahead(self.facing, self.half_angle_deg, True)


@public
class _CurvedReceiver(ReceiverSection):
    """A screen around the lens, whose chart is centred on the direction ``facing``."""

    centre_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(
        default=(0.0, 0.0, 0.0), description="Centre (x, y, z) of the screen's curvature."
    )
    facing: Direction = Field(
        default=(0.0, 0.0, 1.0), description="Direction (x, y, z) from the centre to the middle of the chart."
    )
    radius_mm: Millimetres = Field(description="Radius of the screen.")

    def pixel_rad(self, pixels: int) -> float:
        """Angle of a pixel seen from the centre."""
        return max(self.size) / pixels / self.radius_mm

    def clear_mm(self, place_mm: Vector) -> float:
        """Distance of the screen from a place within it."""
        return self.radius_mm - dist(self.centre_mm, place_mm)


@public
class CylinderReceiver(_CurvedReceiver):
    """A cylindrical screen, unrolled.

    Its axis is the y axis of a frame that faces ``facing``: the lens's own, tilted the shortest way, then turned by
    ``rotation_deg``.
    """

    phrase: ClassVar[str] = "on a cylinder of radius {0.radius_mm:g} mm"

    kind: Literal["cylinder"] = "cylinder"
    width_mm: Millimetres = Field(description="Width along the arc.")
    height_mm: Millimetres = Field(description="Height along the axis of the cylinder.")

    @property
    def size(self) -> tuple[float, float]:
        """Length of the arc, and height (mm)."""
        return self.width_mm, self.height_mm

    @check
    def _goes_round_once(self) -> None:
        if self.width_mm > 2.0 * pi * self.radius_mm * (1.0 + 1e-9):
            raise ValueError(
                f"width_mm = {self.width_mm:g} is more than once around a radius_mm of {self.radius_mm:g}, "
                f"{2.0 * pi * self.radius_mm:.6g}"
            )


@public
class SphereReceiver(_CurvedReceiver):
    """A spherical screen up to ``half_angle_deg`` from the direction that it faces, seen from its centre.

    Charted so that areas are kept: a place lies 2 ``radius_mm`` sin(angle / 2) from the chart's centre.
    """

    phrase: ClassVar[str] = "on a sphere of radius {0.radius_mm:g} mm"
    is_round: ClassVar[bool] = True

    kind: Literal["sphere"] = "sphere"
    half_angle_deg: Annotated[float, Field(ge=0.01, le=150.0)] = Field(
        description="Largest angle from the direction that it faces, seen from its centre."
    )

    @property
    def size(self) -> tuple[float, float]:
        """Sides of the equal-area chart (mm)."""
        side = 4.0 * self.radius_mm * sin(0.5 * radians(self.half_angle_deg))
        return side, side


_Implied = TypeVar("_Implied", PlaneReceiver, FarFieldReceiver)


def implied_receiver(target: TargetSection) -> ReceiverSection:
    """The receiver that a target alone stands for. Raises ``ValueError`` where it names none."""
    if target.half_angle_deg is not None:
        return _with(FarFieldReceiver, target, half_angle_deg=target.half_angle_deg)
    if target.distance_mm is None or target.receiver_mm is None:
        if target.distance_mm is not None:
            raise ValueError("target.receiver_mm: missing; give the side of the square receiver, 1.5 times the pattern")
        either = "half_angle_deg" if target.unit == "deg" else "distance_mm and receiver_mm"
        raise ValueError(f"target: its receiver is missing; give {either}, or put the target into [[receivers]]")
    side = target.receiver_mm
    return _with(PlaneReceiver, target, centre_mm=(0.0, 0.0, target.distance_mm), width_mm=side, height_mm=side)


def _with(kind: type[_Implied], target: TargetSection, **place: object) -> _Implied:
    try:
        return kind(name="light", targets=(target,), **place)
    except InputError as error:
        raise ValueError(f"target: {str(error).removeprefix(f'{kind.__name__}: ')}") from None


def _require_ahead(facing: tuple[float, float, float], half_angle_deg: float, behind: bool) -> None:
    """Refuse a receiver that faces away from the half space z > 0, into which a lens sends its light."""
    up = facing[2] / sum(value**2 for value in facing) ** 0.5
    if behind and up <= -cos(radians(90.0 - half_angle_deg)):
        raise ValueError("receivers: it lies behind the source, whose lens sends its light to z > 0; turn or move it")
