"""Tables of surfaces, whole and level by level from patches, against the exact sum; refinement and gradient."""

import numpy as np
import pytest
import torch
from scenes import random_surface, small_spec, weight_matrix

from lensforge.errors import InputError
from lensforge.kernels.bicubic import refine, refine_adjoint
from lensforge.search.parameters import Parametrisation
from lensforge.surfaces.basis_tables import dyadic_grid, weight_maps
from lensforge.surfaces.bicubic_table import TableGrid, grid_for, table_error, tabulate
from lensforge.surfaces.mirror_group import NAMES
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, level_sigma


@pytest.mark.parametrize("symmetry", NAMES)
def test_the_weight_matrix_makes_the_table_of_the_exact_sum(symmetry: str) -> None:
    surface = random_surface(1, 6.0, symmetry=symmetry)
    grid = TableGrid(40)
    table = surface.offset_mm + weight_matrix(grid, surface.basis) @ surface.weights_mm
    assert np.allclose(table.reshape(grid.side, -1), tabulate(grid, surface), atol=1e-12)


def test_the_table_converges_with_the_fourth_power_of_the_step() -> None:
    surface = random_surface(2, 2.45, levels=(25, 81))
    grids = [TableGrid(nodes) for nodes in (61, 121)]
    errors = [table_error(grid, tabulate(grid, surface), surface) for grid in grids]
    assert 3.6 < np.log2(errors[0] / errors[1]) < 4.4


def test_the_grid_resolves_the_narrowest_function() -> None:
    grid = grid_for(0.1, 4.0)
    assert 2.0 * grid.step <= 0.1 / 4.0 < 2.0 * grid.step * 1.02


LEVELS = [9, 25, 81, 289]


def parametrisation(nodes_per_sigma: float, **changes: object) -> Parametrisation:
    return Parametrisation.patched(
        small_spec(lens__levels=LEVELS, optimise__steps_per_level=None, **changes), nodes_per_sigma
    )


def random_weights(count: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(3).normal(size=(count, 2)) * 0.01)


@pytest.mark.parametrize("symmetry", ["none", "mirror_x", "rectangle", "square"])
@pytest.mark.parametrize("nodes_per_sigma", [2.5, 3.4, 5.0])
def test_tables_are_no_worse_than_those_of_the_exact_sum(symmetry: str, nodes_per_sigma: float) -> None:
    ours = parametrisation(nodes_per_sigma, lens__symmetry=symmetry)
    weights, offsets = random_weights(ours.basis.size), torch.tensor([1.0, 1.1], dtype=torch.float64)
    for face, table in enumerate(ours.tables(weights, offsets)):
        scale = float(ours.scale_mm[face])
        surface = SrbfSurface(ours.basis, weights[:, face].numpy() * scale, float(offsets[face]) * scale)
        best = table_error(ours.grid, tabulate(ours.grid, surface), surface)
        assert table_error(ours.grid, table.numpy(), surface) < 1.5 * best + 3e-5 * 0.01 * scale


@pytest.mark.parametrize("count", [9, 34, 115, 404])
def test_the_first_levels_alone_are_the_same_as_zeros_in_the_others(count: int) -> None:
    ours, weights = parametrisation(3.4), random_weights(404)
    weights[count:] = 0.0
    offsets = torch.ones(2, dtype=torch.float64)
    for few, all_of_them in zip(ours.tables(weights[:count], offsets), ours.tables(weights, offsets), strict=True):
        assert torch.equal(few, all_of_them)


def test_the_gradient_is_that_of_a_linear_map() -> None:
    ours, weights = parametrisation(3.4), random_weights(404).requires_grad_()
    offsets = torch.ones(2, dtype=torch.float64, requires_grad=True)
    by_tables = [torch.from_numpy(np.random.default_rng(k).normal(size=(ours.grid.side,) * 2)) for k in (0, 1)]

    def product(weights: torch.Tensor, offsets: torch.Tensor) -> torch.Tensor:
        return sum(torch.sum(by * table) for by, table in zip(by_tables, ours.tables(weights, offsets), strict=True))

    value = product(weights, offsets)
    by_weights, by_offsets = torch.autograd.grad(value, (weights, offsets))
    along = torch.sum(by_weights * weights) + torch.sum(by_offsets * offsets)
    assert along.item() == pytest.approx(value.item(), rel=1e-10), "homogeneous of degree 1"
    other = torch.flip(weights.detach(), [0])
    change = product(other, offsets.detach()) - value.detach()
    assert torch.sum(by_weights * (other - weights.detach())).item() == pytest.approx(change.item(), rel=1e-10)


def test_a_refined_table_is_the_same_spline() -> None:
    coarse, fine = TableGrid(12), TableGrid(23)
    rng = np.random.default_rng(1)
    table, halfway, finer = rng.normal(size=(14, 14)), np.empty((25, 14)), np.empty((25, 25))
    refine(table, halfway, finer)
    assert coarse.side == 14 and fine.side == 25

    def at_nodes(values: np.ndarray) -> np.ndarray:
        along = (values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0
        return (along[:, :-2] + 4.0 * along[:, 1:-1] + along[:, 2:]) / 6.0

    assert np.allclose(at_nodes(finer)[::2, ::2], at_nodes(table), rtol=0.0, atol=1e-14)
    assert np.allclose(at_nodes(finer)[1::2, ::2], _between(table), rtol=0.0, atol=1e-14)
    by_finer, by_table = rng.normal(size=(25, 25)), np.empty((14, 14))
    refine_adjoint(by_finer, halfway, by_table)
    assert np.sum(by_table * table) == pytest.approx(np.sum(by_finer * finer), rel=1e-12)


def _between(table: np.ndarray) -> np.ndarray:
    """The spline midway between nodes along the first axis, at nodes along the second."""
    along = (table[:-3] + 23.0 * table[1:-2] + 23.0 * table[2:-1] + table[3:]) / 48.0
    return (along[:, :-2] + 4.0 * along[:, 1:-1] + along[:, 2:]) / 6.0


def test_every_level_is_resolved_on_its_own_grid() -> None:
    sigmas = [level_sigma(count, 1.75) for count in LEVELS]
    grid, halvings = dyadic_grid(sigmas, 3.4)
    assert list(halvings) == sorted(halvings, reverse=True) and halvings[-1] == 0
    for sigma, times in zip(sigmas, halvings, strict=True):
        assert (grid.nodes - 1) % 2**times == 0
        assert (grid.nodes - 1) >> times >= grid_for(sigma, 3.4).nodes - 1 or times == 0


FEW_LEVELS = (1, 9, 49, 200)


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
    basis = SrbfBasis(FEW_LEVELS, 1.7)
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
