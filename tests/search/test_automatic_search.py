"""Searches that choose their levels: where they stop, how they resume, and how their light is judged."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from judgements import judge_as
from nightly import first_by_day
from presets import FEW_STEPS
from scenes import small_spec
from search_scenes import require_same_bits_after

import lensforge as lf
from lensforge.search import feasibility
from lensforge.search.design_result import constraint_criteria
from lensforge.search.merit import MeritFunction
from lensforge.search.optimiser import search
from lensforge.search.problem import Problems, ValidationRays
from lensforge.search.schedule import Judgement, UsefulLevels, rays_ahead
from lensforge.search.search_state import SearchState
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.sources.ray_set import RaySetEmitter
from lensforge.spec import Spec, load_spec
from lensforge.spec.accuracy import PRESETS, SearchEffort

FEW = FEW_STEPS.effort
EXAMPLES = Path(__file__).parents[2] / "examples"


def automatic(**changes: object) -> Spec:
    return small_spec(lens__levels="auto", optimise__steps_per_level=None, optimise__rays=None, **changes)


def levels_of(spec: Spec, finest: int = 4225) -> UsefulLevels:
    return UsefulLevels.of(spec, build_source(spec.source), finest)


def square(spec: Spec) -> Source:
    return build_source(spec.source)


def measured(spec: Spec) -> Source:
    return RaySetEmitter(square(spec).sample(4000, 1), 1.0)


@pytest.mark.parametrize(
    ("light", "changes", "stop_at"),
    first_by_day(
        1,
        [
            (measured, {}, 9),
            (square, {"target__uniform_mm": 60.0}, 18),
            (square, {}, 9),
            (square, {}, 4),
            *((square, {}, step) for step in (1, 3, 5, 8, 13, 14)),
            (square, {"target__uniform_mm": 60.0}, 14),
        ],
    ),
)
def test_the_same_bits_after_an_interrupt(
    light: Callable[[Spec], Source], changes: dict[str, object], stop_at: int, tmp_path: Path
) -> None:
    spec = automatic(**changes)
    path = tmp_path / "checkpoint.bin"
    source = light(spec)
    whole = search(spec, source, accuracy=FEW_STEPS)
    assert whole.ended and whole.steps >= stop_at
    require_same_bits_after(stop_at, spec, source, path, whole, accuracy=FEW_STEPS)


def test_a_level_that_is_left_out_at_the_very_end_leaves_its_functions_out(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    seconds = iter(range(0, 10_000, 20))
    monkeypatch.setattr("lensforge.search.optimiser.time.perf_counter", lambda: float(next(seconds)))
    spec = automatic(optimise__seconds=700.0, target__uniform_mm=None)
    path = tmp_path / "checkpoint.bin"
    for resume in (False, True):
        judge_as(monkeypatch, 1.0, 0.5, 0.51, 0.49)
        result = search(spec, build_source(spec.source), accuracy=FEW_STEPS, checkpoint=path, resume=resume)
        assert result.lens.basis.levels == (9,) and result.steps == 3 * FEW.steps[0]
        assert "25 functions more lower the error by" in str(result.ended)


@pytest.mark.parametrize("seed", first_by_day(1, range(4)))
def test_a_search_by_few_points_still_ends_within_its_limits(seed: int) -> None:
    """At the nodes of its coarse table this lens is a little smaller than between them."""
    spec = automatic()
    problem = Problems(spec, build_source(spec.source), PRESETS["draft"].nodes_per_sigma, None).of((9, 25, 81))
    weights = torch.from_numpy(np.random.default_rng(seed).normal(size=(115, 2)) * [0.0, 0.02])
    offsets = torch.ones(2, dtype=torch.float64)
    fields = problem.constraints.fields(problem.parametrisation.tables(weights, offsets))
    largest = 7.0 - problem.constraints.least(fields)["radius_margin_mm"]
    factor = (7.0 - 1e-3) / largest
    weights[:, 1] *= factor
    offsets[1] = factor
    weights, offsets = feasibility.project_to_feasible(*problem.in_full(), weights, offsets)
    lens = problem.parametrisation.lens(weights, offsets, problem.spec, 0, "draft")
    assert all(criterion.holds for criterion in constraint_criteria(lens.spec, feasibility.measure_constraints(lens)))


@pytest.mark.nightly("six seconds; by day a search by few points ends within its limits")
def test_a_limit_that_the_coarse_table_keeps_is_kept_by_the_lens_itself() -> None:
    """Curvatures of a table of 2.5 nodes a sigma are off by more than the margin: one projection is not enough."""
    problem = Problems(
        automatic(lens__symmetry="square", lens__inner__concave_radius_mm=1.0),
        build_source(small_spec().source),
        PRESETS["draft"].nodes_per_sigma,
        None,
    ).of((9, 25, 81, 289))
    weights = torch.from_numpy(np.random.default_rng(1).normal(size=(404, 2)) * [0.06, 0.0])
    state = SearchState(weights, torch.ones(2, dtype=torch.float64), problem.constraints.multipliers)
    once = feasibility.project_to_feasible(*problem.in_full(), weights, state.offsets)
    first = feasibility.measure_constraints(problem.parametrisation.lens(*once, problem.spec, 0, "draft"))
    lens, margins = feasibility.feasible_lens(problem, state, 0, "draft")
    assert first.curvature_margin_per_mm["inner"] < -0.005
    assert margins == feasibility.measure_constraints(lens)
    assert all(criterion.holds for criterion in constraint_criteria(problem.spec, margins))


def test_the_force_of_a_constraint_is_the_same_on_the_next_level() -> None:
    """Curvature and draft are scaled by the width of the narrowest function: their multipliers go the other way."""
    spec = automatic(lens__outer__concave_radius_mm=3.0, lens__outer__draft_deg=5.0, lens__symmetry="square")
    problems = Problems(spec, build_source(spec.source), 3.4, None)
    coarse = problems.of((9, 25))
    fine = problems.of((9, 25, 81))
    before = torch.ones_like(coarse.constraints.multipliers)
    after = fine.constraints.at_nearest(coarse.constraints, before)
    forces = [c.constraints._factor * m.mean(dim=1, keepdim=True) for c, m in ((coarse, before), (fine, after))]
    assert torch.allclose(*forces, rtol=1e-12)
    factors = fine.constraints._factor / coarse.constraints._factor
    assert torch.allclose(factors[:3], torch.ones(1, dtype=torch.float64)) and (factors[3:] < 0.7).all()


def test_wide_sources_and_balls_make_fine_levels_useless() -> None:
    pi, flat_top = (load_spec(EXAMPLES / f"{name}.toml") for name in ("pi", "flat_top"))
    assert levels_of(pi, 1089).why == "finest level of this accuracy: 1089 functions"
    assert levels_of(flat_top).counts[-1] == 289
    assert "a fifth of the angle of the source, 1 mm wide" in levels_of(flat_top).why
    assert levels_of(pi, 289).why == "finest level of this accuracy: 289 functions"
    small = pi.replace({"source.side_mm": 0.1})
    assert levels_of(small).counts[-1] == 4225
    coarse = small.replace({"lens.outer.concave_radius_mm": 40.0})
    assert levels_of(coarse).counts[-1] < 1089 and "a ball of 40 mm" in levels_of(coarse).why
    (receiver,) = coarse.all_receivers
    pixel_rad = max(receiver.size) / coarse.evaluate.pixels / receiver.distance_mm
    turned = coarse.lens.media.largest_turning_power * coarse.constraints.max_radius_mm
    assert f"narrower than {2.0 * 40.0 * pixel_rad / turned:.2g} rad" in levels_of(coarse).why


def test_validation_rays_judge_without_the_noise_of_their_number() -> None:
    spec = automatic()
    source = build_source(spec.source)
    problem = Problems(spec, source, 3.4, None).of((9, 25))
    weights = torch.from_numpy(np.random.default_rng(0).normal(size=(34, 2)) * 0.01)
    offsets = torch.ones(2, dtype=torch.float64)
    few = [
        ValidationRays.of(source, 2**9, seed)[0].judge(problem, weights, offsets, False)[0].image for seed in range(16)
    ]
    error = np.std(few) / np.sqrt(len(few))
    many = ValidationRays.of(source, 2**16, 99)[0].judge(problem, weights, offsets, False)[0].image
    assert abs(np.mean(few) - many) < 4.0 * error
    noisy = problem.merit.step_loss(weights, offsets, source.sample(2**9, 5), problem.constraints, False).nmse
    assert noisy > many + 4.0 * error, "what the noise of as many rays adds"


def judged_again(spec: Spec, design: lf.Design, effort: SearchEffort, seed: int = 0) -> Judgement:
    """The finished lens, judged by the validation rays of its search."""
    source = build_source(spec.source)
    problem = Problems(spec, source, PRESETS["draft"].nodes_per_sigma, None).of(design.lens.basis.levels)
    validation, _ = ValidationRays.of(source, effort.validation_rays, seed)
    judgement, _ = validation.judge(problem, *problem.parametrisation.parameters_of(design.lens), False)
    return judgement


@pytest.mark.parametrize("seed", first_by_day(1, range(3)))
def test_no_search_ends_above_what_validation_rays_have_accepted(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []
    judge = ValidationRays.judge

    def noted(self: ValidationRays, *given: Any) -> Any:
        judgement = judge(self, *given)
        seen.append(judgement[0].merit)
        return judgement

    monkeypatch.setattr(ValidationRays, "judge", noted)
    spec = automatic(target__uniform_mm=None)
    design = lf.design(spec, accuracy=FEW_STEPS, seed=seed)
    assert len(seen) > 2
    last = judged_again(spec, design, FEW, seed).merit
    assert last <= min(seen[:-1]) + 1e-4, "a margin of a constraint may still have been missing"


def test_a_machine_that_becomes_slower_keeps_the_budget(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    clock = [0.0]
    levels = []
    compiling = [0.0]
    evaluate = MeritFunction.step_loss
    monkeypatch.setattr("lensforge.search.optimiser.time.perf_counter", lambda: clock[0] + compiling[0])

    def compiled(merit: MeritFunction, weights: Any, offsets: Any, rays: RayBundle, *more: Any) -> Any:
        compiling[0] += 1000.0 if len(rays) == 1 else 0.0
        return evaluate(merit, weights, offsets, rays, *more)

    def slow(*given: Any) -> Iterator[RayBundle]:
        for rays in rays_ahead(*given):
            clock[0] += 1.0 if clock[0] < FEW.steps[0] else 30.0
            yield rays

    def observe(step: lf.Progress) -> None:
        if step.level_done:
            levels.append(step.functions)

    monkeypatch.setattr("lensforge.search.optimiser.rays_ahead", slow)
    monkeypatch.setattr(MeritFunction, "step_loss", compiled)
    spec = automatic(optimise__seconds=50.0)
    path = tmp_path / "checkpoint.bin"
    result = search(spec, build_source(spec.source), accuracy=FEW_STEPS, progress=observe, checkpoint=path)
    assert result.seconds == 4.0 + 2 * 30.0, "the step that goes beyond the budget is the last"
    assert compiling[0] == 1000.0, "is no time of the search"
    assert str(result.ended).endswith("optimise.seconds = 50 are used")
    assert len(levels) == len(result.lens.basis.levels)
    resumed = search(spec, build_source(spec.source), accuracy=FEW_STEPS, checkpoint=path, resume=True)
    assert resumed.lens.sha256 == result.lens.sha256 and resumed.steps == result.steps == FEW.steps[0] + 2
