"""Work on a file from outside in a child process: with limits of memory and time, and free to crash.

A child imports nothing from the current folder (``-P``, a working folder of its own), reads and writes nothing but
files of that folder, hands back no pickle, and ends with its own children when its parent is done with it or dies. CAD
and mesh libraries are written in C++: a hostile file may end their process, or let it grow, where no exception says so.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import TracebackType

from lensforge.errors import InputError

_WORKER = Path(__file__).with_name("worker.py").resolve()
_PACKAGES = Path(__file__).resolve().parents[2]
_REFUSED, _MEMORY, _FAILED = 3, 4, 5  # exit codes of a script, see ``serve``
_OUT_OF_TIME = getattr(signal, "SIGXCPU", 24)  # Windows has none
_PATIENCE = 4.0  # limits of time by the clock over those of processor time: other programs run, too
_WORDS_FILE = "refused.txt"
_MOST_WORDS = 500  # characters of a message: a library may print half of the file
# One thread each: for every core of a large machine these libraries would reserve memory before there is any work.
_THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class Ending(Enum):
    """The way in which a child process ended."""

    DONE = "done"
    REFUSED = "refused"  # the file is at fault, as the script says
    FAILED = "failed"  # a library raised what it should not
    MEMORY = "memory"
    TIME = "time"
    CRASHED = "crashed"


@dataclass(frozen=True)
class ChildLimits:
    """Memory (MiB) and processor time (s) of a child process, which also ends after four times as long by the clock."""

    memory_mib: int
    seconds: float


class Child:
    """A child process that runs ``script``, a Python file that calls :func:`serve`, on the files in ``folder``."""

    def __init__(self, script: Path, folder: Path, limits: ChildLimits) -> None:
        self._folder, self._limits, self._closed = Path(folder).resolve(), limits, False
        own = {name: str(self._folder) for name in ("TMPDIR", "TEMP", "TMP")}  # goes when the folder goes
        self._process = subprocess.Popen(
            worker_command(script, self._folder, limits.memory_mib, limits.seconds),
            cwd=self._folder,
            env={**os.environ, **_THREADS, **own},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # a group of its own, to be ended with all that it starts
        )

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def wait(self) -> tuple[Ending, str]:
        """Wait for its end: the way in which it ended, and the script's words where the file is at fault."""
        try:
            code = self._process.wait(_PATIENCE * self._limits.seconds)
        except subprocess.TimeoutExpired:
            return Ending.TIME, f"took more than {_PATIENCE * self._limits.seconds:.0f} s"
        finally:
            self.close()
        if code == 0:
            return Ending.DONE, ""
        if code == -_OUT_OF_TIME:
            return Ending.TIME, f"took more than {self._limits.seconds:.0f} s of processor time"
        if code == _MEMORY:
            return Ending.MEMORY, f"needs more than {self._limits.memory_mib} MiB of memory"
        if code in (_REFUSED, _FAILED):
            return (Ending.REFUSED if code == _REFUSED else Ending.FAILED), self._words()
        return Ending.CRASHED, f"stopped its reader ({_name_of(code)})"

    def close(self) -> None:
        """End the process and all that it has started; once, since its number may be given to another one later."""
        if not self._closed:
            self._closed = True
            kill_group(self._process)

    def _words(self) -> str:
        try:
            words = (self._folder / _WORDS_FILE).read_text(encoding="utf-8", errors="replace")
        except OSError:
            return "stopped its reader"
        return " ".join(words.split())[:_MOST_WORDS]


def worker_command(*work: object) -> list[str]:
    """The command of a child process that does ``work``, the arguments of a script, or answers calls."""
    # -P: neither the folder of the script nor the current one is searched for modules.
    return [sys.executable, "-P", *map(str, (_WORKER, _PACKAGES, *work, os.getpid()))]


def work_in_child(script: Path, folder: Path, limits: ChildLimits, *, origin: str, remedy: str) -> None:
    """Run ``script`` on the files in ``folder``, to which it adds its results.

    Raises :class:`InputError` with the script's own words where it refuses the file, and otherwise says how the child
    ended; ``origin`` names the file, ``remedy`` what to try.
    """
    with Child(script, folder, limits) as child:
        ending, words = child.wait()
    if ending is Ending.REFUSED:
        raise InputError(words)
    if ending is not Ending.DONE:
        raise InputError(f"{origin}: {words}; {remedy}")


def serve(work: Callable[[Path], None]) -> None:
    """Do ``work`` on the files in the folder that the parent names, and end this process with a code that says how.

    The interpreter does not tear down: destructors of a hostile shape may crash after the work is done.
    """
    folder = Path(sys.argv[1])
    try:
        work(folder)
        code, words = 0, ""
    except MemoryError:
        code, words = _MEMORY, ""
    except InputError as error:
        code, words = _REFUSED, str(error)
    except Exception as error:  # C++ libraries raise many kinds; the cause is always the file
        code, words = _FAILED, f"stopped its reader ({type(error).__name__}: {error})"
    (folder / _WORDS_FILE).write_text(words, encoding="utf-8", errors="replace")
    os._exit(code)


def kill_group(process: "subprocess.Popen[bytes]") -> None:
    """End ``process``, which leads a session of its own, with all processes that it has started, and collect it."""
    if sys.platform != "win32":
        with suppress(ProcessLookupError, PermissionError):  # all of the group have ended
            os.killpg(process.pid, signal.SIGKILL)
    if process.poll() is None:
        process.kill()
    process.wait()


def _name_of(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code}"
