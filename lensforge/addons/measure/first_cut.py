"""The measured face of a first cut: registered, and its deviation filtered at the wavelength that suits its noise.

The pose of the points, the motion that their registration fits, is where the part lay in the measuring machine: it is
stated, and no part of the deviation. With datums (registration "none") all that is measured is form. The wavelength of
the areal filter lies between the shortest that the points can show and the longest that the face can hold.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.addons.measure.areal_filter import ArealFilter, FilteredPoints, PointDeviations, shortest_by_nodes_mm
from lensforge.addons.measure.measurement_result import InferredForm, Registration
from lensforge.addons.measure.part_series import PartSeries
from lensforge.addons.measure.registration import Registered, registered
from lensforge.cad.boundary import WHOLE, Domain
from lensforge.cad.patch import Patch
from lensforge.errors import InputError
from lensforge.spec.spec_section import rounded_up
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

# The filter takes 0.55 of the degrees of freedom of a square grid of points, (2 pi / 3)^2 / 8; with two spacings it
# takes nearly all, and their noise cannot be told.
_SPACINGS = 3.0
_PLACES = 5000  # at random: on a pattern of their own points may coincide with all of them, and show no gap
_MEASURED_SHARE = 0.75  # of the face: a square grid has a point within half of its pitch of 0.785 of the plane
_STEP = np.sqrt(2.0)  # from one wavelength to the next: 0.8 to 1.2 times as much of a wave in between passes
_LONGEST = 1.0  # of the largest radius: a longer wave is a matter of the best-fit sphere


@dataclass(frozen=True)
class FilterRange:
    """Distance of neighbouring points, and the shortest and longest wavelength, in mm."""

    spacing_mm: float
    shortest_mm: float
    longest_mm: float

    @staticmethod
    def of(points: PointDeviations) -> "FilterRange":
        """Range for ``points``: three points for each wave, as far as nodes suffice. Raises :class:`InputError`."""
        spacing = point_spacing_mm(points)
        radius = points.largest_radius_mm
        shortest, longest = max(_SPACINGS * spacing, shortest_by_nodes_mm(radius)), _LONGEST * radius
        if shortest > longest:
            raise InputError(
                f"points: {spacing:.3g} mm apart, must be at most {longest / _SPACINGS:.3g} on a face of "
                f"{radius:.3g} mm; measure more points, over all of the face"
            )
        return FilterRange(spacing, shortest, longest)

    def covered(self, points: PointDeviations) -> float:
        """Share of the face that ``points`` measure."""
        reach = _COVERED_SPACINGS * self.spacing_mm / points.largest_radius_mm
        return coverage(points.directions, reach, points.domain)

    def require(self, wavelength_mm: float) -> None:
        """Raise :class:`InputError` for a wavelength outside the range."""
        if not self.shortest_mm <= wavelength_mm <= self.longest_mm:
            by_points = self.shortest_mm <= _SPACINGS * self.spacing_mm
            why = f"three spacings of the points, {self.spacing_mm:.3g} mm" if by_points else "the nodes of a face"
            raise InputError(
                f"wavelength_mm = {wavelength_mm:g}: must be from {rounded_up(self.shortest_mm)} ({why}) to "
                f"{self.longest_mm:.4g}; leave it out to have it chosen by the noise of the points"
            )


def point_spacing_mm(points: PointDeviations) -> float:
    """Distance (mm) of neighbouring points: the pitch of a square grid that leaves gaps as wide.

    Twice the distance to the nearest point that three quarters of the face do not exceed: lines of a scan do not pass
    for dense points.
    """
    places = np.random.default_rng(0).normal(size=(_PLACES, 3))
    places *= np.sign(places[:, 2:]) / np.linalg.norm(places, axis=1, keepdims=True)
    places = points.domain.held(places)
    distance, _ = cKDTree(points.directions).query(places)
    radius = points.surface.radius(places)
    order = np.argsort(distance * radius)
    share = np.cumsum(radius[order] ** 2) / np.sum(radius**2)
    return float(2.0 * (distance * radius)[order][np.searchsorted(share, _MEASURED_SHARE)])


def deviations_of(surface: Surface, placed: Registered, domain: Domain) -> PointDeviations:
    """Radial deviations of the ``placed`` points from ``surface``."""
    radius = np.linalg.norm(placed.points, axis=1)
    directions = placed.points / radius[:, None]
    return PointDeviations(surface, directions, radius - surface.radius(directions), domain)


@dataclass(frozen=True)
class TriedFilter:
    """A filter and its result, the noise (mm rms along the normal) of the points by its residual, and its score."""

    filtered: FilteredPoints
    noise_mm: float
    score: float

    @staticmethod
    def of(points: PointDeviations, wavelength_mm: float) -> "TriedFilter":
        """Filter ``points``. The score is the error (mm^2) at points that were not measured (Golub et al. 1979)."""
        filtered = ArealFilter(points, wavelength_mm).solve()
        freedom, noise = filtered.residual_noise()
        square = points.mean_square(points.deviations - filtered.values)
        return TriedFilter(filtered, float(np.sqrt(square / noise)), square / freedom**2)


def longest_fitting(points: PointDeviations, span: FilterRange, finest: TriedFilter) -> FilteredPoints:
    """Filter at the longest wavelength whose residual is no more than noise.

    Each is judged by generalised cross-validation; the longest counts whose score exceeds the least by less than its
    standard error, ``sqrt(2/n)`` of it. Long waves are smooth: the light depends on slopes, and short waves of noise
    have the largest. ``finest``: at the shortest of ``span``.
    """
    count = 1 + int(np.floor(np.log(span.longest_mm / span.shortest_mm) / np.log(_STEP)))
    tried = [finest, *(TriedFilter.of(points, span.shortest_mm * _STEP**step) for step in range(1, count))]
    allowed = min(trial.score for trial in tried) * (1.0 + np.sqrt(2.0 / len(points.directions)))
    return [trial.filtered for trial in tried if trial.score <= allowed][-1]


_MOST_GAIN = 2.0  # beyond, errors grow from cut to cut
_COVERED_SPACINGS = 2.0  # a place further from the next point than two spacings of them is not measured
_COVERAGE_DIRECTIONS = 2000
_SEED = 0  # of the noise of the points that is drawn anew


def coverage(directions: Float[np.ndarray, "n 3"], reach_rad: float, domain: Domain = WHOLE) -> float:
    """Share of a face that has a measured point within ``reach_rad``; elsewhere the design is assumed."""
    chord = 2.0 * np.sin(0.5 * reach_rad)
    on_face = domain.held(fibonacci_hemisphere(_COVERAGE_DIRECTIONS))
    nearest, _ = cKDTree(directions).query(on_face, distance_upper_bound=chord)
    return float(np.isfinite(nearest).mean())


@dataclass(frozen=True)
class Request:
    """Settings of a correction: wavelength (mm; None: by the points' noise), gain, and registration."""

    wavelength_mm: float | None = None
    gain: float = 1.0
    registration: Registration = "rigid"

    def __post_init__(self) -> None:
        if not 0.0 < self.gain <= _MOST_GAIN:
            raise InputError(
                f"gain = {self.gain:g}: must be above 0 and at most {_MOST_GAIN:g}; 1 mirrors the deviation"
            )


@dataclass(frozen=True)
class FirstCut:
    """The measured face: its registered points, their deviations, the share that they cover, and the filters.

    ``noise_mm``: rms of the points. ``likeliest``: the deviation at the wavelength that suits the points; ``chosen``:
    at that of the request. Of several parts it is the face that they have in common: ``series`` tells how they scatter
    about it, and ``again`` has deviations that other parts could have. ``count``: of the points that were given.
    ``inferred``: what it rests on where there are none, but errors by pictures; ``inputs``: the hash of these.
    """

    placed: Registered
    points: PointDeviations
    covered: float
    span: FilterRange
    noise_mm: float
    likeliest: FilteredPoints
    chosen: FilteredPoints
    series: PartSeries | None = None
    again: Float[np.ndarray, " n"] | None = None
    count: int = 0
    inferred: InferredForm | None = None
    inputs: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def of(
        surface: Surface, patch: Patch, cloud: Float[np.ndarray, "k 3"], request: Request, domain: Domain = WHOLE
    ) -> "FirstCut":
        """Register ``cloud`` (mm) to the face and filter its deviations. Raises :class:`InputError`."""
        placed = registered(patch, cloud, request.registration)
        return replace(FirstCut.on(placed, deviations_of(surface, placed, domain), request), count=len(cloud))

    @staticmethod
    def on(placed: Registered, points: PointDeviations, request: Request) -> "FirstCut":
        """Filter the deviations of ``placed`` points."""
        span = FilterRange.of(points)
        if request.wavelength_mm is not None:
            span.require(request.wavelength_mm)
        finest = TriedFilter.of(points, span.shortest_mm)
        likeliest = longest_fitting(points, span, finest)
        wavelength = request.wavelength_mm
        chosen = likeliest if wavelength is None else ArealFilter(points, wavelength).solve()
        return FirstCut(
            placed=placed,
            points=points,
            covered=span.covered(points),
            span=span,
            noise_mm=finest.noise_mm,
            likeliest=likeliest,
            chosen=chosen,
        )

    def measured_again(self) -> Float[np.ndarray, " n"]:
        """Radial deviations (mm) of the points as another measurement of the same face could find them.

        Of one part the noise is drawn anew (a parametric bootstrap: Efron & Tibshirani 1993).
        """
        if self.again is not None:
            return self.again
        noise = self.noise_mm * np.random.default_rng(_SEED).normal(size=len(self.points.deviations))
        return np.asarray(self.likeliest.values + noise / self.points.cosines)

    def left_um(self, filtered: FilteredPoints) -> float:
        """Rms (um), along the normal and over the area, of the residual of ``filtered`` at the points."""
        return 1e3 * float(np.sqrt(self.points.mean_square(self.points.deviations - filtered.values)))
