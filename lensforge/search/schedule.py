"""Coarse to fine: which levels move in a stage of the search, for how many steps and how far; the rays of each step.

A lens is judged by validation rays; what one lens gains over another stands with the error of that gain. Finer levels
help until the source, the receiver or the cutter blurs them.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lensforge.results import Count, NotNegative, Number, Positive, Record, Share
from lensforge.results.estimates import jackknife_error
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import Preset, SearchEffort
from lensforge.surfaces.srbf import level_sigma

LEAST_IMAGE = 1e-4  # NMSE below which nothing is left to gain: an evaluation is no more certain than a fifth of that
FIRST_LIMIT_WEIGHT = 0.01
_LIMIT_FACTOR = 10.0  # from stage to stage: from a hundredth at once to all of it road_wide misses a limit
SLICES = 8  # of the validation rays: the error of a gain is then known to a quarter of itself
# Standard errors that a gain must reach: by chance one stage in six would. With two, a level that halves the error of a
# lens for 20,000 measured rays is left out (led_colours, 53 +- 32 %).
_ERRORS = 1.0


class Gain(NamedTuple):
    """Share by which the error was lowered, and its standard error."""

    share: float
    standard_error: float

    def reaches(self, least: float) -> bool:
        """True for a gain of ``least`` or more that is no mere noise."""
        return self.share >= max(least, _ERRORS * self.standard_error)


class Judgement(Record):
    """A lens judged by validation rays: ``merit``, all terms; ``image``, the error of the image and of its limits.

    ``limits``: what both have of the limits on the light, in full. ``without``, ``limits_without``: merit and limits
    without one slice of the rays, for each of them. ``limits_missed``: number of the limits that are not kept.
    """

    merit: Number
    image: Positive
    without: Annotated[tuple[Number, ...], Field(min_length=SLICES, max_length=SLICES)]
    limits: Number = 0.0
    limits_without: Annotated[tuple[Number, ...], Field(min_length=SLICES, max_length=SLICES)] = (0.0,) * SLICES
    limits_missed: Count = 0

    def weighted(self, limit_weight: float) -> "Judgement":
        """The judgement with so much of the limits."""
        lighter = 1.0 - limit_weight
        return self.changed(
            merit=self.merit - lighter * self.limits,
            image=max(self.image - lighter * self.limits, LEAST_IMAGE),
            without=tuple(
                merit - lighter * limits for merit, limits in zip(self.without, self.limits_without, strict=True)
            ),
        )

    def gain_of(self, later: "Judgement") -> Gain:
        """The gain of ``later``, relative to the error of this image; by jackknife, as both see the same rays."""
        lowered = np.array(self.without) - np.array(later.without)
        return Gain((self.merit - later.merit) / self.image, jackknife_error(lowered) / self.image)


class Outcome(Record):
    """End of a stage after ``steps``: ``seconds`` of the search, and the judgements of its lens.

    ``limit_weight``: of the limits on the light in its merit.

    ``light``: by image and flux. ``even``: with the uniformity before the image, in a scene that has a region of
    uniform light.
    """

    steps: Count
    seconds: NotNegative
    light: Judgement
    even: Judgement | None = None
    limit_weight: Share = 1.0

    def judged(self, even: bool) -> Judgement:
        """The judgement by the light, or with the uniformity first where it is ``even`` and there is such a region."""
        return self.light if self.even is None or not even else self.even

    def gain_of(self, later: "Outcome", even: bool) -> Gain:
        """The gain of ``later`` over this one, by the merit that it was searched with."""
        before, after = (outcome.judged(even).weighted(later.limit_weight) for outcome in (self, later))
        return before.gain_of(after)


# Step sizes are large while the functions are few and broad, small at the end.
_FINEST_RATE_SHARE = 0.2
_FLOOR = 0.05
# A lens of revolution has a few dozen parameters, whose gradients have little noise. For round light it begins near its
# best, and large first steps throw light away for good, by an exit that comes down to the rim of the wall: flashlight
# loses 1.2 % through the wall with the usual rate, 0.65 % with half of it, 0.42 % with a quarter. For a patch it begins
# far from its best: with half the rate oval ends at an NMSE of 0.0085 and loses 3.0 %, at 0.0020 and 0.26 % where it
# goes far first. A share of the light, and the one mirror of a reflector, bear more: spot_10 has 0.864 within
# 10 degrees with twice the rate, 0.843 with it, 0.826 with half; a reflector 0.771 with twice, 0.766 with half.
_FEWER_RAYS = 4
_SHARE_RATES = (2.0,)
_TAILORED_RATES = (0.5,)  # with longer steps no search of spot_thin finds more light than its start
_ROUND_RATES = (0.25,)
_PATTERN_RATES = (2.0, 0.5)
# With a quarter of the rate it arrives later. From 100,000 rays of a file, drawn at random, a draft of a torch of 12
# degrees has 9.3 x 10.9 degrees with a quarter of the rays and the usual steps, 10.6 x 11.9 with all and twice these.
_ROUND_STEPS = 2


@dataclass(frozen=True)
class Stage:
    """Part of a search: the first ``functions`` weights move for ``steps`` steps of ``rays`` rays.

    ``limit_weight``: of the limits on the light in its merit. ``levels``: all of the basis whose tables are traced;
    ``level``: the last of them that moves. ``uniform``: put the uniformity before the image. ``least_gradient``: of a
    weight that moves as far as half of the others in a step of Adam, whose epsilon it is.
    """

    level: int
    levels: tuple[int, ...]
    functions: int
    steps: int
    rays: int
    learning_rate: float
    uniform: bool = False
    least_gradient: float = 1e-8
    limit_weight: float = 1.0

    def rate(self, step: int) -> float:
        """Learning rate at ``step``: cosine decay over the stage to a twentieth."""
        return self.learning_rate * (_FLOOR + (1.0 - _FLOOR) * 0.5 * (1.0 + math.cos(math.pi * step / self.steps)))


@dataclass(frozen=True)
class NextStage:
    """Continuation of a search: ``stage``, None at the end, and the parameters with which it begins.

    ``improved``: the last stage ended with the best lens of its level. ``accepted``: so far the best lens of all is the
    best of the level that has ended. ``why``: where the search ends, the reason.
    """

    stage: Stage | None
    begin: Literal["current", "best", "accepted"] = "current"
    improved: bool = False
    accepted: bool = False
    why: str = ""

    def with_limit_weight(self, weight: float) -> "NextStage":
        """The same with this weight of the limits on the light."""
        return self if self.stage is None else replace(self, stage=replace(self.stage, limit_weight=weight))


@dataclass(frozen=True)
class LimitWeights:
    """Weights of the limits on the light in the merit, by sequential unconstrained minimisation.

    A search begins with the ``first`` weight, or with less where the limits would outweigh the image at the start,
    but no less than ``least``; it takes ``factor`` times as much after each stage that ends with a limit missed, up
    to 1 (Fiacco and McCormick 1968). Limits of few places that count in full from the start hold a search at them: a
    draft of signal has an NMSE of 0.019 by that, 0.003 so, and of road_m3 0.63 and 0.74 of the light, with all limits
    kept.
    """

    first: float = 1.0
    factor: float = 1.0
    least: float = 1.0

    @staticmethod
    def over(stages: int) -> "LimitWeights":
        """Weights that reach 1 in the last of so many ``stages``, if a limit is missed in all before."""
        least = _LIMIT_FACTOR ** -max(stages - 1, 0)
        return LimitWeights(max(FIRST_LIMIT_WEIGHT, least), _LIMIT_FACTOR, least)

    def after(self, start: "Judgement") -> float:
        """The weight after a ``start`` that is judged so."""
        if start.limits <= 0.0:
            return self.first
        return max(min(self.first, (start.image - start.limits) / start.limits), self.least)


class Schedule(ABC):
    """The stages of a search, one after another, of which the first takes no step: there the start is judged."""

    @property
    @abstractmethod
    def limit_weights(self) -> LimitWeights:
        """Weights of the limits on the light."""

    @abstractmethod
    def phases(self) -> Generator[NextStage, Outcome]:
        """The whole search: every stage is answered by its outcome, and the last item has no stage."""

    def next_stages(self, outcomes: Iterable[Outcome]) -> Iterator[NextStage]:
        """The first stage, and what follows each of ``outcomes``, one after another."""
        phases = self.phases()
        weight = self.limit_weights.first
        yield next(phases).with_limit_weight(weight)
        missed = 0  # by the lens that the search goes on from
        for number, outcome in enumerate(outcomes):
            following = phases.send(outcome)
            missed = outcome.light.limits_missed if following.begin == "current" else missed
            if number == 0:
                weight = self.limit_weights.after(outcome.light)
            elif missed:
                weight = min(weight * self.limit_weights.factor, 1.0)
            yield following.with_limit_weight(weight)

    def next_stage(self, outcomes: Sequence[Outcome]) -> NextStage:
        """Continuation after the stages that had ``outcomes``."""
        *_, last = self.next_stages(outcomes)
        return last

    def most_steps(self, outcomes: Sequence[Outcome]) -> int:
        """Steps of the whole search, as far as can be said after ``outcomes``: those so far, and of what follows."""
        stage = self.next_stage(outcomes).stage
        return sum(outcome.steps for outcome in outcomes) + (0 if stage is None else stage.steps)

    def validation_rays(self, most: int) -> int:
        """Rays of each sample that judges a lens, ``most`` of them or fewer."""
        return most

    def most_seconds(self, outcomes: Sequence[Outcome]) -> float:
        """Seconds of the search after which the stage that follows ``outcomes`` ends at once; infinity for never."""
        return math.inf


# How a search goes on from a stage that has ended.
ACCEPTED = NextStage(None, "current", improved=True, accepted=True)
TAKEN_BACK = NextStage(None, "accepted")


def stages_of(schedule: Schedule, outcomes: Sequence[Outcome]) -> list[Stage]:
    """The stages that had ``outcomes``, and the one that follows, if any."""
    return [following.stage for following in schedule.next_stages(outcomes) if following.stage is not None]


@dataclass(frozen=True)
class FixedSchedule(Schedule):
    """Stages that are known before the search; each goes on from the best lens so far."""

    stages: tuple[Stage, ...]

    @property
    def limit_weights(self) -> LimitWeights:
        """Weights that may reach 1 in the last stage."""
        return LimitWeights.over(sum(stage.steps > 0 for stage in self.stages))

    def phases(self) -> Generator[NextStage, Outcome]:
        """The start, all stages in their order, and the end; the reason names levels that did not gain."""
        best = yield NextStage(replace(self.stages[0], steps=0))
        how = ACCEPTED
        lost = list[str]()
        for stage in self.stages:
            if stage.steps == 0:
                continue
            outcome = yield replace(how, stage=stage)
            how = ACCEPTED if best.gain_of(outcome, even=False).share > 0.0 else TAKEN_BACK
            if how is ACCEPTED:
                best = outcome
            else:
                lost.append(f"the {stage.steps} steps of {stage.functions} functions did not lower the error")
        yield replace(how, why="; ".join(lost))

    def validation_rays(self, most: int) -> int:
        """No more than eight steps have: judging is to take little of the time of a short search."""
        return min(most, SLICES * self.stages[0].rays)

    def most_steps(self, outcomes: Sequence[Outcome]) -> int:
        """Steps of all stages."""
        return sum(stage.steps for stage in self.stages)


def fixed_schedule(spec: Spec, preset: Preset, *, last_only: bool, measured: bool = False) -> FixedSchedule:
    """A stage for each level, or only the last; ``measured``: of rays of a file. What is left open is the preset's."""
    levels = spec.lens.shape_levels
    settings = spec.optimise
    of_basis = spec.lens.levels
    assert of_basis != "auto", "a schedule of its own"
    last = len(levels) - 1
    fine_steps = preset.fine_steps * (_ROUND_STEPS if _profile_rates(spec) is _ROUND_RATES else 1)
    steps = settings.steps_per_level or (preset.coarse_steps,) * last + (fine_steps,)
    if not spec.lens.free:
        steps = (0,) * len(levels)
    rays = settings.rays or preset.design_rays // (_FEWER_RAYS if spec.lens.is_round and not measured else 1)
    stages = []
    functions = 0
    for level, count in enumerate(levels):
        functions += count
        rate = preset.effort.learning_rate * _FINEST_RATE_SHARE ** (level / max(1, last))
        rates = _profile_rates(spec) if level == 0 and spec.lens.has_creases else (1.0,)
        for number, level_rate in enumerate(rates):
            part = (steps[level] + number) // len(rates)
            stages.append(Stage(level, of_basis, functions, part, rays, level_rate * rate))
    return FixedSchedule(tuple(stages[-1:] if last_only else stages))


