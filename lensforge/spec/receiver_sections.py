"""Receivers of a spec: a plane in any pose, the far field, a cylinder or a sphere, with the targets on them.

A target may imply a receiver. Receivers lie outside the lens and, where it has a cover glass, behind it.
"""

from math import cos, hypot, pi, radians, sin
from typing import Annotated, ClassVar, Literal, TypeVar

from pydantic import Field

from lensforge.errors import InputError
from lensforge.spec.emitter_section import Degrees, Turn
from lensforge.spec.lens_section import AnyLens
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.shape_targets import (
    CrossTarget,
    DiscTarget,
    EllipseTarget,
    FlatTopTarget,
    PolygonTarget,
    RectangleTarget,
    RingTarget,
    SpotsTarget,
)
from lensforge.spec.spec_section import Coordinate, Millimetres, Section, check
from lensforge.spec.target_sections import (
    ArrayTarget,
    BatwingTarget,
    BeamTarget,
    HalfAngle,
    ImageTarget,
    PhotometricTarget,
    TableTarget,
    TextTarget,
    Unit,
)

Target = Annotated[
    FlatTopTarget
    | RectangleTarget
    | DiscTarget
    | EllipseTarget
    | RingTarget
    | PolygonTarget
    | CrossTarget
    | TextTarget
    | ImageTarget
    | ArrayTarget
    | TableTarget
    | SpotsTarget
    | BeamTarget
    | BatwingTarget
    | PhotometricTarget,
    Field(discriminator="kind"),
]
_MOST_TARGETS = 1000


class ReceiverSection(Section):
    """Fields of every receiver; receivers are transparent, each sees every ray that leaves the lens."""

    unit: ClassVar[Unit] = "mm"
    words: ClassVar[str]  # for its place, by its fields

    kind: str
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] | None = None
    """Name of the receiver, by default its kind."""
    targets: Annotated[tuple[Target, ...], Field(min_length=1, max_length=_MOST_TARGETS)]
    """Targets on it, which add up."""
    share: Annotated[float, Field(ge=1e-6, le=1e6)] = 1.0
    """Weight in the merit, relative to the other receivers."""
    rotation_deg: Turn = 0.0
    """Turn about the direction that the receiver faces, from x towards y."""

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the chart, in its unit."""
        raise NotImplementedError

    @property
    def place(self) -> str:
        """Its place in a few words."""
        return self.words.format(self)

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height in the unit in which targets are given."""
        return self.size

    @check
    def _targets_belong_here(self) -> None:
        for target in self.targets:
            if target.unit != self.unit:
                where = "degrees" if self.unit == "deg" else "mm"
                raise ValueError(f"targets: a {target.kind} in {target.unit}, on this receiver lengths are in {where}")
            _require_on_receiver(target, self.extent)


def _require_on_receiver(target: Target, extent: tuple[float, float]) -> None:
    """Raise ``ValueError`` for a target whose centre, or mask, or edge does not fit the receiver."""
    unit, (width, height) = target.unit, extent
    require_on(f"centre_{unit} =", target.centre, unit, extent, "the receiver")
    mask = target.pair("uniform")
    if mask is not None and (mask[0] > width or mask[1] > height) and target.rotation_deg == 0.0:
        given = f"{mask[0]:g}" if mask[0] == mask[1] else f"({mask[0]:g}, {mask[1]:g})"
        raise ValueError(f"uniform_{unit} = {given} must not exceed the receiver's {_words(width, height, unit)}")
    edge = getattr(target, "edge", 0.0)
    if edge > max(width, height):
        raise ValueError(f"edge_{unit} = {edge:g} must not exceed the receiver's {_words(width, height, unit)}")


def require_on(what: str, place: tuple[float, float], unit: Unit, extent: tuple[float, float], receiver: str) -> None:
    """Raise ``ValueError`` for a place off a receiver, whose ``extent`` is in the same unit; ``what``: its words."""
    (x, y), half_width, half_height = place, 0.5 * extent[0], 0.5 * extent[1]
    off = x * x + y * y > half_width**2 if unit == "deg" else abs(x) > half_width or abs(y) > half_height
    if off:
        reach = f"{half_width:g} deg" if unit == "deg" else f"{half_width:g} in x and {half_height:g} in y"
        raise ValueError(f"{what} ({x:g}, {y:g}) is off {receiver}, which reaches {reach}")


def _words(width: float, height: float, unit: str) -> str:
    return f"{width:g} {unit}" if width == height else f"{width:g} x {height:g} {unit}"


_Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Direction = tuple[_Number, _Number, _Number]
_LEAST_ACROSS = 1e-3  # sine of the angle at which a plane may be seen from the lens: 0.06 degrees


class PlaneReceiver(ReceiverSection):
    """A rectangle in a plane in any pose.

    The side that faces the lens receives the light, whichever that is. The plane takes the axes x and y of the lens
    with it: tilted by the smallest rotation, then turned about its normal by ``rotation_deg``.
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

    @check
    def _is_seen_from_the_lens(self) -> None:
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

    @property
    def place(self) -> str:
        """Its place in a few words."""
        if self.centre_mm[:2] == (0.0, 0.0) and self.facing[:2] == (0.0, 0.0):
            return f"at {self.centre_mm[2]:g} mm"
        return f"centred at ({', '.join(f'{value:g}' for value in self.centre_mm)}) mm"


class FarFieldReceiver(ReceiverSection):
    """Intensity by direction, around an axis."""

    unit: ClassVar[Unit] = "deg"
    words: ClassVar[str] = "in the far field, to {0.half_angle_deg:g}°"
    centre_mm: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 0.0)

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

    @check
    def _has_an_axis(self) -> None:
        if not any(self.axis):
            raise ValueError("axis = (0, 0, 0) is no direction")


class _CurvedReceiver(ReceiverSection):
    """A screen around the lens, whose chart is centred on the direction ``facing``."""

    centre_mm: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    """Centre (x, y, z) of the screen's curvature."""
    facing: Direction = (0.0, 0.0, 1.0)
    """Direction (x, y, z) from the centre to the middle of the chart."""
    radius_mm: Millimetres
    """Radius of the screen."""

    @check
    def _faces_somewhere(self) -> None:
        if not any(self.facing):
            raise ValueError("facing = (0, 0, 0) is no direction")


