"""A search that chooses its levels: what follows from the judgement of validation rays, by hand and for any."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from judgements import judged
from scenes import small_spec

from lensforge.search.automatic_schedule import AutomaticSchedule, schedule_of
from lensforge.search.schedule import SLICES, AutomaticStages, Judgement, Outcome, Stage, UsefulLevels, stages_of
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import SearchEffort, preset_of

EFFORT = SearchEffort(finest=289, steps=(6, 20), rays=(256, 1024), validation_rays=4096, step_gain=0.1, level_gain=0.2)
LEVELS = UsefulLevels((9, 25, 81), "three levels are enough")
MOST_STAGES = 1000


def schedule(**changes: object) -> AutomaticSchedule:
    defaults = {"levels": LEVELS, "effort": EFFORT, "images": 1, "start_level": 0}
    given = defaults | changes
    stages = AutomaticStages(**{name: given.pop(name) for name in defaults})  # type: ignore[arg-type]
    return AutomaticSchedule(stages, **({"uniform": False} | given))  # type: ignore[arg-type]


class Followed:
    """A whole search, where ``merit`` says what becomes of a lens of some merit in a stage; 256 rays take a second.

    The merit with the uniformity first is ``even`` times that of the light.
    """

    def __init__(
        self, plan: AutomaticSchedule, merit: Callable[[Stage, float], float], even: float = 2.0, noise: float = 0.0
    ) -> None:
        self.stages: list[Stage] = []
        self.outcomes: list[Outcome] = []
        kept = dict.fromkeys(("current", "best", "accepted"), (1.0, (9,)))
        following = plan.next_stage([])
        seconds = 0.0
        while following.stage is not None and len(self.stages) < MOST_STAGES:
            stage = following.stage
            self.stages.append(stage)
            seconds += stage.steps * stage.rays / 256
            before, _ = kept["current"]
            value = merit(stage, before) if stage.steps else before
            kept["current"] = value, stage.levels
            uniform = judged(even * value) if plan.uniform else None
            light = judged(value, noise, len(self.outcomes))
            self.outcomes.append(Outcome(steps=stage.steps, seconds=seconds, light=light, even=uniform))
            following = plan.next_stage(self.outcomes)
            kept["best"] = kept["current"] if following.improved else kept["best"]
            kept["accepted"] = kept["best"] if following.accepted else kept["accepted"]
            kept["current"] = kept[following.begin]
            if following.begin != "current":
                kept["best"] = kept["current"]
        self.why = following.why
        (self.merit, self.levels) = kept["current"]

    @property
    def long(self) -> list[Stage]:
        return [stage for stage in self.stages if stage.steps == EFFORT.steps[1]]


def towards(limits: dict[int, float]) -> Callable[[Stage, float], float]:
    """Each stage halves the distance to the least merit of its level."""
    return lambda stage, merit: 0.5 * (merit + min(limits[stage.level], merit))


def test_levels_are_added_while_they_gain() -> None:
    followed = Followed(schedule(), towards({0: 0.5, 1: 0.2, 2: 0.05}))
    assert [(stage.level, stage.steps) for stage in followed.stages[:4]] == [(0, 0), (0, 6), (1, 6), (2, 6)]
    assert followed.levels == (9, 25, 81)
    assert followed.why.startswith(f"{LEVELS.why}; the last 20 steps lowered the error by ")
    assert followed.why.endswith(" %, less than 10 %")
    assert followed.merit == min(outcome.light.merit for outcome in followed.outcomes if outcome.light)


def test_a_level_that_was_led_astray_is_tried_again_with_smaller_steps() -> None:
    rate = schedule().stages.level_stage(1).learning_rate
    followed = Followed(schedule(), lambda stage, m: m * 1.5 if stage.learning_rate == rate else max(1e-3, 0.5 * m))
    assert followed.levels == (9, 25, 81)
    assert [stage.level for stage in followed.stages[:5]] == [0, 0, 1, 1, 2]


@pytest.mark.parametrize("index", [1.4936, 1.9])
def test_functions_that_a_ball_reaches_are_as_wide_as_move_the_light_by_a_pixel(index: float) -> None:
    """Hollow as a ball of 20 mm, a function w wide has a slope of w/40 mm, which turns light by n - 1 of that."""
    spec = small_spec(lens__refractive_index=index, manufacture__cutter_radius_mm=20.0)
    pixel_rad = spec.all_receivers[0].pixel_rad(spec.evaluate.pixels)
    wide_rad = pixel_rad * 2.0 * 20.0 / (index - 1.0) / spec.constraints.max_radius_mm
    why = UsefulLevels.of(spec, build_source(spec.source), 4225).why
    assert why.startswith(f"functions narrower than {wide_rad:.2g} rad would not show: what a ball of 20 mm reaches")


@pytest.mark.parametrize(("robust", "images"), [(False, 4), (True, 1)])
def test_parts_of_a_robust_search_have_no_mirror_images(robust: bool, images: int) -> None:
    changes = {
        "lens__symmetry": "rectangle",
        "lens__levels": "auto",
        "optimise__steps_per_level": None,
        "optimise__rays": None,
    }
    spec = small_spec(optimise__robust=robust, **changes)
    plan = schedule_of(spec, build_source(spec.source), preset_of("draft"), None)
    assert isinstance(plan, AutomaticSchedule) and plan.stages.images == images


def test_a_level_that_gains_too_little_is_left_out() -> None:
    followed = Followed(schedule(), towards({0: 0.5, 1: 0.7, 2: 0.05}))
    assert {stage.level for stage in followed.stages} == {0, 1}, "81 functions are not tried"
    assert followed.levels == (9,)
    assert re.match(r"25 functions more lower the error by [0-9.]+ %, less than 20 %; the last 20 steps", followed.why)


@pytest.mark.parametrize("uniform", [False, True])
def test_long_stages_take_ever_smaller_steps_with_more_rays(uniform: bool) -> None:
    followed = Followed(
        schedule(uniform=uniform), lambda s, m: 0.5 * m if m > (1e-3 if s.uniform == uniform else 0.1) else m
    )
    long = [stage for stage in followed.long if stage.uniform == uniform]
    assert len(long) > 2 and all(stage.steps == EFFORT.steps[1] for stage in long)
    assert np.allclose([stage.learning_rate for stage in long], long[0].learning_rate * 0.5 ** np.arange(len(long)))
    assert [stage.rays for stage in long[:3]] == [256, 512, 1024]


@pytest.mark.parametrize("worse", [1, 2, 3, 4])
def test_a_long_stage_that_ends_no_better_is_followed_by_one_of_half_the_steps(worse: int) -> None:
    """Of those that take as large steps as the first ``worse`` long stages: three of them in a row end the search."""
    first = schedule().stages.long_stage(2, 0, None).learning_rate
    followed = Followed(
        schedule(),
        lambda s, m: 1.1 * m if s.steps == 20 and s.learning_rate > first * 0.51**worse else max(0.5 * m, 1e-3),
    )
    assert (len(followed.long) > 3) == (worse < 3)
    assert followed.merit == min(outcome.light.merit for outcome in followed.outcomes if outcome.light)
    if worse > 2:
        assert len(followed.long) == 3 and followed.why.endswith(
            "the last 20 steps lowered the error by 0 %, less than 10 %"
        )


def test_uniformity_comes_last_and_is_judged_by_its_own_merit() -> None:
    image = towards({0: 0.5, 1: 0.2, 2: 0.05})
    for factor in (1.0, 2.0):
        followed = Followed(schedule(uniform=True), lambda s, m, f=factor: image(s, m) * (f if s.uniform else 1.0))
        uniform = [stage.uniform for stage in followed.stages]
        first = uniform.index(True)
        assert all(uniform[first:]) and not any(uniform[:first])
        before = [outcome.light.merit for outcome in followed.outcomes[:first] if outcome.light]
        assert followed.merit == min(before) if factor > 1.0 else followed.merit < min(before)


def test_a_gain_that_may_be_noise_is_none() -> None:
    halved = towards({0: 0.1, 1: 0.01, 2: 0.001})
    assert len(Followed(schedule(), halved).stages) > 5
    followed = Followed(schedule(), halved, noise=1.0)
    assert {stage.level for stage in followed.stages} == {0, 1} and followed.levels == (9,)
    assert "which may be noise: its standard error is" in followed.why


def from_lens(factor: float) -> Callable[[Stage, float], float]:
    """What becomes of a lens in each stage: its merit changes by ``factor``, but never below 0.1."""
    return lambda stage, merit: max(0.1, merit * factor)


def test_a_search_from_a_lens_never_ends_worse_than_that_lens() -> None:
    for worse in (1.5, 0.6):
        followed = Followed(schedule(start_level=1), from_lens(worse))
        assert followed.stages[0].steps == 0 and [stage.level for stage in followed.stages[:3]] == [1, 0, 1]
        assert all(stage.levels == (9, 25) for stage in followed.stages[:3]), "all its functions stay"
        assert [stage.functions for stage in followed.stages[:3]] == [34, 9, 34], "the broad ones move first"
        assert followed.merit <= 1.0 and (followed.merit == 1.0) == (worse > 1.0)
        assert followed.levels == (9, 25) if worse > 1.0 else followed.levels == (9, 25, 81)


def test_a_lens_that_its_own_functions_do_not_improve_gets_finer_ones() -> None:
    """Limits that it touches, or a search that ended: what the next level can do is known when it has been tried."""

    def merit(stage: Stage, merit: float) -> float:
        return 1.5 * merit if stage.level < 2 else max(0.1, 0.6 * merit)

    followed = Followed(schedule(start_level=1), merit)
    assert [(stage.level, stage.functions) for stage in followed.stages[:4]] == [(1, 34), (0, 9), (1, 34), (2, 115)]
    assert followed.levels == (9, 25, 81) and followed.merit == 0.1


def test_a_budget_is_kept() -> None:
    for budget_s in (60.0, 110.0):
        followed = Followed(schedule(budget_s=budget_s), lambda stage, merit: 0.7 * merit)
        assert budget_s - 40.0 <= followed.outcomes[-1].seconds <= budget_s, "ten steps of 1024 rays take 40 s"
        assert f"optimise.seconds = {budget_s:g} are used" in followed.why
    assert (
        "optimise.seconds = 26 leaves no time for 81 functions"
        in Followed(schedule(budget_s=26.0), lambda stage, merit: 0.7 * merit).why
    )


def test_a_level_is_not_tried_again_without_time() -> None:
    for budget_s in range(8, 30):
        followed = Followed(schedule(budget_s=float(budget_s)), lambda stage, merit: 0.95 * merit)
        assert all(stage.steps for stage in followed.stages[1:]), budget_s


def test_a_short_budget_is_shared_among_the_levels() -> None:
    effort = EFFORT.model_copy(update={"steps": (60, 200)})
    halved = towards({0: 0.5, 1: 0.2, 2: 0.05})
    steps = {}
    for budget_s in (150.0, 250.0, 2000.0):
        followed = Followed(schedule(effort=effort, budget_s=budget_s), halved)
        assert followed.levels == (9, 25, 81) and followed.outcomes[-1].seconds <= budget_s
        steps[budget_s] = [stage.steps for stage in followed.stages[1:4]]
    assert [step[0] for step in steps.values()] == [60] * 3, "how long a step takes is known after the first level"
    assert 10 <= max(steps[150.0][1:]) < min(steps[250.0][1:]) and steps[2000.0] == [60] * 3
    assert Followed(schedule(effort=effort, budget_s=90.0), halved).levels == (9,)


def test_some_of_a_budget_is_left_for_the_uniformity() -> None:
    followed = Followed(schedule(uniform=True, budget_s=200.0), lambda stage, merit: 0.7 * merit)
    assert followed.stages[-1].uniform and any(s.steps > EFFORT.steps[0] for s in followed.stages)
    assert followed.outcomes[-1].seconds <= 200.0


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([None, 30.0, 80.0]))
def test_no_search_ends_above_what_validation_rays_have_accepted(
    seed: int, uniform: bool, budget_s: float | None
) -> None:
    draw = np.random.default_rng(seed)
    factors = (0.5, 0.7, 0.85, 0.97, 1.0, 1.3)
    followed = Followed(
        schedule(uniform=uniform, budget_s=budget_s), lambda _, merit: merit * float(draw.choice(factors))
    )
    assert len(followed.stages) < MOST_STAGES, "it ends"
    assert followed.why
    pairs = list(zip(followed.outcomes, followed.stages, strict=True))
    assert followed.merit == min(o.light.merit for o, s in pairs if o.light and s.level == len(followed.levels) - 1)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_same_judgements_lead_to_the_same_stages(seed: int) -> None:
    draw = np.random.default_rng(seed)
    followed = Followed(schedule(), lambda stage, merit: merit * float(draw.uniform(0.6, 1.1)))
    assert stages_of(schedule(), followed.outcomes) == followed.stages


def test_the_error_of_a_gain_is_that_of_many_pairs_of_samples() -> None:
    """Of a mean over slices the jackknife's error is the usual one; what both judgements share does not count."""
    draw = np.random.default_rng(5)
    shares = []
    errors = []
    for _ in range(2000):
        shared = draw.normal(size=SLICES)
        scatter = 0.01 * draw.normal(size=(2, SLICES))
        slices = np.array([1.0, 0.8])[:, None] + shared + scatter
        before, after = (
            Judgement(
                merit=float(block.mean()), image=2.0, without=tuple(((block.sum() - block) / (SLICES - 1)).tolist())
            )
            for block in slices
        )
        gain = before.gain_of(after)
        shares.append(gain.share)
        errors.append(gain.standard_error)
    assert np.isclose(np.mean(shares), 0.1, atol=4e-4)
    assert np.isclose(np.sqrt(np.mean(np.square(errors))), np.std(shares), rtol=0.05)
