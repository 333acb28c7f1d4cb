"""A fixed sparse matrix in a differentiable computation."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from scipy.sparse import csr_matrix
from torch import Tensor


@dataclass(frozen=True)
class SparseMatrix:
    """A constant ``r`` x ``s`` matrix and its transpose, both by rows.

    SciPy multiplies: torch's own sparse product took fifty times as long forward and more backward.
    """

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


class _Product(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, dense: Tensor, matrix: SparseMatrix) -> Tensor:
        ctx.matrix = matrix
        return torch.from_numpy(matrix.rows @ dense.detach().numpy())

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return torch.from_numpy(ctx.matrix.columns @ gradients[0].numpy()), None
