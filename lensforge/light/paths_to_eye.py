"""Paths of light to an eye: where the points of the LED are seen from there, by rays that pass beside it.

A ray that passes an eye by the angle t shows the point of the LED from which it comes at another place of the lens than
that at which the eye sees this point. In a lens of focal length f both are f t apart, so that a picture of such rays is
blurred, and its brightest spot too dark where the image of the LED is small. Here the ray is turned about its point of
the LED until it meets the eye, by Newton's method, and counts where it leaves the lens then. Étendue is conserved,
dx dt = dp ds at the lens (x, t) and at the LED (p, s), and so each element of the LED's image keeps its light, but for
the square of the angle times the change of the lens's magnification.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.eye_view import EyeView
from lensforge.scene.receiver import Landings
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.waist import at_height

_TURN_RAD = 1e-5  # of a difference quotient
_MOST_RAD = 0.1  # of a step
_STEPS = 4  # of Newton's method
_FLAT = 1e-9  # a determinant of slopes that turns nothing
_CLOSE = 0.05  # of the blur: a ray that passes the eye so near is turned far enough

Trace = Callable[[RayBundle], ExitRays]
Vectors = Float[np.ndarray, "k 3"]


@dataclass(frozen=True)
class Pivots:
    """Points of the LED about which ``rays`` turn; ``before_mm``: distances from there to the starts of the rays."""

    rays: RayBundle
    points: Vectors
    before_mm: Float[np.ndarray, " k"]

    @staticmethod
    def of(rays: RayBundle, waist_mm: float | None) -> "Pivots":
        """Pivots of ``rays``: their starts, or for measured rays their crossings with the waist plane."""
        if waist_mm is None:
            return Pivots(rays, rays.origins, np.zeros(len(rays)))
        points = at_height(rays, waist_mm)
        return Pivots(rays, points, ((rays.origins - points) * rays.directions).sum(axis=1))

    def __len__(self) -> int:
        return len(self.points)

    def take(self, rows: Bool[np.ndarray, " k"]) -> "Pivots":
        """Select pivots by row."""
        return Pivots(self.rays.take(rows), self.points[rows], self.before_mm[rows])

    def turned(self, steps_rad: Vectors) -> "Pivots":
        """The rays, turned by small angles."""
        directions = self.rays.directions + steps_rad
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        origins = self.points + self.before_mm[:, None] * directions
        return replace(self, rays=replace(self.rays, origins=origins, directions=directions))


def landed_at_eye(
    trace: Trace, rays: RayBundle, exits: ExitRays, view: EyeView, waist_mm: float | None = None
) -> Landings:
    """Landings of ``rays``, which left the lens as ``exits``, each where the eye of ``view`` sees its point of the LED.

    ``waist_mm``: of measured rays, whose lines alone locate these points. A ray that cannot be turned to the eye stays
    where it passes.
    """
    landed = view.land(exits)
    for number, eye in enumerate(view.members):
        rows = np.flatnonzero(landed.arrived & eye.land(exits).arrived)
        if len(rows):
            places = _seen_at(trace, Pivots.of(rays.take(rows), waist_mm), exits.take(rows), eye)
            within = np.abs(places[:, 1]) <= 0.5 * eye.grid.height  # beyond it is the picture of another eye
            landed.hits[rows[within]] = places[within] + [0.0, view.raised(number)]
    return landed


def _seen_at(trace: Trace, pivots: Pivots, exits: ExitRays, view: EyeView) -> Float[np.ndarray, "k 2"]:
    """Places on the plane of ``view`` at which the eye sees ``pivots``."""
    places, beside = view.passed(exits)
    moved = places.copy()
    nearest = np.linalg.norm(beside, axis=1)
    going = np.arange(len(pivots))
    for _ in range(_STEPS):
        pivots = pivots.turned(_steps(trace, pivots, beside, view))
        exits = trace(pivots.rays)
        places, beside = view.passed(exits)
        nearer = exits.left_lens & (np.linalg.norm(beside, axis=1) < nearest[going])
        going = going[nearer]
        pivots = pivots.take(nearer)
        places = places[nearer]
        beside = beside[nearer]
        nearest[going] = np.linalg.norm(beside, axis=1)
        close = nearest[going] < _CLOSE * view.blur_rad
        moved[going[close]] = places[close]
        if not len(going):
            break
    return moved


def _steps(trace: Trace, pivots: Pivots, beside: Float[np.ndarray, "k 2"], view: EyeView) -> Vectors:
    """Turns (rad) that bring the rays to the eye, to first order; 0 where not known."""
    across = _across(pivots.rays.directions)
    slopes = np.empty((len(pivots), 2, 2))
    known = np.ones(len(pivots), dtype=bool)
    for number, turn in enumerate(across):
        exits = trace(pivots.turned(_TURN_RAD * turn).rays)
        slopes[:, :, number] = (view.passed(exits)[1] - beside) / _TURN_RAD
        known &= exits.left_lens
    known &= np.abs(np.linalg.det(slopes)) > _FLAT
    slopes[~known] = np.eye(2)
    amounts = np.where(known[:, None], -np.linalg.solve(slopes, beside[:, :, None])[:, :, 0], 0.0)
    sizes = np.linalg.norm(amounts, axis=1, keepdims=True)
    amounts *= np.minimum(1.0, _MOST_RAD / np.maximum(sizes, _FLAT))
    steps: Vectors = amounts[:, :1] * across[0] + amounts[:, 1:] * across[1]
    return steps


def _across(directions: Vectors) -> tuple[Vectors, Vectors]:
    """Two unit vectors perpendicular to each direction and to each other."""
    aside = np.where(np.abs(directions[:, :1]) < 0.6, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    first = np.cross(directions, aside)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return first, np.cross(directions, first)
