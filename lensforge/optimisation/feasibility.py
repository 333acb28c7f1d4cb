"""Whether the finished lens is feasible: its constraints by the exact sum, and a gate for each."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.gates import Gate, at_least
from lensforge.lens import Lens
from lensforge.optimisation.constraints import Constraint, constraints_of
from lensforge.optimisation.design import Margins
from lensforge.optimisation.watch import ChartPoints, RadiusJet, Watch, watched_points
from lensforge.spec import Spec
from lensforge.surfaces import chart
from lensforge.surfaces.spline import TableGrid, grid_for, tabulate
from lensforge.surfaces.srbf import fibonacci_hemisphere

# Curvature and draft come from a table of the exact sum, by differences of fourth order: at 8 nodes across the
# narrowest function its curvature is off by less than 1e-4, and a window of 21 x 21 points looks between the nodes.
_NODES_PER_SIGMA = 8.0
_ZOOM_POINTS = 21


def measure_constraints(lens: Lens, directions: int = 60_000) -> Margins:
    """The least value of each constraint.

    Lengths: by the exact sum, over a Fibonacci grid of the hemisphere and its rim.
    """
    constraints = constraints_of(lens.spec)
    points, inner, outer = _exact_radii(lens, directions)
    found = {each.key: float(each.field(inner, outer, points).min()) for each in constraints if not each.derivatives}
    of_shape = [each for each in constraints if each.derivatives]
    if of_shape:
        grid = grid_for(lens.detail_rad, _NODES_PER_SIGMA)
        tables = [torch.from_numpy(tabulate(grid, surface)) for surface in (lens.inner, lens.outer)]
        everywhere = watched_points(grid, lens.spec.lens.basis.symmetry)
        found |= {each.key: _least(each, grid, everywhere, tables) for each in of_shape}
    return Margins.model_validate(found)


def constraint_gates(spec: Spec, measured: Margins) -> tuple[Gate, ...]:
    """One gate for each constraint of ``spec``: at least 0 but for its tolerance."""
    return tuple(
        at_least(each.name, getattr(measured, each.key), -each.tolerance, each.unit, each.remedy)
        for each in constraints_of(spec)
    )


def _exact_radii(lens: Lens, directions: int) -> tuple[ChartPoints, RadiusJet, RadiusJet]:
    azimuth = np.linspace(0.0, 2.0 * np.pi, 2048, endpoint=False)
    rim = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)
    u = np.concatenate([fibonacci_hemisphere(directions), rim])
    nothing = torch.empty(0, len(u), dtype=torch.float64)
    inner, outer = (RadiusJet(torch.from_numpy(each.radius(u)), nothing) for each in (lens.inner, lens.outer))
    return ChartPoints.of(chart.to_chart(u)), inner, outer


def _least(
    constraint: Constraint, grid: TableGrid, points: Float[np.ndarray, "k 2"], tables: list[Float[Tensor, "s s"]]
) -> float:
    """The minimum over ``points``, then over finer ones around where it is."""
    least, step = np.inf, grid.step
    for _ in range(2):
        watch = Watch.of(grid, points, derivatives=True)
        inner, outer = watch.jets(*tables)
        field = constraint.field(inner, outer, watch.points)
        least, at = min(least, float(field.min())), points[int(field.argmin())]
        window = at + chart.grid(_ZOOM_POINTS, step).reshape(-1, 2)
        points = window / np.maximum(1.0, np.linalg.norm(window, axis=1, keepdims=True))
    return least
