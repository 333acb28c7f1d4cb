"""Receivers of a spec as a whole: the one that a target implies, and where receivers may not be."""

from math import cos, radians
from typing import TypeVar

from lensforge.errors import InputError
from lensforge.spec.receiver_section import Target
from lensforge.spec.receivers import (
    AnyReceiver,
    CylinderReceiver,
    FarFieldReceiver,
    PlaneReceiver,
    SphereReceiver,
)
from lensforge.spec.search import ConstraintsSection

_Implied = TypeVar("_Implied", PlaneReceiver, FarFieldReceiver)
_OF_RECEIVER = ("distance_mm", "receiver_mm", "half_angle_deg")  # fields of a target that stands alone


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
    found: list[AnyReceiver] = []
    for receiver in receivers:
        for target in receiver.targets:
            own = next((name for name in _OF_RECEIVER if getattr(target, name) is not None), None)
            if own is not None:
                words = "a target in [[receivers]] lies on that receiver; leave it out"
                raise ValueError(f"receivers.targets.{own}: {words}")
        alike = [each for each in receivers if each.kind == receiver.kind]
        number = next(k for k, each in enumerate(alike, start=1) if each is receiver)
        name = receiver.name or (receiver.kind if len(alike) == 1 else f"{receiver.kind}_{number}")
        if any(name == each.name for each in found):
            raise ValueError(f"receivers: two are called {name!r}; give each a name of its own")
        found.append(receiver.model_copy(update={"name": name}))
    return tuple(found)


def require_outside(receiver: AnyReceiver, limits: ConstraintsSection, field: str) -> None:
    """Raise ``ValueError`` for a receiver inside the largest lens, or where its light cannot come."""
    largest = limits.max_radius_mm
    match receiver:
        case PlaneReceiver():
            if receiver.distance_mm <= largest:
                raise ValueError(
                    f"{field} = {receiver.distance_mm:g} is inside the lens: it must exceed constraints.max_radius_mm "
                    f"= {largest:g}"
                )
            _require_ahead(receiver.facing, 0.0, receiver.centre_mm[2] < 0.0)
        case FarFieldReceiver():
            _require_ahead(receiver.facing, receiver.half_angle_deg, True)
        case CylinderReceiver() | SphereReceiver():
            room = receiver.radius_mm - sum(value**2 for value in receiver.centre_mm) ** 0.5
            if room <= largest:
                raise ValueError(
                    f"receivers.radius_mm = {receiver.radius_mm:g}: the {receiver.kind} leaves {room:.4g} mm around "
                    f"the lens origin, it must leave more than constraints.max_radius_mm = {largest:g}"
                )


def _require_ahead(facing: tuple[float, float, float], half_angle_deg: float, behind: bool) -> None:
    """Refuse a receiver that faces away from the half space z > 0, into which a lens sends its light."""
    up = facing[2] / sum(value**2 for value in facing) ** 0.5
    if behind and up <= -cos(radians(90.0 - half_angle_deg)):
        raise ValueError("receivers: it lies behind the source, whose lens sends its light to z > 0; turn or move it")
