"""The search: from a spec to the lens that lights its target best, with its record.

Its steps are Adam's, with multiplier updates between rounds, stage after stage; resumable at any step.
"""

import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge import seeds
from lensforge.errors import Cancelled, remedy
from lensforge.kernels.parallel import kernel_threads, thread_count
from lensforge.results.arguments import threads_of_torch
from lensforge.scene.body import radii
from lensforge.scene.lens import Lens
from lensforge.search.automatic_schedule import AutomaticSchedule, preset_for, schedule_of
from lensforge.search.checkpoint import delete_checkpoint, fingerprint
from lensforge.search.design_result import ENOUGH, Design, Level, Margins, Observer, Progress
from lensforge.search.ending import Candidates, SearchEnd
from lensforge.search.feasibility import require_feasible_start
from lensforge.search.light_path import Pairs
from lensforge.search.merit import StepLoss
from lensforge.search.problem import Problem, Problems, ValidationRays
from lensforge.search.scene_symmetry import settled_symmetry, traced_source
from lensforge.search.schedule import NextStage, Outcome, Schedule, Stage, rays_ahead, stages_of
from lensforge.search.search_state import Adam, Parameters, SearchState, forms_of_search
from lensforge.sources.build_source import summarise
from lensforge.sources.measured_rays import searched
from lensforge.sources.ray_bundle import Source
from lensforge.sources.several_sources import each_of
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.accuracy import preset_of
from lensforge.spec.spec_files import input_hashes, section_sha256
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.mirror_group import first_images

_CHECKPOINT_SECONDS = 2.0
_HALVINGS = 6  # of a step that leads to no lens; Adam goes as far in the next one


