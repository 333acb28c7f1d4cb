"""The projection onto the limits, round by round: what it is given, when it ends, and what it returns."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scenes import small_spec, sphere

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search import feasibility
from lensforge.search.constraint_points import ChartPoints, RadiusJet, constraint_points
from lensforge.search.constraints import AugmentedLagrangian, Constraint, constraints_of
from lensforge.search.design_result import Margins
from lensforge.search.parameters import Parametrisation
from lensforge.search.problem import Problem
from lensforge.search.search_state import SearchState
from lensforge.spec import Spec
from lensforge.surfaces import surface
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import fibonacci_hemisphere

WEIGHTS, OFFSETS = torch.full((4, 2), 0.5, dtype=torch.float64), torch.tensor([1.0, 2.0], dtype=torch.float64)


class Tables(Parametrisation):
    """Parameters whose tables are their own sums."""

    def tables(self, weights: torch.Tensor, offsets: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        inner, outer = (weights.sum(dim=0) + offsets).reshape(2, 1, 1)
        return inner, outer


class Scripted(AugmentedLagrangian):
    """Constraints with a given shortfall after each round."""

    def begin(self, shortfalls: Sequence[float]) -> "Scripted":
        self.script, self.seen, self.updates, self.begun_with = list(shortfalls), [], 0, 0.0
        return self

    def fresh(self, penalty: float) -> AugmentedLagrangian:
        self.begun_with = penalty
        return self

    def fields(self, inner: torch.Tensor, outer: torch.Tensor) -> torch.Tensor:
        return torch.cat([inner.reshape(1, 1), outer.reshape(1, 1)])

    def term(self, fields: torch.Tensor) -> torch.Tensor:
        return (fields[0, 0] - 7.0) ** 2 + (fields[1, 0] - 4.0) ** 2

    def shortfall(self, fields: torch.Tensor) -> float:
        self.seen.append(fields.detach().clone())
        return self.script[len(self.seen) - 1]

    def update(self, fields: torch.Tensor) -> None:
        self.updates += 1


def made(kind: type, **fields: Any) -> Any:
    found = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(found, name, value)
    return found


@pytest.mark.parametrize(
    ("shortfalls", "rounds"),
    [
        ([0.7, 9.0], 0),  # accepted as it is
        ([0.71, 0.4, 9.0], 1),
        ([10.0, 8.0, 6.4, 5.2, 0.1], 3),  # the last of these rounds left more than 0.8
        ([10.0, 7.0, 0.7], 2),
        ([10.0, 9.0], 1),
        ([0.5**k * 1e6 for k in range(20)], 12),
    ],
)
def test_rounds_go_on_while_they_help_and_the_margins_are_missing(shortfalls, rounds, monkeypatch) -> None:
    asked = []

    class Noted(feasibility._LBFGS):
        def __init__(self, parameters: list[torch.Tensor], **how: Any) -> None:
            asked.append(how)
            super().__init__(parameters, **how)

    monkeypatch.setattr(feasibility, "_LBFGS", Noted)
    constraints = made(Scripted, keys_=()).begin(shortfalls)
    moved, shortfall = feasibility._least_move(made(Tables), constraints, WEIGHTS, OFFSETS, 0.7)
    assert (constraints.updates, constraints.begun_with) == (rounds, 1e6)
    assert shortfall == shortfalls[rounds] and moved.shape == (5, 2) and not moved.requires_grad
    assert asked == [{"max_iter": 40, "line_search_fn": "strong_wolfe"}] * rounds
    first = constraints.seen[0].ravel().tolist()
    assert first == [3.0, 4.0], "the sum of the weights and the offset of each face"
    if rounds:  # least of |m|^2 / 2 + (sum - 7)^2: every parameter of the inner face by 2 * 4 / 11
        np.testing.assert_allclose(moved[:, 0].numpy(), 8.0 / 11.0, rtol=1e-5)
        np.testing.assert_allclose(moved[:, 1].numpy(), 0.0, atol=1e-6)


@pytest.mark.parametrize(("shortfall", "moves"), [(0.7, True), (1.0, True), (1.01, False), (5.0, False)])
def test_parameters_are_moved_only_to_where_no_limit_is_missed(shortfall, moves, monkeypatch) -> None:
    by, asked = torch.arange(10, dtype=torch.float64).reshape(5, 2), []
    monkeypatch.setattr(feasibility, "_least_move", lambda *given: asked.append(given[-1]) or (by, shortfall))
    weights, offsets = feasibility.project_to_feasible(made(Tables), made(Scripted), WEIGHTS, OFFSETS)
    assert asked == [0.7], "the part of the margins that may be missing"
    assert torch.equal(weights, WEIGHTS + by[1:] if moves else WEIGHTS)
    assert torch.equal(offsets, OFFSETS + by[0] if moves else OFFSETS)


class Given(Problem):
    """A problem whose lenses are one lens."""

    @property
    def parametrisation(self) -> Any:
        return SimpleNamespace(lens=lambda *parameters: self.made_lens)

    def in_full(self) -> Any:
        return made(Tables), self.constraints


@pytest.mark.parametrize(
    ("misses", "stricter"),
    [
        ([0.0], [{}]),
        ([4.9e-4], [{}]),  # within the tolerance of 7e-5 of 7 mm
        ([0.01, 0.002, 0.0], [{}, {"radius_margin_mm": 0.01}, {"radius_margin_mm": 0.012}]),
        ([0.01] * 4, [{}, *({"radius_margin_mm": 0.01 * k} for k in (1, 2, 3))]),
    ],
)
def test_a_limit_is_made_stricter_by_what_the_measured_lens_misses(misses, stricter, monkeypatch) -> None:
    spec = small_spec()
    lens, left = Lens(sphere(3.0), sphere(6.0), spec, 0, "draft"), list(misses)

    class Own(AugmentedLagrangian):
        def tightened(self, by: Any) -> Any:
            seen.append(dict(by))
            return self

    seen: list[dict[str, float]] = []
    constraints = made(Own, constraints=constraints_of(spec))
    monkeypatch.setattr(feasibility, "project_to_feasible", lambda *given: given[2:])
    monkeypatch.setattr(
        feasibility, "measure_constraints",
        lambda lens: Margins(cavity_clearance_mm=0.1, wall_margin_mm=0.0, radius_margin_mm=-left.pop(0)),
    )  # fmt: skip
    problem = made(Given, spec=spec, constraints=constraints, made_lens=lens)
    found, margins = feasibility.feasible_lens(problem, made(SearchState, weights=WEIGHTS, offsets=OFFSETS), 0, "draft")
    assert found is lens and margins.radius_margin_mm == -misses[-1] and not left
    assert len(seen) == len(stricter)
    for one, other in zip(seen, stricter, strict=True):
        assert one == pytest.approx(other)


def start(
    spec: Spec, shortfalls: list[float], monkeypatch: pytest.MonkeyPatch, levels: tuple[int, ...] = (9, 25)
) -> list:
    asked: list[tuple[int, float]] = []

    def move(
        parametrisation: Any, constraints: Any, weights: torch.Tensor, offsets: torch.Tensor, accepted: float
    ) -> Any:
        asked.append((len(weights), accepted))
        assert torch.equal(offsets, torch.ones(2, dtype=torch.float64)) and not weights.any()
        return torch.ones(len(weights) + 1, 2, dtype=torch.float64), shortfalls[len(asked) - 1]

    monkeypatch.setattr(feasibility, "_least_move", move)
    grid = TableGrid(24)
    constraints = AugmentedLagrangian.of(spec, grid)

    def tables(weights: torch.Tensor, offsets: torch.Tensor) -> list[torch.Tensor]:
        assert torch.equal(offsets, torch.full((2,), 2.0, dtype=torch.float64)) and (weights == 1.0).all()
        return [torch.full((grid.side, grid.side), radius, dtype=torch.float64) for radius in (3.0, 7.5)]

    basis = SimpleNamespace(levels=levels, size=sum(levels))

    class Own(Problem):
        @property
        def parametrisation(self) -> Any:
            return SimpleNamespace(basis=basis, tables=tables)

    feasibility.require_feasible_start([made(Own, spec=spec, constraints=constraints)] * 2)
    return asked


def test_a_start_is_sought_by_few_functions_and_then_by_all(monkeypatch: pytest.MonkeyPatch) -> None:
    tall = small_spec(constraints__max_height_mm=6.0)
    assert start(tall, [10.0], monkeypatch) == [(9, 10.0)], "a search finds its way out of ten margins"
    assert start(tall, [10.1, 3.0], monkeypatch) == [(9, 10.0), (34, 10.0)]
    assert start(tall, [99.0, 99.0, 5.0], monkeypatch) == [(9, 10.0), (34, 10.0), (9, 10.0)]
    assert start(tall, [99.0, 1.0], monkeypatch, (4,)) == [(4, 10.0), (4, 10.0)]
    assert start(small_spec(), [], monkeypatch) == [], "of the paper's three the spec knows all"
    with pytest.raises(InputError) as refusal:
        start(tall, [99.0] * 4, monkeypatch)
    words = str(refusal.value)
    assert "max_height_mm = 6" in words and "keep_out" not in words
    nearest = words.split("nearest one has ")[1]
    assert nearest.startswith("radius margin -0.5 mm: ") and "height margin -1.5 mm: " in nearest
    assert "wall" not in nearest.split(": ")[0] and "cavity clearance" not in nearest


def test_a_fixed_surface_needs_a_start_too(monkeypatch: pytest.MonkeyPatch) -> None:
    fixed = {"levels": [9, 25], "fixed_inner": {"kind": "sphere", "radius_mm": 3.0}, "outer_offset_mm": 6.0}
    assert start(small_spec(lens=fixed), [1.0], monkeypatch) == [(9, 10.0)]


@pytest.mark.parametrize("symmetry", ["none", "square"])
def test_lengths_are_measured_over_the_hemisphere_and_at_2048_places_of_its_rim(symmetry: str) -> None:
    lens = Lens(sphere(3.0), sphere(6.0), small_spec(lens__symmetry=symmetry), 0, "draft")
    object.__setattr__(lens, "inner", sphere(3.0))
    points, inner, outer = feasibility._exact_radii(lens, 300)
    turn = 2.0 * np.pi * np.arange(2048) / 2048
    rim = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    every = surface.to_chart(np.concatenate([fibonacci_hemisphere(300), rim]))
    if lens.symmetry == "none":
        np.testing.assert_allclose(np.column_stack([points.x, points.y]), every, atol=1e-12)
    assert (inner.rho.numpy() == pytest.approx(3.0)) and (outer.rho.numpy() == pytest.approx(6.0))
    assert inner.derivatives.shape == (0, len(points.x))


@pytest.mark.parametrize("seed", range(4))
def test_the_least_of_a_field_is_looked_for_between_the_points_once(seed: int) -> None:
    """A field of waves: its least at the points, then at 21 x 21 places around that one, none beyond the rim."""
    chance, grid = np.random.default_rng(seed), TableGrid(13)
    waves, phases = chance.normal(size=(6, 2)) * 9.0, chance.uniform(0.0, 6.0, 6)

    def height(x: Any, y: Any) -> Any:
        return sum(np.cos(a * x + b * y + c) for (a, b), c in zip(waves, phases, strict=True))

    def field(inner: RadiusJet, outer: RadiusJet, points: ChartPoints) -> torch.Tensor:
        assert inner.derivatives.shape == outer.derivatives.shape == (5, len(points.x))
        return torch.from_numpy(height(points.x.numpy(), points.y.numpy()))

    own = Constraint("a_mm", "mm", 0.0, "", field, 1.0, 0.0, True)
    points = constraint_points(grid, "none")
    tables = [torch.ones(grid.side, grid.side, dtype=torch.float64)] * 2
    x, y = min(points.tolist(), key=lambda place: float(height(*place)))
    least = float(height(x, y))
    for k in range(21):
        for m in range(21):
            near, along = x + grid.step * (k / 10 - 1.0), y + grid.step * (m / 10 - 1.0)
            shrink = max(1.0, np.hypot(near, along))
            least = min(least, float(height(near / shrink, along / shrink)))
    assert feasibility._least(own, grid, points, tables) == pytest.approx(least, abs=1e-9)


def test_shapes_are_measured_on_a_table_of_eight_nodes_across_the_narrowest_function(monkeypatch) -> None:
    spec = small_spec(constraints__inner_draft_deg=1.0, constraints__outer_draft_deg=2.0)
    lens, asked = Lens(sphere(3.0), sphere(6.0), spec, 0, "draft"), []
    monkeypatch.setattr(feasibility, "grid_for", lambda *given: asked.append(given) or TableGrid(24))
    found = feasibility.measure_constraints(lens, 200)
    assert asked == [(lens.detail_rad, 8.0)]
    assert found.inner_draft_margin_deg == pytest.approx(-1.0, abs=1e-4)
    assert found.outer_draft_margin_deg == pytest.approx(-2.0, abs=1e-4)
    assert found.wall_margin_mm == pytest.approx(2.0) and found.inner_curvature_margin_per_mm is None
    plain = Lens(sphere(3.0), sphere(6.0), small_spec(), 0, "draft")
    assert feasibility.measure_constraints(plain, 200).inner_draft_margin_deg is None and len(asked) == 1
