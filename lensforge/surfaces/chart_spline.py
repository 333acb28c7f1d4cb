"""A surface that is known by its radius in many directions: a quintic spline of the radius over the chart."""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.errors import InputError
from lensforge.results import Number
from lensforge.surfaces.mirror_group import largest_symmetry
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import (
    ByContent,
    Place,
    Surface,
    SurfaceRecord,
    gradient_on_sphere,
    surface_record,
    to_chart,
)

if TYPE_CHECKING:
    from scipy.interpolate import NdBSpline

DEGREE = 5  # as the exported faces, which could not follow the kinks of a cubic's third derivative to a nanometre
# Below the rim a direction gets the radius of one no further out than this; the way there has 7 derivatives.
REACH = 0.2  # of the chart's unit
_SOFTNESS = 7  # 1 rad at the rim
HALF_WIDTH = 1.0 + REACH  # of the square over which the spline is known
_WIDEST_DETAIL_RAD = 0.5
_MOST_KNOTS = 512
_MIRRORED = 1000  # directions at which mirror images are compared
_SAME_MM = 1e-6  # how far they may differ


@dataclass(frozen=True, eq=False)
class ChartSpline(ByContent, Surface):
    """``knots``, the same in X and Y, and ``control`` (mm), [X, Y], of the radius; over the square of ``HALF_WIDTH``.

    ``detail``: sigma (rad) of a Gaussian as narrow as its narrowest feature.
    """

    knots: Float[np.ndarray, " k"]
    control: Float[np.ndarray, "n n"]
    detail: float

    @staticmethod
    def through(axis: Float[np.ndarray, " m"], values: Float[np.ndarray, "m m"]) -> "ChartSpline":
        """The spline through radii (mm) on the square grid of ``axis``, [X, Y], its detail measured."""
        from scipy.interpolate import make_interp_spline

        along_x = make_interp_spline(axis, values, k=DEGREE)
        along_y = make_interp_spline(axis, along_x.c.T, k=DEGREE)
        return ChartSpline(along_x.t, np.ascontiguousarray(along_y.c.T), detail_of(along_x.t, along_y.c.T))

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of the narrowest feature."""
        return self.detail

    @cached_property
    def symmetry(self) -> str:
        """Largest mirror group that changes the radius by no more than a nanometre."""
        directions = fibonacci_hemisphere(_MIRRORED)
        radii = self.radius(directions)

        def unchanged(mirror: Float[np.ndarray, "3 3"]) -> bool:
            return bool(np.abs(self.radius(directions @ mirror) - radii).max() < _SAME_MM)

        return largest_symmetry(unchanged)

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm) in unit ``directions``."""
        return self._spline(_bent(to_chart(directions))[0])

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad)."""
        chart = to_chart(directions)
        bent, outwards, around = _bent(chart)
        chart_slopes = np.stack([self._spline(bent, nu=order) for order in ((1, 0), (0, 1))], axis=1)
        distance = np.linalg.norm(chart, axis=1, keepdims=True)
        radial = chart / np.where(distance == 0.0, 1.0, distance)
        slopes = (
            chart_slopes * around[:, None]
            + np.sum(chart_slopes * radial, axis=1, keepdims=True) * radial * (outwards - around)[:, None]
        )
        return gradient_on_sphere(chart, slopes)

    @cached_property
    def _spline(self) -> "NdBSpline":
        from scipy.interpolate import NdBSpline

        return NdBSpline((self.knots, self.knots), self.control, DEGREE)


def bent_radius(radius: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Chart radius at which a direction of chart ``radius`` is evaluated: itself inside the rim, 1.2 at most beyond."""
    beyond = np.maximum(radius - 1.0, 0.0)
    bent: Float[np.ndarray, "*n"] = (
        radius - beyond + beyond * (1.0 + (beyond / REACH) ** _SOFTNESS) ** (-1.0 / _SOFTNESS)
    )
    return bent


def _bent(
    chart: Float[np.ndarray, "n 2"],
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Chart points at which the spline is evaluated, and the scale there of a step outwards and of one around."""
    radius = np.hypot(chart[:, 0], chart[:, 1])
    beyond = np.maximum(radius - 1.0, 0.0)
    around = np.where(beyond > 0.0, bent_radius(radius) / np.maximum(radius, 1.0), 1.0)
    outwards = (1.0 + (beyond / REACH) ** _SOFTNESS) ** (-1.0 / _SOFTNESS - 1.0)
    return chart * around[:, None], outwards, around


def detail_of(knots: Float[np.ndarray, " k"], control: Float[np.ndarray, "n n"]) -> float:
    """Sigma of a Gaussian with the same ratio of second to fourth derivative, ``sqrt(6 f'' / f'''')``; 0.5 at most.

    The error of a table is that of the fourth, and the second leaves out a sphere's size and place.
    """
    from scipy.interpolate import BSpline

    axis = np.linspace(-0.98, 0.98, 4 * len(control))
    squared = axis[:, None] ** 2 + axis**2
    angle = 2.0 / (1.0 + squared)  # rad in a unit of the chart

    def largest(order_x: int, order_y: int) -> float:
        along_x = BSpline(knots, control, DEGREE)(axis, nu=order_x)
        values = BSpline(knots, along_x.T, DEGREE)(axis, nu=order_y).T / angle ** (order_x + order_y)
        return float(np.abs(values[squared < 0.96]).max())

    second, fourth = (max(largest(order, 0), largest(0, order)) for order in (2, 4))
    if fourth * _WIDEST_DETAIL_RAD**2 <= 6.0 * second:
        return _WIDEST_DETAIL_RAD
    return float(np.sqrt(6.0 * second / fourth))


class ChartSplineRecord(SurfaceRecord):
    """A given face: its radius as a quintic spline over the stereographic chart, control values by rows of X."""

    kind: Literal["chart_spline"]
    knots: Annotated[tuple[Annotated[Number, Field(ge=-2.0, le=2.0)], ...], Field(max_length=_MOST_KNOTS, repr=False)]
    control_mm: Annotated[tuple[Place, ...], Field(max_length=_MOST_KNOTS**2, repr=False)]
    detail_rad: Annotated[Number, Field(ge=1e-3, le=1.0)]

    def surface(self) -> ChartSpline:
        """The surface. Raises :class:`InputError` if knots and control values do not belong to one spline."""
        side = len(self.knots) - DEGREE - 1
        knots = np.array(self.knots, dtype=np.float64)
        if side <= DEGREE or len(self.control_mm) != side**2 or not (np.diff(knots) >= 0.0).all():
            raise InputError(
                f"{len(self.knots)} knots and {len(self.control_mm)} control values: the knots must not fall, and the "
                f"values must be as many as the square of the knots less {DEGREE + 1}"
            )
        return ChartSpline(knots, np.array(self.control_mm, dtype=np.float64).reshape(side, side), self.detail_rad)


@surface_record.register
def _(surface: ChartSpline) -> SurfaceRecord:
    knots = tuple(surface.knots.tolist())
    control = tuple(surface.control.ravel().tolist())
    return ChartSplineRecord(kind="chart_spline", knots=knots, control_mm=control, detail_rad=surface.detail)
