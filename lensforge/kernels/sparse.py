"""A constant sparse matrix as a differentiable torch operation.

SciPy's product runs on one core and holds the interpreter's lock; this one is divided among all cores by rows, so that
the sums do not depend on the number of threads.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import csr_matrix
from torch import Tensor

from lensforge.kernels.compiled import kernel
from lensforge.kernels.parallel import CHUNKS, in_chunks


@kernel
def multiply_rows(starts, columns, values, dense, first, last, product):
    """Fill rows ``first`` to ``last`` of ``product`` (r, c) with those of the matrix (CSR) times ``dense`` (s, c)."""
    if dense.shape[1] == 2:  # both surfaces at once: their sums stay in registers
        for row in range(first, last):
            inner, outer = 0.0, 0.0
            for k in range(starts[row], starts[row + 1]):
                value, column = values[k], columns[k]
                inner += value * dense[column, 0]
                outer += value * dense[column, 1]
            product[row, 0], product[row, 1] = inner, outer
        return
    for row in range(first, last):
        total = product[row]
        total[:] = 0.0
        for k in range(starts[row], starts[row + 1]):
            value, source = values[k], dense[columns[k]]
            for c in range(len(source)):
                total[c] += value * source[c]


@kernel
def add_transposed(starts, columns, values, dense, first, last, total):
    """Add to ``total`` (s, 2) the transposed rows ``first`` to ``last`` times those of ``dense`` (r, 2)."""
    for row in range(first, last):
        inner, outer = dense[row, 0], dense[row, 1]
        for k in range(starts[row], starts[row + 1]):
            value, column = values[k], columns[k]
            total[column, 0] += value * inner
            total[column, 1] += value * outer


_WORTH_SHARING = 2**19  # products: a quarter of a millisecond of work


@dataclass(frozen=True)
class SparseMatrix:
    """A constant ``r`` x ``s`` matrix, by rows."""

    rows: csr_matrix

    def __matmul__(self, dense: Float[Tensor, "s c"]) -> Float[Tensor, "r c"]:
        """The product with ``dense``; differentiable by it."""
        product: Tensor = _Product.apply(dense, self)
        return product

    @cached_property
    def transposed(self) -> csr_matrix:
        """The transpose, for wide factors; a factor of two columns is faster with the rows themselves."""
        return self.rows.T.tocsr()


def _packed(matrix: csr_matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return matrix.indptr, matrix.indices, matrix.data


def _run(work: Callable[[int, slice], None], count: int, shared: bool) -> None:
    if shared:
        in_chunks(work, count)
    else:
        work(0, slice(0, count))


def _times(matrix: csr_matrix, factor: Float[np.ndarray, "s c"]) -> Float[np.ndarray, "r c"]:
    product = np.empty((matrix.shape[0], factor.shape[1]))

    def work(_: int, part: slice) -> None:
        multiply_rows(*_packed(matrix), factor, part.start, part.stop, product)

    _run(work, len(product), matrix.nnz * factor.shape[1] >= _WORTH_SHARING)
    return product


def _transposed_times(matrix: csr_matrix, factor: Float[np.ndarray, "r 2"]) -> Float[np.ndarray, "s 2"]:
    shared = 2 * matrix.nnz >= _WORTH_SHARING
    totals = np.zeros((CHUNKS if shared else 1, matrix.shape[1], 2))

    def work(chunk: int, part: slice) -> None:
        add_transposed(*_packed(matrix), factor, part.start, part.stop, totals[chunk])

    _run(work, len(factor), shared)
    total: Float[np.ndarray, "s 2"] = totals.sum(axis=0)
    return total


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, dense: Tensor, matrix: SparseMatrix) -> Tensor:
        ctx.matrix = matrix
        return torch.from_numpy(_times(matrix.rows, dense.detach().contiguous().numpy()))

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        factor, matrix = gradients[0].contiguous().numpy(), ctx.matrix
        narrow = factor.shape[1] == 2
        by_dense = _transposed_times(matrix.rows, factor) if narrow else _times(matrix.transposed, factor)
        return torch.from_numpy(by_dense), None
