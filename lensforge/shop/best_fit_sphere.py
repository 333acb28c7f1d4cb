"""The best-fit sphere of a face, by five definitions.

Averages are over the area, by its integration points. A centre that an extreme decides is that of the samples; the
extremes from it are searched for between them.

A deviation is measured along the sphere's normal, ``|P - c| - R``: positive where the face is farther from the centre
than the sphere. A deviation along z would diverge at the steep rim of a hemisphere.

=================== ==============================================================================
``least_squares``   centre on the axis, least mean square deviation over the area; the default
``free_centre``     the same, centre anywhere
``minimum_pv``      centre on the axis, least peak-to-valley deviation (the minimum zone)
``enclosing``       smallest sphere, centre on the axis, that contains the face: the turned blank
``inscribed``       largest sphere about the centre of ``minimum_pv`` that the face does not enter
=================== ==============================================================================

A largest inscribed sphere with a free centre does not exist for an open face (it grows without bound as its centre
moves away from the face), hence the last definition.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, minimize_scalar

from lensforge.shop.check_result import Variant
from lensforge.shop.face_samples import FaceSamples

VARIANTS: tuple[Variant, ...] = get_args(Variant)

_SCAN = 65  # axis positions tried before the local search: peak-to-valley is not convex in the centre
_REACH = 0.75  # the scan's half-width in sphere radii


@dataclass(frozen=True)
class BestFitSphere:
    """A sphere (mm) and the face's departure from it: deviation (mm) and angle between normals (rad) per sample.

    ``pv_mm`` and ``largest_slope``: peak-to-valley deviation (mm) and largest angle (rad), between the samples too.
    """

    variant: Variant
    radius_mm: float
    centre_mm: Float[np.ndarray, "3"]
    deviation_mm: Float[np.ndarray, " k"]
    slope_departure: Float[np.ndarray, " q"]
    rms_mm: float
    pv_mm: float
    largest_slope: float


def best_fit_sphere(samples: FaceSamples, variant: Variant = "least_squares") -> BestFitSphere:
    """Fit the named sphere to a face."""
    area = samples.area
    shares = area.areas / area.total_mm2
    centre = _centre(variant, samples, shares)
    away = samples.points - centre
    distance, slopes = np.linalg.norm(away, axis=1), _angles(samples.outward, away)
    patch = samples.face.patch

    def outward(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        found: Float[np.ndarray, " m"] = np.linalg.norm(patch.points(points) - centre, axis=1)
        return found

    def slope(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        return _angles(patch.normals(points), patch.points(points) - centre)

    farthest, nearest = samples.largest(outward, distance)[1], -samples.largest(lambda c: -outward(c), -distance)[1]
    from_area = np.linalg.norm(area.points - centre, axis=1)
    radius = _radius(variant, float(shares @ from_area), farthest, nearest)
    return BestFitSphere(
        variant=variant,
        radius_mm=radius,
        centre_mm=centre,
        deviation_mm=distance - radius,
        slope_departure=slopes,
        rms_mm=float(np.sqrt(shares @ (from_area - radius) ** 2)),
        pv_mm=(farthest - radius) - (nearest - radius),
        largest_slope=samples.largest(slope, slopes)[1],
    )


def _angles(normals: Float[np.ndarray, "k 3"], away: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, " k"]:
    """Angles (rad) between unit normals and vectors, from their chords: accurate also where they nearly agree."""
    chord = np.linalg.norm(normals - away / np.linalg.norm(away, axis=1, keepdims=True), axis=1)
    angles: Float[np.ndarray, " k"] = 2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))
    return angles


def _centre(variant: Variant, samples: FaceSamples, shares: Float[np.ndarray, " q"]) -> Float[np.ndarray, "3"]:
    match variant:
        case "least_squares":
            return _least_squares_centre(samples.area.points, shares, free=False)
        case "free_centre":
            return _least_squares_centre(samples.area.points, shares, free=True)
        case "minimum_pv" | "inscribed":
            return _minimum_pv_centre(samples.points, _least_squares_centre(samples.area.points, shares, free=False))
        case "enclosing":
            reach = float(np.linalg.norm(samples.points, axis=1).max())
            return _minimise_on_axis(lambda distance: float(distance.max()), samples.points, -reach, reach)


def _radius(variant: Variant, mean_mm: float, farthest_mm: float, nearest_mm: float) -> float:
    """The radius (mm) from the mean distance over the area and the extreme distances from the centre."""
    match variant:
        case "least_squares" | "free_centre":
            return mean_mm
        case "minimum_pv":
            return (farthest_mm + nearest_mm) / 2.0
        case "enclosing":
            return farthest_mm
        case "inscribed":
            return nearest_mm


def _least_squares_centre(
    points: Float[np.ndarray, "q 3"], shares: Float[np.ndarray, " q"], free: bool
) -> Float[np.ndarray, "3"]:
    """Variable projection: for any centre the best radius is the mean distance over the area."""
    moving = np.eye(3) if free else np.array([[0.0, 0.0, 1.0]])
    root = np.sqrt(shares)

    def residual(parameters: Float[np.ndarray, " p"]) -> Float[np.ndarray, " q"]:
        distance = np.linalg.norm(points - parameters @ moving, axis=1)
        departure: Float[np.ndarray, " q"] = root * (distance - shares @ distance)
        return departure

    def slope(parameters: Float[np.ndarray, " p"]) -> Float[np.ndarray, "q p"]:
        away = points - parameters @ moving
        towards = -(away / np.linalg.norm(away, axis=1, keepdims=True)) @ moving.T
        change: Float[np.ndarray, "q p"] = root[:, None] * (towards - shares @ towards)
        return change

    scale = float(np.linalg.norm(points, axis=1).mean())
    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    found = least_squares(residual, np.zeros(len(moving)), slope, method="lm", x_scale=scale, **tight)
    centre: Float[np.ndarray, " 3"] = found.x @ moving
    return centre


def _minimum_pv_centre(points: Float[np.ndarray, "k 3"], near: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    def zone(distance: Float[np.ndarray, " k"]) -> float:
        return float(np.ptp(distance))

    around = float(near[2])
    reach = _REACH * float(np.linalg.norm(points, axis=1).max())
    scan = around + np.linspace(-reach, reach, _SCAN)
    best = scan[int(np.argmin([zone(np.linalg.norm(points - [0.0, 0.0, z], axis=1)) for z in scan]))]
    step = 2.0 * reach / (_SCAN - 1)
    return _minimise_on_axis(zone, points, best - step, best + step)


def _minimise_on_axis(
    figure: Callable[[Float[np.ndarray, " k"]], float], points: Float[np.ndarray, "k 3"], low: float, high: float
) -> Float[np.ndarray, "3"]:
    """The centre on the axis, ``low`` to ``high``, that minimises ``figure`` of its distances to the points."""

    def at(z: float) -> float:
        return figure(np.linalg.norm(points - [0.0, 0.0, z], axis=1))

    found = minimize_scalar(at, bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    return np.array([0.0, 0.0, float(found.x)])
