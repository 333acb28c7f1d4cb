"""Tables of both surfaces from the maps of all levels to one grid, as differentiable torch operations."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.kernels.sparse import SparseMatrix
from lensforge.surfaces.spline import TableGrid
from lensforge.surfaces.srbf import SrbfBasis
from lensforge.surfaces.weight_maps import WeightMap, weight_maps


@dataclass(frozen=True)
class LevelMap:
    """A :class:`~lensforge.surfaces.weight_maps.WeightMap` as differentiable operations."""

    samples: SparseMatrix
    refine: SparseMatrix

    @staticmethod
    def of(level: WeightMap) -> "LevelMap":
        """The same numbers."""
        return LevelMap(SparseMatrix(level.samples), SparseMatrix(level.refine))

    @property
    def functions(self) -> int:
        """Number of weights."""
        count: int = self.samples.rows.shape[1]
        return count

    def coefficients(self, weights: Float[Tensor, "m c"]) -> Float[Tensor, "side side c"]:
        """Table coefficients of ``c`` sets of weights, first index Y: the product ends with it."""
        side, nodes = self.refine.rows.shape
        samples = (self.samples @ weights).reshape(nodes, -1)
        along_x = (self.refine @ samples).reshape(side, nodes, -1)
        along_y = self.refine @ along_x.transpose(0, 1).reshape(nodes, -1)
        return along_y.reshape(side, side, -1)


@dataclass(frozen=True)
class LevelMaps:
    """The maps of all levels, coarse first."""

    levels: tuple[LevelMap, ...]

    @staticmethod
    def of(grid: TableGrid, basis: SrbfBasis) -> "LevelMaps":
        """The maps of ``basis`` to tables on ``grid``."""
        return LevelMaps(tuple(LevelMap.of(level) for level in weight_maps(grid, basis)))

    def coefficients(self, weights: Float[Tensor, "k 2"]) -> Float[Tensor, "side side 2"]:
        """Table coefficients, first index Y, of both columns of the first ``k`` weights; differentiable."""
        total, first = torch.zeros(1, dtype=torch.float64), 0
        for level in self.levels:
            if first < len(weights):
                total = total + level.coefficients(weights[first : first + level.functions])
            first += level.functions
        return total
