"""The one way to start a child process: a fresh Python on one thread, which ends when its parent is done or dies.

It imports nothing of the script that called the library, so no script needs a guard around its main code, and nothing
from the current folder (``-P``). ``results.sandbox`` has it work on files under limits, ``results.child_pool`` has it
call functions. loky 3.7 does not take its place: its first answer takes 0.30 s for 0.08 s here, it starts two further
processes, its workers outlive a parent that is killed, and they answer by pickles, which readers of foreign files must
not do.
"""

import os
import pickle
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

TEMPORARY = ("TMPDIR", "TEMP", "TMP")  # of the environment: the folder of temporary files
_WORKER = Path(__file__).with_name("worker.py").resolve()
_PACKAGES = Path(__file__).resolve().parents[2]
# Threads are what the parent shares out. For every core of a large machine these libraries would also reserve memory
# before there is any work.
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def _threads_for_calls() -> dict[str, str]:
    """Thread limits of a child for calls: the parent's for linear algebra, whose rounding depends on the number."""
    names = ("OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS")  # the first that is set counts
    stated = (os.environ[name] for name in names if os.environ.get(name))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return {**_ONE_THREAD, "OPENBLAS_NUM_THREADS": next(stated, str(cores))}


class ChildProcess:
    """A child process that does ``work``, a script with its arguments, in ``folder``; without any it answers calls.

    Its temporary files lie in ``folder``, and are deleted with it. Raises :class:`OSError` if the system has no room.
    """

    def __init__(self, folder: Path, *work: object) -> None:
        pipe, threads = (subprocess.DEVNULL, _ONE_THREAD) if work else (subprocess.PIPE, _threads_for_calls())
        self._closed = False
        self._process = subprocess.Popen(
            # -P: neither the folder of the script nor the current one is searched for modules
            [sys.executable, "-P", *map(str, (_WORKER, _PACKAGES, *work, os.getpid()))],
            cwd=folder if work else None,
            env={**os.environ, **threads, **dict.fromkeys(TEMPORARY, str(folder))},
            stdin=pipe,
            stdout=pipe,
            stderr=subprocess.DEVNULL,
            # A group of its own, to be ended with all that it starts; an interrupt at the terminal is for the parent.
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def ask(self, call: bytes) -> tuple[bool, Any]:
        """Send a pickled call: True and its result, or False and its error. Raises errors of pipes if it has ended."""
        calls = self._process.stdin
        answers = self._process.stdout
        if calls is None or answers is None:
            raise ValueError("a child process that has work answers no calls")
        calls.write(call)
        calls.flush()
        returned, result = pickle.load(answers)
        return bool(returned), result

    def code(self, seconds: float) -> int:
        """Wait for its exit code. Raises :class:`subprocess.TimeoutExpired` after ``seconds``."""
        return self._process.wait(seconds)

    def close(self) -> None:
        """End the process and all that it started; only once, since its number may be reused later."""
        if self._closed:
            return
        self._closed = True
        if sys.platform != "win32":
            with suppress(ProcessLookupError, PermissionError):  # all of the group have ended
                os.killpg(self._process.pid, signal.SIGKILL)
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            with suppress(OSError):  # of what the process has not read
                if pipe is not None:
                    pipe.close()
