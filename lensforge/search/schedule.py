"""Coarse to fine: which levels move in a stage of the search, for how many steps and how far; the rays of each step.

A lens is judged by validation rays; what one lens gains over another stands with the error of that gain.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from pydantic import Field

from lensforge.light.metrics import jackknife_error
from lensforge.results import Count, NotNegative, Number, Positive, Record
from lensforge.sources.ray_bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import Preset

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
    """A lens judged by validation rays: ``merit``, all terms; ``image``, the error of the image alone.

    ``without``: the merit without one slice of the rays, for each of them.
    """

    merit: Number
    image: Positive
    without: Annotated[tuple[Number, ...], Field(min_length=SLICES, max_length=SLICES)]

    def gain_of(self, later: "Judgement") -> Gain:
        """The gain of ``later``, relative to the error of this image; by jackknife, as both see the same rays."""
        lowered = np.array(self.without) - np.array(later.without)
        return Gain((self.merit - later.merit) / self.image, jackknife_error(lowered) / self.image)


class Outcome(Record):
    """End of a stage after ``steps``: ``seconds`` of the search, judgements of its lens where a schedule needs them.

    ``light``: by image and flux. ``even``: with the uniformity before the image, in a scene that has a region of
    uniform light.
    """

    steps: Count
    seconds: NotNegative
    light: Judgement | None = None
    even: Judgement | None = None

    def gain_of(self, later: "Outcome", even: bool) -> Gain:
        """The gain of ``later`` over this one."""
        before, after = (self.even, later.even) if even else (self.light, later.light)
        assert before is not None and after is not None, "an automatic schedule has only outcomes with judgements"
        return before.gain_of(after)


# Step sizes relative to the starting offset: large while the functions are few and broad, small at the end.
_FINEST_RATE_SHARE = 0.2
_FLOOR = 0.05


@dataclass(frozen=True)
class Stage:
    """Part of a search: the first ``functions`` weights move for ``steps`` steps of ``rays`` rays.

    ``levels``: all of the basis whose tables are traced; ``level``: the last of them that moves. ``uniformity_from``:
    the step from which the uniformity loss is added; ``steps`` for never. ``least_gradient``: of a weight that moves as
    far as half of the others in a step of Adam, whose epsilon it is.
    """

    level: int
    levels: tuple[int, ...]
    functions: int
    steps: int
    rays: int
    learning_rate: float
    uniformity_from: int
    least_gradient: float = 1e-8

    def rate(self, step: int) -> float:
        """Learning rate at ``step``: cosine decay over the stage to a twentieth."""
        return self.learning_rate * (_FLOOR + (1.0 - _FLOOR) * 0.5 * (1.0 + math.cos(math.pi * step / self.steps)))

    @property
    def uniform(self) -> bool:
        """True where its last step puts the uniformity before the image."""
        return self.uniformity_from < self.steps


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


@runtime_checkable
class Schedule(Protocol):
    """The stages of a search, one after another."""

    def next_stages(self, outcomes: Iterable[Outcome]) -> Iterator[NextStage]:
        """The first stage, and what follows each of ``outcomes``, one after another."""
        ...

    def next_stage(self, outcomes: Sequence[Outcome]) -> NextStage:
        """Continuation after the stages that had ``outcomes``."""
        ...

    def accepts(self, outcome: Outcome) -> bool:
        """True where ``outcome`` has the judgements that decide what follows."""
        ...

    def most_steps(self, outcomes: Sequence[Outcome]) -> int:
        """Steps of the whole search, as far as can be said after ``outcomes``."""
        ...

    def most_seconds(self, outcomes: Sequence[Outcome]) -> float:
        """Seconds of the search after which the stage that follows ``outcomes`` ends at once; infinity for never."""
        ...


def stages_of(schedule: Schedule, outcomes: Sequence[Outcome]) -> list[Stage]:
    """The stages that had ``outcomes``, and the one that follows, if any."""
    return [following.stage for following in schedule.next_stages(outcomes) if following.stage is not None]


@dataclass(frozen=True)
class FixedSchedule:
    """Stages that are known before the search; ``outcomes`` count, nothing else."""

    stages: tuple[Stage, ...]

    def next_stages(self, outcomes: Iterable[Outcome]) -> Iterator[NextStage]:
        """All stages in their order, and the end."""
        yield self.next_stage(())
        for done, _ in enumerate(outcomes, 1):
            yield NextStage(self.stages[done] if done < len(self.stages) else None)

    def accepts(self, outcome: Outcome) -> bool:
        """True for one without judgements: nothing depends on them."""
        return outcome.light is None and outcome.even is None

    def next_stage(self, outcomes: Sequence[Outcome]) -> NextStage:
        """The next stage; the current parameters are kept."""
        done = len(outcomes)
        return NextStage(self.stages[done] if done < len(self.stages) else None)

    def most_steps(self, outcomes: Sequence[Outcome]) -> int:
        """Steps of all stages."""
        return sum(stage.steps for stage in self.stages)

    def most_seconds(self, outcomes: Sequence[Outcome]) -> float:
        """Infinity: every stage has all its steps."""
        return math.inf


def fixed_schedule(spec: Spec, preset: Preset, *, last_only: bool) -> FixedSchedule:
    """A stage for each level of a spec, or only the last; what the spec leaves open comes from the preset."""
    levels, settings = spec.lens.basis.levels, spec.optimise
    last = len(levels) - 1
    steps = settings.steps_per_level or (preset.coarse_steps,) * last + (preset.fine_steps,)
    stages, functions = [], 0
    for level, count in enumerate(levels):
        functions += count
        share = _FINEST_RATE_SHARE ** (level / max(1, last))
        uniform = min(settings.uniformity_steps, steps[level]) if level == last else 0
        stages.append(
            Stage(
                level, levels, functions, steps[level], settings.rays or preset.design_rays,
                settings.learning_rate * share, steps[level] - uniform,
            )
        )  # fmt: skip
    return FixedSchedule(tuple(stages[-1:] if last_only else stages))


def rays_ahead(source: Source, count: int, seeds: Iterable[int]) -> Iterator[RayBundle]:
    """A sample of ``count`` rays for each of ``seeds``, in their order; the next is drawn while one is in use."""
    with ThreadPoolExecutor(1) as pool:
        following = None
        for seed in seeds:
            current, following = following, pool.submit(source.sample, count, seed)
            if current is not None:
                yield current.result()
        if following is not None:
            yield following.result()
