"""The best-fit sphere of a face, by five definitions; rms values are over the area.

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

from lensforge.manufacturing.face import FaceSamples
from lensforge.manufacturing.result import Variant

VARIANTS: tuple[Variant, ...] = get_args(Variant)

_SCAN = 65  # axis positions tried before the local search: peak-to-valley is not convex in the centre
_REACH = 0.75  # the scan's half-width in sphere radii


@dataclass(frozen=True)
class BestFitSphere:
    """A sphere (mm) and the face's departure from it: deviation (mm) and angle between normals (rad) per sample."""

    variant: Variant
    radius_mm: float
    centre_mm: Float[np.ndarray, "3"]
    deviation_mm: Float[np.ndarray, " k"]
    slope_departure: Float[np.ndarray, " k"]
    rms_mm: float

    @property
    def pv_mm(self) -> float:
        """Peak-to-valley deviation (mm)."""
        return float(np.ptp(self.deviation_mm))


def best_fit_sphere(samples: FaceSamples, variant: Variant = "least_squares") -> BestFitSphere:
    """Fit the named sphere to a face."""
    points = samples.points
    shares = samples.areas / samples.areas.sum()
    centre = _centre(variant, points, shares)
    away = points - centre
    distance = np.linalg.norm(away, axis=1)
    radius = _radius(variant, distance, shares)
    deviation = distance - radius
    # The angle from its chord: accurate also where the two normals nearly agree.
    chord = np.linalg.norm(samples.outward - away / distance[:, None], axis=1)
    return BestFitSphere(
        variant=variant,
        radius_mm=radius,
        centre_mm=centre,
        deviation_mm=deviation,
        slope_departure=2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)),
        rms_mm=float(np.sqrt(shares @ deviation**2)),
    )


def _centre(
    variant: Variant, points: Float[np.ndarray, "k 3"], shares: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "3"]:
    match variant:
        case "least_squares":
            return _least_squares_centre(points, shares, free=False)
        case "free_centre":
            return _least_squares_centre(points, shares, free=True)
        case "minimum_pv" | "inscribed":
            return _minimum_pv_centre(points, shares)
        case "enclosing":
            reach = float(np.linalg.norm(points, axis=1).max())
            return _minimise_on_axis(lambda distance: float(distance.max()), points, -reach, reach)


def _radius(variant: Variant, distance: Float[np.ndarray, " k"], shares: Float[np.ndarray, " k"]) -> float:
    match variant:
        case "least_squares" | "free_centre":
            return float(shares @ distance)
        case "minimum_pv":
            return float(distance.max() + distance.min()) / 2.0
        case "enclosing":
            return float(distance.max())
        case "inscribed":
            return float(distance.min())


def _least_squares_centre(
    points: Float[np.ndarray, "k 3"], shares: Float[np.ndarray, " k"], free: bool
) -> Float[np.ndarray, "3"]:
    """Variable projection: for any centre the best radius is the mean distance over the area."""
    moving = np.eye(3) if free else np.array([[0.0, 0.0, 1.0]])
    root = np.sqrt(shares)

    def residual(parameters: Float[np.ndarray, " p"]) -> Float[np.ndarray, " k"]:
        distance = np.linalg.norm(points - parameters @ moving, axis=1)
        departure: Float[np.ndarray, " k"] = root * (distance - shares @ distance)
        return departure

    def slope(parameters: Float[np.ndarray, " p"]) -> Float[np.ndarray, "k p"]:
        away = points - parameters @ moving
        towards = -(away / np.linalg.norm(away, axis=1, keepdims=True)) @ moving.T
        change: Float[np.ndarray, "k p"] = root[:, None] * (towards - shares @ towards)
        return change

    scale = float(np.linalg.norm(points, axis=1).mean())
    tight = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14}
    found = least_squares(residual, np.zeros(len(moving)), slope, method="lm", x_scale=scale, **tight)
    centre: Float[np.ndarray, " 3"] = found.x @ moving
    return centre


def _minimum_pv_centre(points: Float[np.ndarray, "k 3"], shares: Float[np.ndarray, " k"]) -> Float[np.ndarray, "3"]:
    def zone(distance: Float[np.ndarray, " k"]) -> float:
        return float(np.ptp(distance))

    around = float(_least_squares_centre(points, shares, free=False)[2])
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
