"""The sparse product of a search against SciPy's, alone and shared among the cores."""

import numpy as np
import pytest
import torch
from scipy.sparse import csr_matrix, random_array

from lensforge.kernels.sparse import SparseMatrix
from lensforge.results.arguments import threads_of_torch


@pytest.mark.parametrize("faces", [1, 2, 3, 4])
@pytest.mark.parametrize("density", [0.001, 0.4])
def test_product_and_its_gradient(density: float, faces: int) -> None:
    rng = np.random.default_rng(2)
    matrix = csr_matrix(random_array((1200, 1100), density=density, rng=rng))
    dense = torch.from_numpy(rng.normal(size=(1100, faces))).requires_grad_()
    mixer = torch.from_numpy(rng.normal(size=(1200, faces)))
    product = SparseMatrix(matrix) @ dense
    assert np.allclose(product.detach().numpy(), matrix @ dense.detach().numpy(), rtol=0.0, atol=1e-12)
    (gradient,) = torch.autograd.grad((product * mixer).sum(), dense)
    assert np.allclose(gradient.numpy(), matrix.T @ mixer.numpy(), rtol=0.0, atol=1e-12)


def test_a_factor_need_not_be_contiguous() -> None:
    matrix = csr_matrix(np.arange(12.0).reshape(3, 4))
    dense = torch.arange(8.0, dtype=torch.float64).reshape(2, 4).T
    assert torch.equal(SparseMatrix(matrix) @ dense, torch.from_numpy(matrix.toarray()) @ dense)


def test_the_bits_do_not_depend_on_the_threads() -> None:
    rng = np.random.default_rng(0)
    products = []
    matrix = SparseMatrix(csr_matrix(random_array((1200, 1100), density=0.4, rng=rng)))
    dense = torch.from_numpy(rng.normal(size=(1100, 2))).requires_grad_()
    for count in (1, 3):
        with threads_of_torch(count):
            product = matrix @ dense
            products.append((product.detach(), *torch.autograd.grad(product.sin().sum(), dense)))
    assert all(torch.equal(one, three) for one, three in zip(*products, strict=True))
