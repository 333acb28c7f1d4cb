"""A schedule that chooses its levels and ends when nothing is gained: decisions from validation rays after every stage.

Finer levels help until the source, the receiver or the cutter blurs them.

The lens from which a search starts is judged first, so that the end is never worse. Each level has one short stage:
broad functions need not be converged, the next level does the same work better, and a converged coarse lens leads to a
worse fine one. A level that lowered the error by too little, or by no more than noise, is tried again with smaller
steps; if that does not help, it is left out, and no finer one is tried.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Literal

import numpy as np

from lensforge.search.schedule import Gain, Outcome, Stage, Turn
from lensforge.sources.ray_bundle import Source
from lensforge.spec import AnyReceiver, Spec
from lensforge.spec.accuracy import SearchEffort
from lensforge.spec.receiver_sections import CylinderReceiver, FarFieldReceiver, PlaneReceiver, SphereReceiver
from lensforge.surfaces.srbf import level_sigma

_CANDIDATES = (9, 25, 81, 289, 1089, 4225)  # about four times as many functions, of half the width, each time
# Least width of a function, sigma, relative to the angle under which the outer face sees the source. One 1 mm wide in
# a lens of 2.45 mm gains from 289 functions (0.36 of it) and loses by 1,089 (0.18). What lies above may still gain too
# little: the search finds out.
_OF_SOURCE = 0.2


@dataclass(frozen=True)
class UsefulLevels:
    """Numbers of functions of the levels that may be tried, and ``why`` there are no finer ones."""

    counts: tuple[int, ...]
    why: str

    @staticmethod
    def of(spec: Spec, source: Source, finest: int) -> "UsefulLevels":
        """Levels for ``spec`` up to ``finest`` functions; at least the first."""
        narrowest_rad, reason = max(_limits(spec, source))
        counts = [_CANDIDATES[0]]
        for count in _CANDIDATES[1:]:
            if count > finest:
                return UsefulLevels(tuple(counts), f"finest level of this accuracy: {counts[-1]} functions")
            if level_sigma(count, spec.lens.sigma_c) < narrowest_rad:
                words = f"functions narrower than {narrowest_rad:.2g} rad would not show: {reason}"
                return UsefulLevels(tuple(counts), words)
            counts.append(count)
        return UsefulLevels(tuple(counts), f"finest level there is: {counts[-1]} functions")

    def resolving(self, detail_rad: float, sigma_c: float) -> int:
        """The coarsest level whose functions are as narrow as ``detail_rad``, or the last."""
        narrow = [level_sigma(count, sigma_c) <= 1.001 * detail_rad for count in self.counts]
        return narrow.index(True) if any(narrow) else len(narrow) - 1


def _limits(spec: Spec, source: Source) -> list[tuple[float, str]]:
    """Widths (rad) below which a function is useless, each with its reason."""
    radius_mm, found = spec.constraints.max_radius_mm, []
    outline = source.outline()
    width_mm = float(np.ptp(outline[:, :2], axis=0).max()) if len(outline) else 0.0
    found.append((_OF_SOURCE * width_mm / radius_mm, f"a fifth of the angle of the source, {width_mm:.3g} mm wide"))
    pixel_rad = min(_pixel_rad(receiver, spec.evaluate.pixels) for receiver in spec.all_receivers)
    for face in ("inner", "outer"):
        limit_mm = getattr(spec.constraints, f"{face}_concave_radius_mm")
        ball_mm = spec.manufacture.cutter_radius_mm if limit_mm is None else limit_mm
        words = f"what a ball of {ball_mm:g} mm reaches in the {face} face moves the light by less than a pixel"
        found.append((_width_of_ball(spec, ball_mm, pixel_rad), words))
    return found


def _pixel_rad(receiver: AnyReceiver, pixels: int) -> float:
    """Angle of a pixel as seen from the lens, where the receiver is nearest."""
    pixel = max(receiver.size) / pixels
    match receiver:
        case FarFieldReceiver():
            return pixel
        case PlaneReceiver():
            return pixel / receiver.distance_mm
        case CylinderReceiver() | SphereReceiver():
            return pixel / receiver.radius_mm


def _width_of_ball(spec: Spec, ball_mm: float, pixel_rad: float) -> float:
    """Width (rad) of a function that, hollow as a ball of that radius, moves the light by one pixel.

    Its slope is width over twice the ball's radius, and light turns by ``n - 1`` times that in air.
    """
    turn = spec.lens.media.largest_turning_power
    return 2.0 * ball_mm * pixel_rad / (turn * spec.constraints.max_radius_mm) if turn > 0.0 else 0.0


# Measured on pi, cross and flat_top (docs/results.md): further in the first steps than a spec's learning rate,
# which is for levels that are converged.
_FIRST_RATE, _LEVEL_RATE = 1.5, 0.65  # of the spec's, and of a level's relative to that of the one before
_AGAIN_RATE = 0.4  # of a level's, where that gained too little: its steps may have led astray
_LAST_RATE = 0.75  # of the first long stage, relative to its level's; half of it in each one that follows
_UNIFORM_RATE = 0.3  # of the first stage for the uniformity, likewise
_OF_IMAGES = 0.25  # exponent: with a square's 8 images 1.7 times as far, and 2.8 times in long stages; flat_top
# Levels from this one on take twice the rays: their functions are so narrow that few rays meet each of them. With twice
# the rays in its long stages, too, flat_top of 404 functions takes 1.4 times as long: three seeds gain 0.1 % of their
# efficiency and 3 % of NMSE, and deviate from uniform light by 0.80 % for 0.97 %. With half of them cross of 1,493
# loses 0.2 % and 4 %.
_TWICE_FROM = 4
# Gradients of the narrow functions are 1e-2 to 3e-3 where light is, and a tenth of that at the rim, where noise then
# takes them ten times as far. On cross this brings facets there a quarter to a third nearer to the face.
_LEAST_GRADIENT = 3e-4


@dataclass(frozen=True)
class AutomaticStages:
    """Stages for ``levels`` with the steps and rays of ``effort``, from a spec's ``learning_rate``.

    ``images``: mirror images of every ray; their mean has less noise, so that steps may be larger. ``start_level``: of
    the lens from which it starts, all of whose functions stay while the broad ones move.
    """

    levels: UsefulLevels
    effort: SearchEffort
    learning_rate: float
    images: int = 1
    start_level: int = 0

    def level_stage(self, level: int, most_steps: int | None = None, *, again: bool = False) -> Stage:
        """The stage of one level, cut to ``most_steps``; ``again``: for the second time, with smaller steps."""
        share = _AGAIN_RATE if again else 1.0
        return self._stage(level, _cut(self.effort.steps[0], most_steps), 0, share)

    def long_stage(self, level: int, before: int, most_steps: int | None) -> Stage:
        """A stage after ``before`` other long ones, cut to ``most_steps``."""
        rate = _LAST_RATE * 0.5**before * self.images**_OF_IMAGES
        return self._stage(level, _cut(self.effort.steps[1], most_steps), before, rate)

    def uniform_stage(self, level: int, before: int, most_steps: int | None) -> Stage:
        """A stage for the uniformity after ``before`` others, cut to ``most_steps``."""
        rate = _UNIFORM_RATE * 0.5**before
        stage = self._stage(level, _cut(self.effort.steps[1], most_steps), before, rate)
        return replace(stage, uniformity_from=0)

    def _stage(self, level: int, steps: int, doublings: int, share: float) -> Stage:
        counts, (first, most) = self.levels.counts, self.effort.rays
        levels = counts[: max(level, self.start_level) + 1]
        rate = _FIRST_RATE * self.learning_rate * _LEVEL_RATE**level * share * self.images**_OF_IMAGES
        rays = min(first * 2 ** (level // _TWICE_FROM + doublings), most)
        return Stage(
            level,
            levels,
            sum(counts[: level + 1]),
            steps,
            rays,
            rate,
            uniformity_from=steps,
            least_gradient=_LEAST_GRADIENT,
        )


def _cut(steps: int, most: int | None) -> int:
    return steps if most is None else min(steps, most)


_OF_BUDGET = 0.7  # for all levels, each of which gains more than a long stage; the rest is for those
_FOR_UNIFORMITY = 0.3  # of the budget, in a scene with a region of uniform light
_DEARER = 1.6  # a step takes that much longer than one of the level before: 1.2 to 2.0, most where rays are doubled
_GAIN_IN_BUDGET = 0.02  # of a long stage, at least: who gives seconds wants what can be had in them
_SAFE = 0.93  # of the budget, for steps that take longer than those before, and what follows the last one
_UP = 0.95  # of the budget: a machine that others use may become slower by any factor; then a stage ends at once
_FEWEST = 10  # steps of a stage that is cut to fit the budget


@dataclass(frozen=True)
class AutomaticSchedule:
    """``budget_s``: seconds of the whole search, None for as long as it gains.

    ``uniform``: the scene has a region of uniform light.
    """

    stages: AutomaticStages
    uniform: bool
    budget_s: float | None = None

    def turn(self, outcomes: Sequence[Outcome]) -> Turn:
        """Decide what follows the stages that had ``outcomes``."""
        return self._last(outcomes).turn

    def turns(self, outcomes: Iterable[Outcome]) -> Iterator[Turn]:
        """The first turn, and the one that follows each of ``outcomes``."""
        return (position.turn for position in self._positions(outcomes))

    def accepts(self, outcome: Outcome) -> bool:
        """True for one with judgements of its light, and of its uniformity in a scene that asks for it."""
        return outcome.light is not None and (outcome.even is not None) == self.uniform

    def most_steps(self, outcomes: Sequence[Outcome]) -> int:
        """Steps so far, and those of the stage that follows."""
        return self._last(outcomes).steps

    def most_seconds(self, outcomes: Sequence[Outcome]) -> float:
        """Nearly the budget, but the first level has all its steps."""
        return math.inf if self.budget_s is None or len(outcomes) < 2 else _UP * self.budget_s

    def _last(self, outcomes: Sequence[Outcome]) -> "_Position":
        *_, last = self._positions(outcomes)
        return last

    def _positions(self, outcomes: Iterable[Outcome]) -> "Iterator[_Position]":
        return accumulate(outcomes, _Position.after, initial=_Position.first(self))

    @property
    def step_gain(self) -> float:
        """Share by which a long stage must lower the error, else the search ends."""
        gain = self.stages.effort.step_gain
        return gain if self.budget_s is None else min(gain, _GAIN_IN_BUDGET)


_Part = Literal["levels", "long", "uniform"]
_Begin = Literal["current", "best", "accepted"]


@dataclass(frozen=True)
class _Position:
    """Position of a search: ``best`` outcome of its part, ``accepted`` one of its levels, of ``accepted_level``.

    ``stages``: of its part. ``again``: the level is tried for the second time. ``steps``: of all stages, the next one
    included.
    """

    schedule: AutomaticSchedule
    part: _Part
    level: int
    turn: Turn
    steps: int = 0
    best: Outcome | None = None
    accepted: Outcome | None = None
    accepted_level: int = 0
    seconds: float = 0.0
    stages: int = 0
    again: bool = False
    why: str = ""

    @staticmethod
    def first(schedule: AutomaticSchedule) -> "_Position":
        level = schedule.stages.start_level
        judged = replace(schedule.stages.level_stage(level), steps=0, uniformity_from=0)
        return _Position(schedule, "levels", level, Turn(judged))

    def after(self, outcome: Outcome) -> "_Position":
        """The position after one more stage."""
        following = self._after_level(outcome) if self.part == "levels" else self._after_long_stage(outcome)
        last, stage = self.turn.stage, following.turn.stage
        assert last is not None, "it has had an outcome"
        done = self.steps - last.steps + outcome.steps
        return replace(following, seconds=outcome.seconds, steps=done + (0 if stage is None else stage.steps))

    def _after_level(self, outcome: Outcome) -> "_Position":
        counts, level = self.schedule.stages.levels.counts, self.level
        now = replace(self, best=outcome, accepted=outcome, accepted_level=level)
        kept = Turn(None, "current", improved=True, accepted=True)
        if self.accepted is None:
            return now._level_stage(0, kept)
        if level < self.schedule.stages.start_level:
            return self._after_broad_functions(outcome, now, kept)
        gain = self.accepted.gain_of(outcome, even=False)
        if not gain.reaches(self.schedule.stages.effort.level_gain):
            if not self.schedule.stages.start_level == level < len(counts) - 1:
                return self._after_small_gain(gain, outcome, now)
            if gain.share <= 0.0:  # the functions of a finished lens are near their best, those of the next level new
                now, kept = self, Turn(None, "accepted")
        if level + 1 == len(counts):
            return replace(now, why=self.schedule.stages.levels.why)._stage_of("long", outcome, kept)
        most = self._steps_of_level(outcome, len(counts) - 1 - level)
        if most == 0:
            why = f"optimise.seconds = {self.schedule.budget_s:g} leaves no time for {counts[level + 1]} functions"
            return replace(now, why=why)._stage_of("long", outcome, kept)
        return now._level_stage(level + 1, kept, most)

    def _after_broad_functions(self, outcome: Outcome, now: "_Position", kept: Turn) -> "_Position":
        """The next level of a finished lens, from this one if it has gained anything."""
        assert self.accepted is not None
        better = self.accepted.gain_of(outcome, even=False).share > 0.0
        start_level = self.schedule.stages.start_level
        position = replace(now if better else self, accepted_level=start_level)
        turn = kept if better else Turn(None, "accepted")
        most = self._steps_of_level(outcome, start_level - self.level)
        if most == 0:
            why = f"optimise.seconds = {self.schedule.budget_s:g} leaves no time for all levels"
            return replace(position, level=start_level, why=why)._stage_of("long", outcome, turn)
        # the finest functions of a finished lens are near their best: smaller steps from the first one on
        return position._level_stage(self.level + 1, turn, most, again=self.level + 1 == start_level)

    def _after_small_gain(self, gain: Gain, outcome: Outcome, now: "_Position") -> "_Position":
        """The level once more with smaller steps, or without it; that of the start stays, with what it has gained."""
        first, least = self.level == self.accepted_level, self.schedule.stages.effort.level_gain
        more = "the first steps" if first else f"{self.schedule.stages.levels.counts[self.level]} functions more"
        why = f"{more} lower the error by {_judged(gain, least)}"
        if not first and self._time_is_up(outcome):
            why = f"optimise.seconds = {self.schedule.budget_s:g} leaves no time for {more}"
        if first and gain.share > 0.0:
            return replace(now, why=why)._stage_of("long", outcome, Turn(None, "current", improved=True, accepted=True))
        most = self._steps_of_level(outcome, 1)
        if not self.again and most != 0:
            return self._level_stage(self.level, Turn(None, "accepted"), most, again=True)
        back = replace(self, level=self.accepted_level, best=self.accepted, why=why)
        return back._stage_of("long", outcome, Turn(None, "accepted"))

    def _level_stage(
        self, level: int, turn: Turn, most_steps: int | None = None, *, again: bool = False
    ) -> "_Position":
        """The stage of ``level``, cut to ``most_steps``; ``again``: for the second time."""
        stage = self.schedule.stages.level_stage(level, most_steps, again=again)
        return replace(self, level=level, again=again, turn=replace(turn, stage=stage))

    def _steps_of_level(self, outcome: Outcome, levels: int) -> int | None:
        """Steps of each of so many ``levels`` more for which the budget has time, or of fewer levels; 0 for none."""
        if self.schedule.budget_s is None:
            return None
        left_s, step_s = _OF_BUDGET * self.schedule.budget_s - outcome.seconds, self._step_s(outcome)
        for count in range(levels, 0, -1):
            steps = int(left_s / step_s / sum(_DEARER**k for k in range(1, count + 1)))
            if steps >= min(_FEWEST, self.schedule.stages.effort.steps[0]):
                return steps
        return 0

    def _step_s(self, outcome: Outcome) -> float:
        """Seconds of a step of the stage that has ended; its set-up included."""
        return max(outcome.seconds - self.seconds, 1e-9) / max(outcome.steps, 1)

    def _after_long_stage(self, outcome: Outcome) -> "_Position":
        assert self.best is not None
        gain, least = self.best.gain_of(outcome, even=self.part == "uniform"), self.schedule.step_gain
        improved = gain.share > 0.0
        now = replace(self, best=outcome if improved else self.best)
        if gain.reaches(least):
            return now._stage_of(self.part, outcome, Turn(None, "current", improved=True))
        words = f"the last {outcome.steps} steps lowered the error by {_judged(gain, least)}"
        if self._time_is_up(outcome):
            words = self._used()
        return now._after_part(outcome, Turn(None, "best", improved), self.part, words)

    def _time_is_up(self, outcome: Outcome) -> bool:
        return self.schedule.budget_s is not None and outcome.seconds >= _UP * self.schedule.budget_s

    def _used(self) -> str:
        return f"optimise.seconds = {self.schedule.budget_s:g} are used"

    def _stage_of(self, part: _Part, outcome: Outcome, turn: Turn) -> "_Position":
        """One more stage of ``part``, with the parameters of ``turn``, if there is time; else what comes after it."""
        # those of a finished lens have been in a first one before: larger steps would lead away from it
        first = 1 if part == "long" and self.schedule.stages.start_level > 0 else 0
        before = self.stages if part == self.part else first
        make = self.schedule.stages.long_stage if part == "long" else self.schedule.stages.uniform_stage
        most = self._steps_left(outcome, make(self.level, before, None))
        if most is not None and most < _FEWEST:
            begin: _Begin = "best" if turn.begin == "current" else turn.begin
            return self._after_part(outcome, replace(turn, begin=begin), part, self._used())
        stage = make(self.level, before, most)
        return replace(self, part=part, stages=before + 1, turn=replace(turn, stage=stage))

    def _after_part(self, outcome: Outcome, turn: Turn, part: _Part, words: str) -> "_Position":
        """The first stage for the uniformity, or the end, because of ``words``."""
        if self.schedule.uniform and part != "uniform":
            return self._stage_of("uniform", outcome, turn)
        return replace(self, turn=replace(turn, why=f"{self.why}; {words}"))

    def _steps_left(self, outcome: Outcome, stage: Stage) -> int | None:
        """Steps of ``stage`` for which the budget has time, judged by the seconds of the last stage."""
        last = self.turn.stage
        if self.schedule.budget_s is None or last is None:
            return None
        kept = _FOR_UNIFORMITY if self.schedule.uniform and not stage.uniform else 0.0
        until_s = (_SAFE - kept) * self.schedule.budget_s
        return int((until_s - outcome.seconds) / (self._step_s(outcome) * max(1.0, stage.rays / last.rays)))


def _judged(gain: Gain, least: float) -> str:
    """A gain that is not enough, in words."""
    lowered = 100.0 * max(gain.share, 0.0)
    if gain.share >= least:
        return f"{lowered:.2g} %, which may be noise: its standard error is {100 * gain.standard_error:.2g} %"
    return f"{lowered:.2g} %, less than {100 * least:g} %"
