"""Operations that NumPy and torch name differently, in both."""

import numpy as np
import pytest
import torch

from lensforge.optics.arrays import replaced


@pytest.mark.parametrize("of", [np.array, torch.tensor], ids=["numpy", "torch"])
def test_rows_are_replaced_in_a_copy(of) -> None:
    """What stood in them is gone, and the rest stays."""
    before = of([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    after = replaced(before, of([2, 0]), of([[0.5, 0.25], [7.0, 8.0]]))
    assert after.tolist() == [[7.0, 8.0], [3.0, 4.0], [0.5, 0.25]]
    assert before.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]


def test_replaced_rows_are_differentiable_in_both() -> None:
    before, values = (torch.tensor(numbers, requires_grad=True) for numbers in ([1.0, 2.0, 3.0], [5.0]))
    weights = torch.tensor([10.0, 20.0, 30.0])
    (weights * replaced(before, torch.tensor([1]), values)).sum().backward()
    assert before.grad.tolist() == [10.0, 0.0, 30.0] and values.grad.tolist() == [20.0]
