"""Parameters of a search: relative weights and offsets of the free surfaces, and the tables of both."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import remedy
from lensforge.kernels.sparse import SparseMatrix
from lensforge.lens import Lens
from lensforge.optimisation.symmetry import mirror_mean
from lensforge.spec import Accuracy, Spec
from lensforge.surfaces.spline import TableGrid, grid_for, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface
from lensforge.surfaces.weight_maps import WeightMap, weight_maps

_FIT_DIRECTIONS, _FIT_CHUNK = 8, 4096  # for each function; at a time
_FIT_DAMPING = 1e-10


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
class Parametrisation:
    """Parameters of both surfaces, which share one basis: the same maps make both tables.

    Parameters are relative to the starting offsets: a unit step means the same for a lens of any size. Column 0 is
    the inner surface, column 1 the outer. The column of a ``fixed`` surface has no effect.
    """

    basis: SrbfBasis
    grid: TableGrid
    levels: tuple[LevelMap, ...]
    scale_mm: Float[Tensor, "2"]
    fixed: tuple[Surface | None, Surface | None] = (None, None)

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "Parametrisation":
        """Parametrisation of the spec's lens, on a grid that resolves its narrowest feature."""
        lens, basis = spec.lens, spec.lens.basis
        details = [basis.detail_rad, *(surface.detail_rad for surface in lens.fixed if surface is not None)]
        with remedy("raise lens.sigma_c, lower the last of lens.levels, or take a lower accuracy"):
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
        free = ((total + offsets) * self.scale_mm).unbind(dim=-1)
        inner, outer = (
            mirror_mean(free[i].T, self.basis.symmetry, x_axis=0) if fixed is None else fixed
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
