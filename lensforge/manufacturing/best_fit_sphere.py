"""The sphere that a face departs from: five named fits, each weighted by area, never along z.

A deviation is measured along the sphere's own normal, ``|P - c| - R``: positive where the face is farther from the
centre than the sphere. A fit along z would blow up at the steep rim of a hemisphere.

=================== ==============================================================================
``least_squares``   centre on the axis, least mean square deviation; the default
``free_centre``     the same, centre anywhere
``minimum_pv``      centre on the axis, least peak-to-valley deviation (the minimum zone)
``enclosing``       smallest sphere, centre on the axis, that contains the face: the turned blank
``inscribed``       largest sphere about the centre of ``minimum_pv`` that the face does not enter
=================== ==============================================================================

A largest inscribed sphere with a free centre does not exist for an open face (it grows without bound as its centre
moves away from the face), hence the last definition.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares, minimize_scalar

from lensforge.manufacturing.sampling import FaceSamples

Variant = Literal["least_squares", "free_centre", "minimum_pv", "enclosing", "inscribed"]
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
    weights = samples.areas / samples.areas.sum()
    centre = _CENTRES[variant](points, weights)
    away = points - centre
    distance = np.linalg.norm(away, axis=1)
    radius = {"enclosing": distance.max(), "inscribed": distance.min()}.get(variant)
    if radius is None:
        radius = weights @ distance if variant != "minimum_pv" else (distance.max() + distance.min()) / 2.0
    deviation = distance - radius
    # The angle from the chord, for digits where the face is nearly the sphere.
    chord = np.linalg.norm(samples.outward - away / distance[:, None], axis=1)
    return BestFitSphere(
        variant=variant,
        radius_mm=float(radius),
        centre_mm=centre,
        deviation_mm=deviation,
        slope_departure=2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0)),
        rms_mm=float(np.sqrt(weights @ deviation**2)),
    )


def _on_axis(z: float) -> Float[np.ndarray, "3"]:
    return np.array([0.0, 0.0, z])


def _least_squares_centre(
    points: Float[np.ndarray, "k 3"], weights: Float[np.ndarray, " k"], free: bool
) -> Float[np.ndarray, "3"]:
    """Variable projection: for any centre the best radius is the weighted mean distance."""
    moving = np.eye(3) if free else np.array([[0.0, 0.0, 1.0]])
    root = np.sqrt(weights)

    def residual(parameters: Float[np.ndarray, " p"]) -> Float[np.ndarray, " k"]:
        distance = np.linalg.norm(points - parameters @ moving, axis=1)
        return root * (distance - weights @ distance)

    scale = float(np.linalg.norm(points, axis=1).mean())
    start = np.zeros(len(moving))
    found = least_squares(residual, start, x_scale=scale, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return found.x @ moving


def _least_squares_on_axis(
    points: Float[np.ndarray, "k 3"], weights: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "3"]:
    return _least_squares_centre(points, weights, free=False)


def _least_squares_free(points: Float[np.ndarray, "k 3"], weights: Float[np.ndarray, " k"]) -> Float[np.ndarray, "3"]:
    return _least_squares_centre(points, weights, free=True)


def _minimum_pv_centre(points: Float[np.ndarray, "k 3"], weights: Float[np.ndarray, " k"]) -> Float[np.ndarray, "3"]:
    def zone(z: float) -> float:
        return float(np.ptp(np.linalg.norm(points - _on_axis(z), axis=1)))

    around = float(_least_squares_on_axis(points, weights)[2])
    reach = _REACH * float(np.linalg.norm(points, axis=1).max())
    scan = around + np.linspace(-reach, reach, _SCAN)
    best = float(scan[int(np.argmin([zone(z) for z in scan]))])
    step = 2.0 * reach / (_SCAN - 1)
    return _on_axis(_lowest(zone, best - step, best + step))


def _enclosing_centre(points: Float[np.ndarray, "k 3"], weights: Float[np.ndarray, " k"]) -> Float[np.ndarray, "3"]:
    reach = float(np.linalg.norm(points, axis=1).max())  # convex in z: no scan is needed
    return _on_axis(_lowest(lambda z: float(np.linalg.norm(points - _on_axis(z), axis=1).max()), -reach, reach))


def _lowest(function, low: float, high: float) -> float:  # type: ignore[no-untyped-def]
    return float(minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": 1e-10}).x)


_CENTRES = {
    "least_squares": _least_squares_on_axis,
    "free_centre": _least_squares_free,
    "minimum_pv": _minimum_pv_centre,
    "enclosing": _enclosing_centre,
    "inscribed": _minimum_pv_centre,
}
