"""Stands of lamps: the place of each, where it is aimed, and how it is turned."""

from math import atan2, degrees, hypot
from typing import NamedTuple

Vector = tuple[float, float, float]
ALONG_Z: Vector = (0.0, 0.0, 1.0)


class Stand(NamedTuple):
    """Stand of a lamp: the place (mm) of its origin, the direction of its axis, and its turn (degrees).

    It is turned about z, from x towards y, and then tilted the shortest way.
    """

    place_mm: Vector = (0.0, 0.0, 0.0)
    axis: Vector = ALONG_Z
    turn_deg: float = 0.0


_SAME = 1e-9  # relative: an axis as near to z is along it


def aimed_from(place_mm: Vector, aim_mm: Vector) -> tuple[Vector, float]:
    """Unit vector from a place to its aim, and the azimuth (degrees) of the side to which that is tilted, 0 along z."""
    x, y, z = (to - start for start, to in zip(place_mm, aim_mm, strict=True))
    length = hypot(x, y, z)
    if hypot(x, y) <= _SAME * length:
        return (0.0, 0.0, 1.0 if z > 0.0 else -1.0), 0.0
    return (x / length, y / length, z / length), degrees(atan2(y, x))
