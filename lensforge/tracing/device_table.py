"""A bicubic table of ``rho`` over the stereographic chart, in plain torch on any device: what ``spline_kernel`` is.

Rays lie along the last axis of every tensor here, so that neighbours in memory are neighbours in the work.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from lensforge.surfaces.spline import TableGrid
from lensforge.tracing.bounds_kernel import SurfaceBounds


@dataclass(frozen=True)
class DeviceTable:
    """``coefficients`` (mm), and the bounds that a search goes by; ``tiles`` are those of ``bounds``, on the device."""

    coefficients: Float[Tensor, "side side"]
    grid: TableGrid
    bounds: SurfaceBounds
    tiles: Float[Tensor, "3 t t"]

    @staticmethod
    def of(
        table: Float[Tensor, "side side"], grid: TableGrid, bounds: SurfaceBounds, device: torch.device
    ) -> "DeviceTable":
        """A copy of ``table`` on ``device``; its gradient finds the way back."""
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
        (wx, dx), (wy, dy) = _cubic_weights(u - i), _cubic_weights(v - j)
        along, across = (block * wy).sum(dim=1), (block * dy).sum(dim=1)
        return (wx * along).sum(dim=0), (dx * along).sum(dim=0) * per_step, (wx * across).sum(dim=0) * per_step

    def _cell(self, position: Float[Tensor, " n"]) -> Int[Tensor, " n"]:
        """The second of the four coefficients that act at ``position`` (in steps), kept inside of the table."""
        return position.detach().to(torch.int64).clamp(1, self.grid.side - 3)

    def bounds_near(self, X: Float[Tensor, " n"], Y: Float[Tensor, " n"]) -> Float[Tensor, "3 n"]:
        """Least rho, largest gradient and Hessian near a direction, from inside of the table also for no number."""
        i, j = (
            ((at - self.grid.origin) * self.bounds.per_unit).to(torch.int64).clamp(0, self.tiles.shape[1] - 1)
            for at in (X, Y)
        )
        return self.tiles[:, i, j]


def _cubic_weights(f: Float[Tensor, " n"]) -> tuple[Float[Tensor, "4 n"], Float[Tensor, "4 n"]]:
    """Uniform cubic B-spline: the four weights, and their derivatives in units of the step."""
    g = 1.0 - f
    weights = g**3 / 6.0, 2.0 / 3.0 - f**2 * (1.0 - 0.5 * f), 2.0 / 3.0 - g**2 * (1.0 - 0.5 * g), f**3 / 6.0
    slopes = -0.5 * g**2, f * (1.5 * f - 2.0), g * (2.0 - 1.5 * g), 0.5 * f**2
    return torch.stack(weights), torch.stack(slopes)
