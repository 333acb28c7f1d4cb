"""Fields of all constraints by hand, and the terms that a search makes of them, as sums over points."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from scenes import random_surface, small_spec, sphere, table_of

from lensforge.optics.face_roles import DOUBLE, SHELL
from lensforge.scene.lens import Lens
from lensforge.search.constraint_points import ChartOperator, ChartPoints, RadiusJet, constraint_points
from lensforge.search.constraints import WALL, AugmentedLagrangian, Constraint, constraints_of
from lensforge.search.design_result import Margins, constraint_criteria, limits_of
from lensforge.search.face_fields import draft_sine, least_curvature, meridian_curvature
from lensforge.search.feasibility import measure_constraints
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import TableGrid

SHOP = {
    "lens__inner__concave_radius_mm": 2.5, "lens__outer__concave_radius_mm": 4.0, "lens__inner__draft_deg": 3.0,
    "lens__outer__draft_deg": 2.0, "constraints__max_wall_mm": 2.5, "constraints__max_height_mm": 5.0,
}  # fmt: skip


def shop_spec(**changes: Any) -> Spec:
    return small_spec(**SHOP | changes)


def jets(count: int = 30) -> tuple[RadiusJet, RadiusJet, ChartPoints]:
    chance = np.random.default_rng(0)
    inner, outer = (RadiusJet(torch.from_numpy(chance.uniform(low, low + 1.0, count)),
                              torch.from_numpy(chance.normal(size=(5, count)))) for low in (2.5, 5.5))  # fmt: skip
    return inner, outer, ChartPoints.of(chance.uniform(-0.7, 0.7, (count, 2)))


@pytest.mark.parametrize("process", ["milled", "moulded"])
def test_fields_of_all_constraints_are_their_definitions(process: str) -> None:
    spec = shop_spec(manufacture={"process": process}, constraints__cavity_radius_mm=1.25)
    inner, outer, points = jets()
    faces = {"inner": inner, "outer": outer}
    fields = {
        constraint.key: constraint.of(faces, points).numpy()
        for constraint in constraints_of(spec)
        if constraint.key != WALL
    }
    a = inner.rho.numpy()
    b = outer.rho.numpy()
    cosine = points.cosine.numpy()
    sign = 1 if process == "milled" else -1
    drafts = [np.degrees(np.arcsin(np.clip(draft_sine(jet, points).numpy(), -1.0, 0.5))) for jet in (inner, outer)]
    wanted = {
        "cavity_clearance_mm": 0.5 / 1.25**2 * a**2 * (1.0 - cosine**2) + a * cosine - 0.5,
        "radius_margin_mm": 7.0 - b,
        "inner_curvature_margin_per_mm": 1.0 / 2.5 + least_curvature(inner, points, -sign).numpy(),
        "outer_curvature_margin_per_mm": 1.0 / 4.0 + least_curvature(outer, points, sign).numpy(),
        "inner_draft_margin_deg": drafts[0] - 3.0,
        "outer_draft_margin_deg": drafts[1] - 2.0,
        "largest_wall_margin_mm": 2.5 - (b - a),
        "height_margin_mm": 5.0 - b * cosine,
    }
    assert list(fields) == list(wanted)
    for key, values in wanted.items():
        np.testing.assert_allclose(fields[key], values, atol=1e-9, err_msg=key)


def test_a_face_that_is_turned_has_the_curvature_of_its_meridian() -> None:
    """By differences along the meridians of crooked faces, on the axis too, and with derivatives."""
    grid = TableGrid(129)
    surface = random_surface(3, 4.0, 0.05, (9, 25))
    polar = np.array([0.0, 0.3, 0.8, 1.2])
    turn = np.array([0.0, 0.4, 2.0, 5.0])
    places = np.tan(0.5 * polar)[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    operator = ChartOperator.of(grid, places, derivatives=True)
    (jet,) = operator.jets(table_of(surface, grid)[None])
    step = 1e-3
    at = polar[:, None] + step * np.array([-1.0, 0.0, 1.0])
    u = np.stack([np.sin(at) * np.cos(turn)[:, None], np.sin(at) * np.sin(turn)[:, None], np.cos(at)], axis=-1)
    below, rho, above = surface.radius(u.reshape(-1, 3)).reshape(at.shape).T
    first = (above - below) / (2.0 * step)
    second = (above - 2.0 * rho + below) / step**2
    wanted = (rho**2 + 2.0 * first**2 - rho * second) / (rho**2 + first**2) ** 1.5
    for air in (1, -1):
        np.testing.assert_allclose(meridian_curvature(jet, operator.points, air), air * wanted, atol=2e-4)
    moved = [tensor.clone().requires_grad_() for tensor in (jet.rho, jet.derivatives)]
    assert torch.autograd.gradcheck(lambda *jet: meridian_curvature(RadiusJet(*jet), operator.points, 1), moved)
    for process, of_face in (("turned", meridian_curvature), ("milled", least_curvature)):
        spec = shop_spec(manufacture={"process": process})
        limit = next(
            constraint for constraint in constraints_of(spec) if constraint.key == "outer_curvature_margin_per_mm"
        )
        jets = {"inner": RadiusJet(jet.rho - 1.0, jet.derivatives), "outer": jet}
        np.testing.assert_allclose(limit.of(jets, operator.points), 0.25 + of_face(jet, operator.points, 1), rtol=1e-12)


def decentred(radius: float, centre: tuple[float, float, float], grid: TableGrid) -> torch.Tensor:
    """The table of a sphere about another point."""
    u = grid.sample_directions()
    along = u @ np.array(centre)
    rho = along + np.sqrt(along**2 + radius**2 - np.dot(centre, centre))
    return torch.from_numpy(grid.coefficients(rho[:, None]).reshape(grid.side, grid.side))


@pytest.mark.parametrize(("limit_mm", "bound"), [(2.0, True), (0.05, False)])
def test_the_wall_is_the_distance_to_the_outer_face_where_it_may_bind(limit_mm: float, bound: bool) -> None:
    """To a sphere of 6 mm about (0.9, 0.4, 0.2); below z = 0 there is no face, and on the ray it is farther."""
    spec = small_spec(constraints__min_thickness_mm=limit_mm)
    grid = TableGrid(97)
    centre = np.array([0.9, 0.4, 0.2])
    operator = ChartOperator.of(grid, constraint_points(grid, "none", every_node=4), derivatives=False)
    inner, outer = operator.jets(
        torch.stack([decentred(4.2, (-0.2, 0.0, 0.1), grid), decentred(6.0, (0.9, 0.4, 0.2), grid)])
    )
    field = constraints_of(spec)[1].field(inner, outer, operator.points).numpy() + limit_mm
    start = (inner.rho[:, None] * operator.points.directions).numpy()
    away = start - centre
    wall = 6.0 - np.linalg.norm(away, axis=1)
    radial = (outer.rho - inner.rho).numpy()
    above = (centre + 6.0 * away / np.linalg.norm(away, axis=1, keepdims=True))[:, 2] > 0.01
    thin = above & (wall < limit_mm)
    assert thin.any() == bound and (field <= radial + 1e-12).all()
    np.testing.assert_allclose(field[thin], wall[thin], atol=1e-5)
    assert bound or np.array_equal(field, radial), "where it does not bind it is not sought"
    assert not bound or (radial[thin] - field[thin]).max() > 0.03


def test_the_wall_of_faces_that_cross_is_below_zero() -> None:
    grid = TableGrid(40)
    operator = ChartOperator.of(grid, constraint_points(grid, "none", every_node=4), derivatives=False)
    tables = torch.stack([torch.full((grid.side, grid.side), radius, dtype=torch.float64) for radius in (5.0, 4.0)])
    field = constraints_of(small_spec())[1].field(*operator.jets(tables), operator.points)
    np.testing.assert_allclose(field.numpy(), -1.0 - small_spec().constraints.min_thickness_mm, atol=1e-9)


def test_all_constraints_have_their_derivatives() -> None:
    grid = TableGrid(40)
    constraints = AugmentedLagrangian.of(shop_spec(lens__outer__concave_radius_mm=100.0), grid, penalty=100.0)
    surfaces = random_surface(1, 3.2, 0.02, (9, 25)), random_surface(2, 6.5, 0.05, (9, 25))
    tables = torch.stack([table_of(surface, grid) for surface in surfaces]).requires_grad_()
    constraints.update(constraints.fields(tables))
    assert (constraints.multipliers[3:].amax(dim=1) > 0.0).all(), "every constraint of the shop is violated somewhere"
    rng = np.random.default_rng(0)
    along = torch.from_numpy(rng.normal(size=tables.shape)) * 1e-3
    (gradient,) = torch.autograd.grad(constraints.term(constraints.fields(tables)), tables)
    step = 1e-4

    def moved(sign: float) -> float:
        with torch.no_grad():
            return float(constraints.term(constraints.fields(tables + sign * step * along)))

    expected = float((gradient * along).sum())
    assert (moved(1.0) - moved(-1.0)) / (2.0 * step) == pytest.approx(expected, rel=1e-6)


def test_the_draft_counts_up_to_30_degrees_and_has_a_slope_at_the_horizon() -> None:
    """At the apex of a sphere the normal is along the axis, in an undercut against it."""
    inner, outer, _ = jets(3)
    draft = next(constraint for constraint in constraints_of(shop_spec()) if constraint.key == "outer_draft_margin_deg")
    points = ChartPoints.of(np.array([[0.0, 0.0], [1.0 / math.sqrt(3.0), 0.0], [1.0, 0.0]]))
    flat = RadiusJet(outer.rho, torch.zeros(5, 3, dtype=torch.float64))
    np.testing.assert_allclose(draft.of({"inner": inner, "outer": flat}, points).numpy(), [28.0, 28.0, -2.0], atol=1e-9)
    upside = torch.zeros(5, 1, dtype=torch.float64)
    upside[0] = -1e5
    steep = RadiusJet(torch.ones(1, dtype=torch.float64), upside.requires_grad_())
    under = draft.field(steep, ChartPoints.of(np.array([[1.0, 0.0]])))
    assert -92.0 < under.item() < -91.9, "almost straight down, where the slope of the arcsine is still finite"
    assert torch.isfinite(torch.autograd.grad(under.sum(), steep.derivatives)[0]).all()


@pytest.mark.parametrize(("excess", "passed"), [(0.0, True), (0.99, True), (1.01, False)])
def test_each_limit_may_be_missed_by_its_tolerance(excess: float, passed: bool) -> None:
    spec = shop_spec()
    limits = limits_of(spec)
    margins = Margins.of({limit: -excess * limit.tolerance for limit in limits})
    criteria = constraint_criteria(spec, margins)
    assert [criterion.holds for criterion in criteria] == [passed] * 9
    assert [criterion.key for criterion in criteria] == [limit.name for limit in limits]
    assert {limit.name for limit in limits} >= {"inner curvature margin", "outer draft margin", "height margin"}
    unknown = Margins(cavity_clearance_mm=0.0, wall_margin_mm=0.0, radius_margin_mm=0.0)
    assert [criterion.holds for criterion in constraint_criteria(spec, unknown)] == [True] * 3 + [False] * 6


def known(fields: int = 2) -> tuple[AugmentedLagrangian, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Constraints on three points, with multipliers: also fields, weights of the points, and margins."""
    places = np.array([[0.0, 0.0], [0.5, 0.1], [-0.2, 0.9]])
    operator = ChartOperator.of(TableGrid(24), places, derivatives=False)
    constraints = tuple(
        Constraint(
            f"{name}_mm", SHELL[1:], "mm", 1e-3, "", 0.0, 0.0, True, lambda face, points: face.rho, factor, margin
        )
        for name, factor, margin in (("a", 0.25, 0.4), ("b", 0.5, 0.6))
    )
    lagrangian = AugmentedLagrangian(constraints, operator, DOUBLE, 40.0)
    lagrangian.multipliers = torch.tensor([[0.0, 2.0, 1.0], [0.5, 0.0, 30.0]], dtype=torch.float64)
    area = (2.0 / (1.0 + np.sum(places**2, axis=1))) ** 2
    values = np.array([[0.05, 0.3, 0.1], [-0.2, 0.31, 0.9]])
    return lagrangian, values, area / area.sum(), np.array([[0.1], [0.3]]), lagrangian.multipliers.numpy().copy()


