"""What the optimiser turns: relative weights and offsets of the free surfaces, and the tables of both."""

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.optimisation.sparse import SparseMatrix
from lensforge.lens import Lens
from lensforge.receivers.losses import mirror_mean
from lensforge.spec import Spec
from lensforge.surfaces.spline import TableGrid, grid_for, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface
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
        """Table coefficients of ``c`` sets of weights, first index Y."""
        side, nodes = self.refine.rows.shape
        samples = (self.samples @ weights).reshape(nodes, -1)
        along_x = (self.refine @ samples).reshape(side, nodes, -1)
        along_y = self.refine @ along_x.transpose(0, 1).reshape(nodes, -1)
        return along_y.reshape(side, side, -1)


@dataclass(frozen=True)
class Parametrisation:
    """Both surfaces share one basis, so the same maps make both tables.

    Parameters are relative to the starting offsets: a unit step means the same for a lens of any size. Column 0 is
    the inner surface, column 1 the outer. A ``fixed`` surface has its columns, too: they change nothing.
    """

    basis: SrbfBasis
    grid: TableGrid
    levels: tuple[LevelMap, ...]
    scale_mm: Float[Tensor, "2"]
    fixed: tuple[Surface | None, Surface | None] = (None, None)

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "Parametrisation":
        """For the spec's lens, on a grid that resolves its narrowest feature."""
        lens, basis = spec.lens, spec.lens.basis
        details = [basis.detail_rad, *(surface.detail_rad for surface in lens.fixed if surface is not None)]
        grid = grid_for(min(details), nodes_per_sigma)
        levels = tuple(LevelMap.of(level) for level in weight_maps(grid, basis))
        return Parametrisation(basis, grid, levels, torch.tensor(lens.start_mm, dtype=torch.float64), lens.fixed)

    def tables(
        self, weights: Float[Tensor, "k 2"], offsets: Float[Tensor, "2"]
    ) -> tuple[Float[Tensor, "side side"], Float[Tensor, "side side"]]:
        """Tables (mm) of both surfaces from the first ``k`` relative weights; differentiable."""
        total, first = torch.zeros(1, dtype=torch.float64), 0
        for level in self.levels:
            if first < len(weights):
                total = total + level.coefficients(weights[first : first + level.functions])
            first += level.functions
        images = ((total + offsets) * self.scale_mm).unbind(dim=-1)
        # images have y in their rows, tables X
        inner, outer = (
            mirror_mean(images[i], self.basis.symmetry).T if still is None else still
            for i, still in enumerate(self._fixed_tables)
        )
        return inner.contiguous(), outer.contiguous()

    @cached_property
    def _fixed_tables(self) -> list[Float[Tensor, "side side"] | None]:
        return [None if still is None else torch.from_numpy(tabulate(self.grid, still)) for still in self.fixed]

    def lens(
        self, weights: Float[Tensor, "m 2"], offsets: Float[Tensor, "2"], spec: Spec, seed: int, accuracy: str
    ) -> Lens:
        """The frozen record of these parameters."""
        millimetres, radii = (weights * self.scale_mm).numpy(), (offsets * self.scale_mm).tolist()
        inner, outer = (
            SrbfSurface(self.basis, millimetres[:, i].copy(), radii[i]) if still is None else still
            for i, still in enumerate(self.fixed)
        )
        return Lens(inner, outer, spec, seed, accuracy)
