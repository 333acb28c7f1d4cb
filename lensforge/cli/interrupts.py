"""Ctrl-C, SIGTERM and SIGHUP as one exception in the main thread, which ends a command and saves what it can.

Python's own handler raises wherever the program is: in the import of a library, which may leave half a module, in a
destructor, which prints it, or in the clean-up after the first one. Here a signal is noted at once, and raised as
:class:`KeyboardInterrupt` where that is safe; until then, or where it was swallowed, a timer asks again. A signal that
is ignored when the program starts, as under nohup, stays ignored. The library leaves signals to the script.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "terminated (the terminal was closed)"}
_IMPORTING = "<frozen importlib._bootstrap>"
_AGAIN_SECONDS = 0.1
_LONGEST_IMPORT_SECONDS = 20.0  # the CAD kernel takes 2 s, and 10 s from a cold network disk
# Terminals and wrappers such as `timeout` often send a signal twice at once; a later one is a user who does not wait.
_PATIENCE_SECONDS = 1.0


class Interrupts:
    """The signals that end a command: noted from :meth:`install` on, raised inside :meth:`raised` only.

    ``resumable``: set by a command that continues from what it leaves; None in all others. ``how``: words behind "the
    same command".
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self.resumable: Callable[[], bool] | None = None
        self.how = "with --resume continues from the last checkpoint"
        self._at = 0.0
        self._raising = False
        self._before: dict[int, Any] = {}

    @property
    def line(self) -> str:
        """Line for the user: the end, and how to continue, only where there is something to continue from."""
        cause = "interrupted" if self.received is None else _WORDS[self.received.name]
        if self.resumable is None:
            return cause
        if not self.resumable():
            return f"{cause}; there is nothing to resume yet: run the same command again"
        return f"{cause}; the same command {self.how}"

    @property
    def exit_code(self) -> int:
        """128 and the number of the signal, as shells have it: 130 for Ctrl-C, 143 for SIGTERM."""
        return 128 + (self.received or signal.SIGINT)

    def install(self) -> "Interrupts":
        """Note signals from now on, in place of Python's own handlers. Outside the main thread nothing is done."""
        if threading.current_thread() is threading.main_thread():
            for name in _WORDS:
                number = getattr(signal, name, None)  # Windows has no SIGHUP
                if number is not None and signal.getsignal(number) not in (signal.SIG_IGN, None):
                    self._before[number] = signal.signal(number, self._on_signal)
            if hasattr(signal, "SIGALRM"):
                self._before[signal.SIGALRM] = signal.signal(signal.SIGALRM, self._on_timer)
        return self

    def uninstall(self, *, at_exit: bool = False) -> None:
        """Put the earlier handlers back; ``at_exit``: the system's own, which end the process without words."""
        self._stop_timer()
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_DFL if at_exit else handler)
        self._before = {}

    @contextmanager
    def raised(self) -> Iterator[None]:
        """Raise a signal, also one that came earlier, as :class:`KeyboardInterrupt` in the main thread."""
        hooks = sys.unraisablehook, sys.excepthook
        sys.unraisablehook, sys.excepthook = (self._without_interrupts(hook) for hook in hooks)
        try:
            self._raising = True
            if self.received is not None:
                raise KeyboardInterrupt
            yield
        finally:
            self._raising = False
            self._stop_timer()
            sys.excepthook = hooks[1]
            if self.received is None:  # else what it has left half made in a library would say so at the end
                sys.unraisablehook = hooks[0]

    def _without_interrupts(self, hook: Callable[..., Any]) -> Callable[..., Any]:
        """``hook``, but silent on an interrupt that a destructor or compiled code swallowed: the timer raises it again.

        Cython prints the exception of a function that cannot raise by both hooks.
        """

        def report(*error: Any) -> None:
            if self.received is None:
                hook(*error)

        return report

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self.received is None:
            self.received = signal.Signals(number)
            self._at = now
            self._raise_or_wait(frame)
        elif now - self._at > _PATIENCE_SECONDS:
            os._exit(self.exit_code)

    def _on_timer(self, _number: int, frame: FrameType | None) -> None:
        if self.received is not None:
            self._raise_or_wait(frame)

    def _raise_or_wait(self, frame: FrameType | None) -> None:
        if not self._raising:
            return
        if hasattr(signal, "setitimer"):  # not on Windows: there it is raised at once, and once
            signal.setitimer(signal.ITIMER_REAL, _AGAIN_SECONDS)
            waited = time.monotonic() - self._at
            if _is_cleaning_up() or (_is_importing(frame) and waited < _LONGEST_IMPORT_SECONDS):
                return
        raise KeyboardInterrupt

    def _stop_timer(self) -> None:
        if hasattr(signal, "setitimer"):
            signal.setitimer(signal.ITIMER_REAL, 0.0)


def _is_cleaning_up() -> bool:
    """True where an interrupt is on its way already, through a ``finally``, a ``with`` or the end of a generator."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt | GeneratorExit):
        error = error.__context__
    return error is not None


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code.co_filename != _IMPORTING:
        frame = frame.f_back
    return frame is not None
