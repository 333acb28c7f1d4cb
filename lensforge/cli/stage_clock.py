"""Progress on stderr: a line for each stage with its time; on a terminal the running stage has a clock.

The clock is drawn by a thread of its own, and by a process where a library keeps all threads waiting. Elsewhere, as in
a pipe, each stage is written once it has ended; how far it is every two minutes, too, and every two seconds in a study.
"""

import os
import subprocess
import sys
import threading
import time
from contextlib import suppress
from types import TracebackType
from typing import Any, Self

from rich.console import Console
from rich.live import Live
from rich.text import Text

from lensforge.cli import stage_line
from lensforge.cli.printing import printable, warning_line

_FRAMES_PER_SECOND = 4
_SILENT_SECONDS, _SILENT_SECONDS_OF_STUDY = 120.0, 2.0  # at most, where a pipe is written


class StageClock:
    """Lines of the stages of one command, of which the first is ``name``.

    ``quiet``: nothing but warnings. Where there is no terminal, a line is written every two minutes at least;
    ``study``: every two seconds.
    """

    def __init__(self, name: str, *, quiet: bool = False, study: bool = False) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._quiet, self._silent_seconds = quiet, _SILENT_SECONDS_OF_STUDY if study else _SILENT_SECONDS
        self._name, self._detail, self._began = name, "", time.monotonic()
        self._end_expected, self._at_least = 0.0, ""  # of the whole command; no time is left where it is not known
        self._written = self._entered = self._began
        self._beside: dict[str, float] = {}  # the beginning of each stage that runs beside the one that is shown
        self._live: Live | None = None
        self._drawer: subprocess.Popen[bytes] | None = None
        self._ended = threading.Event()

    @property
    def live(self) -> bool:
        """True where a terminal shows the clock."""
        return self._console.is_terminal and not self._quiet

    def __enter__(self) -> Self:
        self._began = self._entered = time.monotonic()
        if self.live:
            self._live = Live(
                console=self._console,
                get_renderable=self._running,
                refresh_per_second=_FRAMES_PER_SECOND,
                transient=True,
                redirect_stdout=False,
                redirect_stderr=False,
            )
            self._live.start()
            self._drawer = _drawer()
            self._report()
        elif not self._quiet:
            threading.Thread(target=self._write_until_ended, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._live is not None:
            self._live.stop()
        if self._drawer is not None:
            self._drawer.communicate()
            self._drawer = None
        if error is None:
            self._write()

    def begin(self, name: str, detail: str = "") -> None:
        """End the stage that runs, and begin ``name``."""
        self._write()
        self._name, self._detail, self._began = name, detail, time.monotonic()
        self._report()

    def begin_beside(self, name: str) -> None:
        """Begin ``name`` beside the stage that runs; where none runs, it is the one that is shown."""
        if self._name:
            self._beside[name] = time.monotonic()
        else:
            self.begin(name)

    def end(self, name: str = "", seconds: float | None = None) -> None:
        """End the stage that runs, or ``name`` beside it, which has taken ``seconds``; of all others none begins."""
        if name in self._beside:
            began = self._beside.pop(name)
            self._write((name, time.monotonic() - began if seconds is None else seconds, ""))
            return
        self._write(seconds=seconds)
        self._name = self._detail = ""
        if self._beside:
            self._name = next(iter(self._beside))
            self._began = self._beside.pop(self._name)
            self._report()

    def total(self) -> None:
        """End the stage that runs, and write a line on the time of all: less than their sum where some overlap."""
        self.end()
        self._write(("in all", time.monotonic() - self._entered, ""))

    def show(self, detail: str) -> None:
        """Show how far the stage is, beside its time."""
        self._detail = detail
        self._report()

    def expect(self, seconds: float, *, at_least: bool = False) -> None:
        """Show that the whole command will take so many more seconds, or at least so many, until they have passed."""
        self._end_expected, self._at_least = time.monotonic() + seconds, "at least " if at_least else ""

    def head(self, words: str) -> None:
        """End the stage that runs, and write a line on the stages that follow."""
        self.end()
        self.note(words)

    def note(self, words: str) -> None:
        """Write a line above the clock."""
        if not self._quiet:
            self._console.print(printable(words), soft_wrap=True, markup=False)

    def warn(self, words: str) -> None:
        """Write a warning as one line, also where progress is not asked for."""
        self._console.print(warning_line(words), soft_wrap=True, markup=False)

    def _line(self) -> str:
        """Stage, its time, and how far it is, or what runs beside it."""
        return _worded(self._name, time.monotonic() - self._began, self._shown())

    def _shown(self) -> str:
        return self._detail or (f"beside {', '.join(self._beside)}" if self._beside else "")

    def _running(self) -> Text:
        """The line of the stage that runs, cut at the width of the terminal."""
        self._report()
        left = self._end_expected - time.monotonic()
        line = f"{self._line()}, {self._at_least}{stage_line.duration(left)} left" if left > 0.0 else self._line()
        return Text(line if self._name else "", no_wrap=True, overflow="ellipsis")

    def _report(self) -> None:
        """Tell the process that draws in place of this one that there is no need yet."""
        if self._drawer is not None and self._drawer.stdin is not None:
            line = printable(self._name), self._began, printable(self._shown()), self._console.width
            with suppress(OSError, ValueError):  # it has ended: the clock stands now and then
                stage_line.report(self._drawer.stdin.fileno(), *line)

    def _write(self, stage: tuple[str, float, str] | None = None, *, seconds: float | None = None) -> None:
        """Write the line of ``stage``, else of the one that runs; on a terminal cut at its width, elsewhere in full."""
        self._written = time.monotonic()
        if stage is None:
            stage = self._name, self._written - self._began if seconds is None else seconds, self._detail
        if stage[0] and not self._quiet:
            cut: dict[str, Any] = {"no_wrap": True, "overflow": "ellipsis"} if self.live else {"soft_wrap": True}
            self._console.print(_worded(*stage), markup=False, **cut)

    def _write_until_ended(self) -> None:
        while not self._ended.wait(max(0.01, self._written + self._silent_seconds - time.monotonic())):
            if time.monotonic() >= self._written + self._silent_seconds:
                self._write()


def _worded(name: str, seconds: float, detail: str) -> str:
    return stage_line.stage_line(printable(name), seconds, printable(detail))


def _drawer() -> "subprocess.Popen[bytes] | None":
    """The process that draws where this one cannot; None where stderr is no terminal."""
    if sys.platform == "win32" or not sys.stderr.isatty():
        return None
    try:
        command = [sys.executable, "-I", "-S", stage_line.__file__]
        drawer = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    except OSError:  # too many processes: a clock is not worth an error
        return None
    if drawer.stdin is not None:
        os.set_blocking(drawer.stdin.fileno(), False)
    return drawer