def _profile_rates(spec: Spec) -> tuple[float, ...]:
    """Factors of the rate of each part of the steps in which profiles move alone."""
    if spec.lens.begins_tailored:
        return _TAILORED_RATES
    if spec.lens.is_opaque or spec.optimise.counts_light_alone:
        return _SHARE_RATES
    return _ROUND_RATES if spec.lens.is_round else _PATTERN_RATES


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
                limit = f"functions narrower than {narrowest_rad:.2g} rad would not show: {reason}"
                return UsefulLevels(tuple(counts), limit)
            counts.append(count)
        return UsefulLevels(tuple(counts), f"finest level there is: {counts[-1]} functions")

    def resolving(self, detail_rad: float, sigma_c: float) -> int:
        """The coarsest level whose functions are as narrow as ``detail_rad``, or the last."""
        narrow = [level_sigma(count, sigma_c) <= 1.001 * detail_rad for count in self.counts]
        return narrow.index(True) if any(narrow) else len(narrow) - 1


def _limits(spec: Spec, source: Source) -> list[tuple[float, str]]:
    """Widths (rad) below which a function is useless, each with its reason."""
    radius_mm = spec.constraints.max_radius_mm
    limits = []
    outline = source.outline()
    width_mm = float(np.ptp(outline[:, :2], axis=0).max()) if len(outline) else 0.0
    limits.append((_OF_SOURCE * width_mm / radius_mm, f"a fifth of the angle of the source, {width_mm:.3g} mm wide"))
    pixel_rad = min(receiver.pixel_rad(spec.evaluate.pixels) for receiver in spec.receivers_in_states)
    for name in spec.lens.names:
        limit_mm = spec.face_limits(name).concave_radius_mm
        ball_mm = spec.manufacture.cutter_radius_mm if limit_mm is None else limit_mm
        limit = f"what a ball of {ball_mm:g} mm reaches in the {name} face moves the light by less than a pixel"
        limits.append((_width_of_ball(spec, ball_mm, pixel_rad), limit))
    return limits