@dataclass
class Descent:
    """A search on its way: ``state`` is all that decides its end.

    ``begun``: when the search began by the clock, less the seconds of before an interrupt; all of it counts, set-up and
    observers too. ``enough``: its observer wants no further step.
    """

    source: Source
    problems: Problems
    schedule: Schedule
    validation: ValidationRays
    seed: int
    accuracy: AnyAccuracy
    observer: Observer
    state: SearchState
    begun: float
    enough: bool = False
    _judged: tuple[tuple[int, int], Outcome] | None = None

    @property
    def seconds(self) -> float:
        """Seconds of the search so far."""
        return time.perf_counter() - self.begun

    def run(self, checkpoint: Path | None, key: str) -> NextStage:
        """Run all remaining stages and return the end; keep the checkpoint fresh, also at an interrupt."""
        saved = time.monotonic()
        if self.problems.spec.optimise.seconds is not None:
            self._compile_kernels()
        try:
            while (stage := self.schedule.next_stage(self.state.outcomes).stage) is not None and not self.enough:
                steps = self._stage_steps(stage)
                while not (self.enough or self._is_over(stage, self.state)):
                    next(steps)
                    if checkpoint is not None and time.monotonic() - saved > _CHECKPOINT_SECONDS:
                        self.state.save(checkpoint, key)
                        saved = time.monotonic()
                steps.close()
                if self.enough and checkpoint is not None:
                    self.state.save(checkpoint, key)  # no later: no search resumes from a stage that was cut short
                self.state = self._after_stage(stage)
        finally:
            if checkpoint is not None and not self.enough:
                self.state.save(checkpoint, key)
        return self.schedule.next_stage(self.state.outcomes)

    def _compile_kernels(self) -> None:
        """Take a derivative that nobody needs, and count no time for it: kernels are compiled once on a machine."""
        stage = self.schedule.next_stage(self.state.outcomes).stage
        if stage is not None:
            problem = self.problems.of(stage.levels)
            weights, offsets = (
                parameter.clone().requires_grad_() for parameter in (self.state.weights, self.state.offsets)
            )
            ray = self.source.sample(1, 0)
            pairs = self._pairs(problem, 0)[:1]
            begun = time.perf_counter()
            problem.merit.step_loss(
                weights, offsets, ray, problem.constraints, stage.uniform, pairs, stage.limit_weight
            ).loss.backward()
            self.begun += time.perf_counter() - begun

    def _pairs(self, problem: Problem, step: int) -> Pairs:
        """Parts of a robust search for ``step``, counted over all levels; none for any other."""
        return () if problem.parts is None else problem.parts.of_step(self.seed, step)

    def _is_over(self, stage: Stage, state: SearchState) -> bool:
        """True for ``state`` after the last step of ``stage``, or where the time of the search is up before."""
        return state.step >= stage.steps or state.seconds >= self.schedule.most_seconds(state.outcomes)

    def _stage_steps(self, stage: Stage) -> Generator[None]:
        """Take the stage's remaining steps, one for each item; the state is replaced before every yield."""
        problem = self.problems.of(stage.levels)
        problem.constraints.multipliers = self.state.multipliers
        weights = self.state.weights[: stage.functions].clone().requires_grad_()
        still = self.state.weights[stage.functions :]
        offsets = self.state.offsets.clone().requires_grad_()
        before = self.state.steps_of_moments, self.state.moments
        optimiser = Adam(weights, offsets, (0.9, 0.99), stage.least_gradient, *before)
        earlier = self.state.steps_done - self.state.step
        most_steps = self.schedule.most_steps(self.state.outcomes)
        steps = range(self.state.step, stage.steps)
        between = preset_of(self.accuracy).effort.multiplier_steps
        own_seeds = (seeds.of_step(self.seed, earlier + step) for step in steps)
        looked_at = bool(problem.spec.limits_in_states) or problem.parametrisation.is_steep
        for step, rays in zip(steps, rays_ahead(self.source, stage.rays, own_seeds), strict=True):
            with remedy(f"raise {' or '.join(f'lens.{name}.offset_mm' for name in problem.spec.lens.names)}"):
                every = torch.cat([weights, still]) if still.any() else weights
                pairs = self._pairs(problem, earlier + step)
                result = problem.merit.step_loss(
                    every, offsets, rays, problem.constraints, stage.uniform, pairs, stage.limit_weight
                )
            optimiser.zero_grad()
            result.loss.backward()
            unmoved = Parameters(weights.detach().clone(), offsets.detach().clone())
            optimiser.step(stage.rate(step))
            if looked_at:  # else no step leads there, and to look costs a fourteenth of it
                _shorten(problem, unmoved, Parameters(weights, offsets), still)
            if step % between == between - 1:
                problem.constraints.update(result.fields)
            following = self._after_step(stage, step, problem, optimiser, result)
            proceed = self.observer(self._progress(following, stage, most_steps, result))
            self.state = following  # not earlier: where the observer is interrupted, a resumed search calls it again
            self.enough = proceed == ENOUGH
            if proceed is False:
                raise Cancelled(f"{self.problems.spec.name}: cancelled after step {following.steps_done}")
            yield

    def _after_step(self, stage: Stage, step: int, problem: Problem, optimiser: Adam, result: StepLoss) -> SearchState:
        weights, offsets = (parameter.detach() for parameter in optimiser.parameters)
        every_weight = self.state.weights.clone()
        every_weight[: stage.functions] = weights
        return replace(
            self.state,
            weights=every_weight,
            offsets=offsets.clone(),
            multipliers=problem.constraints.multipliers,
            step=step + 1,
            moments=optimiser.moments,
            steps_of_moments=optimiser.steps,
            history=_with_step(self.state.history, stage, result, problem.constraints.least(result.fields)),
            seconds=self.seconds,
        )

    def _after_stage(self, stage: Stage) -> SearchState:
        state = self.state
        problem = self.problems.of(stage.levels)
        following = self.schedule.next_stage((*state.outcomes, self._outcome(stage, state)))
        coming = following.stage
        kept = _kept(following, state)
        state = replace(
            state,
            weights=kept.begin.weights,
            offsets=kept.begin.offsets,
            outcomes=(*state.outcomes, self._outcome(stage, state)),
            step=0,
            best=kept.best if following.begin == "current" else kept.begin,
            accepted=kept.accepted,
        )
        moved = (stage.functions, stage.uniform)
        if coming is None or following.begin != "current" or (coming.functions, coming.uniform) != moved:
            state = replace(state, moments=None, steps_of_moments=0)
        if coming is not None:
            state = self._for_levels(state, problem, coming)
        return replace(state, seconds=self.seconds)

    def _outcome(self, stage: Stage, state: SearchState) -> Outcome:
        key = len(state.outcomes), state.steps_done
        if self._judged is None or self._judged[0] != key:
            problem = self.problems.of(stage.levels)
            uniform = self.problems.spec.has_uniform_region
            light, even = self.validation.judge(problem, state.weights, state.offsets, uniform)
            self._judged = (
                key,
                Outcome(
                    steps=state.step, seconds=self.seconds, light=light, even=even, limit_weight=stage.limit_weight
                ),
            )
        return self._judged[1]

    def _ends_level(self, stage: Stage, state: SearchState) -> Parameters | None:
        """The parameters with which the search leaves the level of ``stage`` for good; None within it.

        None also for a level that is left out.
        """
        if not self._is_over(stage, state):
            return None
        following = self.schedule.next_stage((*state.outcomes, self._outcome(stage, state)))
        begin = _kept(following, state).begin
        within = following.stage is not None and following.stage.level == stage.level
        return None if within or len(begin.weights) != len(state.weights) else begin

    def _for_levels(self, state: SearchState, before: Problem, stage: Stage) -> SearchState:
        """``state`` with as many weights as ``stage`` has, new ones 0, and multipliers at the points of its grid."""
        following = self.problems.of(stage.levels)
        if following is not before:
            multipliers = following.constraints.at_nearest(before.constraints, state.multipliers)
            state = replace(state, multipliers=multipliers)
        size = following.parametrisation.size
        if size == len(state.weights):
            return state
        weights, _ = following.parametrisation.start()
        kept = min(size, len(state.weights))
        weights[:kept] = state.weights[:kept]
        return replace(state, weights=weights, best=Parameters(weights, state.offsets))

    def _progress(self, state: SearchState, stage: Stage, most_steps: int, result: StepLoss) -> Progress:
        problem = self.problems.of(stage.levels)
        at_end = self._ends_level(stage, state)
        parameters = at_end or Parameters(state.weights, state.offsets)

        def lens() -> Lens:
            return problem.parametrisation.lens(*parameters, problem.spec, self.seed, self.accuracy)

        def tables() -> tuple[TableGrid, np.ndarray]:
            with torch.no_grad():
                return problem.parametrisation.grid, problem.parametrisation.tables(*parameters).numpy()

        return Progress(
            level=stage.level,
            step=state.step,
            steps_done=state.steps_done,
            steps_total=most_steps,
            nmse=result.nmse,
            efficiency=result.efficiency,
            functions=stage.functions,
            level_done=at_end is not None,
            seconds=state.seconds,
            accuracy=self.accuracy,
            lens=lens,
            images=tuple(np.asarray(image) for image in result.images),
            tables=tables,
        )


