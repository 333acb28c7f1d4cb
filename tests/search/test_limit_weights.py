"""Limits on the light count for as little as keeps them: weights of the stages, judgements by them, missed limits."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scenes import small_spec
from scipy import sparse

from lensforge.scene.limit_readings import LightLimit
from lensforge.search.automatic_schedule import AutomaticSchedule
from lensforge.search.limit_terms import LimitTerm
from lensforge.search.merit import MeritFunction
from lensforge.search.parameters import SphereParameters
from lensforge.search.problem import Problems, ValidationRays
from lensforge.search.schedule import (
    SLICES,
    AutomaticStages,
    FixedSchedule,
    Judgement,
    LimitWeights,
    Outcome,
    Stage,
    UsefulLevels,
    stages_of,
)
from lensforge.sources.build_source import build_source
from lensforge.spec.accuracy import SearchEffort
from lensforge.spec.quantities import PlaceLight

STAGES = tuple(Stage(level, (9, 25, 81), functions, 4, 64, 0.01) for level, functions in enumerate((9, 34, 115)))


def ended(missed: int, merit: float = 1.0, weight: float = 1.0) -> Outcome:
    light = Judgement(merit=merit, image=merit, without=(merit,) * SLICES, limits_missed=missed)
    return Outcome(steps=4, seconds=1.0, light=light, limit_weight=weight)


@pytest.mark.parametrize(
    ("missed", "weights"),
    [
        ((0, 0, 0), [0.01, 0.01, 0.01, 0.01]),
        ((5, 0, 0), [0.01, 0.01, 0.01, 0.01]),  # a start keeps no limit
        ((1, 1, 0), [0.01, 0.01, 0.1, 0.1]),
        ((1, 2, 1), [0.01, 0.01, 0.1, 1.0]),
        ((0, 0, 3), [0.01, 0.01, 0.01, 0.1]),
        ((0, 1, 0), [0.01, 0.01, 0.1, 0.1]),
    ],
)
def test_a_limit_that_is_missed_counts_for_more_in_the_next_stage(missed, weights) -> None:
    plan = FixedSchedule(STAGES)
    stages = stages_of(plan, [ended(number, 1.0 / (k + 1)) for k, number in enumerate(missed)])
    assert [stage.limit_weight for stage in stages] == pytest.approx(weights)


def test_the_only_stage_of_a_search_has_its_limits_in_full() -> None:
    assert stages_of(FixedSchedule(STAGES[-1:]), [ended(0)])[-1].limit_weight == 1.0
    assert LimitWeights.over(2) == LimitWeights(0.1, 10.0, pytest.approx(0.1))
    assert LimitWeights.over(5) == LimitWeights(0.01, 10.0, pytest.approx(1e-4))


@pytest.mark.parametrize(("limits", "weight"), [(0.0, 0.01), (20.0, 0.01), (500.0, 0.001), (1e6, 1e-4)])
def test_limits_that_would_outweigh_the_image_begin_with_less(limits: float, weight: float) -> None:
    start = Judgement(merit=limits + 0.6, image=limits + 0.5, without=(1.0,) * SLICES, limits=limits)
    assert LimitWeights.over(5).after(start) == pytest.approx(weight)
    begun = Outcome(steps=0, seconds=1.0, light=start)
    plan = FixedSchedule((*STAGES, *STAGES[-1:] * 2))
    assert stages_of(plan, [begun])[-1].limit_weight == pytest.approx(weight)


def automatic(start_level: int = 0) -> AutomaticSchedule:
    effort = SearchEffort(
        finest=25, steps=(6, 20), rays=(256, 1024), validation_rays=4096, step_gain=0.1, level_gain=0.2
    )
    stages = AutomaticStages(levels=UsefulLevels((9, 25), "two"), effort=effort, images=1, start_level=start_level)
    return AutomaticSchedule(stages, uniform=False)


def test_a_search_goes_on_while_limits_are_missed_that_could_count_for_more() -> None:
    """It gains nothing from the first stage on: with all limits kept it ends at once, else when they count in full."""
    by_missed = {}
    for missed in (0, 1):
        outcomes = []
        plan = automatic()
        while (stage := plan.next_stage(outcomes).stage) is not None:
            outcomes.append(ended(missed, 1.0 if stage.steps else 1.1, stage.limit_weight))
        by_missed[missed] = [stage.limit_weight for stage in stages_of(plan, outcomes)]
    assert set(by_missed[0]) == {0.01}
    assert by_missed[1][-1] == 1.0 and by_missed[1][1:4] == pytest.approx([0.01, 0.04, 0.16])
    assert by_missed[1].count(1.0) <= 2, "with its limits in full a search ends as any other"
    assert automatic(1).limit_weights == LimitWeights()


def test_a_stage_that_is_taken_back_leaves_the_weight_as_it_was() -> None:
    """The second stage ends worse, and misses a limit that the lens before it keeps."""
    plan = FixedSchedule(STAGES)
    stages = stages_of(plan, [ended(1, 1.0), ended(0, 0.5), ended(3, 0.8), ended(0, 0.4)])
    assert [stage.limit_weight for stage in stages] == pytest.approx([0.01] * 4)


@pytest.mark.parametrize(("sense", "kept", "missed"), [(">=", 1.04, 1.02), ("<=", 0.96, 0.98)])
def test_what_pictures_of_a_search_show_too_good_must_be_kept_by_more(sense, kept: float, missed: float) -> None:
    limit = LightLimit("a", 0, PlaceLight(), sense, "lx", sparse.csr_array(np.eye(4)), 2.0)
    of_picture = LimitTerm.of(limit)
    by_intensities = LimitTerm.of(replace(limit, application=0))
    assert [of_picture.is_missed(2.0 * share) for share in (kept, missed)] == [False, False]
    assert [by_intensities.is_missed(2.0 * share) for share in (kept, missed)] == [False, True]
    assert of_picture.is_missed(2.0 / kept)


def test_two_lenses_are_compared_by_the_merit_that_the_later_was_searched_with() -> None:
    """Merits 1.0 and 0.9, of which the limits are 0.5 and 0.6: with a tenth of them 0.55 and 0.36."""
    first, second = (
        Judgement(
            merit=merit,
            image=0.8,
            without=(merit,) * (SLICES - 1) + (merit + 0.1,),
            limits=limits,
            limits_without=(limits,) * (SLICES - 1) + (limits + more,),
        )
        for merit, limits, more in ((1.0, 0.5, 0.2), (0.9, 0.6, 0.0))
    )
    light = first.weighted(0.1)
    assert (light.merit, light.image) == (pytest.approx(0.55), pytest.approx(0.35))
    assert light.without == pytest.approx((0.55,) * (SLICES - 1) + (0.55 + 0.1 - 0.9 * 0.2,))
    before = Outcome(steps=1, seconds=1.0, light=first, limit_weight=0.01)
    after = Outcome(steps=1, seconds=1.0, light=second, limit_weight=0.1)
    assert before.gain_of(after, even=False).share == pytest.approx((0.55 - 0.36) / 0.35)
    in_full = Outcome(steps=1, seconds=1.0, light=second)
    assert before.gain_of(in_full, even=False).share == pytest.approx(0.1 / 0.8)


ZONE = {"kind": "zone", "unit": "w_per_m2"}


def test_a_judgement_counts_the_limits_that_its_rays_show_to_be_missed() -> None:
    """Of three limits the second is missed by far; one that is only just missed, within its noise, is not counted."""
    spec = small_spec().replace(limits=[ZONE | {"at_most": 1e6}, ZONE | {"at_most": 1e-3}, ZONE | {"at_least": 1e-12}])
    source = build_source(spec.source)
    problem = Problems(spec, source, 3.0, None).of((9,))
    validation, _ = ValidationRays.of(source, 2**12, 0)
    weights, offsets = problem.parametrisation.start()
    light, _ = validation.judge(problem, weights, offsets, False)
    assert light.limits_missed in (1, 2)  # the dark rim of the window may miss the third
    alone = Problems(spec.replace(limits=[ZONE | {"at_most": 1e6}]), source, 3.0, None).of((9,))
    kept, _ = validation.judge(alone, weights, offsets, False)
    assert (kept.limits_missed, kept.limits) == (0, 0.0)
    assert light.merit - light.limits == pytest.approx(kept.merit, rel=1e-9)
    assert [a - b for a, b in zip(light.without, light.limits_without, strict=True)] == pytest.approx(kept.without)


def test_a_step_sees_so_much_of_the_limits_as_its_stage_says() -> None:
    spec = small_spec().replace(limits=[ZONE | {"at_most": 1e-3}])
    source = build_source(spec.source)
    parameters = SphereParameters.of(spec, 3.0)
    merit = MeritFunction.of(spec, source, parameters)
    weights = torch.zeros((parameters.basis.size, 2), dtype=torch.float64)
    light = merit.light_of(parameters.tables(weights, torch.ones(2, dtype=torch.float64)), source.sample(2**10, 1))
    bare = replace(merit, limits=()).training_loss(light, False).loss.item()
    full = merit.training_loss(light, False).loss.item()
    assert full - bare > 1.0
    tenth = merit.training_loss(light, False, 0.1).loss.item()
    assert tenth == pytest.approx(bare + 0.1 * (full - bare), rel=1e-12)
    assert np.isfinite(full)
