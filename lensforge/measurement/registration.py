"""Registration of measured points to a surface of the design: the rigid motion that brings them onto it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from lensforge.errors import InputError
from lensforge.geometry.patch import Patch
from lensforge.measurement.comparison import Registration
from lensforge.measurement.motion_error import motion_errors
from lensforge.point_cloud import LEAST_POINTS
from lensforge.surfaces.chart import HALF_WIDTH, to_chart

_REACH = HALF_WIDTH**2  # squared chart radius up to which the patch is defined: a little below the rim
_START_SHARE = 0.5  # of the points must lie over the surface at the start
_ROUNDS = 4  # of fits with ever more points over the surface


@dataclass(frozen=True)
class RigidMotion:
    """Motion that takes measured points to lens coordinates: rotation by the vector ``rotation_rad``, then translation.

    Both with their standard errors by noise and form error: 0 for what was not fitted, infinite for what the points do
    not determine, such as rotations of a sphere. A nearly spherical surface determines its own rotation poorly.
    """

    rotation_rad: Float[np.ndarray, "3"]
    translation_mm: Float[np.ndarray, "3"]
    rotation_error_rad: Float[np.ndarray, "3"]
    translation_error_mm: Float[np.ndarray, "3"]

    def apply(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """``points`` (mm) in lens coordinates."""
        return moved(points, np.concatenate([self.rotation_rad, self.translation_mm]))


@dataclass(frozen=True)
class Registered:
    """Motion of measured points, those of them over the surface (mm, in lens coordinates), and their share of all."""

    motion: RigidMotion
    points: Float[np.ndarray, "n 3"]
    share: float


def registered(patch: Patch, cloud: Float[np.ndarray, "k 3"], registration: Registration = "rigid") -> Registered:
    """Register ``cloud`` (mm) to the surface of ``patch`` as :func:`register` does, and keep what lies over it."""
    motion = register(patch, cloud, registration)
    placed = motion.apply(cloud)
    over = over_surface(placed)
    return Registered(motion, placed[over], float(over.mean()))


def moved(points: Float[np.ndarray, "n 3"], motion: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 3"]:
    """``points`` rotated and translated by ``motion``: a rotation vector (rad) and a translation (mm)."""
    placed: Float[np.ndarray, "n 3"] = Rotation.from_rotvec(motion[:3]).apply(points) + motion[3:]
    return placed


def over_surface(points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """True for points over the hemisphere, down to a little below the rim."""
    lengths = np.linalg.norm(points, axis=1)
    above = (lengths > 0.0) & (points[:, 2] > -0.5 * lengths)
    chart = np.full((len(points), 2), np.inf)
    chart[above] = to_chart(points[above])
    inside: Bool[np.ndarray, " n"] = np.sum(chart**2, axis=1) <= _REACH
    return inside


def distances(
    patch: Patch, points: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Signed distance (mm) of points over the surface from it, positive away from the origin, and the normals there.

    The radial gap times the cosine to the normal: exact to first order in the gap.
    """
    lengths = np.linalg.norm(points, axis=1)
    directions = points / lengths[:, None]
    normals = patch.normals(to_chart(points))
    cosine = np.sum(normals * directions, axis=1)
    return (lengths - patch.radius(directions)) * cosine, normals


def register(patch: Patch, points: Float[np.ndarray, "n 3"], registration: Registration = "rigid") -> RigidMotion:
    """Fit ``points`` (mm) to ``patch`` by least squares along its normals, from two starting positions.

    ``registration``: rotation and translation, translation alone, or nothing where datums put the points in lens
    coordinates. Points should lie within a few millimetres and about ten degrees of the lens coordinates: a freeform
    has more than one position that nearly fits. A surface close to a sphere rotates easily under its own deformation;
    where that would matter, measure against datums. Raises :class:`InputError` where fewer than half of the points lie
    over the surface before, or fewer than :data:`LEAST_POINTS` after it.
    """
    if np.mean(over_surface(points)) < _START_SHARE:
        raise InputError("points: fewer than half of them lie above z = 0 around the origin; give lens coordinates")
    if registration == "none":
        _require_enough(over_surface(points))
        return RigidMotion(*np.zeros((4, 3)))
    free = np.arange(6) >= (3 if registration == "shift" else 0)
    fits = [_settled(patch, points, start, free) for start in _starts(patch, points)]
    motion, _ = min(fits, key=lambda fit: fit[1])
    place = moved(points, motion)
    over = over_surface(place)
    _require_enough(over)
    gaps, slopes = _gaps_and_slopes(patch, points[over], motion)
    directions = place[over] / np.linalg.norm(place[over], axis=1)[:, None]
    errors = np.zeros(6)
    errors[free] = motion_errors(directions, gaps, slopes[:, free])
    return RigidMotion(motion[:3], motion[3:], errors[:3], errors[3:])


