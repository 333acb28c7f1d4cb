"""Bicubic tables of ``rho`` in plain torch, on any device: the same coefficients and bounds as those of the kernels.

Rays lie along the last axis of every tensor inside a table, so that neighbouring rays are neighbours in memory.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from lensforge.kernels.bounds import SurfaceBounds
from lensforge.kernels.spline import uniform_cubic
from lensforge.surfaces.spline import TableGrid
from lensforge.tracing.tables import Scene, checked_bounds


@dataclass(frozen=True)
class DeviceTable:
    """``coefficients`` (mm), and the bounds for the search; ``tiles`` are those of ``bounds``, on the device."""

    coefficients: Float[Tensor, "side side"]
    grid: TableGrid
    bounds: SurfaceBounds
    tiles: Float[Tensor, "3 t t"]

    @staticmethod
    def of(
        table: Float[Tensor, "side side"], grid: TableGrid, bounds: SurfaceBounds, device: torch.device
    ) -> "DeviceTable":
        """Copy of ``table`` on ``device``, through which gradients pass."""
        tiles = torch.from_numpy(bounds.tiles).permute(2, 0, 1).contiguous().to(device)
        return DeviceTable(table.to(device, torch.float64), grid, bounds, tiles)

    def value_and_slope(
        self, X: Float[Tensor, " n"], Y: Float[Tensor, " n"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"], Float[Tensor, " n"]]:
        """``rho``, d rho/dX, d rho/dY at points of the chart; differentiable in them and in the coefficients."""
        per_step = 1.0 / self.grid.step
        u, v = ((at - self.grid.origin) * per_step for at in (X, Y))
        i, j = self._cell(u), self._cell(v)
        four = torch.arange(-1, 3, device=i.device)
        rows, columns = (i + four[:, None])[:, None], (j + four[:, None])[None, :]
        # by one index: its backward pass adds in a fixed order, on a GPU too
        block = self.coefficients.reshape(-1)[rows * self.grid.side + columns]
        (wx, dx), (wy, dy) = (map(torch.stack, uniform_cubic(f)[:2]) for f in (u - i, v - j))
        along, across = (block * wy).sum(dim=1), (block * dy).sum(dim=1)
        return (wx * along).sum(dim=0), (dx * along).sum(dim=0) * per_step, (wx * across).sum(dim=0) * per_step

    def _cell(self, position: Float[Tensor, " n"]) -> Int[Tensor, " n"]:
        """The second of the four coefficients that act at ``position`` (in steps), kept inside the table."""
        return position.detach().to(torch.int64).clamp(1, self.grid.side - 3)

    def bounds_near(self, X: Float[Tensor, " n"], Y: Float[Tensor, " n"]) -> Float[Tensor, "3 n"]:
        """Least rho, largest gradient and Hessian near a direction; indices stay within the table even for NaN."""
        i, j = (
            ((at - self.grid.origin) * self.bounds.per_unit).to(torch.int64).clamp(0, self.tiles.shape[1] - 1)
            for at in (X, Y)
        )
        return self.tiles[:, i, j]

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|`` (mm), Eq. (5): positive inside."""
        r = torch.linalg.norm(points, dim=1)
        shift = (r + points[:, 2]).clamp(min=torch.finfo(points.dtype).tiny)
        gap: Tensor = self.value_and_slope(points[:, 0] / shift, points[:, 1] / shift)[0] - r
        return gap

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        x, y, z = points.unbind(dim=1)
        r = torch.linalg.norm(points, dim=1)
        per_shift = 1.0 / (r + z)
        _, rho_x, rho_y = self.value_and_slope(x * per_shift, y * per_shift)
        radial = (rho_x * x + rho_y * y) * per_shift * per_shift
        along = (1.0 + radial) / r
        return torch.stack((x * along - rho_x * per_shift, y * along - rho_y * per_shift, z * along + radial), dim=1)


def tables_on(
    device: torch.device, inner: Float[Tensor, "side side"], outer: Float[Tensor, "side side"], scene: Scene
) -> tuple[DeviceTable, DeviceTable]:
    """Both tables and their bounds on ``device``. Raises :class:`InputError` for a radius that is not positive."""
    bounds = checked_bounds(inner, outer, scene)
    first, second = (
        DeviceTable.of(table, scene.grid, bound, device) for table, bound in zip((inner, outer), bounds, strict=True)
    )
    return first, second