@torch.no_grad()
def _shorten(problem: Problem, before: Parameters, after: Parameters, still: Float[Tensor, "s f"]) -> None:
    """Halve a step in place until the lens ``after`` it can be traced, or take it back.

    Where limits on the light are missed by far, the first steps follow these against all constraints; tables of a
    profile overshoot where it turns steeply.
    """
    for _ in range(_HALVINGS):
        if problem.can_be_traced(torch.cat([after.weights, still]), after.offsets):
            return
        for moved, was in zip(after, before, strict=True):
            moved.lerp_(was, 0.5)
    for moved, was in zip(after, before, strict=True):
        moved.copy_(was)


class _Kept(NamedTuple):
    """Parameters that a search keeps at the end of a stage, and those with which it goes on."""

    best: Parameters | None
    accepted: Parameters | None
    begin: Parameters


def _kept(following: NextStage, state: SearchState) -> _Kept:
    now = Parameters(state.weights, state.offsets)
    best = now if following.improved else state.best
    accepted = best if following.accepted else state.accepted
    begin = {"current": now, "best": best, "accepted": accepted}[following.begin]
    assert begin is not None, "it goes back to what it has kept"
    return _Kept(best, accepted, begin)


def _with_step(
    history: tuple[Level, ...], stage: Stage, result: StepLoss, least: dict[str, float]
) -> tuple[Level, ...]:
    if history and history[-1].level == stage.level:
        earlier = history[:-1]
        last = history[-1]
    else:
        none: dict[str, tuple[float, ...]] = dict.fromkeys(least, ())
        earlier = history
        last = Level(level=stage.level, functions=stage.functions, loss=(), nmse=(), efficiency=(), constraints=none)
    longer = {
        "loss": (*last.loss, result.loss.item()),
        "nmse": (*last.nmse, result.nmse),
        "efficiency": (*last.efficiency, result.efficiency),
        "constraints": {name: (*values, least[name]) for name, values in last.constraints.items()},
    }
    return (*earlier, last.changed(**longer))


