"""Faces of revolution by their profile: the reciprocal radius as a spline of the cosine to the axis.

The reciprocal radius of a sphere about the origin, of a plane across the axis, and of a conic with a focus at the
origin is linear in the cosine. A spline holds these exactly: its coefficients are then the values at ``averages``
(Greville).
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.errors import InputError
from lensforge.results import Number, Record
from lensforge.surfaces.reciprocal import ConeFace, PlaneFace, ReciprocalSurface
from lensforge.surfaces.srbf import Levels, MirrorGroup, Spread, SrbfBasis, SrbfSurface, Weights, fields_of
from lensforge.surfaces.surface import ByContent, Place, Surface, SurfaceRecord, recorded, surface_record

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]
_Splines = tuple["BSpline", "BSpline", "BSpline"]

HORIZON = np.array([[1.0, 0.0, 0.0]])
AXIS = np.array([[0.0, 0.0, 1.0]])
DEGREE = 5  # as the exported faces; tables and exports could not follow the kinks of a cubic's third derivative
LEAST_COEFFICIENTS = DEGREE + 1
_MOST_COEFFICIENTS = 512
_SAMPLES = 8  # of a fit, for each coefficient
_MERIDIANS = 32  # of a face of no revolution
_FIT_RCOND = 1e-5  # of the functions of a fit: combinations that hardly differ have small weights


@dataclass(frozen=True)
class ProfileBasis:
    """``count`` B-splines on even knots from cosine ``low`` to ``high``, continued beyond them smoothly.

    A continuation has the value, slope and curvature of the end; its curvature fades within a step, so that it goes on
    straight. Raises :class:`InputError` for fewer than six functions, and for cosines that do not rise within -1 and 1.
    """

    low: float
    high: float
    count: int

    def __post_init__(self) -> None:
        if not -1.0 <= self.low < self.high <= 1.0:
            raise InputError(f"profile: low = {self.low:g}, high = {self.high:g}: cosines, must rise within -1 and 1")
        if self.count < LEAST_COEFFICIENTS:
            raise InputError(f"profile: {self.count} coefficients: must be {LEAST_COEFFICIENTS} at least")

    @property
    def step(self) -> float:
        """Cosine from knot to knot."""
        return (self.high - self.low) / (self.count - DEGREE)

    @property
    def averages(self) -> Float[np.ndarray, " c"]:
        """Greville abscissae: cosines whose values are a linear function's coefficients; some lie beyond ``low`` and
        ``high``.
        """
        return self.low + self.step * (np.arange(self.count) - 0.5 * (DEGREE - 1))

    def splines(self, coefficients: Float[np.ndarray, "c *w"]) -> _Splines:
        """The sum of the functions with these coefficients over the knot number, and its first two derivatives."""
        from scipy.interpolate import BSpline

        value = BSpline(np.arange(-DEGREE, self.count + 1.0), coefficients, DEGREE)
        return value, value.derivative(1), value.derivative(2)

    def at(self, splines: _Splines, cosines: _Values) -> tuple[Float[np.ndarray, "n *w"], Float[np.ndarray, "n *w"]]:
        """A sum and its derivative by the cosine, at each cosine."""
        within = np.clip(cosines, self.low, self.high)
        value, slope, bend = (spline((within - self.low) / self.step) for spline in splines)
        beyond = ((cosines - within) / self.step).reshape(-1, *[1] * (value.ndim - 1))
        turn = np.expm1(-np.abs(beyond))
        # The bend is half of the square near the end, and straight far away.
        continued = value + beyond * slope + (np.abs(beyond) + turn) * bend
        return continued, (slope - np.sign(beyond) * turn * bend) / self.step

    def value(self, splines: _Splines, cosines: _Values) -> Float[np.ndarray, "n *w"]:
        """A sum, at each cosine."""
        value = splines[0]((np.clip(cosines, self.low, self.high) - self.low) / self.step)
        beyond = (cosines < self.low) | (cosines > self.high)
        value[beyond] = self.at(splines, cosines[beyond])[0]
        return value

    def matrix(self, cosines: _Values) -> Float[np.ndarray, "n c"]:
        """Values of every function at each cosine."""
        return self.value(self.splines(np.eye(self.count)), cosines)

    def nearest(self, cosines: _Values, values: _Values) -> tuple[float, ...]:
        """Coefficients of the least-squares fit to ``values`` at the cosines."""
        coefficients: list[float] = np.linalg.lstsq(self.matrix(cosines), values, rcond=None)[0].tolist()
        return tuple(coefficients)


Cosine = Annotated[Number, Field(ge=-1.0, le=1.0)]
Reciprocals = Annotated[tuple[Place, ...], Field(min_length=LEAST_COEFFICIENTS, max_length=_MOST_COEFFICIENTS)]


@recorded("profile", "A face of revolution: its reciprocal radius (1/mm) as a spline of the cosine to the axis.")
@dataclass(frozen=True)
class ProfileFace(ReciprocalSurface):
    """A face of revolution: ``1/rho`` (1/mm) is the sum of ``coefficients`` times the functions of its ``basis``.

    ``low``, ``high``: cosines between which the profile bends; let them reach a little beyond the part that light
    meets. Raises :class:`InputError` as :class:`ProfileBasis` does, and if it lies nowhere within its reach.
    """

    low: Cosine
    high: Cosine
    coefficients: Reciprocals

    def __post_init__(self) -> None:
        ProfileBasis(self.low, self.high, len(self.coefficients))
        if not np.isfinite(self.coefficients).all():
            raise InputError("profile: a coefficient is infinite, or no number")
        super().__post_init__()

    @staticmethod
    def fitted(
        face: Surface | Callable[[_Values], _Values], low: float, high: float, count: int, reach_mm: float
    ) -> "ProfileFace":
        """The least-squares fit to ``face`` in ``1/rho`` from ``low`` to ``high``.

        ``face``: a surface, whose meridian over x is fitted, or its ``1/rho`` (1/mm) by cosines. Raises
        :class:`InputError` as the face does.
        """
        basis = ProfileBasis(low, high, count)
        cosines = np.linspace(low, high, _SAMPLES * count)
        wanted = _meridian(face, cosines) if isinstance(face, Surface) else face(cosines)
        return ProfileFace(reach_mm, low, high, basis.nearest(cosines, wanted))

    @cached_property
    def basis(self) -> ProfileBasis:
        """Functions that the coefficients weigh."""
        return ProfileBasis(self.low, self.high, len(self.coefficients))

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square"

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``1/rho`` and its gradient in space."""
        slope = np.zeros_like(directions)
        value, slope[:, 2] = self.basis.at(self._splines, directions[:, 2])
        return value, slope

    def value(self, directions: _Vectors) -> _Values:
        """``1/rho`` at the cosine."""
        return self.basis.value(self._splines, directions[:, 2])

    @cached_property
    def _splines(self) -> _Splines:
        return self.basis.splines(np.array(self.coefficients))


