import numpy as np
import pytest
from nightly import first_by_day
from scenes import random_surface, weight_matrix

from lensforge.surfaces.bicubic_table import TableGrid, grid_for, tabulate
from lensforge.surfaces.mirror_group import NAMES


@pytest.mark.parametrize("symmetry", first_by_day(3, NAMES))
def test_the_weight_matrix_makes_the_table_of_the_exact_sum(symmetry: str) -> None:
    surface = random_surface(1, 6.0, symmetry=symmetry)
    grid = TableGrid(40)
    table = surface.offset_mm + weight_matrix(grid, surface.basis) @ surface.weights_mm
    assert np.allclose(table.reshape(grid.side, -1), tabulate(grid, surface), atol=1e-12)


def test_the_grid_resolves_the_narrowest_function() -> None:
    grid = grid_for(0.1, 4.0)
    assert 2.0 * grid.step <= 0.1 / 4.0 < 2.0 * grid.step * 1.02
