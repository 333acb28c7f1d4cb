"""Tables from the weights of basis functions, level by level, against the exact sum; refinement and gradient."""

import numpy as np
import pytest
import torch
from nightly import first_by_day
from scenes import small_spec
from scipy.interpolate import BSpline

from lensforge.kernels.bicubic import refine, refine_adjoint
from lensforge.search.parameters import SphereParameters
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import BasisTables, TableGrid, dyadic_grid, evaluate_table, table_error, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere, level_sigma

LEVELS = [9, 25, 81, 289]


def parametrisation(nodes_per_sigma: float, **changes: object) -> SphereParameters:
    spec = small_spec(**{"lens__levels": LEVELS, "optimise__steps_per_level": None} | changes)
    return SphereParameters.of(spec, nodes_per_sigma)


def random_weights(count: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(3).normal(size=(count, 2)) * 0.01)


@pytest.mark.parametrize(
    "symmetry", first_by_day(2, ["none", "mirror_x", "rectangle", "square"], "more widths and groups")
)
@pytest.mark.parametrize("nodes_per_sigma", first_by_day(2, [2.5, 3.4, 5.0], "more nodes"))
def test_tables_are_no_worse_than_those_of_the_exact_sum(symmetry: str, nodes_per_sigma: float) -> None:
    ours = parametrisation(nodes_per_sigma, lens__symmetry=symmetry)
    weights = random_weights(ours.basis.size)
    offsets = torch.tensor([1.0, 1.1], dtype=torch.float64)
    for face, table in enumerate(ours.tables(weights, offsets)):
        scale = float(ours.scale_mm[face])
        surface = SrbfSurface(ours.basis, weights[:, face].numpy() * scale, float(offsets[face]) * scale)
        best = table_error(ours.grid, tabulate(ours.grid, surface), surface)
        assert table_error(ours.grid, table.numpy(), surface) < 1.5 * best + 3e-5 * 0.01 * scale


@pytest.mark.parametrize("levels", [(1,), (4,), (60,), (1, 9, 49, 200), (49, 9), (81, 25, 1)])
@pytest.mark.parametrize("sigma_c", first_by_day(2, [1.75, 30.0, 1.0, 3.0], "more widths"))
def test_any_levels_of_any_width_in_any_order_are_tables(levels: tuple[int, ...], sigma_c: float) -> None:
    basis = SrbfBasis(levels, sigma_c)
    rng = np.random.default_rng(1)
    grid, halvings = dyadic_grid([level_sigma(count, sigma_c) for count in levels], 3.4)
    tables = BasisTables.of(basis, grid, halvings)
    weights = rng.normal(size=basis.size) * 0.01
    surface = SrbfSurface(basis, weights, 1.0)
    table = tables.table(weights)
    assert table_error(grid, 1.0 + table, surface) < 1.5 * table_error(grid, tabulate(grid, surface), surface)
    by_table = rng.normal(size=table.shape)
    along = np.sum(tables.by_weights(by_table, basis.size) * weights)
    assert along == pytest.approx(np.sum(by_table * table), rel=1e-9)


@pytest.mark.parametrize("off_mm", [0.02, -0.02])
def test_the_error_of_a_table_is_the_largest_to_either_side_where_directions_count(off_mm: float) -> None:
    """A table too far out or in by a constant, and on one half of the hemisphere by twice that."""
    grid, ball = TableGrid(65), sphere(5.0, 0.5)
    aside = np.where(np.arange(grid.side) < grid.side // 2, 2.0, 1.0)[:, None]
    table = tabulate(grid, ball) + off_mm * aside
    assert table_error(grid, table, ball) == pytest.approx(0.04, abs=1e-4)
    assert table_error(grid, table, ball, within=lambda ways: ways[:, 0] > 0.1) == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize("count", first_by_day(2, [9, 34, 115, 404]))
def test_the_first_levels_alone_are_the_same_as_zeros_in_the_others(count: int) -> None:
    ours = parametrisation(3.4)
    weights = random_weights(404)
    weights[count:] = 0.0
    offsets = torch.ones(2, dtype=torch.float64)
    for few, all_of_them in zip(ours.tables(weights[:count], offsets), ours.tables(weights, offsets), strict=True):
        assert torch.equal(few, all_of_them)


def test_the_gradient_is_that_of_a_linear_map() -> None:
    ours = parametrisation(3.4)
    weights = random_weights(404).requires_grad_()
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


def test_a_table_is_its_cubic_spline_up_to_the_rim_of_the_coarsest_grid() -> None:
    """The splines are those of scipy; its outermost cells reach from 0.93 of the chart to 1.02 of it."""
    grid = TableGrid(24)
    table = np.random.default_rng(5).normal(size=(grid.side, grid.side))
    turns = np.linspace(0.0, 2.0 * np.pi, 65)
    rim = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(65)])
    directions = np.concatenate([rim, fibonacci_hemisphere(500)])
    knots = grid.origin + grid.step * (np.arange(grid.side + 4) - 2.0)
    places = directions[:, :2] / (1.0 + directions[:, 2:])
    along, across = (BSpline.design_matrix(column, knots, 3).toarray() for column in places.T)
    wanted = np.sum((along @ table) * across, axis=1)
    np.testing.assert_allclose(evaluate_table(grid, table, directions), wanted, atol=1e-12)


def test_a_refined_table_is_the_same_spline() -> None:
    coarse = TableGrid(12)
    fine = TableGrid(23)
    rng = np.random.default_rng(1)
    table = rng.normal(size=(14, 14))
    halfway = np.empty((25, 14))
    finer = np.empty((25, 25))
    refine(table, halfway, finer)
    assert coarse.side == 14 and fine.side == 25

    def at_nodes(values: np.ndarray) -> np.ndarray:
        along = (values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0
        return (along[:, :-2] + 4.0 * along[:, 1:-1] + along[:, 2:]) / 6.0

    assert np.allclose(at_nodes(finer)[::2, ::2], at_nodes(table), rtol=0.0, atol=1e-14)
    assert np.allclose(at_nodes(finer)[1::2, ::2], _between(table), rtol=0.0, atol=1e-14)
    by_finer = rng.normal(size=(25, 25))
    by_table = np.empty((14, 14))
    refine_adjoint(by_finer, halfway, by_table)
    assert np.sum(by_table * table) == pytest.approx(np.sum(by_finer * finer), rel=1e-12)


def _between(table: np.ndarray) -> np.ndarray:
    """The spline midway between nodes along the first axis, at nodes along the second."""
    along = (table[:-3] + 23.0 * table[1:-2] + 23.0 * table[2:-1] + table[3:]) / 48.0
    return (along[:, :-2] + 4.0 * along[:, 1:-1] + along[:, 2:]) / 6.0
