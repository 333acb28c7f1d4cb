"""The section of a lens with walls that sends light of a point to wanted angles: where a search of such a lens begins.

With t(a) the unit vector at the angle a from z, a ray leaves the point along t(theta) and is to go on in the body along
t(psi), to a plane exit. Cap and walls follow from their normals (tailoring):

    cap:   ln(rho)' = n sin(theta - psi) / (n cos(theta - psi) - 1),
    wall:  N . (s + L w)' = 0,  N = t(psi) - w,

where the light meets the side of the cavity in s, and goes on along w for the length L. Both are linear, and known by
sums over the angle. The left half is that of the mirrored light.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.surfaces.collimator import BEYOND_RAD, ROOM, through_side, towards
from lensforge.surfaces.drawn_profile import DrawnPart

_STEPS = 1600  # of an angle, from the axis to a little below the horizon
_ANGLES = np.linspace(0.0, 0.5 * np.pi + BEYOND_RAD, _STEPS + 1)
_TRIED = 12  # values of cavity and cap in a scan
_ROUNDS = 3  # scans, each closer than the one before
_TALLEST_CAP = 4.0  # over the radius of the cavity
_STEEPEST = 0.98  # of the cosine by which a cap can turn light at all
_SPARE_RAD = 0.02  # from total reflection
_HALVES = 1.0, -1.0

_Angles = Float[np.ndarray, " n"]
_Points = Float[np.ndarray, "n 2"]
Turned = Callable[[_Angles], _Angles]  # wanted angles (rad) from z by those at which light leaves the source


class SectionRoom(NamedTuple):
    """Lengths (mm) that a section is to keep: half width, height, least wall, and half width clear of the source."""

    half_mm: float
    height_mm: float
    wall_mm: float
    clear_mm: float


class WantedLight(NamedTuple):
    """Light to be sent: wanted angles, width (mm) of the source, and half width (sine) of all that is wanted."""

    turned: Turned
    width_mm: float
    half_sine: float


@dataclass(frozen=True)
class HalfSection:
    """The half of a section on the side of positive x: ``psi_rad`` are angles in the body at ``_ANGLES``.

    ``cavity_mm``: half width of the cavity at z = 0; ``cap_mm``: its height on the axis.
    """

    index: float
    draft_rad: float
    cavity_mm: float
    cap_mm: float
    psi_rad: _Angles

    @cached_property
    def cap(self) -> _Angles:
        """Distances (mm) of the cap; it goes on straight where it could turn light no more."""
        turn = self.psi_rad - _ANGLES
        most = np.arccos(1.0 / (_STEEPEST * self.index))
        turn = np.clip(turn, -most, most)
        slope = -self.index * np.sin(turn) / (self.index * np.cos(turn) - 1.0)
        return self.cap_mm * np.exp(_summed(slope))

    @cached_property
    def side(self) -> _Angles:
        """Distances (mm) of the side; infinite near the axis."""
        across = np.cos(self.draft_rad) * np.sin(_ANGLES) + np.sin(self.draft_rad) * np.cos(_ANGLES)
        return self.cavity_mm * np.cos(self.draft_rad) / np.maximum(across, 1e-9)

    @cached_property
    def crease(self) -> int:
        """Number of the first angle at which the side is nearer than the cap."""
        return int(np.argmax(self.side <= self.cap))

    @property
    def first_of_wall(self) -> int:
        """Number of the angle from which on the wall is told, a little above its rim."""
        return max(0, self.crease - int(BEYOND_RAD / _ANGLES[1]))

    @cached_property
    def _wall(self) -> "_WallSums":
        """The wall by sums; its light is turned no farther than it reflects totally."""
        starts, ways, _, _ = through_side(_ANGLES, self.index, self.cavity_mm, self.draft_rad)
        off = np.arctan2(ways[:, 0], ways[:, 1])
        least = off - 2.0 * np.arccos(1.0 / self.index) + _SPARE_RAD
        normals = towards(np.maximum(self.psi_rad, least)) - ways
        facing = (normals * ways).sum(axis=1)
        by_length = -(normals * np.gradient(ways, _ANGLES, axis=0)).sum(axis=1) / facing
        by_start = -(normals * np.gradient(starts, _ANGLES, axis=0)).sum(axis=1) / facing
        growth = np.exp(_summed(by_length))
        return _WallSums(starts, ways, growth, _summed(by_start / growth))

    def highest_mm(self, half_mm: float) -> float:
        """Height at which the light through the crease meets a wall whose rim is at ``half_mm``."""
        start = self._wall.starts[self.crease]
        way = self._wall.ways[self.crease]
        return float(start[1] + (half_mm - start[0]) * way[1] / way[0])

    def wall(self, height_mm: float) -> _Points:
        """Points (x, z) of the wall that reflect light of each angle; its rim is at ``height_mm``."""
        starts, ways, growth, added = self._wall
        k = self.crease
        rim = (height_mm - starts[k, 1]) / ways[k, 1]
        lengths = growth * (rim / growth[k] + added - added[k])
        return starts + lengths[:, None] * ways

    def widths(self, height_mm: float) -> _Angles:
        """x (mm) at which light of each angle leaves cap or wall."""
        of_cap = self.cap * np.sin(_ANGLES)
        return np.where(np.arange(len(_ANGLES)) < self.crease, of_cap, self.wall(height_mm)[:, 0])


class _WallSums(NamedTuple):
    """Points where light meets the side, its ways behind it, and growth and addition of its length to the wall."""

    starts: _Points
    ways: _Points
    growth: _Angles
    added: _Angles


def _summed(slope: _Angles) -> _Angles:
    """Sums of a slope over ``_ANGLES``."""
    step = _ANGLES[1]
    return np.concatenate([[0.0], np.cumsum(0.5 * step * (slope[1:] + slope[:-1]))])


@dataclass(frozen=True)
class DrawnCollimator:
    """A section of two ``halves``, right and left, below a plane exit. Raises :class:`InputError` for no ``room``."""

    halves: tuple[HalfSection, HalfSection]
    room: SectionRoom

    def __post_init__(self) -> None:
        walls = [half.wall(self.height_mm) for half in self.halves]
        horizon = int(np.searchsorted(_ANGLES, 0.5 * np.pi))
        thinnest = min(
            float((wall[half.crease : horizon, 0] - half.cavity_mm).min())
            for wall, half in zip(walls, self.halves, strict=True)
        )
        above = self.height_mm - max(
            float((half.cap * np.cos(_ANGLES))[: half.crease + 1].max()) for half in self.halves
        )
        if min(half.crease for half in self.halves) == 0 or not min(thinnest, above) >= self.room.wall_mm:
            raise InputError(
                f"collimator: half width = {self.room.half_mm:g} mm leaves {thinnest:.3g} mm of wall at the base and "
                f"{above:.3g} mm above the cap, at least {self.room.wall_mm:g}; raise constraints.max_radius_mm, or "
                "take a smaller source"
            )
        if not self.height_mm <= self.room.height_mm:
            raise InputError(
                f"collimator: {self.height_mm:.4g} mm high, at most {self.room.height_mm:g}; take a smaller radius or "
                "source"
            )

    @cached_property
    def height_mm(self) -> float:
        """Height of the exit, at which both walls are within the half width."""
        return min(half.highest_mm(self.room.half_mm) for half in self.halves)

    def share(self, light: WantedLight) -> float:
        """Share of a Lambertian source that goes to where it is wanted, at first order in its width."""
        within = 0.5 * np.pi >= _ANGLES
        angles = _ANGLES[within]
        total = 0.0
        for half in self.halves:
            widening = np.abs(np.gradient(half.widths(self.height_mm)[within], angles))
            kept = np.minimum(np.cos(angles), 2.0 * light.half_sine * widening / light.width_mm)
            total += 0.5 * float(np.trapezoid(kept, angles))
        return total

    def drawn_faces(self, count: int) -> Iterator[tuple[str, DrawnPart]]:
        """The faces by name, of ``count`` coefficients."""
        inner_mm = ROOM * max(float(half.cap[: half.crease + 1].max()) for half in self.halves)
        outer_mm = ROOM * float(np.hypot(self.room.half_mm, self.height_mm))
        level = self.height_mm / np.cos(_ANGLES[:-1])
        parts = {
            "cap": (inner_mm, [half.cap[:, None] * towards(_ANGLES) for half in self.halves]),
            "side": (inner_mm, [half.side[:, None] * towards(_ANGLES) for half in self.halves]),
            "wall": (outer_mm, [half.wall(self.height_mm)[half.first_of_wall :] for half in self.halves]),
            "exit": (outer_mm, [level[:, None] * towards(_ANGLES[:-1])] * 2),
        }
        for name, (reach_mm, halves) in parts.items():
            points = np.concatenate([half * (side, 1.0) for half, side in zip(halves, _HALVES, strict=True)])
            near = np.hypot(*points.T) < reach_mm
            yield name, DrawnPart.through(points[near], reach_mm, count)


def best_drawn_collimator(
    index: float, light: WantedLight, room: SectionRoom, draft_rad: float = 0.035
) -> DrawnCollimator:
    """The section that sends the most light to where it is wanted, at first order.

    Width of the cavity and height of its cap are found by a scan. Raises :class:`InputError` if none has ``room``.
    """
    angles = [np.clip(side * light.turned(side * np.minimum(_ANGLES, 0.5 * np.pi)), -1.5, 1.5) for side in _HALVES]
    bodies = [np.arcsin(np.sin(outside) / index) for outside in angles]

    def section(cavity_mm: float, cap_mm: float) -> DrawnCollimator:
        right, left = (HalfSection(index, draft_rad, cavity_mm, cap_mm, psi) for psi in bodies)
        return DrawnCollimator((right, left), room)

    least = room.clear_mm
    best = section(least, 1.5 * least)
    most = best.share(light)
    low = np.array([least, least])
    high = np.array([0.6 * room.half_mm, _TALLEST_CAP * room.half_mm])
    for _ in range(_ROUNDS):
        for cavity_mm, cap_mm in product(*np.geomspace(low, high, _TRIED).T.tolist()):
            try:
                candidate = section(cavity_mm, cap_mm)
            except InputError:
                continue
            share = candidate.share(light)
            if share > most:
                best = candidate
                most = share
        optimum = np.array([best.halves[0].cavity_mm, best.halves[0].cap_mm])
        step = (high / low) ** (1.5 / _TRIED)
        low = np.maximum(optimum / step, least)
        high = optimum * step
    return best