_SIZE_DIRECTIONS = 20_000  # over the hemisphere, at which radius and height are sampled


@contextmanager
def _torch_on_one_thread() -> Iterator[None]:
    """Products and sums of torch have other bits on another number of threads; the kernels keep theirs."""
    with kernel_threads(thread_count()), threads_of_torch(1):
        yield


@_torch_on_one_thread()
def search(
    spec: Spec,
    source: Source,
    *,
    accuracy: AnyAccuracy = "standard",
    seed: int = 0,
    device: torch.device | None = None,
    start: Lens | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    progress: Observer | None = None,
    warnings: tuple[str, ...] = (),
    preview: bool = False,
) -> Design:
    """Search for the lens of ``spec``; its rays are traced by the CPU's kernels, or by torch on ``device``.

    It ends with no worse a lens than it began with, by the merit that it minimises and rays that no step sees.
    ``start``: a lens to begin from instead of two hemispheres; then given levels all move from the first step on, and
    automatic ones begin with as many as it has, the broad ones first. ``checkpoint`` is written every few seconds and
    at an interrupt; with ``resume`` the search goes on from it and ends with the same bits as an uninterrupted one,
    unless ``optimise.seconds`` makes it depend on time. ``progress`` is called after every gradient step; where it
    returns False, the search raises :class:`Cancelled`; where it returns ``ENOUGH``, it ends with the lens that it has.
    ``warnings``: on the scene, for the record. ``preview``: take fewer steps.
    """
    begun = time.perf_counter()
    preset = preset_for(spec, accuracy, preview=preview)
    spec = settled_symmetry(spec, source)
    schedule = schedule_of(spec, source, preset, start)
    problems = Problems(spec, source, preset.nodes_per_sigma, device, preset.single)
    key = fingerprint(spec, seed, f"{accuracy}, preview" if preview else str(accuracy), start, device)
    if resume and checkpoint is not None:
        state = SearchState.load(checkpoint, key, forms_of_search(schedule, problems))
        begun -= state.seconds
    else:
        state = _fresh_state(schedule, problems, start)
    if checkpoint is not None and not resume:
        delete_checkpoint(checkpoint)  # of an earlier search: an interrupt before the first step leaves none
    of_steps = searched(traced_source(spec, source))
    automatic = spec.lens.levels == "auto"
    validation, smooth = ValidationRays.of(of_steps, schedule.validation_rays(preset.effort.validation_rays), seed)
    observer = progress or (lambda _: None)
    descent = Descent(
        smooth if automatic else of_steps, problems, schedule, validation, seed, accuracy, observer, state, begun
    )
    why = descent.run(checkpoint, key).why
    why = f"ended by its observer after {descent.state.steps_done} steps" if descent.enough else why
    stages = stages_of(schedule, descent.state.outcomes)
    ending = _ending(descent, stages, start)
    last = stages[-1]
    state = replace(descent.state, seconds=descent.seconds)
    moved = "" if state.steps_done == 0 else ending.why  # of faces that are all given nothing moves
    result = _design(ending.lens, ending.margins, source, state, last.rays, warnings)
    ended = "; ".join(reason for reason in (moved, why) if reason) or None
    return result.changed(ended=ended, kept_start=bool(moved))


