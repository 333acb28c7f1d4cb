import inspect
import sys

import numpy as np
import pytest
import torch
from nightly import first_by_day
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search import feasibility
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.design_result import Margins, constraint_criteria
from lensforge.search.feasibility import feasible_lens, measure_constraints, project_to_feasible, require_feasible_start
from lensforge.search.optimiser import search
from lensforge.search.parameters import SphereParameters
from lensforge.search.problem import Problem, Problems
from lensforge.search.search_state import Parameters
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.surfaces.asphere import Asphere


def scene(
    spec: Spec, spread: float, outer: float
) -> tuple[SphereParameters, AugmentedLagrangian, torch.Tensor, torch.Tensor]:
    parametrisation = SphereParameters.of(spec, 2.5)
    weights = np.random.default_rng(1).normal(size=(parametrisation.basis.size, 2)) * spread
    offsets = torch.tensor([1.0, outer], dtype=torch.float64)
    return parametrisation, AugmentedLagrangian.of(spec, parametrisation.grid), torch.from_numpy(weights), offsets


def problem_of(spec: Spec, levels: tuple[int, ...]) -> Problem:
    return Problems(spec, build_source(spec.source), 2.5, None).of(levels)


def failing(parametrisation: SphereParameters, spec: Spec, weights: torch.Tensor, offsets: torch.Tensor) -> set[str]:
    criteria = constraint_criteria(spec, measure_constraints(parametrisation.lens(weights, offsets, spec, 0, "draft")))
    return {criterion.key for criterion in criteria if not criterion.holds}


def test_a_feasible_lens_is_left_to_the_bit() -> None:
    parametrisation, constraints, weights, offsets = scene(small_spec(), 0.001, 1.0)
    moved = project_to_feasible(parametrisation, constraints, weights, offsets)
    assert torch.equal(moved[0], weights)
    assert torch.equal(moved[1], offsets)


def test_a_sphere_that_is_too_large_shrinks_to_the_limit_and_no_further() -> None:
    spec = small_spec(lens__symmetry="square")
    parametrisation, constraints, weights, offsets = scene(spec, 0.0, 7.05 / 6.0)
    assert failing(parametrisation, spec, weights, offsets) == {"radius margin"}
    moved = project_to_feasible(parametrisation, constraints, weights, offsets)
    lens = parametrisation.lens(*moved, spec, 0, "draft")
    largest = 7.0 - measure_constraints(lens).radius_margin_mm
    assert 7.0 * (1.0 - 4e-4) < largest < 7.0
    assert lens.inner.offset_mm == pytest.approx(3.0, abs=1e-9), "the inner face has nothing to do with it"


def test_a_projection_does_not_load_the_compiler_of_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes seconds. Where another test has loaded it, torch has kept what it needs of it: that goes, too."""
    for method in (torch.optim.Optimizer.add_param_group, torch.optim.Optimizer.zero_grad):
        monkeypatch.delattr(inspect.unwrap(method), "__dynamo_disable", raising=False)
    monkeypatch.setitem(sys.modules, "torch._dynamo", None)
    parametrisation, constraints, weights, offsets = scene(small_spec(lens__symmetry="square"), 0.0, 7.05 / 6.0)
    moved = project_to_feasible(parametrisation, constraints, weights, offsets)
    assert not torch.equal(moved[1], offsets)


def test_every_kind_of_violation_is_mended_with_a_small_step() -> None:
    spec = small_spec(lens__inner__concave_radius_mm=2.6, lens__outer__draft_deg=0.3, lens__symmetry="square")
    parametrisation, constraints, weights, offsets = scene(spec, 0.004, 7.0 / 6.0)
    assert failing(parametrisation, spec, weights, offsets) >= {"radius margin", "outer draft margin"}
    moved = project_to_feasible(parametrisation, constraints, weights, offsets)
    assert failing(parametrisation, spec, *moved) == set()
    assert (moved[0] - weights).abs().max() < 0.02


@pytest.mark.parametrize(("gap_mm", "rounds"), [(0.0, 1), (0.05, 2)])
def test_a_limit_is_made_stricter_by_all_that_its_points_see_too_much(
    gap_mm: float, rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sphere 0.03 mm too large, which the points of the projection see smaller by the gap."""
    problem = problem_of(small_spec(lens__symmetry="square"), (9,))
    measured = list[float]()

    def with_gap(lens: Lens) -> Margins:
        margins = measure_constraints(lens)
        measured.append(margins.radius_margin_mm - gap_mm)
        return margins.changed(radius_margin_mm=measured[-1])

    monkeypatch.setattr(feasibility, "measure_constraints", with_gap)
    parameters = Parameters(
        torch.zeros(9, 2, dtype=torch.float64), torch.tensor([1.0, 7.03 / 6.0], dtype=torch.float64)
    )
    lens, margins, _ = feasible_lens(problem, parameters, 0, "draft")
    assert len(measured) == rounds and margins.radius_margin_mm == measured[-1]
    margin_mm = lens.spec.constraints.margin_mm
    assert 0.3 * margin_mm <= margins.radius_margin_mm + 1e-9 <= margin_mm + 2e-9