class CylinderReceiver(_CurvedReceiver):
    """A cylindrical screen, unrolled.

    Its axis is the y axis of a frame that faces ``facing``: the lens's own, tilted the shortest way, then turned by
    ``rotation_deg``.
    """

    words: ClassVar[str] = "on a cylinder of radius {0.radius_mm:g} mm"

    kind: Literal["cylinder"] = "cylinder"
    width_mm: Millimetres
    """Width along the arc."""
    height_mm: Millimetres
    """Height along the axis of the cylinder."""

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


class SphereReceiver(_CurvedReceiver):
    """A spherical screen up to ``half_angle_deg`` from the direction that it faces, seen from its centre.

    Charted so that areas are kept: a place lies 2 ``radius_mm`` sin(angle / 2) from the chart's centre.
    """

    words: ClassVar[str] = "on a sphere of radius {0.radius_mm:g} mm"

    kind: Literal["sphere"] = "sphere"
    half_angle_deg: Annotated[float, Field(ge=0.01, le=150.0)]
    """Largest angle from the direction that it faces, seen from its centre."""

    @property
    def size(self) -> tuple[float, float]:
        """Sides of the equal-area chart (mm)."""
        side = 4.0 * self.radius_mm * sin(0.5 * radians(self.half_angle_deg))
        return side, side


AnyReceiver = PlaneReceiver | FarFieldReceiver | CylinderReceiver | SphereReceiver


_Implied = TypeVar("_Implied", PlaneReceiver, FarFieldReceiver)
OF_RECEIVER = ("distance_mm", "receiver_mm", "half_angle_deg")  # fields of a target that stands alone


def implied_receiver(target: Target) -> AnyReceiver:
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


def _with(kind: type[_Implied], target: Target, **place: object) -> _Implied:
    try:
        return kind(name="light", targets=(target,), **place)
    except InputError as error:
        raise ValueError(f"target: {str(error).removeprefix(f'{kind.__name__}: ')}") from None


def named(receivers: tuple[AnyReceiver, ...]) -> tuple[AnyReceiver, ...]:
    """``receivers``, each with a name: its own, or its kind, numbered where several have it.

    Raises ``ValueError`` for two of the same name, and for targets that name a receiver of their own.
    """
    with_names: list[AnyReceiver] = []
    for receiver in receivers:
        for target in receiver.targets:
            own = next((name for name in OF_RECEIVER if getattr(target, name) is not None), None)
            if own is not None:
                words = "a target in [[receivers]] lies on that receiver; leave it out"
                raise ValueError(f"receivers.targets.{own}: {words}")
        alike = [each for each in receivers if each.kind == receiver.kind]
        number = next(k for k, each in enumerate(alike, start=1) if each is receiver)
        name = receiver.name or (receiver.kind if len(alike) == 1 else f"{receiver.kind}_{number}")
        if any(name == each.name for each in with_names):
            raise ValueError(f"receivers: two are called {name!r}; give each a name of its own")
        with_names.append(receiver.model_copy(update={"name": name}))
    return tuple(with_names)


def require_outside(receiver: AnyReceiver, lens: AnyLens, limits: ConstraintsSection, field: str) -> None:
    """Raise ``ValueError`` for a receiver inside the largest lens, or where its light cannot come."""
    by = "constraints.max_radius_mm" + (" with the height of the lens" if lens.radius_about_axis else "")
    match receiver:
        case PlaneReceiver():
            largest = lens.extent_mm(limits, receiver.facing[2] / hypot(*receiver.facing))
            if receiver.distance_mm <= largest:
                raise ValueError(
                    f"{field} = {receiver.distance_mm:g} is inside the lens: it must exceed {by} = {largest:.6g}"
                )
            _require_ahead(receiver.facing, 0.0, receiver.centre_mm[2] < 0.0)
        case FarFieldReceiver():
            _require_ahead(receiver.facing, receiver.half_angle_deg, True)
        case CylinderReceiver() | SphereReceiver():
            room, largest = receiver.radius_mm - hypot(*receiver.centre_mm), lens.extent_mm(limits)
            if room <= largest:
                raise ValueError(
                    f"receivers.radius_mm = {receiver.radius_mm:g}: the {receiver.kind} leaves {room:.4g} mm around "
                    f"the lens origin, it must leave more than {by} = {largest:.6g}"
                )


def _require_ahead(facing: tuple[float, float, float], half_angle_deg: float, behind: bool) -> None:
    """Refuse a receiver that faces away from the half space z > 0, into which a lens sends its light."""
    up = facing[2] / sum(value**2 for value in facing) ** 0.5
    if behind and up <= -cos(radians(90.0 - half_angle_deg)):
        raise ValueError("receivers: it lies behind the source, whose lens sends its light to z > 0; turn or move it")
