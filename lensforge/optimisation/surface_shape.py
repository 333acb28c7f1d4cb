"""Curvature and draft of a star-shaped surface from its radius over the chart, wall between two; differentiable.

With ``w = ln(rho)``, its gradient ``g`` and Hessian ``W`` on the unit sphere, and ``v = sqrt(1 + |g|^2)``, the first
and second fundamental forms of ``rho u`` are ``rho^2 (I + g g')`` and ``rho (I + g g' - W) / v``, so that the
principal curvatures are the eigenvalues of ``(I - P W P) / (rho v)`` with ``P = (I + g g')^(-1/2)``: symmetric, hence
exact at umbilics, and ``1/rho`` for a sphere about the origin.
"""

from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.kernels.nearest import nearest_on_table
from lensforge.optimisation.chart_points import ChartPoints, RadiusJet
from lensforge.surfaces import chart
from lensforge.surfaces.spline import TableGrid

_EVERY = 2  # node of a table from which a nearest point is looked for: a valley is several nodes wide
_UMBILIC = 1e-24  # below the rounding of a squared eigenvalue: keeps the derivative of the root finite


def least_curvature(jet: RadiusJet, points: ChartPoints, air: int) -> Float[Tensor, " k"]:
    """The smaller principal curvature (1/mm) seen from the air: negative where concave.

    ``air`` is 1 where the air, and with it the cutter, is outside the surface, and -1 where it is inside.
    """
    g_x, g_y = _gradient(jet, points)
    w_xx, w_xy, w_yy = _hessian(jet, points)
    v = torch.sqrt(1.0 + g_x**2 + g_y**2)
    c = 1.0 / (v * (v + 1.0))
    p_xx, p_xy, p_yy = 1.0 - c * g_x**2, -c * g_x * g_y, 1.0 - c * g_y**2
    # the columns of W P, and then P W P
    a_xx, a_xy = w_xx * p_xx + w_xy * p_xy, w_xx * p_xy + w_xy * p_yy
    a_yx, a_yy = w_xy * p_xx + w_yy * p_xy, w_xy * p_xy + w_yy * p_yy
    s_xx, s_xy, s_yy = p_xx * a_xx + p_xy * a_yx, p_xx * a_xy + p_xy * a_yy, p_xy * a_xy + p_yy * a_yy
    deviator = torch.sqrt((0.5 * (s_xx - s_yy)) ** 2 + s_xy**2 + _UMBILIC)
    return (air * (1.0 - 0.5 * (s_xx + s_yy)) - deviator) / (jet.rho * v)


def draft_sine(jet: RadiusJet, points: ChartPoints) -> Float[Tensor, " k"]:
    """Sine of the draft angle, ``n . z`` of the outward normal; negative in an undercut.

    The same for both faces: the mould half of the outer one opens along +z, the core of the cavity along -z, and their
    normals are opposite too.
    """
    g_x, g_y = _gradient(jet, points)
    rho_x, rho_y = jet.derivatives[:2]
    radial = (points.x * rho_x + points.y * rho_y) / jet.rho
    sine: Tensor = (points.cosine + radial) / torch.sqrt(1.0 + g_x**2 + g_y**2)
    return sine


def wall_mm(inner: RadiusJet, outer: RadiusJet, points: ChartPoints, reach_mm: float) -> Float[Tensor, " k"]:
    """Distance (mm) from points of the inner surface to the outer one above z = 0; below 0 where the surfaces cross.

    Exact up to ``reach_mm``; where the wall is thicker it may be the longer way along the ray: only thin places bind.
    As the nearest point moves along the surface the distance stays, so its derivatives are those at fixed directions.
    """
    assert outer.table is not None
    radial = outer.rho - inner.rho
    table, grid = outer.table.detach().numpy(), TableGrid(len(outer.table) - 2)
    starts = inner.rho[:, None] * points.directions
    there = starts.detach().numpy(), radial.detach().numpy(), reach_mm
    feet = nearest_on_table(table, grid.origin, grid.step, _places(grid, table), _EVERY * grid.step, *there)
    at, columns, shares = (torch.from_numpy(each) for each in (feet.points, feet.columns, feet.shares))
    rho = (outer.table.reshape(-1)[columns] * shares).sum(dim=1)
    ends = rho[:, None] * torch.from_numpy(chart.to_sphere(feet.chart))
    distance = torch.linalg.norm(ends - starts[at], dim=1) * torch.sign(radial.detach()[at])
    return radial.index_put((at,), distance)


def _places(grid: TableGrid, table: Float[np.ndarray, "side side"]) -> Float[np.ndarray, "n n 3"]:
    """Points (mm) at every second node of a table; the last node may lie beyond them."""
    along = (table[:-2] + 4.0 * table[1:-1] + table[2:])[::_EVERY] / 6.0
    rho = (along[:, :-2] + 4.0 * along[:, 1:-1] + along[:, 2:])[:, ::_EVERY] / 6.0
    points: Float[np.ndarray, "n n 3"] = rho[:, :, None] * _directions(grid)
    return points


@lru_cache(maxsize=4)
def _directions(grid: TableGrid) -> Float[np.ndarray, "n n 3"]:
    return chart.to_sphere(chart.grid(grid.nodes)[::_EVERY, ::_EVERY])


def _gradient(jet: RadiusJet, points: ChartPoints) -> tuple[Float[Tensor, " k"], Float[Tensor, " k"]]:
    """Gradient of ``ln(rho)`` on the unit sphere, along the chart's axes."""
    rho_x, rho_y = jet.derivatives[:2]
    per_angle = 1.0 / (jet.rho * points.scale)
    return rho_x * per_angle, rho_y * per_angle


def _hessian(
    jet: RadiusJet, points: ChartPoints
) -> tuple[Float[Tensor, " k"], Float[Tensor, " k"], Float[Tensor, " k"]]:
    """Covariant second derivatives of ``ln(rho)`` on the unit sphere: the chart is conformal with ``points.scale``."""
    w_x, w_y, r_xx, r_xy, r_yy = jet.derivatives / jet.rho
    f_x, f_y = -points.scale * points.x, -points.scale * points.y  # gradient of the scale's logarithm
    turn = f_x * w_x - f_y * w_y
    w_xx = r_xx - w_x * w_x - turn
    w_xy = r_xy - w_x * w_y - f_y * w_x - f_x * w_y
    w_yy = r_yy - w_y * w_y + turn
    return w_xx / points.scale**2, w_xy / points.scale**2, w_yy / points.scale**2
