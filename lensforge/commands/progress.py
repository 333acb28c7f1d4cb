"""Progress on stderr: of a design by level, loss, efficiency and time left; of a study by its parts."""

import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from lensforge.commands.printing import warning_line
from lensforge.optimisation.design import Progress as Step
from lensforge.spec import Spec

_LINE_SECONDS = 10.0


class LiveBar:
    """A bar on a terminal's stderr, with ``columns`` after it; elsewhere it is disabled."""

    def __init__(self, words: str, *columns: ProgressColumn) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            *columns,
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task(words, total=None, numbers="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()


class Reporter(LiveBar):
    """A live bar on a terminal; elsewhere a line at the end of each level and the start of each stage.

    ``observers`` are called with every step.
    """

    def __init__(self, spec: Spec, *observers: Callable[[Step], None]) -> None:
        time_left = TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()
        super().__init__(spec.name, TextColumn("{task.fields[numbers]}"), *time_left)
        self._observers = observers
        levels = spec.lens.levels
        self._of_levels, self._of_steps = ("", False) if levels == "auto" else (f"/{len(levels)}", True)
        self._name = spec.name
        self._last: Step | None = None

    def on_step(self, step: Step) -> None:
        """Show a gradient step."""
        numbers = f"NMSE {step.nmse:.4f}  efficiency {step.efficiency:.3f}"
        self._bar.update(
            self._task,
            completed=step.steps_done,
            total=step.steps_total,
            description=f"{self._name}  level {step.level + 1}{self._of_levels}",
            numbers=numbers,
        )
        new_level = self._of_steps and self._last is not None and self._last.level != step.level
        if self._bar.disable and (new_level or step.steps_done == step.steps_total):
            shown = step if step.steps_done == step.steps_total else self._last
            assert shown is not None
            of_steps = f"/{step.steps_total}" if self._of_steps else ""
            self._console.print(
                f"level {shown.level + 1}{self._of_levels}  step {shown.steps_done}{of_steps}  "
                f"NMSE {shown.nmse:.4f}  efficiency {shown.efficiency:.3f}"
            )
        self._last = step
        for observer in self._observers:
            observer(step)

    def on_stage(self, stage: str) -> None:
        """Show that a stage after the design begins."""
        if self._bar.disable:
            self._console.print(stage)
        self._bar.update(self._task, description=f"{self._name}  {stage}", numbers="")

    def on_warning(self, words: str) -> None:
        """Show a warning on the source as one line, above the bar."""
        self._console.print(warning_line(words), soft_wrap=True, markup=False)


class PartsBar(LiveBar):
    """A live bar of measured parts on a terminal; elsewhere a line for each stage, and every ten seconds."""

    def __init__(self, words: str = "yield") -> None:
        super().__init__(words, TextColumn("{task.completed}/{task.total}"), TimeElapsedColumn())
        self._said = time.monotonic()

    def on_stage(self, words: str) -> None:
        """Show that a stage begins."""
        if self._bar.disable:
            self._console.print(words, soft_wrap=True, markup=False)
        self._bar.update(self._task, description=words)

    def on_parts(self, done: int, expected: int) -> None:
        """Show how many parts have been measured."""
        self._bar.update(self._task, completed=done, total=expected)
        if self._bar.disable and time.monotonic() - self._said > _LINE_SECONDS:
            self._said = time.monotonic()
            self._console.print(f"{done} of {expected} parts")
