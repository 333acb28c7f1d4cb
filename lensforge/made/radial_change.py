"""Smooth change of a surface's radius as a spline over the chart, and the surface that has it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import NdBSpline, make_interp_spline

from lensforge.surfaces.chart_spline import DEGREE
from lensforge.surfaces.surface import Surface, gradient_on_sphere, to_chart


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
        along_x = make_interp_spline(axis, values, k=DEGREE)
        along_y = make_interp_spline(axis, along_x.c.T, k=DEGREE)
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
        """Tangential gradient on the unit sphere (mm/rad)."""
        chart = self._inside(to_chart(directions))
        slopes = np.stack([self._spline(chart, nu=order) for order in ((1, 0), (0, 1))], axis=1)
        return gradient_on_sphere(chart, slopes)

    def _inside(self, chart: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        clipped: Float[np.ndarray, "n 2"] = np.clip(chart, self.knots[0], self.knots[-1])
        return clipped

    @cached_property
    def _spline(self) -> NdBSpline:
        return NdBSpline((self.knots, self.knots), self.control, DEGREE)


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
