"""Parameters of a search: relative weights and offsets of the free surfaces, and the tables of both.

The tables are a differentiable torch operation.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import remedy
from lensforge.kernels.parallel import in_parallel
from lensforge.scene.lens import Lens
from lensforge.search.symmetry import mirror_mean
from lensforge.spec import Accuracy, LensSection, Spec
from lensforge.surfaces.basis_tables import BasisTables, dyadic_grid
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere, level_sigma
from lensforge.surfaces.surface import Surface


class _Tables(torch.autograd.Function):
    """The tables of both columns of weights, a thread for each; and the gradient by the weights."""

    @staticmethod
    def forward(ctx: Any, weights: Tensor, tables: BasisTables) -> Tensor:
        ctx.tables, ctx.count = tables, len(weights)
        columns = np.ascontiguousarray(weights.detach().numpy().T)
        both = np.empty((2, tables.side, tables.side))

        def work(face: int) -> None:
            both[face] = tables.table(columns[face])

        in_parallel(work, 2)
        return torch.from_numpy(both)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        by_tables = gradients[0].contiguous().numpy()
        by_weights = np.empty((ctx.count, 2))

        def work(face: int) -> None:
            by_weights[:, face] = ctx.tables.by_weights(by_tables[face], ctx.count)

        in_parallel(work, 2)
        return torch.from_numpy(by_weights), None


_FIT_DIRECTIONS, _FIT_CHUNK = 8, 4096  # for each function; at a time
_FIT_DAMPING = 1e-10


@dataclass(frozen=True)
class Parametrisation:
    """Parameters of both surfaces, which share one basis and one map to tables.

    Parameters are relative to the starting offsets: a unit step means the same for a lens of any size. Column 0 is
    the inner surface, column 1 the outer. The column of a ``fixed`` surface has no effect.
    """

    basis: SrbfBasis
    grid: TableGrid
    basis_tables: BasisTables
    scale_mm: Float[Tensor, "2"]
    fixed: tuple[Surface | None, Surface | None] = (None, None)

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "Parametrisation":
        """Parametrisation of the spec's lens, on a grid that resolves its narrowest feature."""
        lens, basis = spec.lens, spec.lens.basis
        with remedy("raise lens.sigma_c, lower the last of lens.levels, or take a lower accuracy"):
            sigmas = [level_sigma(count, basis.sigma_c) for count in basis.levels]
            grid, halvings = dyadic_grid([*sigmas, *_fixed_details(lens)], nodes_per_sigma)
            tables = BasisTables.of(basis, grid, halvings[: len(sigmas)])
        return Parametrisation(basis, grid, tables, torch.tensor(lens.start_mm, dtype=torch.float64), lens.fixed)

    def refined(self) -> "Parametrisation":
        """The same splines as tables of half the step."""
        grid = TableGrid(2 * self.grid.nodes - 1)
        return replace(self, grid=grid, basis_tables=replace(self.basis_tables, side=grid.side))

    def tables(
        self, weights: Float[Tensor, "k 2"], offsets: Float[Tensor, "2"]
    ) -> tuple[Float[Tensor, "side side"], Float[Tensor, "side side"]]:
        """Tables (mm) of both surfaces from the first ``k`` relative weights; differentiable."""
        coefficients: Tensor = _Tables.apply(weights, self.basis_tables)  # type: ignore[no-untyped-call]  # as torch has it
        free = ((coefficients.permute(2, 1, 0) + offsets) * self.scale_mm).unbind(dim=-1)
        inner, outer = (
            mirror_mean(free[i].T, self.basis.symmetry) if fixed is None else fixed
            for i, fixed in enumerate(self._fixed_tables)
        )
        return inner.contiguous(), outer.contiguous()

    @cached_property
    def _fixed_tables(self) -> list[Float[Tensor, "side side"] | None]:
        return [None if fixed is None else torch.from_numpy(tabulate(self.grid, fixed)) for fixed in self.fixed]

    def parameters_of(self, lens: Lens) -> tuple[Float[Tensor, "m 2"], Float[Tensor, "2"]]:
        """Relative weights and offsets that give the free surfaces of ``lens``.

        Exact where a surface has this basis; any other is fitted in least squares over the hemisphere.
        """
        weights = torch.zeros(self.basis.size, 2, dtype=torch.float64)
        offsets = torch.ones(2, dtype=torch.float64)
        for side, (surface, fixed) in enumerate(zip((lens.inner, lens.outer), self.fixed, strict=True)):
            if fixed is None:
                fitted = _in_basis(self.basis, surface)
                scale = self.scale_mm[side]
                weights[:, side] = torch.from_numpy(fitted.weights_mm) / scale
                offsets[side] = fitted.offset_mm / scale
        return weights, offsets

    def lens(
        self, weights: Float[Tensor, "m 2"], offsets: Float[Tensor, "2"], spec: Spec, seed: int, accuracy: Accuracy
    ) -> Lens:
        """The frozen record of these parameters."""
        millimetres, radii = (weights * self.scale_mm).numpy(), (offsets * self.scale_mm).tolist()
        inner, outer = (
            SrbfSurface(self.basis, millimetres[:, i].copy(), radii[i]) if fixed is None else fixed
            for i, fixed in enumerate(self.fixed)
        )
        return Lens(inner, outer, spec, seed, accuracy)


def _fixed_details(lens: LensSection) -> list[float]:
    return [surface.detail_rad for surface in lens.fixed if surface is not None]


def _in_basis(basis: SrbfBasis, surface: Surface) -> SrbfSurface:
    if isinstance(surface, SrbfSurface) and surface.basis == basis:
        return surface
    return fit_surface(basis, surface)


def fit_surface(basis: SrbfBasis, surface: Surface) -> SrbfSurface:
    """Fit ``surface`` by a sum over ``basis``: least squares of the radius over the hemisphere.

    Its offset is the mean radius; slight damping keeps the weights of nearly dependent functions small.
    """
    directions = fibonacci_hemisphere(_FIT_DIRECTIONS * basis.size)
    radius = surface.radius(directions)
    offset = float(radius.mean())
    normal, right = np.zeros((basis.size, basis.size)), np.zeros(basis.size)
    for rows in np.array_split(np.arange(len(directions)), max(1, len(directions) // _FIT_CHUNK)):
        values = basis.evaluate(directions[rows])
        normal += values.T @ values
        right += values.T @ (radius[rows] - offset)
    normal[np.diag_indices(basis.size)] += _FIT_DAMPING * float(np.trace(normal)) / basis.size
    return SrbfSurface(basis, np.linalg.solve(normal, right), offset)
