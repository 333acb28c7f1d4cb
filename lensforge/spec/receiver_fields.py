"""Fields of every receiver of a spec, and what each of them says of itself: its chart, its place, room for the lens.

A kind of receiver is a class that extends :class:`ReceiverSection`: it registers itself.
"""

from cmath import rect
from math import radians
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

from pydantic import Field

from lensforge.optics.pose import ORIGIN, Pose, Vector
from lensforge.public import public
from lensforge.results.registered_kinds import OfSeveralKinds
from lensforge.spec.emitter_section import Turn
from lensforge.spec.lens_section import LensShape
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import RelativeWeight, Section, check
from lensforge.spec.target_sections import TargetSection, Unit

OF_RECEIVER = ("distance_mm", "receiver_mm", "half_angle_deg")  # fields of a target that stands alone
_MOST_TARGETS = 1000
_SAME = 1e-9  # relative: rounding of a place
_Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Direction = tuple[_Number, _Number, _Number]


@public
class ReceiverSection(OfSeveralKinds, Section):
    """Fields of every receiver; receivers are transparent, each sees every ray that leaves the lens.

    A kind has a chart, of ``size``, whose middle lies at ``centre_mm`` or in the direction ``facing`` from there.
    """

    unit: ClassVar[Unit] = "mm"  # of places on it: of a far field "deg"
    phrase: ClassVar[str]  # for its place, by its fields
    is_round: ClassVar[bool] = False  # it reaches to an angle from its middle
    faces_by: ClassVar[str] = "facing"  # the field of that direction

    if TYPE_CHECKING:  # fields of most kinds; of some they follow from others

        @property
        def centre_mm(self) -> Vector:
            """Middle of the chart, or of its curvature."""

        @property
        def facing(self) -> Direction:
            """Direction of its normal there, away from the lens."""

    kind: str
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] | None = Field(
        default=None, description="Name of the receiver, by default its kind."
    )
    targets: Annotated[tuple[TargetSection, ...], Field(min_length=1, max_length=_MOST_TARGETS)] = Field(
        description="Targets on it, which add up."
    )
    share: RelativeWeight = Field(default=1.0, description="Weight in the merit, relative to the other receivers.")
    rotation_deg: Turn = Field(
        default=0.0, description="Turn about the direction that the receiver faces, from x towards y."
    )

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the chart, in its unit."""
        raise NotImplementedError

    @property
    def place(self) -> str:
        """Its place in a few words."""
        return self.phrase.format(self)

    @property
    def title(self) -> str:
        """Its place in a few words, and its size before it unless that is an angle."""
        width, height = self.size
        size = f"{width:g} mm wide" if width == height else f"{width:g} × {height:g} mm"
        return self.place if self.is_round else f"{size} {self.place}"

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height in the unit in which targets are given."""
        return self.size

    @property
    def is_far_field(self) -> bool:
        """True for light by direction, for which it does not count where a ray starts."""
        return self.unit == "deg"

    def pixel_rad(self, pixels: int) -> float:
        """Angle of a pixel, of so many along the longer side, as seen from the lens where the receiver is nearest."""
        return max(self.size) / pixels / self.clear_mm(ORIGIN)

    def clear_mm(self, place_mm: Vector) -> float:
        """Distance of the receiver from a place on its lit side, where it is nearest."""
        raise NotImplementedError

    @property
    def pose(self) -> Pose:
        """Place of the chart: its middle or that of its curvature, and its axes."""
        return Pose.facing(self.facing, self.centre_mm, self.rotation_deg)

    def posed(self, pose: Pose) -> Self:
        """The receiver in another pose."""
        centre_mm = pose.origin_mm
        facing = pose.axis
        turn_deg = pose.turn_deg
        fields = {"centre_mm": centre_mm, self.faces_by: facing, "tilt_deg": None, "rotation_deg": turn_deg}
        return self.changed(**{name: fields[name] for name in fields if name in type(self).model_fields})

    def require_outside(self, lens: LensShape, limits: ConstraintsSection, distance: str) -> None:
        """Raise ``ValueError`` for a receiver inside the largest lens, or where its light cannot come.

        ``distance``: name of the field that says how far away a plane is.
        """
        room_mm = self.clear_mm(ORIGIN)
        largest_mm = lens.extent_mm(limits)
        radius_mm: float | None = getattr(self, "radius_mm", None)
        field = "receivers" if radius_mm is None else f"receivers.radius_mm = {radius_mm:g}"
        if room_mm <= largest_mm:
            raise ValueError(
                f"{field}: the {self.kind} leaves {room_mm:.4g} mm around the lens origin, it must leave more than "
                f"{largest_of(lens)} = {largest_mm:.6g}"
            )

    @check
    def _faces_somewhere(self) -> None:
        if getattr(self, self.faces_by) == ORIGIN:
            raise ValueError(f"{self.faces_by} = (0, 0, 0) is no direction")

    @check
    def _targets_belong_here(self) -> None:
        for target in self.targets:
            if target.unit != self.unit:
                where = "degrees" if self.unit == "deg" else "mm"
                raise ValueError(f"targets: a {target.kind} in {target.unit}, on this receiver lengths are in {where}")
            _require_on_receiver(target, self.extent)