def test_the_terms_are_means_over_the_solid_angle_of_the_points() -> None:
    lagrangian, values, area, margins, multipliers = known()
    fields = torch.from_numpy(values)
    total = 0.0
    alone = 0.0
    updated = np.zeros((2, 3))
    for c, k in np.ndindex(2, 3):
        missing = margins[c, 0] - values[c, k]
        updated[c, k] = max(multipliers[c, k] + 40.0 * missing, 0.0)
        total += area[k] * (updated[c, k] ** 2 - multipliers[c, k] ** 2) / 80.0
        alone += 20.0 * area[k] * max(missing, 0.0) ** 2
    assert lagrangian.term(fields).item() == pytest.approx(total, rel=1e-12)
    assert lagrangian.penalty_alone(fields).item() == pytest.approx(alone, rel=1e-12)
    assert lagrangian.shortfall(fields) == pytest.approx(1.0 + 0.2 / 0.3)
    assert lagrangian.shortfall(fields + 0.2) == pytest.approx(1.0)
    assert lagrangian.shortfall(fields + 0.45) == pytest.approx(0.05 / 0.3)
    assert lagrangian.shortfall(fields + 5.0) == 0.0
    assert lagrangian.least(fields) == pytest.approx({"a_mm": 0.05 / 0.25, "b_mm": -0.2 / 0.5})
    assert lagrangian.keys == ("a_mm", "b_mm")
    lagrangian.update(fields)
    np.testing.assert_allclose(lagrangian.multipliers.numpy(), updated, rtol=1e-12)
    fresh = lagrangian.fresh(7.0)
    assert fresh.penalty == 7.0 and not fresh.multipliers.any() and fresh.multipliers.shape == (2, 3)


