"""A search that chooses its levels and ends when nothing is gained, by validation rays after every stage.

Its phases, in this order:

1. The lens from which the search starts is judged, so that the end is never worse.
2. Broad functions, where the start is a finished lens: those of each coarser level move once.
3. Levels, one after another, as long as each gains: one short stage each, as broad functions need not be converged; the
   next level does the same work better, and a converged coarse lens leads to a worse fine one. A level that lowered the
   error by too little, or by no more than noise, is tried again with smaller steps; if that does not help, it is left
   out, and no finer one is tried.
4. Long stages of all functions, each with half the step and twice the rays, as long as each gains.
5. The same for the uniformity, where the scene has a region of uniform light.
"""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace

from lensforge.scene.lens import Lens
from lensforge.search.schedule import (
    ACCEPTED,
    FIRST_LIMIT_WEIGHT,
    TAKEN_BACK,
    AutomaticStages,
    Gain,
    LimitWeights,
    NextStage,
    Outcome,
    Schedule,
    Stage,
    UsefulLevels,
    fixed_schedule,
)
from lensforge.sources.measured_rays import searched
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import AnyAccuracy, Preset, for_places, for_preview, preset_of
from lensforge.spec.light_limits import LossLimit, LuminanceLimit
from lensforge.surfaces.mirror_group import group

_OF_BUDGET = 0.7  # for all levels, each of which gains more than a long stage; the rest is for those
_FOR_UNIFORMITY = 0.3  # of the budget, in a scene with a region of uniform light
_DEARER = 1.6  # a step takes that much longer than one of the level before: 1.2 to 2.0, most where rays are doubled
_GAIN_IN_BUDGET = 0.02  # of a long stage, at least: who gives seconds wants what can be had in them
_SAFE = 0.93  # of the budget, for steps that take longer than those before, and what follows the last one
_UP = 0.95  # of the budget: a machine that others use may become slower by any factor; then a stage ends at once
# Long stages in a row that end no better than they began, after which a search ends. By two of them a draft of road_m3
# keeps an efficiency of 0.591, and the third, of a quarter of the steps' length, finds 0.633.
_LOST = 3
_LEAST_LIMIT_WEIGHT = 1e-4
_HEAVIER_LIMITS = 4.0  # times as much after each stage with a limit missed: in full after four
_FEWEST = 10  # steps of a stage that is cut to fit the budget


@dataclass(frozen=True)
class _Ended:
    """A stage that has ended with ``outcome``, begun ``seconds`` after the search."""

    stage: Stage
    outcome: Outcome
    seconds: float

    @property
    def lacks_limits(self) -> bool:
        """True where limits are missed that could yet count for more."""
        return self.outcome.light.limits_missed > 0 and self.stage.limit_weight < 1.0

    @property
    def step_s(self) -> float:
        """Seconds of one of its steps; its set-up included."""
        return max(self.outcome.seconds - self.seconds, 1e-9) / max(self.outcome.steps, 1)


@dataclass(frozen=True)
class SearchTime:
    """Time of the whole search: ``seconds``, None for as long as it gains."""

    seconds: float | None

    @property
    def field(self) -> str:
        """The field of the spec."""
        return f"optimise.seconds = {self.seconds:g}"

    def expired(self, last: _Ended) -> bool:
        """True where nothing is left after the stage ``last``."""
        return self.seconds is not None and last.outcome.seconds >= _UP * self.seconds

    def steps_of_levels(self, last: _Ended, levels: int, full: int) -> int | None:
        """Steps of each of so many ``levels`` more for which there is time, or of fewer of them; 0 for none.

        ``full``: steps of a level that is not cut.
        """
        if self.seconds is None:
            return None
        left_s = _OF_BUDGET * self.seconds - last.outcome.seconds
        for count in range(levels, 0, -1):
            steps = int(left_s / last.step_s / sum(_DEARER**k for k in range(1, count + 1)))
            if steps >= min(_FEWEST, full):
                return steps
        return 0

    def steps_of(self, stage: Stage, last: _Ended, kept: float) -> int | None:
        """Steps of a long ``stage`` for which there is time; a share of the budget is ``kept`` for what follows."""
        if self.seconds is None:
            return None
        left_s = (_SAFE - kept) * self.seconds - last.outcome.seconds
        return int(left_s / (last.step_s * max(1.0, stage.rays / last.stage.rays)))


_IMPROVED = NextStage(None, "current", improved=True)  # how a search goes on from a long stage that has ended


