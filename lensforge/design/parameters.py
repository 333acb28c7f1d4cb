"""What the optimiser turns: relative weights and offsets of the free surfaces, and the tables of both."""

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.lens import Lens
from lensforge.spec import Spec
from lensforge.surfaces.spline import TableGrid, grid_for, tabulate, weight_matrix
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class Parametrisation:
    """Both surfaces share one basis, so one matrix makes both tables.

    Parameters are relative to the starting offsets: a unit step means the same for a lens of any size. Column 0 is
    the inner surface, column 1 the outer. A ``fixed`` surface has its columns, too: they change nothing.
    """

    basis: SrbfBasis
    grid: TableGrid
    matrix: Float[Tensor, "s m"]
    scale_mm: Float[Tensor, "2"]
    fixed: tuple[Surface | None, Surface | None] = (None, None)

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "Parametrisation":
        """For the spec's lens, on a grid that resolves its narrowest function."""
        lens, basis = spec.lens, spec.lens.basis
        inner, outer = (section and section.surface for section in (lens.fixed_inner, lens.fixed_outer))
        finest = min(surface.detail_rad for surface in (basis, inner, outer) if surface is not None)
        grid = grid_for(finest, nodes_per_sigma)
        matrix = torch.from_numpy(weight_matrix(grid, basis))
        return Parametrisation(basis, grid, matrix, torch.tensor(lens.start_mm, dtype=torch.float64), (inner, outer))

    def tables(
        self, weights: Float[Tensor, "k 2"], offsets: Float[Tensor, "2"]
    ) -> tuple[Float[Tensor, "side side"], Float[Tensor, "side side"]]:
        """Tables (mm) of both surfaces from the first ``k`` relative weights; differentiable."""
        columns = (self.matrix[:, : len(weights)] @ weights + offsets) * self.scale_mm
        side = self.grid.side
        inner, outer = (
            columns[:, i].reshape(side, side) if still is None else still for i, still in enumerate(self._fixed_tables)
        )
        return inner, outer

    @cached_property
    def _fixed_tables(self) -> list[Float[Tensor, "side side"] | None]:
        return [surface and torch.from_numpy(tabulate(self.grid, surface)) for surface in self.fixed]

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
