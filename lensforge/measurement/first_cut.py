"""The measured face of a first cut: registered, and its deviation filtered by the areal filter.

The pose of the points, the motion that their registration fits, is where the part lay in the measuring machine: it is
stated, and no part of the deviation. With datums (registration "none") all that is measured is form.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.geometry.patch import Patch
from lensforge.measurement.areal_filter import ArealFilter, FilteredPoints, PointDeviations
from lensforge.measurement.comparison import Registration
from lensforge.measurement.deviation import coverage
from lensforge.measurement.registration import RigidMotion, registered
from lensforge.measurement.wavelength import FilterRange, TriedFilter, longest_fitting
from lensforge.surfaces.surface import Surface

_MOST_GAIN = 2.0  # beyond, errors grow from cut to cut
_COVERED_SPACINGS = 2.0  # a place further from the next point than two spacings of them is not measured


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
    """The measured face: motion of its points, their deviations, shares that were used and covered, and the filters.

    ``noise_mm``: rms of the points. ``likeliest``: the deviation by the wavelength that the points themselves ask for;
    ``chosen``: by that of the request.
    """

    motion: RigidMotion
    points: PointDeviations
    used: float
    covered: float
    span: FilterRange
    noise_mm: float
    likeliest: FilteredPoints
    chosen: FilteredPoints

    @staticmethod
    def of(surface: Surface, patch: Patch, cloud: Float[np.ndarray, "k 3"], request: Request) -> "FirstCut":
        """Register ``cloud`` (mm) to the face and filter its deviations. Raises :class:`InputError`."""
        placed = registered(patch, cloud, request.registration)
        radius = np.linalg.norm(placed.points, axis=1)
        directions = placed.points / radius[:, None]
        points = PointDeviations(surface, directions, radius - surface.radius(directions))
        span = FilterRange.of(points)
        if request.wavelength_mm is not None:
            span.require(request.wavelength_mm)
        finest = TriedFilter.of(points, span.shortest_mm)
        likeliest = longest_fitting(points, span, finest)
        wavelength = request.wavelength_mm
        chosen = likeliest if wavelength is None else ArealFilter(points, wavelength).solve()
        reach = _COVERED_SPACINGS * span.spacing_mm / points.largest_radius_mm
        return FirstCut(
            motion=placed.motion,
            points=points,
            used=placed.share,
            covered=coverage(directions, reach),
            span=span,
            noise_mm=finest.noise_mm,
            likeliest=likeliest,
            chosen=chosen,
        )
