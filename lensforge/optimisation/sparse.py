"""A fixed sparse matrix in a differentiable computation."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import csr_matrix
from torch import Tensor

from lensforge.optimisation.sparse_kernel import add_transposed, multiply_rows
from lensforge.tracing.chunks import CHUNKS, in_chunks

_WORTH_SHARING = 2**19  # products: a quarter of a millisecond of work


@dataclass(frozen=True)
class SparseMatrix:
    """A constant ``r`` x ``s`` matrix, by rows."""

    rows: csr_matrix

    def __matmul__(self, dense: Float[Tensor, "s c"]) -> Float[Tensor, "r c"]:
        """The product with ``dense``; differentiable by it."""
        product: Tensor = _Product.apply(dense, self)  # type: ignore[no-untyped-call]  # as torch leaves it
        return product

    @cached_property
    def transposed(self) -> csr_matrix:
        """For wide factors; where two columns are all, the rows themselves serve better."""
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