@dataclass
class ScheduleState:
    """State of an automatic schedule: the ``best`` outcome so far, the ``level`` of its lens, and the ``last`` stage.

    ``how``: from which lens the next stage begins.
    """

    level: int
    best: Outcome
    last: _Ended
    how: NextStage = ACCEPTED

    def run(self, stage: Stage) -> Generator[NextStage, Outcome, Gain]:
        """Ask for ``stage`` from here; its gain over the best lens."""
        outcome = yield replace(self.how, stage=stage)
        self.last = _Ended(stage, outcome, self.last.outcome.seconds)
        return self.best.gain_of(outcome, stage.uniform)

    def accept(self, level: int, improved: bool = True) -> None:
        """Go on from the lens of the last stage, or from the best one before it where it is not ``improved``."""
        if improved:
            self.level = level
            self.best = self.last.outcome
        self.how = ACCEPTED if improved else TAKEN_BACK


_Phase = Generator[NextStage, Outcome, str]  # returns why it ended, "" for no reason to tell
_MakeStage = Callable[[int, int, int | None], Stage]  # of a level, after so many others, cut to so many steps


@dataclass(frozen=True)
class AutomaticSchedule(Schedule):
    """``budget_s``: seconds of the whole search, None for as long as it gains.

    ``uniform``: the scene has a region of uniform light.
    """

    stages: AutomaticStages
    uniform: bool
    budget_s: float | None = None

    @property
    def limit_weights(self) -> LimitWeights:
        """A weight that grows while limits are missed; that of a finished lens is 1 from its first step on."""
        return (
            LimitWeights()
            if self.stages.start_level
            else LimitWeights(FIRST_LIMIT_WEIGHT, _HEAVIER_LIMITS, _LEAST_LIMIT_WEIGHT)
        )

    def phases(self) -> Generator[NextStage, Outcome]:
        """The whole search: every stage is answered by its outcome, and the last item has none."""
        start = self.stages.start_level
        judged = replace(self.stages.level_stage(start), steps=0)
        outcome = yield NextStage(judged)
        course = ScheduleState(start, outcome, _Ended(judged, outcome, 0.0))
        why = (yield from self._broad_functions(course)) or (yield from self._levels(course))
        # those of a finished lens have been in a first long stage before: larger steps would lead away from it
        before = 1 if start > 0 else 0
        kept = _FOR_UNIFORMITY if self.uniform else 0.0
        end = yield from self._long_stages(course, self.stages.long_stage, before, kept)
        if self.uniform:
            end = yield from self._long_stages(course, self.stages.uniform_stage, 0, 0.0)
        yield replace(course.how, why=f"{why}; {end}")

    def _broad_functions(self, course: ScheduleState) -> _Phase:
        """Move the functions of each level below that of a finished lens once; what loses is taken back."""
        level = self.stages.start_level
        steps: int | None = None
        for broad in range(level):
            gain = yield from course.run(self.stages.level_stage(broad, steps))
            course.accept(level, gain.share > 0.0)
            steps = self._steps_of_levels(course.last, level - broad)
            if steps == 0:
                return f"{self._budget.field} leaves no time for all levels"
        return ""

    def _levels(self, course: ScheduleState) -> _Phase:
        """Add one level after another, until one is left out, or there is no finer one, or no time for it."""
        start = self.stages.start_level
        counts = self.stages.levels.counts
        for level in range(start, len(counts)):
            steps: int | None = None  # the first stage of all has all its steps: by it the time of a step is known
            if level > 0:
                steps = self._steps_of_levels(course.last, 1 if level == start else len(counts) - level)
            if steps == 0:
                return f"{self._budget.field} leaves no time for {counts[level]} functions"
            why = yield from self._level(course, level, steps)
            if why:
                return why
        return self.stages.levels.why

    def _level(self, course: ScheduleState, level: int, steps: int | None) -> _Phase:
        """Try one level, at most twice; where it returns a reason, no finer one follows.

        The finest functions of a finished lens are near their best: they take smaller steps from the first one on, and
        those of the next level, which are new, follow whatever they gain.
        """
        at_start = level == self.stages.start_level
        is_last = level + 1 == len(self.stages.levels.counts)
        again = at_start and level > 0
        while True:
            gain = yield from course.run(self.stages.level_stage(level, steps, again=again))
            enough = gain.reaches(self.stages.effort.level_gain)
            course.accept(level, enough or (at_start and gain.share > 0.0))
            if enough or (at_start and not is_last):
                return ""
            steps = self._steps_of_levels(course.last, 1)
            if again or steps == 0 or course.how is ACCEPTED:
                return self._too_little(gain, course.last, level)
            again = True

    def _long_stages(self, course: ScheduleState, make: _MakeStage, before: int, kept: float) -> _Phase:
        """Move all functions, stage after stage, as long as each gains; the first comes after ``before`` others.

        A share of the time is ``kept`` for what follows. A stage that ends no better than it began has taken too large
        steps, as beside the limits of a tool: the next, of half their length, may gain yet. Three end it.
        """
        lost = 0
        while True:
            steps = self._budget.steps_of(make(course.level, before, None), course.last, kept)
            if steps is not None and steps < _FEWEST:
                course.how = replace(course.how, begin="best") if course.how.begin == "current" else course.how
                return f"{self._budget.field} are used"
            gain = yield from course.run(make(course.level, before, steps))
            if improved := gain.share > 0.0:
                course.best = course.last.outcome
            course.how = _IMPROVED
            if not gain.reaches(self.step_gain):
                course.how = NextStage(None, "best", improved)
                if self._budget.expired(course.last):
                    return f"{self._budget.field} are used"
                lost = 0 if improved else lost + 1
                if 0 < lost < _LOST or course.last.lacks_limits:
                    before += 1
                    continue
                steps = course.last.outcome.steps
                return f"the last {steps} steps lowered the error by {_judged(gain, self.step_gain)}"
            lost = 0
            before += 1

    @property
    def step_gain(self) -> float:
        """Share by which a long stage must lower the error, else the search ends."""
        gain = self.stages.effort.step_gain
        return gain if self.budget_s is None else min(gain, _GAIN_IN_BUDGET)

    @property
    def _budget(self) -> SearchTime:
        return SearchTime(self.budget_s)

    def _steps_of_levels(self, last: _Ended, levels: int) -> int | None:
        return self._budget.steps_of_levels(last, levels, self.stages.effort.steps[0])

    def _too_little(self, gain: Gain, last: _Ended, level: int) -> str:
        """Reason why a level is left out, or why none follows the first one."""
        at_start = level == self.stages.start_level
        more = "the first steps" if at_start else f"{self.stages.levels.counts[level]} functions more"
        if not at_start and self._budget.expired(last):
            return f"{self._budget.field} leaves no time for {more}"
        return f"{more} lower the error by {_judged(gain, self.stages.effort.level_gain)}"

    def most_seconds(self, outcomes: Sequence[Outcome]) -> float:
        """Nearly the budget, but the first level has all its steps."""
        return math.inf if self.budget_s is None or len(outcomes) < 2 else _UP * self.budget_s


