"""Progress on stderr: a line for each stage with its time; on a terminal, running stages have a clock.

A design says level, error and the time left, a study its parts. In a pipe a stage is written once it has ended, and
how far it is once a minute.
"""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import Progress, ProgressColumn, Task, TaskID
from rich.table import Column
from rich.text import Text

from lensforge.cli.output import printable, warning_line
from lensforge.kernels.compiled import are_compiled
from lensforge.report.results import REPORT_FILE, STAGES
from lensforge.search.design_result import COSTS
from lensforge.search.design_result import Progress as Step
from lensforge.search.searches_in_turn import number_of_searches
from lensforge.spec import Spec

_FRAMES_PER_SECOND = 4
_NAME_COLUMNS = 12
_TIME_COLUMNS = 12


class StageClock:
    """Lines of the stages of one command, the first called ``name``; ``quiet``: nothing but warnings.

    ``silent_s``: at most, where a pipe is written.
    """

    def __init__(self, name: str, *, quiet: bool = False, silent_s: float = 60.0) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._quiet = quiet
        self._silent_s = silent_s
        self._progress = Progress(
            _StageColumn(self._time_left),
            console=self._console,
            refresh_per_second=_FRAMES_PER_SECOND,
            transient=True,  # each stage that ends has a line above
            redirect_stdout=False,
            redirect_stderr=False,
            disable=not self.live,
        )
        self._first = name
        self._entered = self._written = time.monotonic()
        self._end_expected = 0.0  # of the whole command
        self._at_least = ""  # no time is left where it is not known
        self._exited = threading.Event()

    @property
    def live(self) -> bool:
        """True where a terminal shows the clock."""
        return self._console.is_terminal and not self._quiet

    def __enter__(self) -> Self:
        self._entered = self._written = time.monotonic()
        self.begin(self._first)
        if self.live:
            self._progress.start()
        elif not self._quiet:
            threading.Thread(target=self._write_until_exit, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._exited.set()
        self._progress.stop()
        if error is None:
            for task in self._progress.tasks:
                self._write(_line(task))

    def begin(self, name: str, detail: str = "", *, beside: bool = False) -> None:
        """End the stage that runs, unless the new one runs ``beside`` it, and begin ``name``."""
        if not beside:
            self.end()
        self._progress.add_task(name, total=None, detail=detail)

    def end(self, name: str = "", seconds: float | None = None) -> None:
        """End the stage ``name``, else the one that has run longest; ``seconds``: its own time, where it is known."""
        task = next((task for task in self._progress.tasks if name in ("", task.description)), None)
        if task is not None:
            self._progress.remove_task(task.id)
            self._write(_line(task, seconds))

    def total(self) -> None:
        """End the stage that runs, and write a line on the time of all: less than their sum where some overlap."""
        self.end()
        self._write(_worded("in all", time.monotonic() - self._entered, ""))

    def show(self, detail: str) -> None:
        """Show how far the stage is that has run longest, beside its time."""
        running: list[TaskID] = self._progress.task_ids
        if running:
            self._progress.update(running[0], detail=detail)

    def expect(self, seconds: float, *, at_least: bool = False) -> None:
        """Show that the whole command will take so many more seconds, or at least so many, until they have passed."""
        self._end_expected = time.monotonic() + seconds
        self._at_least = "at least " if at_least else ""

    def head(self, title: str) -> None:
        """End the stage that runs, and write a line on the stages that follow."""
        self.end()
        self.note(title)

    def note(self, message: str) -> None:
        """Write a line above the clock."""
        if not self._quiet:
            self._console.print(printable(message), soft_wrap=True, markup=False)

    def warn(self, message: str) -> None:
        """Print a warning on one line, even with --quiet."""
        self._console.print(warning_line(message), soft_wrap=True, markup=False)

    def _time_left(self, task: Task) -> str:
        left = self._end_expected - time.monotonic()
        first = task.id == next(iter(self._progress.task_ids), None)
        return f", {self._at_least}{duration(left)} left" if first and left > 0.0 else ""

    def _write(self, line: str) -> None:
        """Write the line of a stage; on a terminal cut at its width, elsewhere in full."""
        self._written = time.monotonic()
        if not self._quiet:
            self._console.print(
                line, markup=False, no_wrap=True, overflow="ellipsis" if self.live else "ignore", crop=self.live
            )

    def _write_until_exit(self) -> None:
        while not self._exited.wait(max(0.01, self._written + self._silent_s - time.monotonic())):
            if time.monotonic() >= self._written + self._silent_s:
                for task in self._progress.tasks:
                    self._write(_line(task))


class _StageColumn(ProgressColumn):
    """The line of a stage that runs; ``time_left``: words that end the line of one of them."""

    def __init__(self, time_left: Callable[[Task], str]) -> None:
        super().__init__(Column(no_wrap=True, overflow="ellipsis"))
        self._time_left = time_left

    def render(self, task: Task) -> Text:
        return Text(_line(task) + self._time_left(task))


def _line(task: Task, seconds: float | None = None) -> str:
    return _worded(task.description, (task.elapsed or 0.0) if seconds is None else seconds, task.fields["detail"])


def _worded(name: str, seconds: float, detail: str) -> str:
    line = f"{printable(name):<{_NAME_COLUMNS}} {duration(seconds):>{_TIME_COLUMNS}}  {printable(detail)}"
    return line.rstrip()


def duration(seconds: float) -> str:
    """Format a time: "0.8 s", "47 s", "7 min 05 s", "1 h 12 min"."""
    whole = round(seconds)
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


# Seconds of all later stages over those of the search, as is usual on two cores: of a draft, and of any other.
_LATER_OF_DRAFT = 2.5
_LATER = 0.6
_NAMES = {*(kind.stage for kind in STAGES), COSTS, REPORT_FILE.partition(".")[0]}


def _later(step: Step) -> float:
    return _LATER_OF_DRAFT if step.accuracy == "draft" else _LATER


class DesignProgress:
    """Progress of a search and of the stages after it, on ``clock``.

    The time left is that of the whole command, of which later stages take a usual share; at least that, where the
    search chooses its levels and may add some.
    """

    def __init__(self, clock: StageClock, spec: Spec) -> None:
        self._clock = clock
        automatic = spec.lens.levels == "auto"
        levels = "" if automatic else f"/{number_of_searches(spec) * len(spec.lens.shape_levels)}"
        self._of_levels = levels
        self._of_steps = not automatic
        self._last: Step | None = None
        self._level_began = 0, 0.0  # step and seconds
        self._searching = True
        if not are_compiled():
            clock.note("compiling kernels, once on this machine, about 20 s")

    def on_step(self, step: Step) -> None:
        """Show a gradient step; where there is no terminal, write a line for each level that the spec names."""
        self._clock.show(f"{_within(step)}level {step.level + 1}{self._of_levels}, NMSE {step.nmse:.4f}")
        left = self._left(step)
        if left is not None:
            self._clock.expect(left, at_least=not self._of_steps or bool(step.within))
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
        return left + _later(step) * (step.seconds + left)

    def _words(self, step: Step) -> str:
        return (
            f"{_within(step)}level {step.level + 1}{self._of_levels}  step {step.steps_done}/{step.steps_total}  "
            f"NMSE {step.nmse:.4f} with ray noise  efficiency {step.efficiency:.3f}"
        )

    def on_stage(self, message: str) -> None:
        """Begin a stage, maybe beside another; other words, on one of several searches, are a line of their own."""
        if message not in _NAMES:
            self._clock.note(message)
            return
        if self._searching:
            self._clock.end()  # the search, which tells its end by no other words
            self._searching = False
            if self._last is not None:
                self._clock.expect(_later(self._last) * self._last.seconds)
        self._clock.begin(message, beside=True)

    def on_end(self, name: str, seconds: float) -> None:
        """End a stage."""
        self._clock.end(name, seconds)


def _within(step: Step) -> str:
    return f"{step.within}, " if step.within else ""


_WORTH_SAYING_S = 10.0


class PartsProgress:
    """Progress of a study on ``clock``: its stages, and how many parts have been measured."""

    def __init__(self, clock: StageClock, parts: str = "parts") -> None:
        self._clock = clock
        self._parts = parts
        self._stage = ""
        self._detail = ""
        self._first: tuple[int, float] | None = None  # parts of this stage that were measured at a time
        self._estimated = clock.live  # a terminal shows the time that is left all the while

    def heard(self, stage: str) -> dict[str, Callable[..., object]]:
        """Keywords by which the verb of ``stage`` is heard; only the yield has stages of its own."""
        return {"progress": self.on_parts, **({"announce": self.on_stage} if stage == "yield" else {})}

    def on_stage(self, announced: str) -> None:
        """Begin a stage; "budget: 2 of 20, source height" is a part of "budget"."""
        stage, _, self._detail = announced.partition(": ")
        if stage != self._stage:
            self._clock.begin(stage)
            self._stage = stage
            self._first = None
        self._clock.show(self._detail)

    def on_parts(self, done: int, expected: int) -> None:
        """Show how many parts have been measured and, once the first of them are, the time for the rest."""
        counted = f"{done} of {expected} {self._parts}"
        self._clock.show(f"{self._detail}: {counted}" if self._detail else counted)
        now = time.monotonic()
        if self._first is None:
            self._first = done, now
        before, began = self._first
        if done <= before:
            return
        left = (now - began) / (done - before) * (expected - done)
        self._clock.expect(left, at_least=True)
        if not self._estimated and left > _WORTH_SAYING_S:
            self._clock.note(f"{done} of {expected} {self._parts}, at least {duration(left)} left")
            self._estimated = True
