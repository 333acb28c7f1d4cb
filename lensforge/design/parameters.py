"""What the optimiser turns: relative weights and offsets of both surfaces, and the tables that they make."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.lens import Lens
from lensforge.spec import Spec
from lensforge.surfaces.spline import TableGrid, grid_for, weight_matrix
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface


@dataclass(frozen=True)
class Parametrisation:
    """Both surfaces share one basis, so one matrix makes both tables.

    Parameters are relative to the starting offsets: a unit step means the same for a lens of any size. Column 0 is
    the inner surface, column 1 the outer.
    """

    basis: SrbfBasis
    grid: TableGrid
    matrix: Float[Tensor, "s m"]
    scale_mm: Float[Tensor, "2"]

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "Parametrisation":
        """For the spec's lens, on a grid that resolves its narrowest function."""
        lens = spec.lens
        basis = SrbfBasis(lens.levels, lens.sigma_c, lens.symmetry)
        grid = grid_for(float(basis.sigmas.min()), nodes_per_sigma)
        matrix = torch.from_numpy(weight_matrix(grid, basis))
        return Parametrisation(
            basis, grid, matrix, torch.tensor([lens.inner_offset_mm, lens.outer_offset_mm], dtype=torch.float64)
        )

    def tables(
        self, weights: Float[Tensor, "k 2"], offsets: Float[Tensor, "2"]
    ) -> tuple[Float[Tensor, "side side"], Float[Tensor, "side side"]]:
        """Tables (mm) of both surfaces from the first ``k`` relative weights; differentiable."""
        columns = (self.matrix[:, : len(weights)] @ weights + offsets) * self.scale_mm
        side = self.grid.side
        return columns[:, 0].reshape(side, side), columns[:, 1].reshape(side, side)

    def lens(
        self, weights: Float[Tensor, "m 2"], offsets: Float[Tensor, "2"], spec: Spec, seed: int, accuracy: str
    ) -> Lens:
        """The frozen record of these parameters."""
        millimetres, radii = (weights * self.scale_mm).numpy(), (offsets * self.scale_mm).tolist()
        inner, outer = (SrbfSurface(self.basis, millimetres[:, i].copy(), radii[i]) for i in (0, 1))
        return Lens(inner, outer, spec, seed, accuracy)
