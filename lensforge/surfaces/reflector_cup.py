"""The reflector that sends the light of a point along the axis: where a search may begin; and the back of any cup.

A paraboloid about the source sends all that meets it along the axis, and what leaves by its mouth directly goes where
it went. The flatter it is, the farther from the source light meets it, and the less the size of the source turns it;
the deeper, the more light it takes. Which one suits a source and a beam is found by a scan.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.surfaces.collimator import share_within
from lensforge.surfaces.profile import ProfileBasis, ProfileFace
from lensforge.surfaces.reciprocal import ConicFace, PlaneFace, ReciprocalSurface
from lensforge.surfaces.surface import Surface

_ROOM = 1.4  # reach of a face over its farthest point, as of a collimator
_RAYS, _TRIED = 64, 24  # angles of the estimated share; focal lengths that are tried, and radii
_NARROWEST = 0.2  # of the largest radius: of a mouth that is tried
_LOWEST, _BEYOND = -0.15, 0.1  # cosines: of the lowest point of a back, and by which it is known beyond its rim
_COEFFICIENTS, _MERIDIANS, _ALONG = 24, 32, 721  # of a back; of a cup, and places on each
_FINE = 8  # times as many places, on which the rim of a mouth is found
_FLATTEST = 0.2  # height of the mouth over its radius, at least
_ENOUGH = 0.98  # of the largest share: among these the lowest cup is chosen

_Values = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class ParabolicCup:
    """A paraboloid of ``focal_mm`` about the origin, whose body of ``wall_mm`` has ``radius_mm`` at its mouth."""

    focal_mm: float
    radius_mm: float
    wall_mm: float

    @property
    def rim_mm(self) -> float:
        """Radius of the mirror at the mouth: less than that of the body by the wall, across which its slope lies."""
        return self.radius_mm - self.wall_mm * float(np.hypot(1.0, 2.0 * self.focal_mm / self.radius_mm))

    @property
    def height_mm(self) -> float:
        """Height of the mouth above the focus."""
        return self.rim_mm**2 / (4.0 * self.focal_mm) - self.focal_mm

    @property
    def face(self) -> ConicFace:
        """The mirror."""
        return ConicFace(_ROOM * float(np.hypot(self.radius_mm, self.height_mm)), 2.0 * self.focal_mm, 1.0)

    def share(self, half_angle_rad: float, side_mm: float, least_rad: float = 0.0) -> float:
        """Share of the light of a square Lambertian source that it turns into a half angle of the axis, at first order.

        What leaves directly, and what the mirror absorbs, do not count: of narrow beams the one is the same for all.
        Of light that is wanted beside the axis only, from ``least_rad`` on, what leaves directly counts, too.
        """
        rim = float(np.arctan2(self.rim_mm, self.height_mm))
        polar = np.linspace(rim, 0.5 * np.pi, _RAYS)
        turned = [(polar, 2.0 * self.focal_mm / np.tan(0.5 * polar))]
        within = share_within(turned, half_angle_rad, side_mm)
        if least_rad == 0.0:
            return within
        direct = np.sin(min(rim, half_angle_rad)) ** 2 - np.sin(least_rad) ** 2
        return within - share_within(turned, least_rad, side_mm) + max(0.0, float(direct))


def best_cup(
    radius_mm: float,
    wall_mm: float,
    side_mm: float,
    half_angle_rad: float,
    least_rad: float = 0.0,
    *,
    clearance_mm: float = 0.0,
    most_height_mm: float = np.inf,
) -> ParabolicCup:
    """The lowest paraboloid of those that turn most of a square Lambertian source into a half angle, at first order.

    ``least_rad``: from the axis, of light that is wanted beside it only; 0 for light about it.

    ``radius_mm``: of its body at the mouth, at most. ``clearance_mm``: least radius at z = 0. Raises
    :class:`InputError` where no paraboloid has room.
    """
    least = max(0.5 * clearance_mm, 1e-3 * radius_mm)
    focal_mm = np.geomspace(least, max(0.5 * radius_mm, least), _TRIED).tolist()
    radii_mm = np.geomspace(_NARROWEST * radius_mm, radius_mm, _TRIED).tolist()
    tried = [ParabolicCup(*sizes, wall_mm) for sizes in product(focal_mm, radii_mm)]
    fitting = [each for each in tried if 0.0 < _FLATTEST * each.rim_mm <= each.height_mm <= most_height_mm]
    if not fitting:
        raise InputError(
            f"reflector: radius = {radius_mm:.4g} mm leaves no room for a cup of {2.0 * least:.4g} mm at least at "
            f"z = 0, a wall of {wall_mm:.3g} mm, and a height of {most_height_mm:.4g} mm at most; raise the radius or "
            "the height, or take a smaller source"
        )
    shares = [each.share(half_angle_rad, side_mm, least_rad) for each in fitting]
    best = (each for each, share in zip(fitting, shares, strict=True) if share >= _ENOUGH * max(shares))
    return min(best, key=lambda each: each.height_mm)


def reflector_faces(
    cup: Surface, radius_mm: float, wall_mm: float, height_mm: float | None = None, most_height_mm: float = np.inf
) -> dict[str, Surface]:
    """The faces of a reflector by name: ``cup``, ``back`` and ``mouth``.

    The mouth is at ``height_mm``, by default where the back has ``radius_mm`` from the axis, or is widest below that,
    and no higher than ``most_height_mm``. Raises :class:`InputError` where it does not meet the cup.
    """
    polar, behind = _behind(cup, wall_mm)
    across, heights = behind * np.sin(polar), behind * np.cos(polar)
    if height_mm is None:
        beyond = np.flatnonzero(across > radius_mm)
        place = int(beyond[0]) if len(beyond) else int(np.argmax(across))
        height_mm = min(float(heights[place]), most_height_mm)
    above = np.flatnonzero(heights > height_mm)
    if not (height_mm > 0.0 and len(above)):
        raise InputError(
            f"reflector: its cup, of {radius_mm:.4g} mm radius with its wall, does not reach up to {height_mm:.4g} mm "
            "above the source, to its mouth; change lens.mouth.offset_mm, the cup, or constraints.max_radius_mm"
        )
    rim = float(polar[above[0]])
    reach = _ROOM * float(behind[above[0]])
    basis = ProfileBasis(_LOWEST, min(1.0, float(np.cos(rim)) + _BEYOND), _COEFFICIENTS)
    known = np.cos(polar) <= basis.high
    back = ProfileFace(reach, basis.low, basis.high, basis.nearest(np.cos(polar[known]), 1.0 / behind[known]))
    if isinstance(cup, ReciprocalSurface):  # a conic has no reach of its own
        cup = replace(cup, reach_mm=min(reach, cup.reach_mm))
    return {"cup": cup, "back": back, "mouth": PlaneFace(reach, height_mm)}


def mouth_radius_mm(cup: Surface, height_mm: float) -> float:
    """Radius (mm) about the axis of the part of a level plane that lies within ``cup``, or a step more."""
    polar = np.linspace(0.0, 0.5 * np.pi, _FINE * _ALONG, endpoint=False)
    directions = _around(polar)
    radii = cup.radius(directions).reshape(len(polar), -1)
    within = np.flatnonzero((radii * np.cos(polar)[:, None] >= height_mm).any(axis=1))
    return height_mm * float(np.tan(polar[min(within.max(initial=0) + 1, len(polar) - 1)]))


def _behind(cup: Surface, wall_mm: float) -> tuple[_Values, _Values]:
    """Angles from the axis, falling from below the horizon, and the distances (mm) of a round back there.

    The farthest all around: at the wall along the normal, to first order.
    """
    polar = np.linspace(np.arccos(_LOWEST), 1e-3, _ALONG)
    directions = _around(polar)
    slant = np.sum(cup.normal(directions) * directions, axis=1)
    found = (cup.radius(directions) + wall_mm / slant).reshape(_ALONG, -1)
    return polar, found.max(axis=1)


def _around(polar: _Values) -> Float[np.ndarray, "k 3"]:
    """Directions at these angles from the axis, on each of the meridians in turn."""
    azimuth = 2.0 * np.pi * np.arange(_MERIDIANS) / _MERIDIANS
    across = [np.outer(np.sin(polar), each).ravel() for each in (np.cos(azimuth), np.sin(azimuth))]
    return np.stack([*across, np.repeat(np.cos(polar), _MERIDIANS)], axis=1)
