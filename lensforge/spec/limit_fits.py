"""Limits on light against the receivers that they are on: their units, and places off the receiver."""

from lensforge.spec.light_limits import (
    OF_FAR_FIELD,
    BeamAngleLimit,
    GlareLimit,
    LimitSection,
    LineLimit,
    PointsLimit,
    ZoneLimit,
)
from lensforge.spec.target import Unit


def require_limit_fits(limit: LimitSection, unit: Unit, extent: tuple[float, float], receiver: str) -> None:
    """Raise ``ValueError`` for units that ``receiver`` does not have, or places off it.

    ``unit``, ``extent``: of its places.
    """
    far_field = unit == "deg"
    if isinstance(limit, GlareLimit | BeamAngleLimit) and not far_field:
        raise ValueError(f"a {limit.kind} limit is one of the far field, {receiver} is none; name a receiver that is")
    if limit.unit is not None and limit.unit != unit:
        words = "degrees" if far_field else "mm"
        raise ValueError(f"its places are in {limit.unit}, on {receiver} they are in {words}")
    light = limit.light_unit
    if light not in (None, "relative") and (light in OF_FAR_FIELD) != far_field:
        allowed = "w_per_sr, cd" if far_field else "w_per_m2, lx"
        raise ValueError(f"its light is in {light}, on {receiver} it is in one of {allowed}, relative")
    for x, y in _places(limit):
        off = (
            x * x + y * y > 0.25 * extent[0] ** 2 if far_field else abs(x) > 0.5 * extent[0] or abs(y) > 0.5 * extent[1]
        )
        if off:
            reach = (
                f"{0.5 * extent[0]:g} {unit}" if far_field else f"{0.5 * extent[0]:g} in x and {0.5 * extent[1]:g} in y"
            )
            raise ValueError(f"the place ({x:g}, {y:g}) is off {receiver}, which reaches {reach}")


def _places(limit: LimitSection) -> tuple[tuple[float, float], ...]:
    match limit:
        case PointsLimit():
            return limit.points
        case LineLimit():
            return limit.ends
        case ZoneLimit(zone=zone) if zone is not None:
            return (zone.centre,)
        case GlareLimit():
            return ((limit.from_deg, 0.0),)
    return ()