def _judged(gain: Gain, least: float) -> str:
    lowered = 100.0 * max(gain.share, 0.0)
    if gain.share >= least:
        return f"{lowered:.2g} %, which may be noise: its standard error is {100 * gain.standard_error:.2g} %"
    return f"{lowered:.2g} %, less than {100 * least:g} %"


def preset_for(spec: Spec, accuracy: AnyAccuracy, *, preview: bool = False) -> Preset:
    """Settings of a search for ``spec``; one of the table takes rays enough for limits that read places."""
    preset = preset_of(accuracy)
    read = (limit for limit in spec.limits_in_states if not isinstance(limit, LossLimit | LuminanceLimit))
    if isinstance(accuracy, str) and (
        spec.applications or {kind for limit in read for kind in limit.quantities()} - {"share"}
    ):
        preset = for_places(preset, spec.optimise.pixels)
    return for_preview(preset) if preview else preset


def schedule_of(spec: Spec, source: Source, preset: Preset, start: Lens | None) -> Schedule:
    """Schedule of a search for ``spec`` from ``start``: of the levels that it gives, or one that chooses them."""
    measured = searched(source).ray_count
    settings = spec.optimise
    if spec.lens.levels != "auto":
        return fixed_schedule(spec, preset, last_only=start is not None, measured=measured is not None)
    effort = preset.effort.with_rays_of(measured)
    levels = UsefulLevels.of(spec, source, effort.finest)
    first = 0 if start is None else levels.resolving(start.detail_rad, spec.lens.sigma_c)
    # parts of a robust search have no symmetry: the spread of their light is not averaged over mirror images
    uniform = spec.has_uniform_region
    images = 1 if settings.robust else len(group(spec.lens.symmetry))
    stages = AutomaticStages(levels, effort, images, first)
    return AutomaticSchedule(stages, uniform, settings.seconds)
