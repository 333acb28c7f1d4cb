"""Registration of measured points to a surface of the design: the rigid motion, and its standard errors.

The residuals are form error and noise, not noise alone. Form error is alike at neighbouring points, so many points know
little more about the motion than a few. It is taken for a random field, stationary over the directions, whose
autocovariance is a sum of exp((cos gamma - 1) / s^2), gamma the angle between two directions, over a few widths s, each
in an amount of its own, plus noise that is independent from point to point. The amounts, none below 0, are those whose
expected products of residuals, two points at a time, are closest to the ones found (C. R. Rao, J. Multivar. Anal. 1,
1971): what the fit itself has removed is accounted for. They then propagate through the fit.

Measured with 1000 points, the root mean square of the error over the stated one, for each of the six parameters: white
noise 1.0 to 1.1; waves of 0.3 to 1.5 radii of the face 0.6 to 1.2; random sums of 81 and of 25 Gaussians over the
hemisphere 0.8 to 1.4; of 9, which a motion can nearly undo, 1.0 to 2.0. White noise would state 2 to 40 times too
little for all of them but itself. Form error that is alike all around the axis, as of turned parts, is no such field:
for rings of about a radius of the face 0.2 to 1.4.
"""

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares, nnls
from scipy.spatial import cKDTree

from lensforge.addons.measure.measurement_result import Registration
from lensforge.cad.patch import Patch
from lensforge.errors import FileWarning, InputError
from lensforge.optics.pose import Pose
from lensforge.surfaces.point_files import LEAST_POINTS
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import HALF_WIDTH, to_chart

_WIDTHS_RAD = (0.1, 0.2, 0.4, 0.8)
_CELLS = 300  # over the hemisphere, 0.14 rad apart: finer detail counts as noise
_DETERMINED = 1e-10  # of the largest eigenvalue of the scaled normal matrix: below, rounding alone holds a motion
_SHARE = 1e-3  # of a parameter in such a motion: less is rounding


def motion_errors(
    directions: Float[np.ndarray, "n 3"], residuals: Float[np.ndarray, " n"], slopes: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, " k"]:
    """Standard errors of the ``k`` parameters of a least-squares fit; infinite for those that are not determined.

    ``residuals`` (mm) at unit ``directions`` after the fit, and their derivatives ``slopes`` by the parameters.
    """
    scale = np.linalg.norm(slopes, axis=0)
    scaled = slopes / np.where(scale > 0.0, scale, 1.0)
    eigenvalues, vectors = np.linalg.eigh(scaled.T @ scaled)
    free = vectors[:, eigenvalues < _DETERMINED * eigenvalues[-1]]  # motions that change no distance
    counts, means = _over_cells(directions, np.concatenate([directions, residuals[:, None], scaled], axis=1))
    places = means[:, :3]
    left = means[:, 3]
    design = means[:, 4:]
    weighted = design * counts[:, None]
    fit = np.linalg.pinv(weighted.T @ design, rcond=_DETERMINED, hermitian=True) @ weighted.T
    kernels = _kernels(places, counts)
    removed = [_without_fit(_without_fit(kernel, design, fit).T, design, fit) for kernel in kernels]
    amounts = _amounts(np.array(removed), _without_fit(left, design, fit))
    variances = np.array([np.sum((fit @ kernel) * fit, axis=1) for kernel in kernels])
    errors = np.sqrt(amounts @ variances) / np.where(scale > 0.0, scale, 1.0)
    return np.where(np.any(np.abs(free) > _SHARE, axis=1), np.inf, errors)


def _without_fit(
    values: Float[np.ndarray, "c *m"], design: Float[np.ndarray, "c k"], fit: Float[np.ndarray, "k c"]
) -> Float[np.ndarray, "c *m"]:
    """Residuals of the cells' ``values`` after the fit."""
    return np.asarray(values - design @ (fit @ values))


def _over_cells(
    directions: Float[np.ndarray, "n 3"], values: Float[np.ndarray, "n m"]
) -> tuple[Float[np.ndarray, " c"], Float[np.ndarray, "c m"]]:
    """Number of points, and the mean of their ``values``, in each cell that has any."""
    cell = cKDTree(fibonacci_hemisphere(_CELLS)).query(directions)[1]
    _, number, counts = np.unique(cell, return_inverse=True, return_counts=True)
    sums = np.stack([np.bincount(number, column, len(counts)) for column in values.T], axis=1)
    return counts.astype(np.float64), sums / counts[:, None]