@dataclass(frozen=True, eq=False)
class FormedFace(ByContent, ProfileFace):
    """A profile with ``weights_per_mm`` (1/mm) times the functions of ``srbf`` added to its reciprocal radius."""

    srbf: SrbfBasis
    weights_per_mm: Float[np.ndarray, " m"]

    def __post_init__(self) -> None:
        if len(self.weights_per_mm) != self.srbf.size:
            raise InputError(f"formed: {len(self.weights_per_mm)} weights of {self.srbf.size} functions")
        super().__post_init__()

    @staticmethod
    def nearest(
        directions: _Vectors, reciprocals: _Values, basis: ProfileBasis, srbf: SrbfBasis, reach_mm: float
    ) -> "FormedFace":
        """The fit to ``1/rho`` (1/mm) at these directions: first the profile, then SRBFs for the residual."""
        coefficients = basis.nearest(directions[:, 2], reciprocals)
        left = reciprocals - basis.matrix(directions[:, 2]) @ np.array(coefficients)
        weights = np.linalg.lstsq(srbf.evaluate(directions), left, rcond=_FIT_RCOND)[0]
        return FormedFace(reach_mm, basis.low, basis.high, coefficients, srbf, weights)

    @property
    def symmetry(self) -> str:
        """Largest mirror group: that of the functions."""
        return self.srbf.symmetry

    @cached_property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature of profile and functions."""
        return min(super().detail_rad, self.srbf.detail_rad)

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """``1/rho``, profile plus functions, and its gradient in space."""
        value, slope = super().reciprocal(directions)
        return value + self._sum.radius(directions), slope + self._sum.gradient(directions)

    def value(self, directions: _Vectors) -> _Values:
        """``1/rho``, profile plus functions."""
        return super().value(directions) + self._sum.radius(directions)

    @cached_property
    def _sum(self) -> SrbfSurface:
        return SrbfSurface(self.srbf, self.weights_per_mm, 0.0)


def _meridian(face: Surface, cosines: _Values) -> _Values:
    """``1/rho`` over the x axis; of faces with a reach, without their continuation."""
    directions = np.column_stack([np.sqrt(1.0 - cosines**2), np.zeros_like(cosines), cosines])
    return face.value(directions) if isinstance(face, ReciprocalSurface) else 1.0 / face.radius(directions)


def around(polar_rad: _Values) -> Float[np.ndarray, "k 3"]:
    """Directions at these angles from the axis, each on all meridians in turn."""
    azimuth = 2.0 * np.pi * np.arange(_MERIDIANS) / _MERIDIANS
    across = [np.outer(np.sin(polar_rad), component).ravel() for component in (np.cos(azimuth), np.sin(azimuth))]
    return np.stack([*across, np.repeat(np.cos(polar_rad), _MERIDIANS)], axis=1)


def shrunk(face: ReciprocalSurface, factor: float) -> ReciprocalSurface:
    """The face divided by ``factor``, within the same reach."""
    match face:
        case ConeFace():
            return replace(face, radius_mm=face.radius_mm / factor)
        case PlaneFace():
            return replace(face, height_mm=face.height_mm / factor)
    assert isinstance(face, ProfileFace)
    return replace(face, coefficients=tuple(factor * coefficient for coefficient in face.coefficients))


class SrbfFunctions(Record):
    """SRBFs of ``levels``, each with its weight."""

    levels: Levels
    sigma_c: Spread
    symmetry: MirrorGroup
    weights: Weights


if TYPE_CHECKING:
    ProfileRecord = SurfaceRecord
else:
    ProfileRecord = SurfaceRecord.kinds["profile"]


class FormedRecord(SurfaceRecord):
    """A profile, and the functions that are added to its reciprocal radius, each with its weight (1/mm)."""

    kind: Literal["formed"]
    profile: ProfileRecord
    functions: SrbfFunctions

    def surface(self) -> FormedFace:
        """The surface. Raises :class:`InputError` if the numbers of weights and functions differ."""
        sums = self.functions
        profile = self.profile.model_dump(exclude={"kind"})
        basis = SrbfBasis(sums.levels, sums.sigma_c, sums.symmetry)
        weights = np.array(sums.weights, dtype=np.float64)
        return FormedFace(**profile, srbf=basis, weights_per_mm=weights)


@surface_record.register
def _(surface: FormedFace) -> SurfaceRecord:
    profile = ProfileFace(*(getattr(surface, field.name) for field in fields(ProfileFace)))
    functions = {**fields_of(surface.srbf), "weights": surface.weights_per_mm.tolist()}
    return FormedRecord.model_validate({"kind": "formed", "profile": surface_record(profile), "functions": functions})
