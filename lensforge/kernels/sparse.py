"""A constant sparse matrix as a differentiable torch operation.

SciPy's product runs on one core and holds the interpreter's lock; this one is divided among all cores by rows, so that
the sums do not depend on the number of threads.
"""

from collections.abc import Callable
from dataclasses import dataclass
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
    """Fill rows ``first`` to ``last`` of ``product`` (r, f) with those of the matrix (CSR) times ``dense`` (s, f)."""
    for row in range(first, last):
        for first_column in range(0, dense.shape[1], 2):  # in pairs: each value of the matrix is read once for both
            second_column = min(first_column + 1, dense.shape[1] - 1)
            first_sum = 0.0
            second_sum = 0.0
            for k in range(starts[row], starts[row + 1]):
                value = values[k]
                column = columns[k]
                first_sum += value * dense[column, first_column]
                second_sum += value * dense[column, second_column]
            product[row, first_column] = first_sum
            product[row, second_column] = second_sum


@kernel
def add_transposed(starts, columns, values, dense, first, last, total):
    """Add to ``total`` (s, f) the transposed rows ``first`` to ``last`` times those of ``dense`` (r, f)."""
    for row in range(first, last):
        for first_column in range(0, dense.shape[1], 2):
            second_column = min(first_column + 1, dense.shape[1] - 1)
            first_sum = dense[row, first_column]
            second_sum = dense[row, second_column] if second_column > first_column else 0.0
            for k in range(starts[row], starts[row + 1]):
                value = values[k]
                column = columns[k]
                total[column, first_column] += value * first_sum
                total[column, second_column] += value * second_sum


_WORTH_SHARING = 2**18  # entries of the matrix: a quarter of a millisecond of work


@dataclass(frozen=True)
class SparseMatrix:
    """A constant ``r`` x ``s`` matrix, by rows, for several columns at once: one for each face."""

    rows: csr_matrix

    def __matmul__(self, dense: Float[Tensor, "s f"]) -> Float[Tensor, "r f"]:
        """The product with ``dense``; differentiable by it."""
        product: Tensor = _Product.apply(dense, self.rows)
        return product


def _run(work: Callable[[int, slice], None], matrix: csr_matrix) -> None:
    if matrix.nnz >= _WORTH_SHARING:
        in_chunks(work, matrix.shape[0])
    else:
        work(0, slice(0, matrix.shape[0]))


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, dense: Tensor, matrix: csr_matrix) -> Tensor:
        ctx.matrix = matrix
        factor = dense.detach().contiguous().numpy()
        product = np.empty((matrix.shape[0], factor.shape[1]))

        def work(_: int, part: slice) -> None:
            multiply_rows(matrix.indptr, matrix.indices, matrix.data, factor, part.start, part.stop, product)

        _run(work, matrix)
        return torch.from_numpy(product)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        factor = gradients[0].contiguous().numpy()
        matrix = ctx.matrix
        totals = np.zeros((CHUNKS if matrix.nnz >= _WORTH_SHARING else 1, matrix.shape[1], factor.shape[1]))

        def work(chunk: int, part: slice) -> None:
            add_transposed(matrix.indptr, matrix.indices, matrix.data, factor, part.start, part.stop, totals[chunk])

        _run(work, matrix)
        return torch.from_numpy(totals.sum(axis=0)), None
