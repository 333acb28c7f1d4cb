"""Degree of the table splines: linear, quadratic, cubic and quintic through the same nodes, against the exact sum.

    python benchmarks/spline_degrees.py cad_out/flat_top cad_out/pi [--json FILE]

The compiled tracer is cubic only; here all four degrees are splines of scipy, traced by the exact tracer, so that
only the degree differs. Prints the table of docs/accuracy.md.
"""

from study_script import main  # before torch

# isort: split
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from convergence.reference import (
    LIGHT_UNITS,
    SHAPE_UNITS,
    SURFACES,
    directions,
    landed_exactly,
)
from convergence.study import ConvergenceStudy, Meter, orders_of
from convergence.tables import TableMeasurement
from jaxtyping import Float
from scipy.interpolate import NdBSpline, RectBivariateSpline

from lensforge.surfaces import surface as chart
from lensforge.surfaces.bicubic_table import TableGrid, grid_for
from lensforge.surfaces.surface import Surface

SETTINGS = (1.7, 2.5, 3.4, 5.0)
DEGREES = {"linear": 1, "quadratic": 2, "cubic": 3, "quintic": 5}
NEWTON_STEPS = 3  # from the exact surface's crossing to that of a linear spline, some um off; the tracer takes one more
THINNED = 4  # every fourth ray of the reference


@dataclass(frozen=True)
class SplineSurface(Surface):
    """A surface by one tensor-product spline of its radius over the stereographic chart."""

    spline: NdBSpline
    detail: float

    @staticmethod
    def through(grid: TableGrid, samples: Float[np.ndarray, "c c"], degree: int, detail_rad: float) -> "SplineSurface":
        """The spline that interpolates the radii at the nodes of ``grid`` and of the apron around them."""
        axis = chart.to_chart(grid.sample_directions()).reshape(*samples.shape, 2)[:, 0, 0]
        fitted = RectBivariateSpline(axis, axis, samples, kx=degree, ky=degree)
        *knots, coefficients = fitted.tck
        side = len(knots[0]) - degree - 1
        return SplineSurface(NdBSpline(tuple(knots), coefficients.reshape(side, side), degree), detail_rad)

    @property
    def detail_rad(self) -> float:
        """Detail (rad) of the surface that it approximates."""
        return self.detail

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Radii (mm) by the spline."""
        return np.asarray(self.spline(chart.to_chart(directions)))

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Slopes of the spline, through the chart ``(x, y) / (r + z)``, which is constant along r."""
        at = chart.to_chart(directions)
        total = np.zeros_like(directions)
        shifted = directions + np.array([0.0, 0.0, 1.0])
        for axis, order in enumerate(((1, 0), (0, 1))):
            slope = self.spline(at, nu=order)
            towards = np.eye(3)[axis] - at[:, axis, None] * shifted
            total += slope[:, None] * towards / shifted[:, 2:]
        return total


def degree_study(measured: TableMeasurement, settings: Sequence[float] = SETTINGS) -> ConvergenceStudy:
    """Splines of each degree at each number of nodes; seconds are those of tracing the rays, by NumPy and torch."""
    reference = measured.reference
    lens = reference.lens
    levels = []
    for setting in settings:
        grid = grid_for(lens.detail_rad, setting)
        samples = {name: samples_of(grid, getattr(lens, name)) for name in SURFACES}
        for name, degree in DEGREES.items():
            made = {side: SplineSurface.through(grid, samples[side], degree, lens.detail_rad) for side in SURFACES}
            other = replace(lens, surfaces=made)
            with Meter() as meter:
                light = landed_exactly(other, measured.grid, measured.tables, reference.rays, NEWTON_STEPS)
            shapes = {side: (one.radius(directions()), one.normal(directions())) for side, one in made.items()}
            errors = reference.shape_errors(shapes) | reference.light_errors(light.hits, light.flux)
            users = ("all tables",) if name == "cubic" else ()
            levels.append(meter.level(setting, name, errors, users, nodes=grid.nodes))
    orders = {
        name: orders_of([level for level in levels if level.series == name], ("rho", "normal")) for name in DEGREES
    }
    levels.append(reference.level("exact sum", SHAPE_UNITS | LIGHT_UNITS))
    return ConvergenceStudy(
        name="degrees",
        title="Degree of the splines",
        knob="nodes per sigma",
        reference=f"the exact sum: {len(reference.rays)} rays; the degree of the tables is fixed, cubic",
        plotted=(),
        against="setting",
        levels=tuple(levels),
        order=orders,
    )


def samples_of(grid: TableGrid, surface: Surface) -> Float[np.ndarray, "c c"]:
    """Radii (mm) at the nodes of ``grid`` and of the apron around them."""
    nodes = grid.sample_directions()
    count = round(len(nodes) ** 0.5)
    return surface.radius_on_grid(nodes.reshape(count, count, 3))


def studies_of(measured: TableMeasurement) -> list[ConvergenceStudy]:
    return [degree_study(replace(measured, reference=measured.reference.thinned(THINNED)))]


if __name__ == "__main__":
    main("Degree of the table splines, measured on finished lenses.", studies_of)
