"""Curvature, draft and wall of faces at points of the chart, as torch operations of their own.

Each has its derivatives in closed form: chains of torch's operations on a thousand points cost more than the numbers.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.kernels.clearance import Feet, nearest_on_table
from lensforge.kernels.face_shape import (
    ChartPlaces,
    draft_sines,
    draft_sines_adjoint,
    least_curvatures,
    least_curvatures_adjoint,
)
from lensforge.search.constraint_points import ChartPoints, RadiusJet
from lensforge.surfaces import surface
from lensforge.surfaces.bicubic_table import TableGrid

_CURVATURE = least_curvatures, least_curvatures_adjoint
_DRAFT = draft_sines, draft_sines_adjoint
_EVERY = 2  # node of a table from which a nearest point is looked for: a valley is several nodes wide


def least_curvature(jet: RadiusJet, points: ChartPoints, air: int) -> Float[Tensor, " k"]:
    """The smaller principal curvature (1/mm) seen from the air: negative where concave.

    ``air`` is 1 where the air, and with it the cutter, is outside the surface, and -1 where it is inside.
    """
    return _of_jet(_CURVATURE, jet, points, air)


def meridian_curvature(jet: RadiusJet, points: ChartPoints, air: int) -> Float[Tensor, " k"]:
    """The curvature (1/mm) of the meridian seen from the air, negative where concave; ``air`` as for the smaller one.

    Of a line at the distance rho from the origin by its polar angle: (rho^2 + 2 rho'^2 - rho rho'') / (...)^(3/2).
    """
    by_x, by_y, xx, xy, yy = jet.derivatives
    radius = torch.sqrt(points.x**2 + points.y**2)
    known = radius > 0.0
    far = torch.clamp(radius, min=torch.finfo(radius.dtype).tiny)
    x, y = torch.where(known, points.x / far, 1.0), torch.where(known, points.y / far, 0.0)
    first = (x * by_x + y * by_y) / points.scale
    second = (x * x * xx + 2.0 * x * y * xy + y * y * yy) / points.scale**2 + radius * first
    speed = jet.rho**2 + first**2
    return air * (speed + first**2 - jet.rho * second) * speed ** (-1.5)


def draft_sine(jet: RadiusJet, points: ChartPoints, sense: int = 1) -> Float[Tensor, " k"]:
    """Sine of the draft angle, ``n . z`` of the outward normal, times ``sense``; negative in an undercut.

    The same for every face of a double lens: the mould half of the envelope opens along +z, the core of the cavity
    along -z, and their normals are opposite too.
    """
    return _of_jet(_DRAFT, jet, points, sense)


def _of_jet(kernels: Any, jet: RadiusJet, points: ChartPoints, sign: int) -> Float[Tensor, " k"]:
    return _OfJet.apply(  # type: ignore[no-untyped-call]  # as torch has it
        jet.rho, jet.derivatives, kernels, points, float(sign)
    )


class _OfJet(torch.autograd.Function):
    """A field of radius and derivatives by a pair of kernels, the second its adjoint."""

    @staticmethod
    def forward(ctx: Any, rho: Tensor, derivatives: Tensor, kernels: Any, points: ChartPoints, sign: float) -> Tensor:
        jet = [np.ascontiguousarray(tensor.detach().numpy()) for tensor in (rho, derivatives)]
        places = ChartPlaces(points.x.numpy(), points.y.numpy(), points.scale.numpy())
        ctx.adjoint = kernels[1]
        ctx.places = (*jet, places, sign)
        gradients = np.empty_like(jet[0])
        kernels[0](*ctx.places, gradients)
        return torch.from_numpy(gradients)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        rho, derivatives = ctx.places[:2]
        by_rho = np.empty_like(rho)
        by_derivatives = np.empty_like(derivatives)
        ctx.adjoint(gradients[0].contiguous().numpy(), *ctx.places, by_rho, by_derivatives)
        return torch.from_numpy(by_rho), torch.from_numpy(by_derivatives), None, None, None


def wall_mm(inside: RadiusJet, outside: RadiusJet, points: ChartPoints, reach_mm: float) -> Float[Tensor, " k"]:
    """Distance (mm) from points of one face to the one outside of it above z = 0; below 0 where the two cross.

    Exact up to ``reach_mm``, in the valley of the nearest node, which on the wildest faces is not the nearest for one
    point in a hundred. Where the wall is thicker it may be the longer way along the ray: only thin places bind.
    """
    radial = outside.rho - inside.rho
    walls: list[Tensor] = [
        _ToTable.apply(inside.rho, table, radial, points, reach_mm)  # type: ignore[no-untyped-call]  # as torch has it
        for table in outside.tables
    ]
    return walls[0] if len(walls) == 1 else torch.stack(walls).amin(dim=0)


class _ToTable(torch.autograd.Function):
    """Distance (mm) to one face: beyond the others that bound the body it is farther than they are.

    As the nearest point moves along the surface the distance stays, so its derivatives are those at fixed directions.
    """

    @staticmethod
    def forward(ctx: Any, rho: Tensor, outside: Tensor, radial: Tensor, points: ChartPoints, reach_mm: float) -> Tensor:
        table = outside.detach().numpy()
        grid = TableGrid(len(outside) - 2)
        ways = points.directions.numpy()
        starts = rho.detach().numpy()[:, None] * ways
        distances = radial.detach().numpy().copy()
        feet = nearest_on_table(
            table, grid.origin, grid.step, _places(grid, table), _EVERY * grid.step, starts, distances, reach_mm
        )
        ahead = surface.to_sphere(feet.chart)
        radius = (table.reshape(-1)[feet.columns] * feet.shares).sum(axis=1)
        lines = radius[:, None] * ahead - starts[feet.points]
        length = np.linalg.norm(lines, axis=1)
        sign = np.sign(distances[feet.points])
        unit = lines * (sign / np.where(length > 0.0, length, np.inf))[:, None]
        distances[feet.points] = length * sign
        ctx.feet = feet
        ctx.side = table.shape
        ctx.slopes = -(unit * ways[feet.points]).sum(axis=1), (unit * ahead).sum(axis=1)
        return torch.from_numpy(distances)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Any:
        feet: Feet = ctx.feet
        by_radial = gradients[0].numpy().copy()
        by = by_radial[feet.points]
        by_rho = np.zeros_like(by_radial)
        by_radial[feet.points] = 0.0
        by_rho[feet.points] = by * ctx.slopes[0]
        binding = np.flatnonzero(by)
        shares = (by * ctx.slopes[1])[binding, None] * feet.shares[binding]
        by_table = np.bincount(feet.columns[binding].ravel(), shares.ravel(), np.prod(ctx.side)).reshape(ctx.side)
        return torch.from_numpy(by_rho), torch.from_numpy(by_table), torch.from_numpy(by_radial), None, None


def _places(grid: TableGrid, table: Float[np.ndarray, "side side"]) -> Float[np.ndarray, "n n 3"]:
    """Points (mm) at every second node of a table; the last node may lie beyond them."""
    along = (table[:-2] + 4.0 * table[1:-1] + table[2:])[::_EVERY] / 6.0
    rho = (along[:, :-2] + 4.0 * along[:, 1:-1] + along[:, 2:])[:, ::_EVERY] / 6.0
    return rho[:, :, None] * _directions(grid)


@lru_cache(maxsize=4)
def _directions(grid: TableGrid) -> Float[np.ndarray, "n n 3"]:
    return surface.to_sphere(surface.grid(grid.nodes)[::_EVERY, ::_EVERY])