@pytest.mark.parametrize(
    ("curvature", "draft_deg", "rounds"), [(2.1e-3, 0.05, 1), (1.9e-3, 0.05, 2), (0.05, 0.021, 1), (0.05, 0.019, 2)]
)
def test_a_search_ends_inside_what_a_check_judges(
    curvature: float, draft_deg: float, rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By twice the tolerance of a ball's curvature, a thousandth of it, and of a draft, 0.01 degrees."""
    shop = {"cutter_radius_mm": 1.0, "max_tilt_deg": 0.0}  # an axis that stands leaves no undercut
    problem = problem_of(small_spec(lens__symmetry="square", manufacture=shop), (9,))
    measured = list[Margins]()

    def beside_the_limit(lens: Lens) -> Margins:
        margins = measure_constraints(lens)
        if not measured:
            curvatures = {**margins.curvature_margin_per_mm, "outer": curvature}
            drafts = {**margins.draft_margin_deg, "outer": draft_deg}
            margins = margins.changed(curvature_margin_per_mm=curvatures, draft_margin_deg=drafts)
        measured.append(margins)
        return margins

    monkeypatch.setattr(feasibility, "measure_constraints", beside_the_limit)
    feasible_lens(problem, Parameters(*problem.parametrisation.start()), 0, "draft")
    assert len(measured) == rounds


def test_where_limits_exclude_each_other_the_worst_of_them_is_lessened() -> None:
    """A radius 5.5 mm less leaves no room for cavity and wall."""
    parametrisation, constraints = problem_of(small_spec(lens__symmetry="square"), (9,)).in_full()
    strict = constraints.tightened({"radius_margin_mm": 5.5})
    start = torch.zeros(9, 2, dtype=torch.float64), torch.tensor([1.0, 7.03 / 6.0], dtype=torch.float64)
    moved = project_to_feasible(parametrisation, strict, *start)
    before, after = (
        strict.shortfall(strict.fields(parametrisation.tables(*parameters))) for parameters in (start, moved)
    )
    assert 1.0 < after < 0.9 * before


def test_of_lenses_that_all_miss_a_limit_the_one_that_misses_least_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of(small_spec(), (9,))
    misses = iter([0.02, 0.01, 0.05, 0.03])

    def measured(_: Lens) -> Margins:
        return Margins(cavity_clearance_mm=0.1, wall_margin_mm=0.0, radius_margin_mm=-next(misses))

    monkeypatch.setattr(feasibility, "measure_constraints", measured)
    parameters = Parameters(*problem.parametrisation.start())
    assert feasible_lens(problem, parameters, 0, "draft")[1].radius_margin_mm == -0.01 and not [*misses]


def test_limits_that_only_a_projection_shows_to_exclude_each_other_are_named_before_the_search() -> None:
    """A cavity of 5.5 mm nowhere tighter than 5.5 mm, 1 mm of wall and 25 degrees of draft need 6.5 / cos(25 deg)."""
    limits = {"constraints__cavity_height_mm": 5.5, "lens__inner__concave_radius_mm": 5.5}
    spec = small_spec(**limits, lens__outer__draft_deg=25.0, lens__symmetry="square")
    begun: list[object] = []
    message = r"no lens meets all of .*lens\.outer\.draft_deg = 25"
    with pytest.raises(InputError, match=message) as refusal:
        search(spec, build_source(spec.source), accuracy="draft", progress=begun.append)
    assert not begun
    assert "keep_out" not in str(refusal.value), "a limit that the spec does not set"
    assert "constraints." in str(refusal.value).split("closest")[1] and "\n" not in str(refusal.value)
    wider = small_spec(**limits, lens__outer__draft_deg=25.0, constraints__max_radius_mm=7.5, lens__symmetry="square")
    require_feasible_start([problem_of(wider, wider.lens.basis.levels)])  # 7.17 mm of radius are enough


@pytest.mark.parametrize("symmetry", first_by_day(1, ["mirror_x", "rectangle", "square"], "other groups of mirrors"))
def test_one_of_each_mirror_image_has_the_margins_of_all(symmetry: str, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = small_spec(lens__symmetry=symmetry)
    parametrisation, _, weights, offsets = scene(spec, 0.01, 1.0)
    lens = parametrisation.lens(weights, offsets, spec, 0, "draft")
    some = measure_constraints(lens)
    monkeypatch.setattr("lensforge.search.feasibility.first_images", lambda u, _: np.ones(len(u), dtype=bool))
    every = measure_constraints(lens)
    for name in ("cavity_clearance_mm", "wall_margin_mm", "radius_margin_mm"):
        assert getattr(every, name) <= getattr(some, name) <= getattr(every, name) + 3e-4


@pytest.mark.parametrize(("raised_mm", "wall_mm"), [(1.0, 35.0**0.5 - 3.0), (-0.5, 2.5)])
def test_a_wall_is_measured_on_the_rim_itself_and_at_the_apex(raised_mm: float, wall_mm: float) -> None:
    """A sphere of 6 mm about a point on the axis, around a hemisphere of 3 mm; thinnest on the rim, or at the apex."""
    spec = small_spec(constraints__min_thickness_mm=0.25)
    lens = Lens.double(Asphere(3.0, -3.0), Asphere(raised_mm + 6.0, -6.0), spec, 0, "draft")
    at_rim = raised_mm > 0.0
    margin = measure_constraints(lens).wall_margin_mm
    assert margin == pytest.approx(wall_mm - 0.25, abs=1e-6 if at_rim else 1e-4)