def _kernels(places: Float[np.ndarray, "c 3"], counts: Float[np.ndarray, " c"]) -> Float[np.ndarray, "q c c"]:
    """Autocovariances of the cells' means: for form error of each width, and for noise, each of unit variance."""
    unit = places / np.linalg.norm(places, axis=1, keepdims=True)
    away = np.maximum(1.0 - unit @ unit.T, 0.0)
    return np.stack([*(np.exp(-away / width**2) for width in _WIDTHS_RAD), np.diag(1.0 / counts)])


def _amounts(expected: Float[np.ndarray, "q c c"], left: Float[np.ndarray, " c"]) -> Float[np.ndarray, " q"]:
    """Non-negative variances whose products are closest to those of the residuals ``left``."""
    flat = expected.reshape(len(expected), -1)
    norms = np.linalg.norm(flat, axis=1)
    unit = flat / norms[:, None]
    products = np.einsum("qij,i,j->q", expected, left, left) / norms
    return np.asarray(nnls(unit @ unit.T, products)[0] / norms)


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

    @property
    def pose(self) -> Pose:
        """Place of the frame of the points in lens coordinates."""
        return Pose.displaced(self.translation_mm, self.rotation_rad)


@dataclass(frozen=True)
class Registered:
    """Motion of measured points, the points on the surface (mm, in lens coordinates), and their share of all."""

    motion: RigidMotion
    points: Float[np.ndarray, "n 3"]
    share: float


def registered(patch: Patch, cloud: Float[np.ndarray, "k 3"], registration: Registration = "rigid") -> Registered:
    """Register ``cloud`` (mm) to the surface of ``patch`` as :func:`register` does, and keep the points on it.

    Points far off the surface, or off their neighbours, are no form error: they are left out, and a
    :class:`FileWarning` tells how many. Another one asks whether points that agree with the design were measured at
    all.
    """
    unreached = np.all(cloud == 0.0, axis=1)
    off = unreached
    for _ in range(_ROUNDS):
        motion = register(patch, cloud[~off], registration)
        placed = motion.pose.points(cloud)
        over = over_surface(placed) & ~unreached
        gaps = distances(patch, placed[over])[0]
        before = off
        off = unreached.copy()
        off[over] = off_surface(placed[over], gaps)
        if np.array_equal(off, before):
            break
    _warn_of_points(int(unreached.sum()), gaps, off[over])
    on = over & ~off
    return Registered(motion, placed[on], float(on.mean()))


_NEIGHBOURS = 12  # points around each
_UNLIKE = 0.75  # a quarter of them may be off, too
_SIGMAS = 20.0  # of the median deviation: no noise, and no form error that is alike nearby, reaches it
_STEPS = 4.0  # from the middle of the neighbours, in those that they have among themselves
_LEAST_STEP_MM = 0.02  # off the neighbours: less is told from form error by no rule
_FAR_SHARE = 0.02  # of the face's distance from the origin: no part that was made to the design is as far off
_NOT_MEASURED_MM = 1e-5


