"""Faces of revolution by their profile: the reciprocal radius as a spline of the cosine to the axis.

The reciprocal radius of a sphere about the origin, of a plane across the axis, and of a conic with a focus at the
origin is linear in the cosine. A spline holds these exactly: its coefficients are then the values at ``averages``
(Greville).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.surfaces.reciprocal import ReciprocalSurface
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]
_Weights = Float[np.ndarray, "n w"]

DEGREE = 5  # as the exported faces; tables and exports could not follow the kinks of a cubic's third derivative
LEAST_COEFFICIENTS = DEGREE + 1
_SAMPLES = 8  # of a fit, for each coefficient


@dataclass(frozen=True)
class ProfileBasis:
    """``count`` B-splines on even knots from cosine ``low`` to ``high``, continued beyond them smoothly.

    A continuation has value, slope and bend of the end; its bend fades within a step, so that it goes on straight.
    Raises :class:`InputError` for fewer than six functions, and for cosines that do not rise within -1 and 1.
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
        """Cosines at which a linear function has its coefficients; some lie beyond ``low`` and ``high``."""
        return self.low + self.step * (np.arange(self.count) - 0.5 * (DEGREE - 1))

    def matrix(self, cosines: _Values) -> Float[np.ndarray, "n c"]:
        """Every function at each cosine."""
        within = np.clip(cosines, self.low, self.high)
        beyond = (cosines - within) / self.step
        bend = np.abs(beyond) + np.expm1(-np.abs(beyond))  # half of the square near the end, straight far away
        straight = self._spread(within, 0) + beyond[:, None] * self._spread(within, 1)
        return np.asarray(straight + bend[:, None] * self._spread(within, 2))

    def slopes(self, cosines: _Values) -> Float[np.ndarray, "n c"]:
        """Derivative of every function by the cosine."""
        within = np.clip(cosines, self.low, self.high)
        beyond = (cosines - within) / self.step
        turn = -np.sign(beyond) * np.expm1(-np.abs(beyond))
        return np.asarray((self._spread(within, 1) + turn[:, None] * self._spread(within, 2)) / self.step)

    def nearest(self, cosines: _Values, values: _Values) -> tuple[float, ...]:
        """Coefficients of the function nearest to ``values`` in least squares."""
        coefficients: list[float] = np.linalg.lstsq(self.matrix(cosines), values, rcond=None)[0].tolist()
        return tuple(coefficients)

    def _spread(self, within: _Values, order: int) -> Float[np.ndarray, "n c"]:
        """Derivatives of ``order`` by the knot, in the columns of their functions."""
        place = (within - self.low) / self.step
        cell = np.clip(np.floor(place).astype(int), 0, self.count - DEGREE - 1)
        spread = np.zeros((len(within), self.count))
        columns = cell[:, None] + np.arange(DEGREE + 1)
        np.put_along_axis(spread, columns, _on_cell(place - cell, order), axis=1)
        return spread


def _on_cell(fraction: _Values, order: int) -> _Weights:
    """The functions that are not 0 on a cell between knots, or their derivatives of ``order`` (de Boor)."""
    weights, f = np.ones((len(fraction), 1)), fraction[:, None]
    for degree in range(1, DEGREE + 1 - order):
        falling = (np.arange(1, degree + 1) - f) / degree * weights
        rising = (f + np.arange(degree - 1, -1, -1)) / degree * weights
        weights = np.pad(falling, ((0, 0), (0, 1))) + np.pad(rising, ((0, 0), (1, 0)))
    for _ in range(order):
        weights = np.pad(weights, ((0, 0), (1, 0))) - np.pad(weights, ((0, 0), (0, 1)))
    return weights


@dataclass(frozen=True)
class ProfileFace(ReciprocalSurface):
    """A face of revolution: ``1/rho`` (1/mm) is the sum of ``coefficients`` times the functions of its ``basis``.

    ``low``, ``high``: cosines between which the profile bends; let them reach a little beyond the part that light
    meets. Raises :class:`InputError` as :class:`ProfileBasis` does, and where it is nowhere within its reach.
    """

    low: float
    high: float
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        ProfileBasis(self.low, self.high, len(self.coefficients))
        if not np.isfinite(self.coefficients).all():
            raise InputError("profile: a coefficient is infinite, or no number")
        super().__post_init__()

    @staticmethod
    def fitted(
        face: Surface | Callable[[_Values], _Values], low: float, high: float, count: int, reach_mm: float
    ) -> "ProfileFace":
        """The profile nearest to ``face`` in least squares of ``1/rho`` from ``low`` to ``high``.

        ``face``: a surface, of which the meridian over x counts, or its ``1/rho`` (1/mm) by cosines. Raises
        :class:`InputError` as the face does.
        """
        basis = ProfileBasis(low, high, count)
        cosines = np.linspace(low, high, _SAMPLES * count)
        wanted = _meridian(face, cosines) if isinstance(face, Surface) else face(cosines)
        return ProfileFace(reach_mm, low, high, basis.nearest(cosines, wanted))

    @cached_property
    def basis(self) -> ProfileBasis:
        """The functions that the coefficients weigh."""
        return ProfileBasis(self.low, self.high, len(self.coefficients))

    @property
    def symmetry(self) -> str:
        """Largest mirror group."""
        return "square"

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """The profile at the cosine, which is z."""
        cosines, own = directions[:, 2], np.array(self.coefficients)
        slope = np.zeros_like(directions)
        slope[:, 2] = self.basis.slopes(cosines) @ own
        return self.basis.matrix(cosines) @ own, slope


@dataclass(frozen=True, eq=False)
class FormedFace(ProfileFace):
    """A profile with ``weights_per_mm`` (1/mm) times the functions of ``srbf`` added to its reciprocal radius."""

    srbf: SrbfBasis
    weights_per_mm: Float[np.ndarray, " m"]

    def __post_init__(self) -> None:
        if len(self.weights_per_mm) != self.srbf.size:
            raise InputError(f"formed: {len(self.weights_per_mm)} weights of {self.srbf.size} functions")
        super().__post_init__()

    @property
    def symmetry(self) -> str:
        """Largest mirror group: that of the functions."""
        return self.srbf.symmetry

    @cached_property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest of profile and functions."""
        return min(super().detail_rad, self.srbf.detail_rad)

    def reciprocal(self, directions: _Vectors) -> tuple[_Values, _Vectors]:
        """The profile at the cosine, and the sum of the functions."""
        value, slope = super().reciprocal(directions)
        return value + self._sum.radius(directions), slope + self._sum.gradient(directions)

    @cached_property
    def _sum(self) -> SrbfSurface:
        return SrbfSurface(self.srbf, self.weights_per_mm, 0.0)


def _meridian(face: Surface, cosines: _Values) -> _Values:
    """``1/rho`` over the x axis, of faces within a reach without their continuation."""
    directions = np.column_stack([np.sqrt(1.0 - cosines**2), np.zeros_like(cosines), cosines])
    return face.reciprocal(directions)[0] if isinstance(face, ReciprocalSurface) else 1.0 / face.radius(directions)
