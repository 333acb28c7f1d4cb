"""The reflector that sends the light of a point along the axis: where a search may begin; and the back of any cup.

A paraboloid about the source, ``rho = 2 f / (1 - cos gamma)``, sends all that meets it along the axis, and what leaves
by its mouth directly keeps its direction. The flatter it is, the farther from the source light meets it, and the less
the size of the source turns it; the deeper, the more light it takes. Which one suits a source and a beam is found by a
scan. For light to one side the cup leans there: its mirror sends light that way, and stands before the light that would
leave to the other sides.
"""

from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import product

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.seeds import sobol
from lensforge.surfaces.collimator import LeavingLight, share_within
from lensforge.surfaces.profile import FormedFace, ProfileBasis, ProfileFace, around
from lensforge.surfaces.reciprocal import ConicFace, PlaneFace, ReciprocalSurface
from lensforge.surfaces.srbf import SrbfBasis
from lensforge.surfaces.surface import Surface

_ROOM = 1.4  # reach of a face over its farthest point, as of a collimator
_RAYS = 64  # angles of the estimated share
_TRIED = 24  # focal lengths that are tried, and radii
# So far around the axis a mouth stays open: nearer to it the facets of a cup's mesh are long and narrow, and an STL's
# normals there wrong. At the start the cup is so much higher.
OPEN_RAD = 0.3
_OPEN = 1.05
_NARROWEST = 0.2  # of the largest radius: of a mouth that is tried
_LOWEST = -0.15  # cosine of the lowest point of a back
_BEYOND = 0.1  # cosine by which a back is known beyond its rim
_COEFFICIENTS = 24  # of a back
_ALONG = 721  # places on each meridian of a cup
_FINE = 8  # times as many places, on which the rim of a mouth is found
_FLATTEST = 0.2  # height of the mouth over its radius, at least
_ENOUGH = 0.98  # of the largest share: among these the lowest cup is chosen
_TRACED = 2048  # rays through a leaning cup
_LEAST_ECCENTRICITY = 0.5
_FLATTER = 0.05  # 1 - eccentricity of the first cup that is tried
_LEAN = 0.6  # of the light's angle, where the search of a lean begins
_FOCI = (1.0, 1.6)  # of the clearance
_STEPS = 120

_Values = Float[np.ndarray, " n"]


@dataclass(frozen=True)
class ParabolicCup:
    """A paraboloid of ``focal_mm`` about the origin; its body, of ``wall_mm``, has ``radius_mm`` at the mouth."""

    focal_mm: float
    radius_mm: float
    wall_mm: float

    @property
    def rim_mm(self) -> float:
        """Radius of the mirror at the mouth: that of the body less the horizontal thickness of the wall."""
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
        """First-order share of a square Lambertian source that the cup turns into a half angle of the axis.

        Direct light and absorption do not count: for narrow beams they are the same for all cups. If light is wanted
        off the axis only, from ``least_rad`` on, direct light counts as well.
        """
        rim = float(np.arctan2(self.rim_mm, self.height_mm))
        polar = np.linspace(rim, 0.5 * np.pi, _RAYS)
        turned = [LeavingLight(polar, 2.0 * self.focal_mm / np.tan(0.5 * polar))]
        within = share_within(turned, half_angle_rad, side_mm)
        if least_rad == 0.0:
            return within
        direct = np.sin(min(rim, half_angle_rad)) ** 2 - np.sin(least_rad) ** 2
        return within - share_within(turned, least_rad, side_mm) + max(0.0, float(direct))


