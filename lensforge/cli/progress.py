"""Progress of a design, by level, error and time left, and of a study, by its parts."""

from collections.abc import Callable

from lensforge.cli.stage_clock import StageClock
from lensforge.report.results import REPORT_FILE, STAGES
from lensforge.search.design_result import Progress as Step
from lensforge.spec import Accuracy, Spec

# Seconds of all later stages over those of the search, as is usual on two cores.
_LATER: dict[Accuracy, float] = {"draft": 2.5, "standard": 0.6, "reference": 0.6}
_NAMES = {*(kind.stage for kind in STAGES), REPORT_FILE.partition(".")[0]}


class DesignProgress:
    """Progress of a search and of the stages after it, on ``clock``.

    The time left is that of the whole command, of which later stages take a usual share; at least that, where the
    search chooses its levels and may add some.
    """

    def __init__(self, clock: StageClock, spec: Spec) -> None:
        self._clock = clock
        levels = spec.lens.levels
        self._of_levels, self._of_steps = ("", False) if levels == "auto" else (f"/{len(levels)}", True)
        self._last: Step | None = None
        self._level_began = 0, 0.0  # step and seconds
        self._searching = True

    def on_step(self, step: Step) -> None:
        """Show a gradient step; where there is no terminal, write a line for each level that the spec names."""
        self._clock.show(f"level {step.level + 1}{self._of_levels}, NMSE {step.nmse:.4f}")
        left = self._left(step)
        if left is not None:
            self._clock.expect(left, at_least=not self._of_steps)
        last = step.steps_done == step.steps_total
        new_level = self._last is not None and self._last.level != step.level
        shown = step if last else self._last
        if self._of_steps and not self._clock.live and (new_level or last) and shown is not None:
            self._clock.note(self._words(shown))
        self._last = step

    def _left(self, step: Step) -> float | None:
        """Seconds that are left: of the steps at the pace of this level, as levels differ, and of the rest."""
        if self._last is None or self._last.level != step.level:
            self._level_began = step.steps_done, step.seconds
        first, began = self._level_began
        if step.steps_done == first:
            return None
        pace = (step.seconds - began) / (step.steps_done - first)
        left = pace * (step.steps_total - step.steps_done)
        return left + _LATER[step.accuracy] * (step.seconds + left)

    def _words(self, step: Step) -> str:
        return (
            f"level {step.level + 1}{self._of_levels}  step {step.steps_done}/{step.steps_total}  "
            f"NMSE {step.nmse:.4f}  efficiency {step.efficiency:.3f}"
        )

    def on_stage(self, words: str) -> None:
        """Begin a stage, maybe beside another; other words, on one of several searches, are a line of their own."""
        if words not in _NAMES:
            self._clock.note(words)
            return
        if self._searching:
            self._clock.end()  # the search, which tells its end by no other words
            self._searching = False
            if self._last is not None:
                self._clock.expect(_LATER[self._last.accuracy] * self._last.seconds)
        self._clock.begin_beside(words)

    def on_end(self, name: str, seconds: float) -> None:
        """End a stage."""
        self._clock.end(name, seconds)


class PartsProgress:
    """Progress of a study on ``clock``: its stages, and how many parts have been measured."""

    def __init__(self, clock: StageClock, parts: str = "parts") -> None:
        self._clock, self._parts = clock, parts
        self._stage = ""

    def heard(self, stage: str) -> dict[str, Callable[..., object]]:
        """Keywords by which the verb of ``stage`` is heard; only the yield has stages of its own."""
        return {"progress": self.on_parts, **({"announce": self.on_stage} if stage == "yield" else {})}

    def on_stage(self, words: str) -> None:
        """Begin a stage; "budget: source height" is a part of "budget"."""
        stage, _, detail = words.partition(": ")
        if stage != self._stage:
            self._clock.begin(stage)
            self._stage = stage
        self._clock.show(detail)

    def on_parts(self, done: int, expected: int) -> None:
        """Show how many parts have been measured."""
        self._clock.show(f"{done} of {expected} {self._parts}")


class StudyProgress:
    """Progress of a trade-off on ``clock``: a line for each of its studies."""

    def __init__(self, clock: StageClock) -> None:
        self._clock = clock

    def on_stage(self, words: str) -> None:
        """Begin a study; a warning is a line of its own."""
        kind, _, rest = words.partition(": ")
        if kind == "warning":
            self._clock.warn(rest)
        else:
            self._clock.begin("study", words)
