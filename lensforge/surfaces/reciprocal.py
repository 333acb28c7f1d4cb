"""Planes, cones and conics as star-shaped surfaces: exact within a reach, and continued smoothly beyond it.

Seen from the origin these surfaces go to infinity, but 1/rho is smooth there: of a plane it is the cosine to its normal
over its distance, of a conic about a focus at the origin ``(1 - e cos)/p``. A face bounds a body that lies within its
reach R; beyond, 1/rho is bent to 3/4 of 1/R by a polynomial with three continuous derivatives, so that tables and
splines have a surface in every direction. The continuation lies outside of the body and no light meets it.
"""

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.errors import InputError
from lensforge.optics.arrays import Array, module_of
from lensforge.results import Number
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Axis, Length, Place, Surface, recorded

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]

_FLAT = 0.5  # of 1/R: below it the continuation is a sphere
_PROFILE = 721  # directions of a meridian from which the detail is taken, 0.15 degrees apart
_MERIDIANS = 24
_TRIED = 2000
_LOWEST = -0.5  # cosine of the lowest direction of a chart
_WIDEST_DETAIL_RAD = 0.5


def bent(value: Float[Array, " n"], reach_mm: float) -> Float[Array, " n"]:
    """``1/rho`` (1/mm) with its continuation beyond the reach, in NumPy or in torch; differentiable."""
    xp = module_of(value)
    x = xp.clip((value * reach_mm - _FLAT) / (1.0 - _FLAT), 0.0, 1.0)
    beyond = (0.5 * (1.0 + _FLAT) + (1.0 - _FLAT) * x**4 * (2.5 - 3.0 * x + x**2)) / reach_mm
    return xp.where(value * reach_mm >= 1.0, value, beyond)


@dataclass(frozen=True)
class ReciprocalSurface(Surface):
    """A surface by its reciprocal radius, exact for ``rho <= reach_mm``."""

    reach_mm: Length

    def __post_init__(self) -> None:
        if not 0.0 < self.reach_mm < np.inf:
            raise InputError(f"reach_mm = {self.reach_mm:g}: must be above 0, and at least the size of the body")
        if not bool((self.radius(fibonacci_hemisphere(_TRIED)) < self.reach_mm).any()):
            raise InputError(
                f"{type(self).__name__.lower()}: nowhere within {self.reach_mm:g} mm of the origin; move it nearer, or "
                "raise reach_mm"
            )

    @abstractmethod
    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``1/rho`` (1/mm) in unit directions, 0 or less where the surface is not met, and its gradient in space."""

    def value(self, directions: _Vectors) -> _Values:
        """``1/rho`` (1/mm) alone, for faces that compute it faster without the gradient."""
        return self.reciprocal(directions)[0]

    def radius(self, directions: _Vectors) -> _Values:
        """``rho`` (mm) at unit ``directions``."""
        return 1.0 / bent(self.value(directions), self.reach_mm)

    def gradient(self, directions: _Vectors) -> _Vectors:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad)."""
        value, slope = self.reciprocal(directions)
        bent, by_value = self._bent(value)
        tangential = slope - np.sum(slope * directions, axis=1, keepdims=True) * directions
        return -(by_value / bent**2)[:, None] * tangential

    @cached_property
    def detail_rad(self) -> float:
        """Sigma of a Gaussian with the range and the largest curvature of the exact part; 0.5 at most."""
        polar = np.linspace(0.0, np.arccos(_LOWEST), _PROFILE)
        azimuth = 2.0 * np.pi * np.arange(_MERIDIANS) / _MERIDIANS
        sine = np.sin(polar)[:, None]
        across = sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)[:, None] + 0.0 * azimuth
        radii = self.radius(np.stack(across, axis=-1).reshape(-1, 3)).reshape(_PROFILE, _MERIDIANS)
        curvature = float(np.abs(np.diff(radii, 2, axis=0)).max()) / (polar[1] - polar[0]) ** 2
        swing = float(np.ptp(radii))
        return min(_WIDEST_DETAIL_RAD, float(np.sqrt(2.0 * swing / curvature))) if swing > 1e-9 else _WIDEST_DETAIL_RAD

    def _bent(self, value: _Values) -> tuple[_Values, _Values]:
        """``1/rho`` with its continuation, and its derivative by the original ``value``."""
        x = np.clip((value * self.reach_mm - _FLAT) / (1.0 - _FLAT), 0.0, 1.0)
        smooth = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        return bent(value, self.reach_mm), np.where(value * self.reach_mm >= 1.0, 1.0, smooth)


