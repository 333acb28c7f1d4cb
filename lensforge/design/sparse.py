"""A fixed sparse matrix in a differentiable computation."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from scipy.sparse import csr_matrix
from torch import Tensor

from lensforge.design.sparse_kernel import multiply_rows
from lensforge.tracing.chunks import in_chunks

_WORTH_SHARING = 2**18  # entries: a quarter of a millisecond of work


@dataclass(frozen=True)
class SparseMatrix:
    """A constant ``r`` x ``s`` matrix and its transpose, both by rows."""

    rows: csr_matrix
    columns: csr_matrix

    @staticmethod
    def of(matrix: csr_matrix) -> "SparseMatrix":
        """With the transpose that the backward pass multiplies by."""
        return SparseMatrix(matrix.tocsr(), matrix.T.tocsr())

    def __matmul__(self, dense: Float[Tensor, "s c"]) -> Float[Tensor, "r c"]:
        """The product with ``dense``; differentiable by it."""
        product: Tensor = _Product.apply(dense, self)
        return product


def _times(matrix: csr_matrix, dense: Tensor) -> Tensor:
    factor = dense.detach().contiguous().numpy()
    product = np.empty((matrix.shape[0], factor.shape[1]))

    def work(_: int, part: slice) -> None:
        multiply_rows(matrix.indptr, matrix.indices, matrix.data, factor, part.start, part.stop, product)

    if matrix.nnz < _WORTH_SHARING:
        work(0, slice(0, len(product)))
    else:
        in_chunks(work, len(product))
    return torch.from_numpy(product)


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, dense: Tensor, matrix: SparseMatrix) -> Tensor:
        ctx.matrix = matrix
        return _times(matrix.rows, dense)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return _times(ctx.matrix.columns, gradients[0]), None