def _require_enough(over: Bool[np.ndarray, " n"]) -> None:
    """Raise :class:`InputError` where too few points lie over the surface."""
    if over.sum() < LEAST_POINTS:
        raise InputError(
            f"points: {over.sum()} of them lie over the surface once registered, must be at least {LEAST_POINTS}; were "
            "they measured on the other surface, or are they not in lens coordinates?"
        )


def _settled(
    patch: Patch, points: Float[np.ndarray, "n 3"], start: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"]
) -> tuple[Float[np.ndarray, "6"], float]:
    """Motion, and mean square (mm^2) of the points over the surface, after fits that lose none of their points.

    Each counts those of the one before and those that came over the surface by it. The last counts what is over the
    surface alone, so that points of other faces do not draw on the motion.
    """
    motion, counted = start, over_surface(moved(points, start))
    for _ in range(_ROUNDS):
        motion = _whole(_fit(patch, points[counted], motion, free).x, free)
        more = counted | over_surface(moved(points, motion))
        if np.array_equal(counted, more):
            break
        counted = more
    over = over_surface(moved(points, motion))
    _require_enough(over)
    found = _fit(patch, points[over], motion, free)
    return _whole(found.x, free), float(np.mean(found.fun**2))


def _whole(chosen: Float[np.ndarray, " k"], free: Bool[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    motion = np.zeros(6)
    motion[free] = chosen
    return motion


def _fit(
    patch: Patch, points: Float[np.ndarray, "n 3"], start: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"]
) -> Any:
    """Trust-region least squares; rotations are scaled by the lens's size, so that all six have a similar effect."""
    size = float(np.linalg.norm(points, axis=1).mean())
    return least_squares(
        lambda chosen: _gaps_and_slopes(patch, points, _whole(chosen, free))[0],
        start[free],
        jac=lambda chosen: _gaps_and_slopes(patch, points, _whole(chosen, free))[1][:, free],
        x_scale=np.array([1.0 / size] * 3 + [1.0] * 3)[free],
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-14,
    )


def _gaps_and_slopes(
    patch: Patch, points: Float[np.ndarray, "n 3"], motion: Float[np.ndarray, "6"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 6"]]:
    """Distances and their derivatives by the motion; beyond the rim, from the tangent plane there.

    A point that left the sum when it left the face would make the sum smaller, and a fit would push points off. Slopes
    beyond the rim leave out that the normal there turns as a point goes around.
    """
    place = moved(points, motion)
    over = over_surface(place)
    gaps, normals = np.zeros(len(points)), np.zeros((len(points), 3))
    gaps[over], normals[over] = distances(patch, place[over])
    across = place[~over, :2]
    rim = HALF_WIDTH * across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), np.finfo(float).tiny)
    normals[~over] = patch.normals(rim)
    gaps[~over] = np.sum((place[~over] - patch.points(rim)) * normals[~over], axis=1)
    # A small further rotation w moves a point by w x p, p after the rotation so far; along the normal by w . (p x n).
    turned = place - motion[3:]
    return gaps, np.concatenate([np.cross(turned, normals) @ _left_jacobian(motion[:3]), normals], axis=1)


def _left_jacobian(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Left Jacobian of the rotation group: rotation by a change of the vector (Chirikjian 2011, eq. 10.86)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    if angle < 1e-6:
        return np.eye(3) + 0.5 * cross
    first, second = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    jacobian: Float[np.ndarray, "3 3"] = np.eye(3) + first * cross + second * cross @ cross
    return jacobian


def _starts(patch: Patch, points: Float[np.ndarray, "n 3"]) -> list[Float[np.ndarray, "6"]]:
    """Starting motions: none, and the shift of the points' best-fit sphere onto that of the surface under them."""
    over = points[over_surface(points)]
    directions = over / np.linalg.norm(over, axis=1)[:, None]
    shift = _sphere_centre(patch.radius(directions)[:, None] * directions) - _sphere_centre(over)
    return [np.zeros(6), np.concatenate([np.zeros(3), shift])]


def _sphere_centre(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Centre of the algebraic best-fit sphere: |p|^2 = 2 c . p + k."""
    matrix = np.concatenate([2.0 * points, np.ones((len(points), 1))], axis=1)
    solution: Float[np.ndarray, " k"] = np.linalg.lstsq(matrix, np.sum(points**2, axis=1), rcond=None)[0]
    return solution[:3]