def off_surface(points: Float[np.ndarray, "n 3"], gaps: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """True for ``points`` whose ``gaps`` (mm) from the face are no form error: far off it, or off their neighbours."""
    centred = gaps - np.median(gaps)
    distances = np.linalg.norm(points, axis=1)
    far = np.maximum(_SIGMAS * _deviation(centred), _FAR_SHARE * float(np.median(distances)))
    directions = points / distances[:, None]
    _, near = cKDTree(directions).query(directions, min(_NEIGHBOURS + 1, len(points)))
    around = gaps[near[:, 1:]]
    middle = np.median(around, axis=1)
    steps = np.quantile(np.abs(around - middle[:, None]), _UNLIKE, axis=1)
    apart = gaps - middle
    allowed = np.maximum(np.maximum(_SIGMAS * _deviation(apart), _LEAST_STEP_MM), _STEPS * steps)
    return np.asarray((np.abs(centred) > far) | (np.abs(apart) > allowed))


def _deviation(values: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of a normal distribution with the median absolute value of ``values``."""
    return 1.4826 * float(np.median(np.abs(values)))


def _warn_of_points(unreached: int, gaps: Float[np.ndarray, " n"], off: Bool[np.ndarray, " n"]) -> None:
    if unreached:
        warning = f"points: {unreached} at 0, 0, 0, as a machine writes what it did not reach, are left out"
        warnings.warn(warning, FileWarning, stacklevel=2)
    if off.any():
        warning = (
            f"points: {off.sum()} of {len(gaps)} lie up to {np.abs(gaps[off]).max():.3g} mm off the face or off their"
        )
        warnings.warn(f"{warning} neighbours, and are left out: were they measured on it?", FileWarning, stacklevel=2)
    rms_mm = float(np.sqrt(np.mean(gaps[~off] ** 2))) if not off.all() else np.inf
    if rms_mm < _NOT_MEASURED_MM:
        warning = f"points: they lie within {1e6 * rms_mm:.2g} nm (rms) of the design, as no part does"
        warnings.warn(f"{warning}: are these the design's points, not measured ones?", FileWarning, stacklevel=2)


def moved(points: Float[np.ndarray, "n 3"], motion: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 3"]:
    """``points`` rotated and translated by ``motion``: a rotation vector (rad) and a translation (mm)."""
    return np.asarray(Pose.displaced(motion[3:], motion[:3]).points(points))


def over_surface(points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """True for points over the hemisphere, down to a little below the rim."""
    lengths = np.linalg.norm(points, axis=1)
    above = (lengths > 0.0) & (points[:, 2] > -0.5 * lengths)
    chart = np.full((len(points), 2), np.inf)
    chart[above] = to_chart(points[above])
    return np.asarray(np.sum(chart**2, axis=1) <= _REACH)


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
    _require_size(patch, points)
    if registration == "none":
        _require_enough(over_surface(points))
        return RigidMotion(*np.zeros((4, 3)))
    free = np.arange(6) >= (3 if registration == "shift" else 0)
    starts = _starts(patch, points)
    fits = [fit for start in starts if (fit := _settled(patch, points, start, free)) is not None]
    if not fits:
        raise _too_few(int(over_surface(points).sum()))
    motion, _ = min(fits, key=lambda fit: fit[1])
    place = moved(points, motion)
    over = over_surface(place)
    _require_enough(over)
    gaps, slopes = _gaps_and_slopes(patch, points[over], motion)
    directions = place[over] / np.linalg.norm(place[over], axis=1)[:, None]
    errors = np.zeros(6)
    errors[free] = motion_errors(directions, gaps, slopes[:, free])
    return RigidMotion(motion[:3], motion[3:], errors[:3], errors[3:])


_SIZES = 0.25, 4.0  # of points to the face under them; a misplaced cloud of a small lens has half or twice
_UNITS = {"inches": 1.0 / 25.4, "cm": 0.1, "metres": 1e-3, "µm": 1e3}  # millimetres, if written in these


def _require_size(patch: Patch, points: Float[np.ndarray, "n 3"]) -> None:
    """Raise :class:`InputError` for points that are all much nearer or farther than the face: in another unit."""
    over = points[over_surface(points) & (points[:, 2] >= 0.0)]
    if not len(over):
        return
    lengths = np.linalg.norm(over, axis=1)
    face = float(np.median(patch.radius(over / lengths[:, None])))
    measured = float(np.median(lengths))
    if not _SIZES[0] * face <= measured <= _SIZES[1] * face:
        unit = min(_UNITS, key=lambda name: abs(np.log(measured / face / _UNITS[name])))
        raise InputError(
            f"points: half of them lie within {measured:.3g} mm of the origin, the face at {face:.3g} mm: are they in "
            f"{unit}? Give mm, or name the unit with the columns: x [in], y [in], z [in]"
        )


def _require_enough(over: Bool[np.ndarray, " n"]) -> None:
    """Raise :class:`InputError` where too few points lie over the surface."""
    if over.sum() < LEAST_POINTS:
        raise _too_few(int(over.sum()))


def _too_few(count: int) -> InputError:
    return InputError(
        f"points: {count} of them lie over the surface once registered, must be at least {LEAST_POINTS}; were they "
        "measured on the other surface, or are they not in lens coordinates?"
    )


def _settled(
    patch: Patch, points: Float[np.ndarray, "n 3"], start: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"]
) -> tuple[Float[np.ndarray, "6"], float] | None:
    """Motion, and mean square (mm^2) of the points over the surface, by repeated fits.

    Each fit counts the points of the one before and those that came over the surface by it. The last counts only points
    over the surface, so that those of other faces do not affect the motion. None for a start that leads to too few.
    """
    motion = start
    counted = over_surface(moved(points, start))
    for _ in range(_ROUNDS):
        if counted.sum() < LEAST_POINTS:
            return None
        motion = _whole(_fit(patch, points[counted], motion, free).x, free)
        more = counted | over_surface(moved(points, motion))
        if np.array_equal(counted, more):
            break
        counted = more
    over = over_surface(moved(points, motion))
    if over.sum() < LEAST_POINTS:
        return None
    fitted = _fit(patch, points[over], motion, free)
    return _whole(fitted.x, free), float(np.mean(fitted.fun**2))


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
    gaps = np.zeros(len(points))
    normals = np.zeros((len(points), 3))
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
    first = (1.0 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


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
