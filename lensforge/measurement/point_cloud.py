"""Points measured on a surface: read from a text file, and registered to the design."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.geometry.patch import Patch
from lensforge.measurement.comparison import Registration
from lensforge.measurement.motion_error import motion_errors
from lensforge.surfaces.chart import HALF_WIDTH, to_chart

LEAST_POINTS = 100
_MOST_BYTES = 128 * MIB  # four million points, which take 1 GiB while they are read; scanners measure a million
_FURTHEST_MM = 1e6  # a machine's own zero may be metres away
_REACH = HALF_WIDTH**2  # squared chart radius up to which the patch is defined: a little below the rim
_START_SHARE = 0.5  # of the points must lie over the surface at the start


def read_cloud(path: Path) -> Float[np.ndarray, "n 3"]:
    """Read points (mm) from a text file: x, y, z first in each line, separated by commas, semicolons, tabs or blanks.

    A header line, lines that begin with # and further columns are skipped. Raises :class:`InputError`.
    """
    content = read_file(path, missing="give the file of the measured points", most_bytes=_MOST_BYTES)
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not readable as text ({error})") from None
    points: list[tuple[float, ...]] = []
    for number, line in enumerate(lines, start=1):
        fields = line.replace(",", " ").replace(";", " ").split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            points.append(tuple(map(float, fields[:3])))
        except ValueError:
            if points:
                raise InputError(f"{path}: line {number}: {line.strip()[:40]!r}: must be x, y, z in mm") from None
            continue
        if len(points[-1]) < 3:
            raise InputError(f"{path}: line {number}: {len(fields)} numbers, must be x, y, z in mm")
    cloud = np.array(points, dtype=np.float64).reshape(-1, 3)
    if len(cloud) < LEAST_POINTS:
        raise InputError(f"{path}: {len(cloud)} points, must be at least {LEAST_POINTS}")
    if not np.isfinite(cloud).all():
        raise InputError(f"{path}: some points are not finite; remove them")
    furthest = float(np.abs(cloud).max())
    if furthest > _FURTHEST_MM:
        raise InputError(f"{path}: a coordinate of {furthest:.4g} mm, must be at most {_FURTHEST_MM:g}; remove it")
    return cloud


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
    where that would matter, measure against datums. Raises :class:`InputError` for points not over the surface.
    """
    if np.mean(over_surface(points)) < _START_SHARE:
        raise InputError("points: fewer than half of them lie above z = 0 around the origin; give lens coordinates")
    if registration == "none":
        return RigidMotion(*np.zeros((4, 3)))
    free = np.arange(6) >= (3 if registration == "shift" else 0)
    fits = [_fit(patch, points, start, free) for start in _starts(patch, points)]
    best = min(fits, key=lambda fit: fit.cost)
    motion, errors = np.zeros(6), np.zeros(6)
    motion[free] = best.x
    place = moved(points, motion)
    over = over_surface(place)
    directions = place[over] / np.linalg.norm(place[over], axis=1)[:, None]
    errors[free] = motion_errors(directions, best.fun[over], best.jac[over][:, : free.sum()])
    return RigidMotion(motion[:3], motion[3:], errors[:3], errors[3:])


def _fit(
    patch: Patch, points: Float[np.ndarray, "n 3"], start: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"]
) -> Any:
    """Trust-region least squares; rotations are scaled by the lens's size, so that all six have a similar effect."""
    size = float(np.linalg.norm(points, axis=1).mean())

    def whole(chosen: Float[np.ndarray, " k"]) -> Float[np.ndarray, "6"]:
        motion = np.zeros(6)
        motion[free] = chosen
        return motion

    return least_squares(
        lambda chosen: _gaps_and_slopes(patch, points, whole(chosen))[0],
        start[free],
        jac=lambda chosen: _gaps_and_slopes(patch, points, whole(chosen))[1][:, free],
        x_scale=np.array([1.0 / size] * 3 + [1.0] * 3)[free],
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-14,
    )


def _gaps_and_slopes(
    patch: Patch, points: Float[np.ndarray, "n 3"], motion: Float[np.ndarray, "6"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 6"]]:
    """Distances and their derivatives by the motion; points below the rim do not count."""
    place = moved(points, motion)
    over = over_surface(place)
    gaps, slopes = np.zeros(len(points)), np.zeros((len(points), 6))
    gaps[over], normals = distances(patch, place[over])
    # A small further rotation w moves a point by w x p, p after the rotation so far; along the normal by w . (p x n).
    turned = place[over] - motion[3:]
    slopes[over] = np.concatenate([np.cross(turned, normals) @ _left_jacobian(motion[:3]), normals], axis=1)
    return gaps, slopes


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
