"""A search never ends below its start: the better of both is kept, judged alike, and the reason is said."""

from pathlib import Path

import pytest
import torch
from judgements import judge_as, judged
from presets import FEW
from search_scenes import small_spec

from lensforge.scene.lens import Lens
from lensforge.search.design_result import design_facts
from lensforge.search.ending import Candidates
from lensforge.search.feasibility import measure_constraints
from lensforge.search.optimiser import search
from lensforge.search.problem import Problems, ValidationRays
from lensforge.search.schedule import FixedSchedule, Outcome, Stage
from lensforge.search.search_state import Parameters
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec

STAGES = tuple(Stage(level, (9, 25), functions, 4, 64, 0.01) for level, functions in enumerate((9, 34)))


def outcome(merit: float) -> Outcome:
    return Outcome(steps=4, seconds=1.0, light=judged(merit))


def faces_of(lens: Lens) -> list[float]:
    return [weight for face in (lens.inner, lens.outer) for weight in (face.offset_mm, *face.weights_mm)]


@pytest.mark.parametrize(
    ("merits", "begins", "lost"),
    [
        ((0.9, 0.5, 0.3), ["current"] * 4, ""),
        ((0.9, 1.0, 0.3), ["current", "current", "accepted", "current"], "4 steps of 9 functions"),
        ((0.9, 0.5, 0.6), ["current", "current", "current", "accepted"], "4 steps of 34 functions"),
        ((0.9, 0.9, 0.9), ["current", "current", "accepted", "accepted"], "9 functions did not lower the error; the 4"),
    ],
)
def test_a_given_level_that_loses_is_taken_back(merits: tuple[float, ...], begins: list[str], lost: str) -> None:
    following = list(FixedSchedule(STAGES).next_stages([outcome(merit) for merit in merits]))
    assert [step.begin for step in following] == begins
    assert [step.stage.steps if step.stage else None for step in following] == [0, 4, 4, None]
    assert (lost in following[-1].why) and bool(lost) == bool(following[-1].why)


def test_what_does_not_move_has_no_stage() -> None:
    still = FixedSchedule(tuple(Stage(0, (9,), 9, 0, 64, 0.01) for _ in range(2)))
    assert [step.stage is None for step in still.next_stages([outcome(0.5)])] == [False, True]


def spec_of_few_steps(**changes: object) -> Spec:
    return small_spec(lens__symmetry="square", optimise__steps_per_level=[2, 2], **changes)


def test_a_search_that_only_loses_ends_with_its_start_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = spec_of_few_steps()
    source = build_source(spec.source)
    better = search(spec, source, accuracy=FEW)
    assert not better.kept_start and better.ended is None
    judge_as(monkeypatch, 0.3, 0.4)
    result = search(spec, source, accuracy=FEW, start=better.lens)
    assert result.kept_start and result.steps > 0 and result.ended is not None
    assert "did not improve on its start" in result.ended and "optimise.steps_per_level" in result.ended
    assert faces_of(result.lens) == pytest.approx(faces_of(better.lens), rel=1e-9, abs=1e-9)
    told = next(fact for group in design_facts(result) for fact in group.facts if fact.key == "kept_start")
    assert told.note == result.ended


def test_a_projection_that_costs_more_than_the_search_gained_gives_way_to_the_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spec = spec_of_few_steps()
    problems = Problems(spec, build_source(spec.source), 2.5, None)
    problem = problems.of((9, 25))
    start = Parameters(*problem.parametrisation.start())
    end = Parameters(start.weights + 1e-3, start.offsets)
    rays, _ = ValidationRays.of(build_source(spec.source), 64, 0)
    judge = Candidates(rays, even=False, seed=0, accuracy=FEW)
    for merits, kept in (((0.4,), False), ((0.6, 0.5), True), ((0.6, 0.7), False)):  # of the end, then of the start
        judge_as(monkeypatch, *merits)
        ending = judge.better(outcome(0.5), (problem, start), (problem, end))
        assert bool(ending.why) == kept and ending.margins == measure_constraints(ending.lens)
        assert bool(ending.lens.inner.weights_mm.any()) != kept
        assert ending.merits == ((merits[1] if kept else merits[0]),)


def test_a_search_that_goes_on_from_a_checkpoint_keeps_the_same_lens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped where the first level, which loses, has been taken back."""
    spec = spec_of_few_steps()
    path = tmp_path / "checkpoint.bin"
    source = build_source(spec.source)
    judge_as(monkeypatch, 0.5, 0.9, 0.4, 0.4)
    whole = search(spec, source, accuracy=FEW)
    judge_as(monkeypatch, 0.5, 0.9)
    with pytest.raises(KeyboardInterrupt):
        search(spec, source, accuracy=FEW, checkpoint=path, progress=_stop_at_third)
    judge_as(monkeypatch, 0.4)
    again = search(spec, source, accuracy=FEW, checkpoint=path, resume=True)
    assert again.lens.sha256 == whole.lens.sha256 and again.ended == whole.ended is not None
    assert torch.equal(*(torch.from_numpy(design.lens.outer.weights_mm) for design in (again, whole)))


def _stop_at_third(step) -> None:
    if step.steps_done == 3:
        raise KeyboardInterrupt
