"""The lens for total internal reflection that sends the light of a point along the axis: where a search may begin.

The cavity has a cap, a hyperboloid that refracts the inner light along the axis, and a side, a cone that refracts the
outer light to the wall. The wall reflects it along the axis, and the plane exit lets it through. All paths from the
source to a plane across the axis are equally long (Fermat), which gives the wall in closed form: where a ray meets the
side after the length l at the height z, and goes on along w, it meets the wall after s in the body, with

    l + n s - n (z + s w_z) = the same of the ray to the rim.

The size of a source is known at first order: the lens keeps the skewness of light and its étendue.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE, FaceRole
from lensforge.surfaces.profile import ProfileBasis, ProfileFace
from lensforge.surfaces.reciprocal import ConeFace, ReciprocalSurface

ROLES = (  # of the faces, turned or drawn
    FaceRole("cap", CAVITY, BODY, on_axis=True),
    FaceRole("side", CAVITY, BODY),
    FaceRole("wall", BODY, OUTSIDE, reflects=True, widens=True, is_placed=True),
    FaceRole("exit", BODY, OUTSIDE, on_axis=True, is_placed=True),
)
_Angles = Float[np.ndarray, " n"]
_Meridian = Float[np.ndarray, "n 2"]  # r and z

COEFFICIENTS = 14  # of the wall: what it turns is along the axis to 1e-5 rad
BEYOND_RAD = 0.06  # the wall is known beyond the rays that it turns
ROOM = 1.4  # reach of a face over its farthest point: so gently is it continued that tables hold it up to the rim
_RAYS = 128  # of the estimated share: angles
_PLACES = 8  # places along each side of the source
_TRIED = 12  # values of cavity and cap in a scan
_ROUNDS = 4  # scans, each closer than the one before
_TALLEST_CAP = 4.0  # over the radius of the cavity
_NARROWEST = 0.3  # of the largest radius, of a low lens
_CLOSE = 0.01  # share of its radius to which that is found


@dataclass(frozen=True)
class Collimator:
    """A lens of ``index`` whose exit has ``radius_mm``; the source is at the origin, in air.

    ``cavity_mm``: radius of the cavity at z = 0. ``cap_mm``: height of its cap on the axis. ``draft_rad``: angle by
    which its side closes upwards. ``least_wall_mm``: least wall of the body at the base, and between cap and exit.
    ``mirrored``: the wall reflects at every angle. Raises :class:`InputError` if the wall would let light through, and
    if the body has no room.
    """

    index: float
    radius_mm: float
    cavity_mm: float
    cap_mm: float
    draft_rad: float = 0.035
    least_wall_mm: float = 0.5
    mirrored: bool = False

    def __post_init__(self) -> None:
        if not (self.index > 1.0 and 0.0 <= self.draft_rad < 0.5 and min(self.cavity_mm, self.cap_mm) > 0.0):
            raise InputError(
                f"collimator: index = {self.index:g}, draft = {self.draft_rad:g} rad, cavity = {self.cavity_mm:g} mm, "
                f"cap = {self.cap_mm:g} mm: the index must be above 1, the draft 0 to 0.5, the lengths above 0"
            )
        steepest = float(np.cos(0.5 * np.arccos(self._at_side(self._side_rays).ways[:, 1])).min())
        if not (self.mirrored or steepest * self.index > 1.0):
            raise InputError(
                f"collimator: index = {self.index:g}: the wall reflects totally from {1.0 / steepest:.4g} on; raise "
                "the index, or the draft, or make the wall a mirror"
            )
        thinnest = float(self._in_body(self._side_rays).min())
        above = self.height_mm - self.cap_mm
        if not min(thinnest, above) >= self.least_wall_mm:
            raise InputError(
                f"collimator: radius = {self.radius_mm:g} mm leaves {thinnest:.3g} mm of wall at the base and "
                f"{above:.3g} mm above the cap, at least {self.least_wall_mm:g}; raise the radius, or take a smaller "
                "cavity or another cap"
            )

    @cached_property
    def crease_rad(self) -> float:
        """Angle from the axis at which cap and side meet."""
        cap = self.cap_mm * (self.index - 1.0)
        cosine = self.cavity_mm * self.index - cap * np.tan(self.draft_rad)
        sine = cap
        return float(np.arccos(self.cavity_mm / np.hypot(cosine, sine)) - np.arctan2(sine, cosine))

    @cached_property
    def height_mm(self) -> float:
        """Height of the exit: its rim lies where the light through the crease meets the wall."""
        return float(self.wall(np.array([self.crease_rad]))[0, 1])

    def wall(self, polar_rad: _Angles) -> _Meridian:
        """Points (r, z) of the wall (mm) that reflect light emitted at these angles from the axis."""
        side = self._at_side(polar_rad)
        return side.points + self._in_body(polar_rad)[:, None] * side.ways

    @cached_property
    def faces(self) -> dict[str, ReciprocalSurface]:
        """The faces by name: ``cap``, ``side``, ``wall`` and ``exit``."""
        crease = float(self._at_side(np.array([self.crease_rad])).lengths_mm[0])
        inner = ROOM * max(crease, self.cap_mm)
        cap = self.cap_mm * (self.index - 1.0)
        rim = float(np.hypot(self.radius_mm, self.height_mm))
        return {
            "cap": _linear(inner, -1.0 / cap, self.index / cap),
            "side": ConeFace(inner, self.cavity_mm, -float(np.tan(self.draft_rad))),
            "wall": self._wall_face(ROOM * rim),
            "exit": _linear(ROOM * rim, 0.0, 1.0 / self.height_mm),
        }

    def share(self, half_angle_rad: float, side_mm: float) -> float:
        """Share of the light of a square Lambertian source within a half angle of the axis, at first order.

        What faces reflect, a tenth of the light, counts as passed.
        """
        return share_within(self._mapped(), half_angle_rad, side_mm)

    def _mapped(self) -> "Iterator[LeavingLight]":
        """Light through the cap, and through the side."""
        inner = np.linspace(1e-3, self.crease_rad, _RAYS)
        cap = self.cap_mm * (self.index - 1.0) / (self.index * np.cos(inner) - 1.0)
        yield LeavingLight(inner, cap * np.sin(inner))
        yield LeavingLight(self._side_rays, self.wall(self._side_rays)[:, 0])

    @cached_property
    def _side_rays(self) -> _Angles:
        return np.linspace(self.crease_rad, 0.5 * np.pi, _RAYS)

    def _at_side(self, polar_rad: _Angles) -> "SideCrossing":
        return through_side(polar_rad, self.index, self.cavity_mm, self.draft_rad)

    def _in_body(self, polar_rad: _Angles) -> Float[np.ndarray, " n"]:
        """Lengths (mm) from the side to the wall for which all optical paths are as long as that of the rim."""
        starts, ways, lengths, _ = self._at_side(np.append(polar_rad, self.crease_rad))
        paths = lengths - self.index * starts[:, 1]
        rim = (self.radius_mm - starts[-1, 0]) / ways[-1, 0] * self.index * (1.0 - ways[-1, 1]) + paths[-1]
        return ((rim - paths) / (self.index * (1.0 - ways[:, 1])))[:-1]

    def _wall_face(self, reach_mm: float) -> ProfileFace:
        points = self.wall(np.linspace(self.crease_rad - BEYOND_RAD, 0.5 * np.pi + BEYOND_RAD, 16 * _RAYS))
        distances = np.hypot(points[:, 0], points[:, 1])
        cosines = points[:, 1] / distances
        basis = ProfileBasis(float(cosines[-1]), float(cosines[0]), COEFFICIENTS)
        return ProfileFace(reach_mm, basis.low, basis.high, basis.nearest(cosines, 1.0 / distances))


class SideCrossing(NamedTuple):
    """Points (r, z) at which light meets the side of a cavity, directions in the body, path lengths and cosines."""

    points: _Meridian
    ways: _Meridian
    lengths_mm: _Angles
    cosines: _Angles


def towards(polar_rad: _Angles) -> _Meridian:
    """Unit vectors (r, z) at angles from the axis."""
    return np.column_stack([np.sin(polar_rad), np.cos(polar_rad)])


def through_side(polar_rad: _Angles, index: float, cavity_mm: float, draft_rad: float) -> SideCrossing:
    """Refract light of a point at the origin at a cone of ``cavity_mm`` radius in z = 0 that closes upwards."""
    incoming = towards(polar_rad)
    normal = np.array([np.cos(draft_rad), np.sin(draft_rad)])
    cosines = incoming @ normal
    lengths = cavity_mm * np.cos(draft_rad) / cosines
    bent = np.sqrt(index**2 - 1.0 + cosines**2) - cosines
    return SideCrossing(lengths[:, None] * incoming, (incoming + bent[:, None] * normal) / index, lengths, cosines)


class LeavingLight(NamedTuple):
    """Light from angles to the axis, the radii (mm) at which it leaves, and the share that the faces transmit."""

    polar_rad: _Angles
    radii_mm: _Angles
    passed: _Angles | float = 1.0


def share_within(mapped: Iterable[LeavingLight], half_angle_rad: float, side_mm: float) -> float:
    """First-order share of a collimated square Lambertian source within a half angle of the axis.

    A source point offset by x in the plane of a ray and by y across it turns the ray by ``x cos dtheta/dr`` and
    ``y sin / r`` at the radius r.
    """
    squares = side_mm**2 * _places_from_the_centre() ** 2
    total = 0.0
    for polar, radii, passed in mapped:
        by_polar = np.gradient(radii, polar)
        along = np.cos(polar) / by_polar
        across = np.sin(polar) / radii
        off = np.column_stack([along**2, across**2]) @ squares
        seen = np.mean(off < np.sin(half_angle_rad) ** 2, axis=1)
        total += float(np.trapezoid(passed * seen * np.sin(2.0 * polar), polar))
    return total


@cache
def _places_from_the_centre() -> Float[np.ndarray, "2 k"]:
    """Points of a square of side 1, along and across four azimuths of a quarter turn; the others follow by symmetry.

    Half of the square: the other half turns rays by as much.
    """
    place = (np.arange(_PLACES) + 0.5) / _PLACES - 0.5
    x, y = (coordinates.reshape(-1, 1) for coordinates in np.meshgrid(place[: _PLACES // 2], place))
    turn = np.pi * (np.arange(4) + 0.5) / 8.0
    return np.stack([x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)]).reshape(2, -1)


@lru_cache(maxsize=64)  # half a second, for the check of a scene and for its search; a low one tries ten radii
def best_collimator(
    index: float,
    radius_mm: float,
    side_mm: float,
    half_angle_rad: float,
    *,
    draft_rad: float = 0.035,
    least_wall_mm: float = 0.5,
    mirrored: bool = False,
    clearance_mm: float = 0.25,
    most_height_mm: float = np.inf,
) -> Collimator:
    """The collimator that sends the largest share of a square Lambertian source into a half angle, at first order.

    The cavity is as large as the source's half diagonal and a clearance, or larger; its radius and the height of the
    cap are found by a scan. Raises :class:`InputError` as :class:`Collimator` does if none can be made.
    """
    least = np.sqrt(0.5) * side_mm + clearance_mm
    smallest = Collimator(index, radius_mm, least, least, draft_rad, least_wall_mm, mirrored)
    if not smallest.height_mm <= most_height_mm:
        raise InputError(
            f"collimator: {smallest.height_mm:.4g} mm high, at most {most_height_mm:g}; take a smaller radius or source"
        )
    best = smallest
    most = smallest.share(half_angle_rad, side_mm)
    low = np.array([least, least])
    high = np.array([radius_mm, _TALLEST_CAP * radius_mm])
    for _ in range(_ROUNDS):
        for candidate in _scanned(smallest, np.geomspace(low, high, _TRIED)):
            share = candidate.share(half_angle_rad, side_mm) if candidate.height_mm <= most_height_mm else -1.0
            if share > most:
                best = candidate
                most = share
        optimum = np.array([best.cavity_mm, best.cap_mm])
        step = (high / low) ** (1.5 / _TRIED)
        low = np.maximum(optimum / step, least)
        high = optimum * step
    return best


def best_low_collimator(
    index: float, most_radius_mm: float, side_mm: float, half_angle_rad: float, most_height_mm: float, **room: Any
) -> Collimator:
    """The best collimator within a radius and a height, where one of a smaller radius may have more light.

    ``room``: as of :func:`best_collimator`. Raises :class:`InputError` as that does, if none has room.
    """
    from scipy.optimize import minimize_scalar

    widest = best_collimator(index, most_radius_mm, side_mm, half_angle_rad, **room)
    if widest.height_mm <= most_height_mm:
        return widest

    tried = list[Collimator]()

    def lost(log_radius: float) -> float:
        radius_mm = float(np.exp(log_radius))
        try:
            lens = best_collimator(index, radius_mm, side_mm, half_angle_rad, most_height_mm=most_height_mm, **room)
        except InputError:
            return radius_mm / most_radius_mm  # too high, or too narrow for a wall
        tried.append(lens)
        return -lens.share(half_angle_rad, side_mm)

    ends = np.log([_NARROWEST * most_radius_mm, most_radius_mm])
    minimize_scalar(lost, bounds=ends, method="bounded", options={"xatol": _CLOSE})
    if not tried:
        narrowest_mm = _NARROWEST * most_radius_mm  # its refusal says what all lack
        return best_collimator(index, narrowest_mm, side_mm, half_angle_rad, most_height_mm=most_height_mm, **room)
    return max(tried, key=lambda lens: lens.share(half_angle_rad, side_mm))


def _scanned(like: Collimator, sizes_mm: Float[np.ndarray, "k 2"]) -> Iterator[Collimator]:
    """Collimators that can be made, for every pair of cavity radius and cap height."""
    for cavity, cap in product(*sizes_mm.T.tolist()):
        try:
            yield replace(like, cavity_mm=cavity, cap_mm=cap)
        except InputError:
            continue


def _linear(reach_mm: float, constant: float, slope: float) -> ProfileFace:
    """The face whose reciprocal radius (1/mm) is linear in the cosine."""
    basis = ProfileBasis(0.0, 1.0, 8)
    return ProfileFace(reach_mm, basis.low, basis.high, tuple((constant + slope * basis.averages).tolist()))
