"""Parameters of a search: relative weights and offsets of the free surfaces, and the tables of both.

The tables are differentiable torch operations: from the patches of the basis functions, or from the maps of all levels
to one grid.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import remedy
from lensforge.kernels.bicubic import add_patches, patch_sums, refine, refine_adjoint
from lensforge.kernels.parallel import in_parallel
from lensforge.kernels.sparse import SparseMatrix
from lensforge.scene.lens import Lens
from lensforge.search.symmetry import mirror_mean
from lensforge.spec import Accuracy, LensSection, Spec
from lensforge.surfaces.basis_tables import LevelPatches, WeightMap, dyadic_grid, level_patches, weight_maps
from lensforge.surfaces.bicubic_table import TableGrid, grid_for, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere, level_sigma
from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class PatchedTables:
    """Coefficients on a grid of ``side`` a side from the weights of all levels, coarse first."""

    levels: tuple[LevelPatches, ...]
    side: int

    @staticmethod
    def of(basis: SrbfBasis, grid: TableGrid, halvings: Sequence[int]) -> "PatchedTables":
        """For tables of ``basis`` on ``grid``, which may be halved so often for each level."""
        return PatchedTables(tuple(level_patches(basis, grid, halvings)), grid.side)

    def coefficients(self, weights: Float[Tensor, "k 2"]) -> Float[Tensor, "side side 2"]:
        """Table coefficients, first index Y, of both columns of the first ``k`` weights; differentiable."""
        tables: Tensor = _Tables.apply(weights, self)  # type: ignore[no-untyped-call]  # as torch has it
        return tables.permute(2, 1, 0)

    def table(self, weights: Float[np.ndarray, " k"]) -> Float[np.ndarray, "side side"]:
        """The table, first index X, of one surface."""
        side = self.levels[0].grid.side
        table = np.zeros((side, side))
        for level, own in self._moving(len(weights)):
            table = _finer(table, level.grid.side)
            add_patches(level.boxes, level.starts, level.values, weights[own], table)
        return _finer(table, self.side)

    def by_weights(self, by_table: Float[np.ndarray, "side side"], count: int) -> Float[np.ndarray, " k"]:
        """Adjoint of :meth:`table`: the gradient by the first ``count`` weights."""
        by_weights = np.empty(count)
        for level, own in reversed(list(self._moving(count))):
            by_table = _coarser(by_table, level.grid.side)
            patch_sums(level.boxes, level.starts, level.values, by_table, by_weights[own])
        return by_weights

    def _moving(self, count: int) -> Iterator[tuple[LevelPatches, slice]]:
        """The levels to which the first ``count`` weights belong, whole ones, each with its weights."""
        first = 0
        for level in self.levels:
            if first < count:
                yield level, slice(first, first + len(level.boxes))
            first += len(level.boxes)


def _finer(table: Float[np.ndarray, "s s"], side: int) -> Float[np.ndarray, "t t"]:
    """The same spline on a grid of ``side``, which is the table's or halves its step once or more."""
    while len(table) < side:
        fine = 2 * len(table) - 3  # twice the cells, and a coefficient beyond each end
        halfway, finer = np.empty((fine, len(table))), np.empty((fine, fine))
        refine(table, halfway, finer)
        table = finer
    return table


def _coarser(by_table: Float[np.ndarray, "t t"], side: int) -> Float[np.ndarray, "s s"]:
    """Adjoint of :func:`_finer`."""
    while len(by_table) > side:
        coarse = (len(by_table) + 3) // 2
        halfway, coarser = np.empty((len(by_table), coarse)), np.empty((coarse, coarse))
        refine_adjoint(by_table, halfway, coarser)
        by_table = coarser
    return by_table


class _Tables(torch.autograd.Function):
    """The tables of both columns of weights, a thread for each; and the gradient by the weights."""

    @staticmethod
    def forward(ctx: Any, weights: Tensor, patched: PatchedTables) -> Tensor:
        ctx.patched, ctx.count = patched, len(weights)
        columns = np.ascontiguousarray(weights.detach().numpy().T)
        tables = np.empty((2, patched.side, patched.side))

        def work(face: int) -> None:
            tables[face] = patched.table(columns[face])

        in_parallel(work, 2)
        return torch.from_numpy(tables)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        by_tables = gradients[0].contiguous().numpy()
        by_weights = np.empty((ctx.count, 2))

        def work(face: int) -> None:
            by_weights[:, face] = ctx.patched.by_weights(by_tables[face], ctx.count)

        in_parallel(work, 2)
        return torch.from_numpy(by_weights), None


@dataclass(frozen=True)
class LevelMap:
    """A :class:`~lensforge.surfaces.basis_tables.WeightMap` as differentiable operations."""

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


_FIT_DIRECTIONS, _FIT_CHUNK = 8, 4096  # for each function; at a time
_FIT_DAMPING = 1e-10


@dataclass(frozen=True)
class Parametrisation:
    """Parameters of both surfaces, which share one basis: the same maps make both tables.

    Parameters are relative to the starting offsets: a unit step means the same for a lens of any size. Column 0 is
    the inner surface, column 1 the outer. The column of a ``fixed`` surface has no effect.
    """

    basis: SrbfBasis
    grid: TableGrid
    maps: LevelMaps | PatchedTables
    scale_mm: Float[Tensor, "2"]
    fixed: tuple[Surface | None, Surface | None] = (None, None)

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "Parametrisation":
        """Parametrisation of the spec's lens, on a grid that resolves its narrowest feature."""
        lens, basis = spec.lens, spec.lens.basis
        with remedy("raise lens.sigma_c, lower the last of lens.levels, or take a lower accuracy"):
            grid = grid_for(min([basis.detail_rad, *_fixed_details(lens)]), nodes_per_sigma)
            maps = LevelMaps.of(grid, basis)
        return Parametrisation(basis, grid, maps, torch.tensor(lens.start_mm, dtype=torch.float64), lens.fixed)

    @staticmethod
    def patched(spec: Spec, nodes_per_sigma: float) -> "Parametrisation":
        """The same by patches: a step takes a fraction of the time, other tables to less than their own error."""
        lens, basis = spec.lens, spec.lens.basis
        with remedy("raise lens.sigma_c, or take a lower accuracy"):
            sigmas = [level_sigma(count, basis.sigma_c) for count in basis.levels]
            grid, halvings = dyadic_grid([*sigmas, *_fixed_details(lens)], nodes_per_sigma)
            maps = PatchedTables.of(basis, grid, halvings[: len(sigmas)])
        return Parametrisation(basis, grid, maps, torch.tensor(lens.start_mm, dtype=torch.float64), lens.fixed)

    def refined(self) -> "Parametrisation":
        """One made by patches, with tables of half the step: the same splines."""
        assert isinstance(self.maps, PatchedTables)
        grid = TableGrid(2 * self.grid.nodes - 1)
        return replace(self, grid=grid, maps=replace(self.maps, side=grid.side))

    def tables(
        self, weights: Float[Tensor, "k 2"], offsets: Float[Tensor, "2"]
    ) -> tuple[Float[Tensor, "side side"], Float[Tensor, "side side"]]:
        """Tables (mm) of both surfaces from the first ``k`` relative weights; differentiable."""
        free = ((self.maps.coefficients(weights) + offsets) * self.scale_mm).unbind(dim=-1)
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
