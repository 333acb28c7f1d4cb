"""A tracer in the plane for lenses of two profiles, which shares no code with the package or with `benchmark_2d.py`.

Profiles are SciPy's B-splines on the knots of docs/definitions.md, crossings and borders of pixels are found by
``brentq``. For each place of the source the slopes are found whose light lands on the borders of pixels; the light in
between is a Gauss quadrature over slopes. So no ray is given to a pixel, and none lies on a grid.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import atan2, cos, exp, hypot, pi, sin

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import brentq

_END = 0.5 + 0.15 / pi  # half turns at which a profile ends
_TOLERANCE = {"xtol": 1e-13, "rtol": 1e-14}
_BETWEEN = 4  # Gauss nodes between two borders: the light lost at the faces alone changes there
_CHECKED = 33  # slopes whose light must land one after another


class Profile:
    """A curve whose reciprocal distance (1/mm) from the origin is a quintic spline of the angle from z."""

    def __init__(self, coefficients: list[float]) -> None:
        count = len(coefficients)
        step = 2.0 * _END / (count - 5)
        knots = -_END + step * np.arange(-5, count + 1)
        self._spline = BSpline(knots, np.array(coefficients), 5)
        self._slope = self._spline.derivative()

    def distance(self, angle: float) -> float:
        """Distance (mm) from the origin at an angle (rad) from z."""
        return 1.0 / float(self._spline(angle / pi))

    def crossing(self, x: float, z: float, turn: float) -> tuple[float, float]:
        """Where a ray from within, ``turn`` (rad) from z, first meets the curve."""
        along_x = sin(turn)
        along_z = cos(turn)

        def inside(path: float) -> float:
            at_x = x + path * along_x
            at_z = z + path * along_z
            return self.distance(atan2(at_x, at_z)) - hypot(at_x, at_z)

        far = 1.0
        while inside(far) > 0.0:
            far += 1.0
        path = brentq(inside, max(far - 1.0, 0.0), far, **_TOLERANCE)
        return x + path * along_x, z + path * along_z

    def normal_turn(self, angle: float) -> float:
        """Angle (rad) from z of the normal outwards."""
        log_slope = float(self._slope(angle / pi)) / pi / float(self._spline(angle / pi))
        return angle + np.arctan(log_slope)


@dataclass(frozen=True)
class PlaneLens:
    """Two profiles about a source on z = 0, an index between them, and a line of pixels at ``distance_mm``."""

    inner: Profile
    outer: Profile
    index: float
    distance_mm: float

    def landed(self, place: float, slope: float) -> tuple[float, float]:
        """Place (mm) where a ray lands, and the share of its light that both faces pass."""
        turn = atan2(slope, 1.0)
        x, z = place, 0.0
        passed = [1.0, 1.0]
        for face, before, after in ((self.inner, 1.0, self.index), (self.outer, self.index, 1.0)):
            x, z = face.crossing(x, z, turn)
            normal = face.normal_turn(atan2(x, z))
            arrives = turn - normal
            leaves = np.arcsin(before / after * sin(arrives))
            across = before * cos(arrives), after * cos(leaves)
            along = before * cos(leaves), after * cos(arrives)
            for k, (one, other) in enumerate((across, along)):
                passed[k] *= 1.0 - ((one - other) / (one + other)) ** 2
            turn = normal + leaves
        return x + (self.distance_mm - z) * np.tan(turn), 0.5 * sum(passed)


@dataclass(frozen=True)
class PlaneSource:
    """Places up to ``half_mm`` and slopes up to ``steepest`` on each side, and a normal density in both.

    ``variance``: of that density, in the squares of both; infinite: even.
    """

    half_mm: float
    steepest: float
    variance: float

    def density(self, share: float) -> float:
        """Density at this share of the way from the middle to the end."""
        return exp(-0.5 * share**2 / self.variance)

    @cached_property
    def flux(self) -> float:
        """Flux of the whole source, in units of the density in its middle."""
        nodes, weights = np.polynomial.legendre.leggauss(40)
        along = sum(weight * self.density(node) for node, weight in zip(nodes, weights, strict=True))
        return self.half_mm * self.steepest * along**2


def pixel_light(lens: PlaneLens, source: PlaneSource, borders: np.ndarray, places: int) -> np.ndarray:
    """Share of the source's flux in each pixel between ``borders`` (mm), by so many places of the source.

    Raises ``ValueError`` where light of slopes one after another does not land one after another.
    """
    light = np.zeros(len(borders) - 1)
    nodes, weights = np.polynomial.legendre.leggauss(places)
    for node, weight in zip(nodes, weights, strict=True):
        of_place = source.half_mm * weight * source.density(node)
        for pixel, flux in _by_pixel(lens, source, source.half_mm * node, borders):
            light[pixel] += of_place * flux
    return light / source.flux


def _by_pixel(lens: PlaneLens, source: PlaneSource, place: float, borders: np.ndarray) -> Iterator[tuple[int, float]]:
    """Pixels that one place lights, each with its flux over the density of the place."""
    steepest = source.steepest

    def lands(slope: float) -> float:
        return lens.landed(place, slope)[0]

    samples = [lands(slope) for slope in np.linspace(-steepest, steepest, _CHECKED)]
    if len(set(np.sign(np.diff(samples)))) > 1:
        raise ValueError(f"place {place:.3g} mm: the light of two slopes crosses before it lands")
    low, high = sorted((samples[0], samples[-1]))
    roots = [
        brentq(lambda slope, at=border: lands(slope) - at, -steepest, steepest, **_TOLERANCE)
        for border in borders
        if low < border < high
    ]
    nodes, weights = np.polynomial.legendre.leggauss(_BETWEEN)
    for start, end in pairwise(sorted([-steepest, *roots, steepest])):
        middle = 0.5 * (start + end)
        half = 0.5 * (end - start)
        pixel = int(np.searchsorted(borders, lands(middle))) - 1
        if 0 <= pixel < len(borders) - 1:
            slopes = middle + half * nodes
            values = [source.density(slope / steepest) * lens.landed(place, slope)[1] for slope in slopes]
            yield pixel, float(half * np.dot(weights, values))