def _require_on_receiver(target: TargetSection, extent: tuple[float, float]) -> None:
    """Raise ``ValueError`` for a target whose centre, or mask, or edge does not fit the receiver."""
    unit = target.unit
    (width, height) = extent
    require_on(f"centre_{unit} =", target.centre, unit, extent, "the receiver")
    mask = target.pair("uniform")
    if mask is not None and (mask[0] > width or mask[1] > height) and target.rotation_deg == 0.0:
        given = f"{mask[0]:g}" if mask[0] == mask[1] else f"({mask[0]:g}, {mask[1]:g})"
        raise ValueError(f"uniform_{unit} = {given} must not exceed the receiver's {_words(width, height, unit)}")
    if target.edge > max(width, height):
        raise ValueError(f"edge_{unit} = {target.edge:g} must not exceed the receiver's {_words(width, height, unit)}")


def require_target_fits(receiver: ReceiverSection, endless: bool) -> None:
    """Raise ``ValueError`` for a target beyond its receiver.

    ``endless``: of lamps without end, whose pattern goes on beyond a receiver of one period.
    """
    for target in receiver.targets:
        unit = target.unit
        turn = rect(1.0 - _SAME, radians(target.rotation_deg))
        for place in () if endless else target.outline:
            at = complex(*target.centre) + place * turn
            subject = f"target: {target.description}: its edge at"
            require_on(subject, (at.real, at.imag), unit, receiver.extent, "the receiver")


def require_on(
    subject: str, place: tuple[float, float], unit: Unit, extent: tuple[float, float], receiver: str
) -> None:
    """Raise ``ValueError`` for a place off a receiver, whose ``extent`` is in the same unit; ``subject``: its words."""
    (x, y) = place
    half_width = 0.5 * extent[0]
    half_height = 0.5 * extent[1]
    off = x * x + y * y > half_width**2 if unit == "deg" else abs(x) > half_width or abs(y) > half_height
    if off:
        reach = f"{half_width:g} deg" if unit == "deg" else f"{half_width:g} in x and {half_height:g} in y"
        raise ValueError(
            f"{subject} ({x:g}, {y:g}) is off {receiver}, which reaches {reach}; move it, or make {receiver} larger"
        )


def _words(width: float, height: float, unit: str) -> str:
    return f"{width:g} {unit}" if width == height else f"{width:g} x {height:g} {unit}"


def named(receivers: tuple[ReceiverSection, ...]) -> tuple[ReceiverSection, ...]:
    """``receivers``, each with a name: its own, or its kind, numbered where several have it.

    Raises ``ValueError`` for two of the same name, and for targets that name a receiver of their own.
    """
    with_names: list[ReceiverSection] = []
    for receiver in receivers:
        for target in receiver.targets:
            field = next((name for name in OF_RECEIVER if getattr(target, name) is not None), None)
            if field is not None:
                advice = "a target in [[receivers]] lies on that receiver; leave it out"
                raise ValueError(f"receivers.targets.{field}: {advice}")
        alike = [candidate for candidate in receivers if candidate.kind == receiver.kind]
        number = next(k for k, candidate in enumerate(alike, start=1) if candidate is receiver)
        name = receiver.name or (receiver.kind if len(alike) == 1 else f"{receiver.kind}_{number}")
        if any(name == receiver.name for receiver in with_names):
            raise ValueError(f"receivers: two are called {name!r}; give each a name of its own")
        with_names.append(receiver.changed(name=name))
    return tuple(with_names)


def largest_of(lens: LensShape) -> str:
    """Fields that bound the largest lens."""
    return "constraints.max_radius_mm" + (" with the height of the lens" if lens.radius_about_axis else "")


Receivers = Annotated[tuple[ReceiverSection, ...], Field(max_length=16)]