@dataclass(frozen=True)
class LeaningCup:
    """A conic about the origin, open at ``height_mm``, whose axis leans by ``lean_rad`` from z towards +x.

    ``focal_mm``: from the origin to its vertex; ``eccentricity``: 1 of a paraboloid, less of an ellipsoid.
    """

    focal_mm: float
    eccentricity: float
    lean_rad: float
    height_mm: float

    @property
    def _parameter_mm(self) -> float:
        return self.focal_mm * (1.0 + self.eccentricity)

    def face(self, radius_mm: float, azimuth_rad: float = 0.0) -> ConicFace:
        """The mirror, of this radius at most, leaning towards ``azimuth_rad`` from x."""
        reach_mm = _ROOM * float(np.hypot(radius_mm, self.height_mm))
        aside = np.sin(self.lean_rad)
        x, y = float(aside * np.cos(azimuth_rad)), float(aside * np.sin(azimuth_rad))
        return ConicFace(reach_mm, self._parameter_mm, self.eccentricity, (x, y, float(np.cos(self.lean_rad))))

    def over(self, radius_mm: float, clearance_mm: float, most_height_mm: float, draft_rad: float) -> float:
        """Largest ratio of a size to its limit in :func:`best_leaning_cup`, above 1 if the cup has no room."""
        directions = around(np.linspace(0.0, 0.5 * np.pi, _ALONG // 4))
        radii = self._parameter_mm / np.maximum(1.0 - self.eccentricity * (directions @ self._axis), 1e-9)
        below = radii * directions[:, 2] <= self.height_mm
        widest_mm = float((radii * np.hypot(directions[:, 0], directions[:, 1]))[below].max())
        normals = directions[below] - self.eccentricity * self._axis
        undercut = float(np.arcsin((normals[:, 2] / np.linalg.norm(normals, axis=1)).max()))
        narrowest_mm = self._parameter_mm / (1.0 + self.eccentricity * float(np.sin(self.lean_rad)))
        past = 1.0 - self.eccentricity * float(np.cos(self.lean_rad + OPEN_RAD))
        tallest_mm = min(most_height_mm, self._parameter_mm * float(np.cos(OPEN_RAD)) / (past * _OPEN))
        sizes = widest_mm / radius_mm, clearance_mm / narrowest_mm, self.height_mm / tallest_mm
        return max(*sizes, 1.0 + draft_rad + undercut)

    @property
    def _axis(self) -> Float[np.ndarray, " 3"]:
        return np.array([np.sin(self.lean_rad), 0.0, np.cos(self.lean_rad)])

    def share(self, off_rad: float, half_rad: float, side_mm: float, mirror: float) -> float:
        """Share of a square Lambertian source that the cup sends within ``half_rad`` of ``off_rad`` from z towards +x.

        Directly, or by one reflection of reflectance ``mirror``. A ray from the point s in the direction u meets the
        conic at ``|s + t u| = p + e a (s + t u)``, a quadratic equation.
        """
        axis = self.eccentricity * self._axis
        (places, ways) = _lambertian()
        places = side_mm * places
        along = ways @ axis
        past = self._parameter_mm + places @ axis
        linear = (places * ways).sum(axis=1) - along * past
        square = np.maximum(1.0 - along**2, 1e-12)
        root = np.sqrt(np.maximum(linear**2 - square * ((places**2).sum(axis=1) - past**2), 0.0))
        to_mirror = (root - linear) / square
        met = to_mirror * ways[:, 2] < self.height_mm
        points = places + to_mirror[:, None] * ways
        normals = points / np.linalg.norm(points, axis=1, keepdims=True) - axis
        turned = ways - (2.0 * (ways * normals).sum(axis=1) / (normals**2).sum(axis=1))[:, None] * normals
        rises = met & (turned[:, 2] > 1e-6)
        to_mouth = np.where(rises, self.height_mm - points[:, 2], 0.0) / np.where(rises, turned[:, 2], 1.0)
        out = points + to_mouth[:, None] * turned
        rises &= np.linalg.norm(out, axis=1) <= self._parameter_mm + out @ axis + 1e-9
        wanted = np.array([np.sin(off_rad), 0.0, np.cos(off_rad)])
        direct = ~met & (ways @ wanted > np.cos(half_rad))
        return float(direct.mean() + mirror * (rises & (turned @ wanted > np.cos(half_rad))).mean())


@cache
def _lambertian() -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points on a square of side 1, and directions of its Lambertian light."""
    x, y, square, turn = sobol(_TRACED, 4, 0).T
    sine = np.sqrt(square)
    azimuth = 2.0 * np.pi * turn
    ways = np.column_stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.sqrt(1.0 - square)])
    return np.column_stack([x - 0.5, y - 0.5, np.zeros_like(x)]), ways


@lru_cache(maxsize=8)  # half a second, for the check of a scene and for its search
def best_leaning_cup(
    radius_mm: float,
    side_mm: float,
    off_rad: float,
    half_rad: float,
    mirror: float,
    clearance_mm: float,
    most_height_mm: float,
    draft_rad: float = -np.inf,
) -> LeaningCup | None:
    """The leaning cup that sends the most light within ``half_rad`` of a direction ``off_rad`` from the axis.

    ``radius_mm``: largest radius of its mirror; ``clearance_mm``: its least radius at z = 0; ``draft_rad``: least angle
    by which it widens upwards. All rays within ``OPEN_RAD`` of the axis meet its mouth. None if no cup has room.
    """
    from scipy.optimize import minimize

    def cup_of(sizes: _Values) -> LeaningCup:
        focal, flatter, lean, height = np.exp(sizes).tolist()
        return LeaningCup(focal, max(1.0 - flatter, _LEAST_ECCENTRICITY), min(lean, 0.5 * np.pi), height)

    def missing(sizes: _Values) -> float:
        cup = cup_of(sizes)
        over = cup.over(radius_mm, clearance_mm, most_height_mm, draft_rad)
        return over if over > 1.0 else -cup.share(off_rad, half_rad, side_mm, mirror)

    tried = [
        minimize(
            missing,
            np.log([focus * clearance_mm, _FLATTER, _LEAN * off_rad, min(radius_mm, most_height_mm)]),
            method="Nelder-Mead",
            options={"maxiter": _STEPS},
        )
        for focus in _FOCI
    ]
    best = min(tried, key=lambda trial: float(trial.fun))
    return cup_of(best.x) if best.fun < 0.0 else None


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
    """The lowest of the paraboloids that turn most of a square Lambertian source into a half angle, at first order.

    ``least_rad``: from the axis, of light that is wanted off-axis only; 0 for light about the axis.

    ``radius_mm``: largest radius of its body at the mouth. ``clearance_mm``: least radius at z = 0. Raises
    :class:`InputError` if no paraboloid has room.
    """
    least = max(0.5 * clearance_mm, 1e-3 * radius_mm)
    focal_mm = np.geomspace(least, max(0.5 * radius_mm, least), _TRIED).tolist()
    radii_mm = np.geomspace(_NARROWEST * radius_mm, radius_mm, _TRIED).tolist()
    tried = [ParabolicCup(*sizes, wall_mm) for sizes in product(focal_mm, radii_mm)]
    fitting = [cup for cup in tried if 0.0 < _FLATTEST * cup.rim_mm <= cup.height_mm <= most_height_mm]
    if not fitting:
        raise InputError(
            f"reflector: radius = {radius_mm:.4g} mm leaves no room for a cup of {2.0 * least:.4g} mm at least at "
            f"z = 0, a wall of {wall_mm:.3g} mm, and a height of {most_height_mm:.4g} mm at most; raise the radius or "
            "the height, or take a smaller source"
        )
    shares = [cup.share(half_angle_rad, side_mm, least_rad) for cup in fitting]
    best = (cup for cup, share in zip(fitting, shares, strict=True) if share >= _ENOUGH * max(shares))
    return min(best, key=lambda cup: cup.height_mm)


def reflector_faces(
    cup: Surface,
    radius_mm: float,
    wall_mm: float,
    height_mm: float | None = None,
    most_height_mm: float = np.inf,
    shaped: SrbfBasis | None = None,
) -> dict[str, Surface]:
    """The faces of a reflector by name: ``cup``, ``back`` and ``mouth``.

    The mouth is at ``height_mm``, by default where the back has ``radius_mm`` from the axis, or is widest below that,
    and no higher than ``most_height_mm``. ``shaped``: functions by which the back follows a cup that leans; without
    them it is round. Raises :class:`InputError` where the mouth does not meet the cup.
    """
    polar, radii = _behind(cup, wall_mm)
    behind = radii.max(axis=1)
    across = behind * np.sin(polar)
    heights = behind * np.cos(polar)
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
    high = 1.0 if shaped is not None else min(1.0, float(np.cos(rim)) + _BEYOND)
    basis = ProfileBasis(_LOWEST, high, _COEFFICIENTS)
    known = np.cos(polar) <= basis.high
    back = ProfileFace(reach, basis.low, basis.high, basis.nearest(np.cos(polar[known]), 1.0 / behind[known]))
    if shaped is not None:
        back = FormedFace.nearest(around(polar), 1.0 / radii.ravel(), basis, shaped, reach)
    if isinstance(cup, ReciprocalSurface):  # a conic has no reach of its own
        cup = replace(cup, reach_mm=min(reach, cup.reach_mm))
    return {"cup": cup, "back": back, "mouth": PlaneFace(reach, height_mm)}


def mouth_radius_mm(cup: Surface, height_mm: float) -> float:
    """Radius (mm) about the axis of a level plane's part within ``cup``, to the next step of the scan."""
    polar = np.linspace(0.0, 0.5 * np.pi, _FINE * _ALONG, endpoint=False)
    directions = around(polar)
    radii = cup.radius(directions).reshape(len(polar), -1)
    within = np.flatnonzero((radii * np.cos(polar)[:, None] >= height_mm).any(axis=1))
    return height_mm * float(np.tan(polar[min(within.max(initial=0) + 1, len(polar) - 1)]))


def _behind(cup: Surface, wall_mm: float) -> tuple[_Values, Float[np.ndarray, "n k"]]:
    """Angles from the axis, falling from below the horizon, and the distances (mm) of the back on each meridian.

    Offset by the wall along the normal, to first order.
    """
    polar = np.linspace(np.arccos(_LOWEST), 1e-3, _ALONG)
    directions = around(polar)
    slant = np.sum(cup.normal(directions) * directions, axis=1)
    return polar, (cup.radius(directions) + wall_mm / slant).reshape(_ALONG, -1)
