import pytest
import torch
from scenes import small_spec, sphere, table_of

from lensforge.scene.lens import Lens
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.design_result import constraint_criteria
from lensforge.search.feasibility import measure_constraints
from lensforge.surfaces.bicubic_table import TableGrid


def test_spheres_have_the_constraints_that_geometry_gives() -> None:
    spec = small_spec()
    found = measure_constraints(Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft"))
    limits = spec.constraints
    # on a sphere of radius r, (a/b^2) r^2 sin^2 + r cos - a is least at the rim or at the pole
    a, b = limits.cavity_height_mm, limits.cavity_radius_mm
    assert found.cavity_clearance_mm == pytest.approx(min(a / b**2 * 9.0 - a, 3.0 - a), abs=1e-4)
    assert found.wall_margin_mm == pytest.approx(6.0 - 3.0 - limits.min_thickness_mm, abs=2e-6)
    assert found.radius_margin_mm == pytest.approx(limits.max_radius_mm - 6.0, abs=1e-12)
    assert all(criterion.passed for criterion in constraint_criteria(spec, found))


def test_the_term_vanishes_inside_and_has_the_derivative_of_the_violation() -> None:
    grid = TableGrid(32)
    constraints = AugmentedLagrangian.of(small_spec(), grid)
    inner = table_of(sphere(3.0), grid)
    assert constraints.term(constraints.fields(torch.stack([inner, table_of(sphere(6.0), grid)]))).item() == 0.0
    outer = (table_of(sphere(7.5), grid)).requires_grad_()
    term = constraints.term(constraints.fields(torch.stack([inner, outer])))
    violation = 0.5 / 7.0 + 3e-4  # and the margin inside of the limit at which the search aims
    assert term.item() == pytest.approx(0.5 * constraints.penalty * violation**2, rel=1e-9)
    gradient = torch.autograd.grad(term, outer)[0].sum().item()  # all coefficients up by 1 mm: the sphere grows
    assert gradient == pytest.approx(constraints.penalty * violation / 7.0, rel=1e-9)


def test_the_term_is_a_mean_over_the_solid_angle() -> None:
    """Of a violation that is a share of the cosine: over the hemisphere the mean of its square is a third."""
    grid, share = TableGrid(100), 0.1
    radius = 7.0 * (1.0 + share * grid.sample_directions()[:, 2])
    outer = torch.from_numpy(grid.coefficients(radius[:, None]).reshape(grid.side, grid.side))
    constraints = AugmentedLagrangian.of(small_spec(), grid)
    term = constraints.term(constraints.fields(torch.stack([table_of(sphere(3.0), grid), outer]))).item()
    margin = 3e-4
    truth = 0.5 * constraints.penalty * (share**2 / 3.0 + share * margin + margin**2)
    assert term == pytest.approx(truth, rel=0.03), "points on the rim count as much as those inside"


def test_multipliers_drive_a_toy_problem_to_its_bound() -> None:
    """Minimise -r subject to r <= 7 for a sphere: the penalty alone overshoots, the multipliers close the gap."""
    grid = TableGrid(24)
    constraints = AugmentedLagrangian.of(small_spec(), grid, penalty=10.0)
    one, inner = table_of(sphere(1.0), grid), table_of(sphere(3.0), grid)
    radius = torch.tensor(6.0, dtype=torch.float64, requires_grad=True)
    for _ in range(30):
        optimiser = torch.optim.LBFGS([radius], line_search_fn="strong_wolfe")

        def closure(optimiser=optimiser) -> torch.Tensor:
            optimiser.zero_grad()
            loss = -radius + constraints.term(constraints.fields(torch.stack([inner, radius * one])))
            loss.backward()
            return loss

        optimiser.step(closure)
        constraints.update(constraints.fields(torch.stack([inner, radius.detach() * one])))
    assert radius.item() == pytest.approx(7.0 * (1.0 - 3e-4), abs=1e-4)
