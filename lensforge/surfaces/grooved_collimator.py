"""The thin lens for total internal reflection, whose exit is a lens within a ring: where a search may begin.

The cap does a share of the turn of the inner light, the lens above it the rest; ring and wall send the outer light
along the axis. Between lens and ring lies a groove that no light meets. As the lens need not be lower than the ring,
both reach the same height, and the cap may be nearer to the source than where one refraction turns all light.

With t(a) the unit vector at the angle a from the axis, light that leaves a point along t(a) goes on in the body along
t((1 - s) a) if the cap is normal to n t((1 - s) a) - t(a) throughout, whence

    rho(a) = cap ((n - 1) / (n cos(s a) - 1))^(1/s),

the hyperboloid of ``surfaces.collimator`` for s = 1. The lens and the wall follow by equal optical paths.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.dielectric import fresnel_transmittances
from lensforge.surfaces.collimator import (
    BEYOND_RAD,
    COEFFICIENTS,
    ROOM,
    LeavingLight,
    SideCrossing,
    share_within,
    through_side,
    towards,
)
from lensforge.surfaces.grooved_face import GroovedFace
from lensforge.surfaces.profile import ProfileFace
from lensforge.surfaces.reciprocal import ConeFace, ReciprocalSurface

_Angles = Float[np.ndarray, " n"]
_Meridian = Float[np.ndarray, "n 2"]  # r and z

_RAYS = 96  # of each path of the estimated share
_GAP = 0.4  # of the side of the source: between the light of lens and ring, where they leave
_STEP = 0.3  # of the side: height of the edge of the light of the lens over the ring, so that the groove lies beyond
_STARTS = (
    (0.3, 0.42, 0.52),
    (0.34, 0.46),
    (0.4, 0.55),
)  # cavity and cap over the height, and the cap's share of the turn
_SLOPE = 0.4  # of the ring, at first
# Light of a source of finite size that the first order does not know as lost, over (side / cavity)^2. Traced, 24 lenses
# of 8.6 and 9 mm around a chip of 1 mm lose 0.13 to 0.35 of it; with 0.25 to 0.8 the best lens is nearly the same.
_SECOND_ORDER = 0.4
_STEPS = 160  # of a simplex
_CLOSE = 1e-4  # share by which it still moves
_DEAR = 10.0  # share that a length costs which a lens lacks, over its height
_LACKING = 1e-3  # of its height
_REFUSED = 10.0
_LEAST = (0.05, 0.05, 0.1, 0.0)  # of cavity and cap over the height, of the cap's share of the turn, and of the slope
_MOST = (0.9, 0.9, 0.9, 1.0)
OF_BEST = 0.98  # of the most light, that a lens as low as possible has
_LOWER = 0.96  # from one height to the next


class _Path(NamedTuple):
    """Light from these angles, the points (r, z) at which it leaves, and the share that faces let through."""

    polar_rad: _Angles
    exits: _Meridian
    passed: _Angles


@dataclass(frozen=True)
class GroovedCollimator:
    """A lens of ``index`` and ``height_mm``, to which exit and rim reach; the source is at the origin, in air.

    ``cavity_mm``: radius of the cavity at z = 0. ``cap_mm``: height of its cap on the axis. ``turn``: share of the turn
    that the cap does. ``slope``: of the ring, a cone that rises outwards. ``draft_rad``: angle by which the side closes
    upwards. ``mirrored``: the wall reflects at every angle. :attr:`least_mm` tells if such a lens can be made.
    """

    index: float
    height_mm: float
    cavity_mm: float
    cap_mm: float
    turn: float
    slope: float
    draft_rad: float = 0.035
    mirrored: bool = False

    @cached_property
    def crease_rad(self) -> float:
        """Angle from the axis at which cap and side meet."""
        from scipy.optimize import brentq

        def beyond_side(polar_rad: float) -> float:
            along = np.sin(polar_rad) + np.tan(self.draft_rad) * np.cos(polar_rad)
            return float(self._cap_distance(polar_rad) * along) - self.cavity_mm

        most = min(0.5 * np.pi, float(np.arccos(1.0 / self.index)) / self.turn) - 1e-6
        if beyond_side(0.0) >= 0.0:
            return 0.0
        return float(brentq(beyond_side, 0.0, most, xtol=1e-14)) if beyond_side(most) > 0.0 else most

    @cached_property
    def radius_mm(self) -> float:
        """Radius of the rim, at which light through the crease meets the wall."""
        side = self._at_side(np.array([self.crease_rad]))
        (r, z), (across, up) = side.points[0], side.ways[0]
        return float(r + (self.height_mm - z) / up * across)

    @cached_property
    def least_mm(self) -> dict[str, float]:
        """Lengths (mm) of which none may be negative in a lens that can be made.

        ``wall``: least thickness, between cap and lens and at the base; ``gap``: between the light of lens and ring;
        ``step``: height of the lens over the ring where the light of the lens ends.
        """
        inner, outer = self._paths
        edge = inner.exits[-1]
        crease = self._cap(inner.polar_rad)
        walls = np.hypot(*(inner.exits - crease).T).min(), self._wall(outer.polar_rad[-1:])[0, 0] - self.cavity_mm
        step = edge[1] - self._ring_height(edge[:1])[0]
        gap = outer.exits[:, 0].min() - inner.exits[:, 0].max()
        return {"wall": float(min(walls)), "gap": float(gap), "step": float(step)}

    def share(self, half_angle_rad: float, side_mm: float) -> float:
        """Share of the light of a square Lambertian source within a half angle of the axis, at first order.

        What faces reflect is left out, and what the wall lets through.
        """
        mapped = (LeavingLight(path.polar_rad, path.exits[:, 0], path.passed) for path in self._paths)
        return share_within(mapped, half_angle_rad, side_mm)

    def faces(self, groove_mm: float) -> dict[str, ReciprocalSurface]:
        """The faces by name: ``cap``, ``side``, ``wall`` and ``exit``, whose groove has a meridian of that radius (mm).

        Raises :class:`InputError` if lens and ring do not meet in a groove.
        """
        inner = self._paths[0].exits
        crease = self._cap(np.array([self.crease_rad]))[0]
        cavity = ROOM * max(float(np.hypot(*crease)), self.cap_mm)
        reach = ROOM * float(np.hypot(self.radius_mm, self.height_mm))
        cap = self._cap(np.linspace(0.0, self.crease_rad + BEYOND_RAD, 8 * _RAYS))
        wall = self._wall(np.linspace(self.crease_rad - BEYOND_RAD, 0.5 * np.pi + BEYOND_RAD, 8 * _RAYS))
        lens = np.vstack([[[0.0, self.height_mm]], inner])
        radii = np.linspace(0.5 * inner[-1, 0], ROOM * self.radius_mm, 8 * _RAYS)
        ring = np.column_stack([radii, self._ring_height(radii)])
        return {
            "cap": _through(cap, cavity),
            "side": ConeFace(cavity, self.cavity_mm, -float(np.tan(self.draft_rad))),
            "wall": _through(wall, reach),
            "exit": GroovedFace.of(reach, _through(lens, reach), _through(ring, reach), groove_mm),
        }

    @cached_property
    def _paths(self) -> tuple[_Path, _Path]:
        """Light through the cap, and through the side."""
        polar = np.linspace(1e-3, self.crease_rad, _RAYS)
        lens = self._lens(polar)
        through_lens = self._passing(self.turn * polar) * self._passing((1.0 - self.turn) * polar)
        side = self._at_side(self._outer_rays)
        wall = self._wall(self._outer_rays)
        up, upright = self._to_ring
        heights = (self._ring_height(wall[:, 0]) - wall[:, 1]) / (up[1] - self.slope * up[0])
        ring = wall + heights[:, None] * up
        through_ring = self._transmitted(side.cosines) * self._transmitted(np.array([upright]))
        reflects = self.mirrored | (self.index * np.sqrt(0.5 + 0.5 * side.ways @ up) > 1.0)
        return _Path(polar, lens, through_lens), _Path(self._outer_rays, ring, through_ring * reflects)

    @cached_property
    def _outer_rays(self) -> _Angles:
        return np.linspace(self.crease_rad, 0.5 * np.pi, _RAYS)

    @cached_property
    def _to_ring(self) -> tuple[Float[np.ndarray, "2"], float]:
        """Direction (r, z) in the body of light that the ring sends along the axis, and its cosine in air."""
        normal = np.array([-self.slope, 1.0]) / np.hypot(self.slope, 1.0)
        across = (np.array([0.0, 1.0]) - normal[1] * normal) / self.index
        return across + np.sqrt(1.0 - across @ across) * normal, float(normal[1])

    def _ring_height(self, radii: _Angles) -> _Angles:
        return self.height_mm + self.slope * (radii - self.radius_mm)

    def _cap(self, polar_rad: _Angles) -> _Meridian:
        return self._cap_distance(polar_rad)[:, None] * towards(polar_rad)

    def _cap_distance(self, polar_rad: Any) -> Any:
        turns = self.index * np.cos(self.turn * polar_rad) - 1.0
        return self.cap_mm * ((self.index - 1.0) / turns) ** (1.0 / self.turn)

    def _lens(self, polar_rad: _Angles) -> _Meridian:
        """Points of the lens over the cap at which light emitted at these angles leaves: all its paths are as long."""
        points = self._cap(polar_rad)
        ways = towards((1.0 - self.turn) * polar_rad)
        on_axis = self.cap_mm + self.index * (self.height_mm - self.cap_mm) - self.height_mm
        lengths = (on_axis - np.hypot(*points.T) + points[:, 1]) / (self.index - ways[:, 1])
        return points + lengths[:, None] * ways

    def _at_side(self, polar_rad: _Angles) -> SideCrossing:
        return through_side(polar_rad, self.index, self.cavity_mm, self.draft_rad)

    def _wall(self, polar_rad: _Angles) -> _Meridian:
        """Points of the wall that reflect light emitted at these angles: all their paths to the ring are as long."""
        points, ways, reached, _ = self._at_side(np.append(polar_rad, self.crease_rad))
        up = self._to_ring[0]
        rim = np.array([self.radius_mm, self.height_mm])
        paths = reached - self.index * (points - rim) @ up
        to_rim = paths[-1] + self.index * float(np.hypot(*(rim - points[-1]))) * (1.0 - ways[-1] @ up)
        lengths = (to_rim - paths) / (self.index * (1.0 - ways @ up))
        return (points + lengths[:, None] * ways)[:-1]

    def _passing(self, turns_rad: _Angles) -> _Angles:
        """Share that a face lets through which turns light by these angles, into the body or out of it."""
        along = self.index * np.cos(turns_rad) - 1.0
        return self._transmitted(along / np.sqrt(self.index**2 + 1.0 - 2.0 * self.index * np.cos(turns_rad)))

    def _transmitted(self, cosines: _Angles) -> _Angles:
        """Share of unpolarised light let through, by the cosines of its angles in air."""
        across, in_plane, _ = fresnel_transmittances(np.maximum(cosines, 1e-6), 1.0 / self.index)
        return 0.5 * (across + in_plane)


class ThinRoom(NamedTuple):
    """Lengths (mm) that a thin lens keeps: largest height, radius of its rim, least wall, and distance from the LED."""

    height_mm: float
    radius_mm: float
    wall_mm: float
    clear_mm: float


@dataclass(frozen=True)
class _Choice:
    """Choice of the thin lens of an ``index`` with the most light of a square source within a half angle, in a room.

    Its numbers: cavity and cap over the height, the cap's share of the turn, and the slope of the ring.
    """

    index: float
    room: ThinRoom
    side_mm: float
    half_angle_rad: float
    draft_rad: float
    mirrored: bool

    def lens_of(self, numbers: Float[np.ndarray, "4"]) -> GroovedCollimator:
        """The lens of these numbers."""
        cavity, cap, turn, slope = numbers.tolist()
        height = self.room.height_mm
        return GroovedCollimator(
            self.index, height, cavity * height, cap * height, turn, slope, self.draft_rad, self.mirrored
        )

    def share(self, numbers: Float[np.ndarray, "4"]) -> float:
        """Light of the lens; 0 for one that lacks room."""
        lens = self.lens_of(numbers)
        return 0.0 if self.lacks(lens) > _LACKING else self._light_of(lens)

    def _light_of(self, lens: GroovedCollimator) -> float:
        """Share of the light at first order, less what a source of its size loses at second order."""
        return lens.share(self.half_angle_rad, self.side_mm) - _SECOND_ORDER * (self.side_mm / lens.cavity_mm) ** 2

    def lacks(self, lens: GroovedCollimator) -> float:
        """Lengths that it lacks, over its height."""
        room = self.room
        lengths = lens.least_mm
        spare_mm = (
            lengths["wall"] - room.wall_mm,
            lengths["gap"] - _GAP * self.side_mm,
            lengths["step"] - _STEP * self.side_mm,
            min(lens.cavity_mm, lens.cap_mm) - room.clear_mm,
            room.radius_mm - lens.radius_mm,
        )
        return -sum(min(0.0, length_mm) for length_mm in spare_mm) / room.height_mm

    def best(self, starts: Iterable[Sequence[float]]) -> Float[np.ndarray, "4"]:
        """Numbers of the best lens near any of ``starts``, by the simplex of Nelder and Mead."""
        from scipy.optimize import minimize

        options = {"maxiter": _STEPS, "fatol": _CLOSE}
        ends = [minimize(self._cost, start, method="Nelder-Mead", options=options) for start in starts]
        return min(ends, key=lambda end: float(end.fun)).x

    def _cost(self, numbers: Float[np.ndarray, "4"]) -> float:
        if not ((numbers > _LEAST).all() and (numbers < _MOST).all()):
            return _REFUSED
        lens = self.lens_of(numbers)
        return _DEAR * self.lacks(lens) - self._light_of(lens)

    def require_room(self, numbers: Float[np.ndarray, "4"]) -> GroovedCollimator:
        """The lens of these numbers. Raises :class:`InputError` if it lacks room."""
        lens = self.lens_of(numbers)
        if self.lacks(lens) > _LACKING:
            raise InputError(
                f"grooved collimator: height = {self.room.height_mm:g} mm leaves no room for cap, lens and ring; "
                "raise it, or take a smaller source"
            )
        return lens


_ALL_STARTS = [(*start, _SLOPE) for start in product(*_STARTS)]


@lru_cache(maxsize=8)  # a second, for the check of a scene and for its search
def best_grooved_collimator(
    index: float,
    room: ThinRoom,
    side_mm: float,
    half_angle_rad: float,
    *,
    draft_rad: float = 0.035,
    mirrored: bool = False,
) -> GroovedCollimator:
    """The thin lens that sends the largest share of a square Lambertian source into a half angle, by an estimate.

    Raises :class:`InputError` if none has ``room``.
    """
    choice = _Choice(index, room, side_mm, half_angle_rad, draft_rad, mirrored)
    return choice.require_room(choice.best(_ALL_STARTS))


def lowest_grooved_collimator(
    index: float, room: ThinRoom, side_mm: float, half_angle_rad: float, *, draft_rad: float = 0.035
) -> GroovedCollimator:
    """The lowest thin lens that has :data:`OF_BEST` of the most light of any height up to that of ``room``.

    From the largest height downwards, each from the one before: light falls slowly at first, and then fast. Raises
    :class:`InputError` if none has ``room``.
    """
    choice = _Choice(index, room, side_mm, half_angle_rad, draft_rad, mirrored=False)
    numbers = choice.best(_ALL_STARTS)
    lowest = choice.require_room(numbers)
    most = choice.share(numbers)
    while True:
        choice = replace(choice, room=choice.room._replace(height_mm=_LOWER * choice.room.height_mm))
        numbers = choice.best([tuple(numbers)])
        share = choice.share(numbers)
        most = max(most, share)
        if share < OF_BEST * most:
            return lowest
        lowest = choice.lens_of(numbers)


def _through(points: _Meridian, reach_mm: float) -> ProfileFace:
    """The face of revolution through these points."""
    distances = np.hypot(*points.T)
    cosines = points[:, 1] / distances
    rising = np.argsort(cosines)
    known = cosines[rising], 1.0 / distances[rising]
    ends = float(cosines.min()), float(cosines.max())
    return ProfileFace.fitted(lambda at: np.interp(at, *known), *ends, COEFFICIENTS, reach_mm)
