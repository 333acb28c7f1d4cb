"""From weights to tables by levels, against every function sampled on the whole table."""

import numpy as np
import pytest
import torch
from scenes import small_spec, weight_matrix

from lensforge.errors import InputError
from lensforge.search.parameters import Parametrisation
from lensforge.surfaces.basis_tables import weight_maps
from lensforge.surfaces.bicubic_table import TableGrid, grid_for, table_error
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

LEVELS = (1, 9, 49, 200)


def _by_levels(grid: TableGrid, basis: SrbfBasis, weights: np.ndarray) -> np.ndarray:
    levels = weight_maps(grid, basis)
    parts = np.split(weights, np.cumsum(basis.levels)[:-1])
    squares = [
        level.refine @ (level.samples @ part).reshape(2 * (level.refine.shape[1],)) @ level.refine.T
        for level, part in zip(levels, parts, strict=True)
    ]
    return np.sum(squares, axis=0)


@pytest.mark.parametrize("nodes_per_sigma", [2.5, 5.0])
def test_levels_on_grids_of_their_own_hardly_add_to_the_error_of_the_table(nodes_per_sigma: float) -> None:
    basis = SrbfBasis(LEVELS, 1.7)
    weights = np.random.default_rng(0).normal(size=basis.size) * 0.02
    grid, surface = grid_for(basis.detail_rad, nodes_per_sigma), SrbfSurface(basis, weights, 1.0)
    dense = 1.0 + (weight_matrix(grid, basis) @ weights).reshape(grid.side, grid.side)
    by_levels = 1.0 + _by_levels(grid, basis, weights)
    assert not np.array_equal(by_levels, dense)
    assert table_error(grid, by_levels, surface) < 1.3 * table_error(grid, dense, surface)


def test_one_level_is_the_table_itself() -> None:
    basis = SrbfBasis((60,), 1.7)
    grid = grid_for(basis.detail_rad, 3.0)
    weights = np.random.default_rng(1).normal(size=60)
    dense = (weight_matrix(grid, basis) @ weights).reshape(grid.side, grid.side)
    assert np.allclose(_by_levels(grid, basis, weights), dense, atol=1e-10)


@pytest.mark.parametrize("symmetry", ["none", "mirror_x", "rectangle", "square"])
def test_tables_of_a_search_are_those_of_the_lens_it_ends_with(symmetry: str) -> None:
    spec = small_spec(lens={**small_spec().lens.model_dump(mode="json"), "levels": [9, 40], "symmetry": symmetry})
    parametrisation = Parametrisation.of(spec, 4.0)
    rng = np.random.default_rng(2)
    weights = torch.from_numpy(rng.normal(size=(49, 2)) * 0.01)
    offsets = torch.tensor([1.1, 0.9], dtype=torch.float64)
    lens = parametrisation.lens(weights, offsets, spec, 0, "draft")
    for table, surface in zip(parametrisation.tables(weights, offsets), (lens.inner, lens.outer), strict=True):
        assert table_error(parametrisation.grid, table.numpy(), surface) < 3e-5 * surface.offset_mm


def test_gradients_by_weights_and_offsets() -> None:
    parametrisation = Parametrisation.of(small_spec(), 1.5)
    count = parametrisation.basis.size
    weights = torch.from_numpy(np.random.default_rng(3).normal(size=(count, 2))).requires_grad_()
    offsets = torch.ones(2, dtype=torch.float64, requires_grad=True)
    mixer = torch.from_numpy(
        np.random.default_rng(4).normal(size=(2, parametrisation.grid.side, parametrisation.grid.side))
    )
    assert torch.autograd.gradcheck(
        lambda w, o: (torch.stack(parametrisation.tables(w, o)) * mixer).sum(), (weights, offsets), atol=1e-6
    )


@pytest.mark.nightly("a quarter of a minute")
def test_maps_that_would_not_fit_are_refused() -> None:
    basis = SrbfBasis((10_000,), 30.0)
    with pytest.raises(InputError, match="would take"):
        weight_maps(TableGrid(2000), basis)
