"""Places of lamps: place, aim and turn of each; and kinds of lens by place: in the middle, at the rim, at its corners.

A lamp at the rim is turned to face outwards, with its LED and lens, and its lens is its own mirror image: about its x
axis along a side, about the diagonal at the corner of a grid. So the mirror image of a place takes the same moulded
lens, only turned; no lens is made left-handed and right-handed.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import atan2, degrees, hypot, inf
from typing import NamedTuple

from lensforge.optics.pose import ALONG_Z, ORIGIN, Pose, Vector


class Lamp(NamedTuple):
    """A lamp as it is stated: the place (mm) of its origin, the direction of its axis, and its turn (degrees)."""

    place_mm: Vector = ORIGIN
    axis: Vector = ALONG_Z
    turn_deg: float = 0.0

    @property
    def pose(self) -> Pose:
        """Place of the lamp, its axes turned and tilted."""
        return Pose.facing(self.axis, self.place_mm, self.turn_deg)


_SAME = 1e-9  # relative: an axis as near to z is along it


def aimed_from(place_mm: Vector, aim_mm: Vector) -> tuple[Vector, float]:
    """Unit vector from a place to its aim, and the azimuth (degrees) of the side to which that is tilted, 0 along z."""
    x, y, z = (to - start for start, to in zip(place_mm, aim_mm, strict=True))
    length = hypot(x, y, z)
    if hypot(x, y) <= _SAME * length:
        return (0.0, 0.0, 1.0 if z > 0.0 else -1.0), 0.0
    return (x / length, y / length, z / length), degrees(atan2(y, x))


MIDDLE = "middle"
EDGE = "edge"
CORNER = "corner"
_ALONG_X = "mirror_y"
_DIAGONAL = "diagonal"
_AXIS_DEG = {_ALONG_X: 0.0, _DIAGONAL: 45.0}  # of the mirror, in the frame of the lamp

KindOfPlace = tuple[str, float, str]  # name of the kind, turn (degrees) of the lamp, and the mirror of its lens


@dataclass(frozen=True)
class LampKind:
    """The lamps that have one lens, by their numbers; ``mirrors``: a group that it keeps, "" for that of the scene."""

    name: str
    numbers: tuple[int, ...]
    mirrors: str = ""

    def symmetry(self, of_all: str) -> str:
        """Mirror group of the lens, where the light of all lamps has the group ``of_all``."""
        return "none" if of_all == "none" else self.mirrors or of_all

    def mirrored_deg(self, turn_deg: float, mirror_deg: float) -> float:
        """Turn of the lens whose light is the mirror image, about an axis at ``mirror_deg``, of one with a turn."""
        return 2.0 * mirror_deg - turn_deg - 2.0 * _AXIS_DEG.get(self.mirrors, mirror_deg)


def kinds_of(
    places: Sequence[tuple[float, float]], names: Sequence[str], mirrors: Iterable[str]
) -> tuple[LampKind, ...]:
    """The kinds of lamps with these places (mm), names and mirrors; the one nearest to the origin comes first."""
    mirror_of = dict(zip(names, mirrors, strict=True))
    nearest = dict.fromkeys(names, inf)
    for place, name in zip(places, names, strict=bool(names)):
        nearest[name] = min(nearest[name], round(hypot(*place), 6))
    ordered = sorted(nearest, key=lambda name: nearest[name])
    numbers = {name: tuple(k for k, lamp_kind in enumerate(names) if lamp_kind == name) for name in ordered}
    return tuple(LampKind(name, numbers[name], mirror_of[name]) for name in ordered)


def in_grid(column: int, row: int, columns: int, rows: int, rings: int) -> KindOfPlace:
    """The kind of a place in a grid, whose outermost ``rings`` have their own; a single row has ends, and no sides."""
    from_x, from_y = _from_rim(column, columns), _from_rim(row, rows)
    right = 2 * column >= columns
    up = 2 * row >= rows
    ring = min(from_x, from_y)
    if ring >= rings:
        return MIDDLE, 0.0, ""
    if from_x == from_y:
        turn = {(True, True): 0.0, (False, True): 90.0, (False, False): 180.0, (True, False): 270.0}[right, up]
        return _name(CORNER, int(ring)), turn, _DIAGONAL
    turn = (0.0 if right else 180.0) if from_x < from_y else (90.0 if up else 270.0)
    return _name(EDGE, int(ring)), turn, _ALONG_X


def _from_rim(number: int, count: int) -> float:
    return min(number, count - 1 - number) if count > 1 else inf


def in_hexagon(i: int, j: int, outermost: int, rings: int) -> KindOfPlace:
    """The kind of the place ``i`` steps along x and ``j`` at 60 degrees to it, in a hexagon with so many rings."""
    around = max(abs(i), abs(j), abs(i + j))
    if outermost - around >= rings or around == 0:
        return MIDDLE, 0.0, ""
    azimuth = degrees(atan2(j * 3.0**0.5 / 2.0, i + 0.5 * j)) % 360.0
    if 0 in (i, j, i + j):
        return _name(CORNER, outermost - around), 60.0 * round(azimuth / 60.0) % 360.0, _ALONG_X
    return _name(EDGE, outermost - around), 60.0 * (azimuth // 60.0) + 30.0, _ALONG_X


def _name(place: str, ring: int) -> str:
    """Name of a kind at the rim, or in a ring within it: those are counted from 2 on."""
    return place if ring == 0 else f"{place}_{ring + 1}"