def _width_of_ball(spec: Spec, ball_mm: float, pixel_rad: float) -> float:
    """Width (rad) of a function that, hollow as a ball of that radius, moves the light by one pixel.

    Its slope is width over twice the ball's radius, and light turns by ``n - 1`` times that in air.
    """
    turn = spec.lens.media.largest_turning_power
    return 2.0 * ball_mm * pixel_rad / (turn * spec.constraints.max_radius_mm) if turn > 0.0 else 0.0


# Measured on pi, cross and flat_top: further in the first steps than in given levels, which are to
# converge.
_FIRST_RATE = 1.5  # of the usual rate
_LEVEL_RATE = 0.65  # of a level, relative to the level before
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
    """Stages for ``levels`` with the steps and rays of ``effort``.

    ``images``: mirror images of every ray; their mean has less noise, so that steps may be larger. ``start_level``: of
    the lens from which it starts, all of whose functions stay while the broad ones move.
    """

    levels: UsefulLevels
    effort: SearchEffort
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
        return replace(stage, uniform=True)

    def _stage(self, level: int, steps: int, doublings: int, share: float) -> Stage:
        counts = self.levels.counts
        first, most = self.effort.rays
        levels = counts[: max(level, self.start_level) + 1]
        rate = _FIRST_RATE * self.effort.learning_rate * _LEVEL_RATE**level * share * self.images**_OF_IMAGES
        rays = min(first * 2 ** (level // _TWICE_FROM + doublings), most)
        return Stage(level, levels, sum(counts[: level + 1]), steps, rays, rate, least_gradient=_LEAST_GRADIENT)


def _cut(steps: int, most: int | None) -> int:
    return steps if most is None else min(steps, most)


def rays_ahead(source: Source, count: int, seeds: Iterable[int]) -> Iterator[RayBundle]:
    """A sample of ``count`` rays for each of ``seeds``, in their order; the next is drawn while one is in use."""
    with ThreadPoolExecutor(1) as pool:
        following = None
        for seed in seeds:
            current = following
            following = pool.submit(source.sample, count, seed)
            if current is not None:
                yield current.result()
        if following is not None:
            yield following.result()