def require_start(spec: Spec, source: Source, accuracy: AnyAccuracy, start: Lens | None) -> None:
    """Raise :class:`InputError` where :func:`search` would, before its first step."""
    preset = preset_for(spec, accuracy)
    spec = settled_symmetry(spec, source)
    problems = Problems(spec, source, preset.nodes_per_sigma, None, preset.single)
    _fresh_state(schedule_of(spec, source, preset, start), problems, start)


def _ending(descent: Descent, stages: list[Stage], start: Lens | None) -> SearchEnd:
    problems = descent.problems
    state = descent.state
    first = stages[0]
    levels = stages[-1].levels
    if problems.spec.lens.levels == "auto":
        # those that have so many weights: the last one may have been left out at the very end
        levels = levels[: list(accumulate(levels)).index(len(state.weights)) + 1]
    even = any(stage.uniform for stage in stages)
    candidates = Candidates(descent.validation, even, descent.seed, descent.accuracy)
    begin = _parameters_of(problems.of(first.levels), start)
    end = problems.of(levels), Parameters(state.weights, state.offsets)
    return candidates.better(state.outcomes[0], (problems.of(first.levels), begin), end)


def _parameters_of(problem: Problem, start: Lens | None) -> Parameters:
    parametrisation = problem.parametrisation
    return Parameters(*(parametrisation.start() if start is None else parametrisation.parameters_of(start)))


def _design(
    lens: Lens, margins: Margins, source: Source, state: SearchState, rays_per_step: int, warnings: tuple[str, ...]
) -> Design:
    """The record of a finished search; ``warnings`` on its scene go with those on its source."""
    source = each_of(source)[0]
    summary = summarise(source, lens.spec.in_first_state.source)
    directions = lens.directions(_SIZE_DIRECTIONS)
    directions = directions if lens.others else directions[first_images(directions, lens.symmetry)]
    radius = np.max([radii(kind.body.envelope, directions).min(axis=0) for kind in lens.kinds], axis=0)
    across = np.hypot(directions[:, 0], directions[:, 1]) if lens.spec.lens.radius_about_axis else 1.0
    return Design(
        inputs={"lens": lens.sha256, "spec": section_sha256(lens.spec), **input_hashes(lens.spec)},
        lens=lens,
        steps=state.steps_done,
        rays_per_step=rays_per_step,
        seconds=state.seconds,
        max_radius_mm=float((radius * across).max()),
        height_mm=float((radius * directions[:, 2]).max()),
        constraints=margins,
        source=summary.changed(warnings=(*summary.warnings, *warnings)),
        source_outline_mm=tuple((float(x), float(y), float(z)) for x, y, z in source.outline()),
        history=state.history,
    )


def _fresh_state(schedule: Schedule, problems: Problems, start: Lens | None) -> SearchState:
    """The state before the first step. Raises :class:`InputError` where no lens is found that keeps the limits."""
    first = schedule.next_stage(()).stage
    assert first is not None, "a spec has levels"
    problem = problems.of(first.levels)
    begin = _parameters_of(problem, start)
    multipliers = problem.constraints.multipliers
    if start is None:
        finest = schedule.stages.levels.counts if isinstance(schedule, AutomaticSchedule) else first.levels
        require_feasible_start(map(problems.of, dict.fromkeys((first.levels, finest))))
    problem.require_room_for_parts(*begin)
    return SearchState(*begin, multipliers)
