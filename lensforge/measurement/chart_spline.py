"""Smooth change of a surface's radius as a spline over the chart, and the surface that has it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import NdBSpline, make_interp_spline

from lensforge.surfaces.chart import to_chart
from lensforge.surfaces.surface import Surface

_DEGREE = 5  # as the exported faces, which could not follow the kinks of a cubic's third derivative to a nanometre


@dataclass(frozen=True)
class RadialChange(Surface):
    """Change of a radius (mm) over the chart: a quintic tensor-product spline; beyond its square, the edge's value.

    ``detail_rad``: as of a surface whose splines have nodes an eighth of the shortest wavelength apart.
    """

    knots: Float[np.ndarray, " k"]
    control: Float[np.ndarray, "n n"]
    detail: float

    @staticmethod
    def through(axis: Float[np.ndarray, " m"], values: Float[np.ndarray, "m m"], detail_rad: float) -> "RadialChange":
        """The spline through ``values`` (mm) on the square grid of ``axis``, [X, Y]."""
        along_x = make_interp_spline(axis, values, k=_DEGREE)
        along_y = make_interp_spline(axis, along_x.c.T, k=_DEGREE)
        return RadialChange(along_x.t, np.ascontiguousarray(along_y.c.T), detail_rad)

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature."""
        return self.detail

    def times(self, factor: float) -> "RadialChange":
        """The change times ``factor``."""
        return RadialChange(self.knots, factor * self.control, self.detail)

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """The change (mm) in unit ``directions``."""
        values: Float[np.ndarray, " n"] = self._spline(self._inside(to_chart(directions)))
        return values

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient on the unit sphere (mm/rad): the chart is conformal, with the scale ``2/(1 + R^2)``."""
        chart = self._inside(to_chart(directions))
        x, y = chart[:, 0], chart[:, 1]
        squared = 1.0 + x**2 + y**2
        # Unit tangents of the chart's axes: derivatives of u = (2X, 2Y, 1 - R^2)/(1 + R^2), over their length.
        along_x = np.stack([1.0 - x**2 + y**2, -2.0 * x * y, -2.0 * x], axis=1) / squared[:, None]
        along_y = np.stack([-2.0 * x * y, 1.0 + x**2 - y**2, -2.0 * y], axis=1) / squared[:, None]
        slope_x, slope_y = (0.5 * squared * self._spline(chart, nu=order) for order in ((1, 0), (0, 1)))
        gradient: Float[np.ndarray, "n 3"] = slope_x[:, None] * along_x + slope_y[:, None] * along_y
        return gradient

    def _inside(self, chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        clipped: Float[np.ndarray, "n 2"] = np.clip(chart, self.knots[0], self.knots[-1])
        return clipped

    @cached_property
    def _spline(self) -> NdBSpline:
        return NdBSpline((self.knots, self.knots), self.control, _DEGREE)


@dataclass(frozen=True)
class ChangedSurface(Surface):
    """A surface whose radius has a change added."""

    original: Surface
    change: RadialChange

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature of either."""
        return min(self.original.detail_rad, self.change.detail_rad)

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm) in unit ``directions``."""
        radius: Float[np.ndarray, " n"] = self.original.radius(directions) + self.change.radius(directions)
        return radius

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad)."""
        gradient: Float[np.ndarray, "n 3"] = self.original.gradient(directions) + self.change.gradient(directions)
        return gradient

    def radius_on_grid(self, directions: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "n n"]:
        """``rho`` (mm) on a square chart grid centred on the axis."""
        change = self.change.radius_on_grid(directions)
        radius: Float[np.ndarray, "n n"] = self.original.radius_on_grid(directions) + change
        return radius