def test_fields_are_scaled_by_the_factor_of_each() -> None:
    lagrangian, *_ = known()
    grid = TableGrid(24)
    tables = torch.stack([torch.full((grid.side, grid.side), radius, dtype=torch.float64) for radius in (2.0, 3.0)])
    np.testing.assert_allclose(lagrangian.fields(tables).numpy(), np.array([[0.25], [0.5]]) * np.full((2, 3), 3.0))
    stricter = lagrangian.tightened({"b_mm": 1.0})
    np.testing.assert_allclose(stricter.fields(tables).numpy(), [[0.75] * 3, [1.0] * 3])
    assert stricter.penalty == lagrangian.penalty and not stricter.multipliers.any()


def test_multipliers_go_to_the_nearest_point_and_keep_the_force_on_a_length() -> None:
    lagrangian, *_ = known()
    places = np.array([[0.45, 0.0], [-0.1, 0.05], [-0.2, 0.8], [0.5, 0.2]])
    operator = ChartOperator.of(TableGrid(24), places, derivatives=False)
    scaled = tuple(replace(constraint, factor=2.0 * constraint.factor) for constraint in lagrangian.constraints)
    here = AugmentedLagrangian(scaled, operator, DOUBLE, 40.0)
    nearest = here.at_nearest(lagrangian, lagrangian.multipliers)
    np.testing.assert_allclose(nearest.numpy(), 0.5 * lagrangian.multipliers.numpy()[:, [1, 0, 2, 1]])


