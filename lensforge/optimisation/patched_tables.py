"""Tables of both surfaces from the patches of their basis functions, as one differentiable torch operation."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.kernels.jit import in_parallel
from lensforge.kernels.patches import add_patches, patch_sums, refine, refine_adjoint
from lensforge.surfaces.patches import LevelPatches, level_patches
from lensforge.surfaces.spline import TableGrid
from lensforge.surfaces.srbf import SrbfBasis


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