@recorded("plane", "A given face: a plane.")
@dataclass(frozen=True)
class PlaneFace(ReciprocalSurface):
    """The plane that meets the axis at ``height_mm``, across ``axis``, a vector of any length with z above 0."""

    height_mm: Length
    axis: Axis = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not (self.height_mm > 0.0 and self.axis[2] > 0.0):
            raise InputError(
                f"plane: height_mm = {self.height_mm:g}, axis {self.axis}: both the height and the z of the axis must "
                "be above 0"
            )
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square" if self.axis[:2] == (0.0, 0.0) else "none"

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``(n.u) / (n_z h)``."""
        slope = np.array(self.axis) / (self.axis[2] * self.height_mm)
        return directions @ slope, np.broadcast_to(slope, directions.shape)


@recorded("cone", "A given face: a cone about the axis.")
@dataclass(frozen=True)
class ConeFace(ReciprocalSurface):
    """A cone about the axis, ``r = radius_mm + slope z``; a cylinder for slope 0, closing upwards below 0."""

    radius_mm: Length
    slope: Place = 0.0

    def __post_init__(self) -> None:
        if not self.radius_mm > 0.0:
            raise InputError(f"cone: radius_mm = {self.radius_mm:g} at z = 0: must be above 0")
        if -self.slope * self.reach_mm > _FLAT * self.radius_mm:
            raise InputError(
                f"cone: slope = {self.slope:g}: its tip at {-self.radius_mm / self.slope:.4g} mm must lie at least "
                f"twice the reach above, {2.0 * self.reach_mm:g} mm; raise it"
            )
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square"

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``(sin - slope cos) / a``."""
        sine = np.hypot(directions[:, 0], directions[:, 1])
        away = np.where(sine > 0.0, sine, 1.0)
        slope = np.column_stack([directions[:, 0] / away, directions[:, 1] / away, np.full(len(sine), -self.slope)])
        return (sine - self.slope * directions[:, 2]) / self.radius_mm, slope / self.radius_mm


@recorded("conic", "A given face: a conic of revolution about a focus at the origin.")
@dataclass(frozen=True)
class ConicFace(ReciprocalSurface):
    """A conic of revolution with a focus at the origin: ``1/rho = (1 - e cos) / p``, with the angle from its ``axis``.

    ``parameter_mm``: p, the distance across the axis; ``eccentricity``: e, of a sphere 0, an ellipsoid below 1, whose
    other focus lies along the axis at ``2 e p / (1 - e^2)``, a paraboloid 1, a hyperboloid above.
    """

    parameter_mm: Length
    eccentricity: Annotated[Number, Field(ge=0.0, le=1e3)]
    axis: Axis = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        if not (self.parameter_mm > 0.0 and self.eccentricity >= 0.0):
            raise InputError(
                f"conic: parameter_mm = {self.parameter_mm:g}, eccentricity = {self.eccentricity:g}: p must be above "
                "0, e at least 0"
            )
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square" if self.axis[:2] == (0.0, 0.0) else "none"

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``(1 - e cos) / p``."""
        slope = -self.eccentricity / self.parameter_mm * np.array(self.axis) / np.linalg.norm(self.axis)
        return 1.0 / self.parameter_mm + directions @ slope, np.broadcast_to(slope, directions.shape)