def test_spheres_have_the_constraints_that_geometry_gives() -> None:
    spec = small_spec()
    margins = measure_constraints(Lens.double(sphere(3.0), sphere(6.0), spec, 0, "draft"))
    limits = spec.constraints
    # on a sphere of radius r, (a/b^2) r^2 sin^2 + r cos - a is least at the rim or at the pole
    a = limits.cavity_height_mm
    b = limits.cavity_radius_mm
    assert margins.cavity_clearance_mm == pytest.approx(min(a / b**2 * 9.0 - a, 3.0 - a), abs=1e-4)
    assert margins.wall_margin_mm == pytest.approx(6.0 - 3.0 - limits.min_thickness_mm, abs=2e-6)
    assert margins.radius_margin_mm == pytest.approx(limits.max_radius_mm - 6.0, abs=1e-12)
    assert all(criterion.holds for criterion in constraint_criteria(spec, margins))


def test_the_term_is_a_mean_over_the_solid_angle() -> None:
    """Of a violation that is a share of the cosine: over the hemisphere the mean of its square is a third."""
    grid = TableGrid(100)
    share = 0.1
    radius = 7.0 * (1.0 + share * grid.sample_directions()[:, 2])
    outer = torch.from_numpy(grid.coefficients(radius[:, None]).reshape(grid.side, grid.side))
    constraints = AugmentedLagrangian.of(small_spec(), grid)
    term = constraints.term(constraints.fields(torch.stack([table_of(sphere(3.0), grid), outer]))).item()
    margin = 3e-4
    truth = 0.5 * constraints.penalty * (share**2 / 3.0 + share * margin + margin**2)
    assert term == pytest.approx(truth, rel=0.03), "points on the rim count as much as those inside"
