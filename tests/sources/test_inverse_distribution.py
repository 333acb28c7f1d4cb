"""Inverses of cumulative distributions against loops over their cells, and at the ends of cells."""

import numpy as np
import pytest

from lensforge.sources.inverse_cdf import choose, choose_each, linear_inverse

CELLS = [2.0, 1.0, 0.0, 5.0, 0.0]  # their shares: dark ones in the middle and at the end
ENDS = np.cumsum(CELLS)
# the ends of cells themselves belong to the next cell that has a share
NUMBERS = np.array([0.0, 0.125, 0.24999, 0.25, 0.3, 0.375, 0.5, 0.99])


def by_loop(shares: list[float], number: float) -> tuple[int, float]:
    """Walk through the cells until the number is spent; a dark cell holds nothing."""
    left = number * sum(shares)
    for cell, share in enumerate(shares):
        if left < share:
            return cell, left / share
        left -= share
    raise ValueError(number)


def test_each_number_is_in_the_cell_that_a_walk_through_the_cells_finds() -> None:
    expected = [by_loop(CELLS, number) for number in NUMBERS]
    cells, rest = choose(ENDS, NUMBERS)
    assert cells.tolist() == [cell for cell, _ in expected]
    np.testing.assert_allclose(rest, [part for _, part in expected], atol=1e-12)


def test_each_number_may_have_a_distribution_of_its_own() -> None:
    rows = [CELLS, CELLS[::-1], [3.0, 1.0, 0.5, 0.25, 7.0], [0.0, 0.0, 4.0, 0.0, 4.0]]
    for numbers in (NUMBERS[:4], NUMBERS[4:]):
        before = np.pad(np.cumsum(rows, axis=1), ((0, 0), (1, 0)))
        cells, rest = choose_each(lambda cell, before=before: before[np.arange(4), cell], 5, numbers)
        expected = [by_loop(row, number) for row, number in zip(rows, numbers, strict=True)]
        assert cells.tolist() == [cell for cell, _ in expected]
        np.testing.assert_allclose(rest, [part for _, part in expected], atol=1e-12)


@pytest.mark.parametrize(("first", "second"), [(1.0, 1.0), (0.0, 2.0), (3.0, 0.0), (0.5, 4.0), (7.0, 2.0)])
def test_the_area_of_a_trapezoid_up_to_the_position_is_the_share(first: float, second: float) -> None:
    share = np.array([0.0, 0.1, 0.5, 0.75, 1.0])
    place = linear_inverse(np.full(5, first), np.full(5, second), share)
    area = first * place + 0.5 * (second - first) * place**2
    np.testing.assert_allclose(area, share * 0.5 * (first + second), atol=1e-14)
    assert place[0] == 0.0 and place[-1] == pytest.approx(1.0)
