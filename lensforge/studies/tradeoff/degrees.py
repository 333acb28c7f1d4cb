"""Degrees: linear, quadratic, cubic and quintic splines through the same nodes, against the exact sum.

The fused tracer knows the cubic only; here all four are traced alike, by scipy's splines and the search that also
traces the exact sum, so that nothing differs but the degree.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.interpolate import NdBSpline, RectBivariateSpline

from lensforge.studies.tradeoff.ladder import Ladder, Meter, Rung, orders_of
from lensforge.studies.tradeoff.truth import (
    LIGHT_UNITS,
    SHAPE_UNITS,
    SURFACES,
    Tables,
    Truth,
    directions,
    landed_exactly,
)
from lensforge.surfaces import chart
from lensforge.surfaces.spline import TableGrid, grid_for
from lensforge.surfaces.surface import Surface

SETTINGS = (1.7, 2.5, 3.4, 5.0)
DEGREES = {"linear": 1, "quadratic": 2, "cubic": 3, "quintic": 5}
_STEPS = 4  # from the cubic's crossing to that of a linear spline, some um off


@dataclass(frozen=True)
class SplineSurface(Surface):
    """A surface by one tensor-product spline of its radius over the stereographic chart."""

    spline: NdBSpline
    detail: float

    @staticmethod
    def through(grid: TableGrid, samples: Float[np.ndarray, "c c"], degree: int, detail_rad: float) -> "SplineSurface":
        """Interpolates the radii at the nodes of ``grid`` and of the apron around them."""
        axis = chart.to_chart(grid.sample_directions()).reshape(*samples.shape, 2)[:, 0, 0]
        fitted = RectBivariateSpline(axis, axis, samples, kx=degree, ky=degree)
        *knots, coefficients = fitted.tck
        side = len(knots[0]) - degree - 1
        return SplineSurface(NdBSpline(tuple(knots), coefficients.reshape(side, side), degree), detail_rad)

    @property
    def detail_rad(self) -> float:
        """That of the surface which it stands for."""
        return self.detail

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """The spline."""
        return np.asarray(self.spline(chart.to_chart(directions)))

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The spline's slopes, through the chart ``(x, y) / (r + z)``, which is constant along r."""
        at = chart.to_chart(directions)
        total = np.zeros_like(directions)
        rising = directions + np.array([0.0, 0.0, 1.0])
        for axis, order in enumerate(((1, 0), (0, 1))):
            slope = self.spline(at, nu=order)
            towards = np.eye(3)[axis] - at[:, axis, None] * rising
            total += slope[:, None] * towards / rising[:, 2:]
        return total


def degree_ladder(truth: Truth, finest: TableGrid, tables: Tables, settings: Sequence[float] = SETTINGS) -> Ladder:
    """Each degree at each number of nodes; seconds are those of tracing the rays, by NumPy."""
    lens = truth.lens
    rungs = []
    for setting in settings:
        grid = grid_for(lens.detail_rad, setting)
        samples = {name: _samples(grid, getattr(lens, name)) for name in SURFACES}
        for name, degree in DEGREES.items():
            made = {side: SplineSurface.through(grid, samples[side], degree, lens.detail_rad) for side in SURFACES}
            with Meter() as meter:
                other = replace(lens, inner=made["inner"], outer=made["outer"])
                light = landed_exactly(other, finest, tables, truth.rays, _STEPS)
            shapes = {side: (one.radius(directions()), one.normal(directions())) for side, one in made.items()}
            errors = truth.shape_errors(shapes) | truth.light_errors(light.hits, light.flux)
            users = ("all tables",) if name == "cubic" else ()
            rungs.append(
                Rung(
                    setting=setting,
                    series=name,
                    seconds=meter.seconds,
                    peak_mb=meter.peak_mb,
                    errors=errors,
                    presets=users,
                    other={"nodes": grid.nodes},
                )
            )
    orders = {name: orders_of([rung for rung in rungs if rung.series == name], ("rho", "normal")) for name in DEGREES}
    rungs.append(truth.reference_rung("exact sum", SHAPE_UNITS | LIGHT_UNITS))
    return Ladder(
        name="degrees",
        title="Degree of the splines",
        knob="nodes per sigma",
        reference=f"the exact sum: {len(truth.rays)} rays; the degree of the tables is fixed, cubic",
        plotted=("normal", "irradiance_nmse"),
        against="setting",
        rows=tuple(rungs),
        order=orders,
    )


def _samples(grid: TableGrid, surface: Surface) -> Float[np.ndarray, "c c"]:
    where = grid.sample_directions()
    count = round(len(where) ** 0.5)
    return surface.radius_on_grid(where.reshape(count, count, 3))
