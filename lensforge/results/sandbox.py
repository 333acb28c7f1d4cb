"""Work on a file from outside in a child process: with limits of memory and time, and free to crash.

A child has a working folder of its own, reads and writes nothing but files of that folder, and hands back no pickle.
CAD and mesh libraries are written in C++: a hostile file may end their process, or let it grow, where no exception says
so.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from lensforge.errors import InputError
from lensforge.results.child_process import ChildProcess

# Exit codes of a script, see ``serve``.
_REFUSED = 3
_MEMORY = 4
_FAILED = 5
_OUT_OF_TIME = getattr(signal, "SIGXCPU", 24)  # Windows has none
_PATIENCE = 4.0  # limits of time by the clock over those of processor time: other programs run, too
_MESSAGE_FILE = "refused.txt"
_MOST_CHARACTERS = 500  # characters of a message: a library may print half of the file


class Ending(Enum):
    """Outcome of a child process."""

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


class Child(ChildProcess):
    """A child process that runs ``script``, a Python file that calls :func:`serve`, on the files in ``folder``."""

    def __init__(self, script: Path, folder: Path, limits: ChildLimits) -> None:
        self._folder = Path(folder).resolve()
        self._limits = limits
        super().__init__(self._folder, script, self._folder, limits.memory_mib, limits.seconds)

    def wait(self) -> tuple[Ending, str]:
        """Wait for its end: how it ended, and the script's message if the file is at fault."""
        try:
            code = self.code(_PATIENCE * self._limits.seconds)
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
            return (Ending.REFUSED if code == _REFUSED else Ending.FAILED), self._refusal()
        return Ending.CRASHED, f"stopped its reader ({_name_of(code)})"

    def _refusal(self) -> str:
        try:
            message = (self._folder / _MESSAGE_FILE).read_text(encoding="utf-8", errors="replace")
        except OSError:
            return "stopped its reader"
        return " ".join(message.split())[:_MOST_CHARACTERS]


def work_in_child(script: Path, folder: Path, limits: ChildLimits, *, origin: str, remedy: str) -> None:
    """Run ``script`` on the files in ``folder``, to which it adds its results.

    Raises :class:`InputError` with the script's own message if it refuses the file, else with how the child ended;
    ``origin`` names the file, ``remedy`` what to try.
    """
    with Child(script, folder, limits) as child:
        ending, message = child.wait()
    if ending is Ending.REFUSED:
        raise InputError(message)
    if ending is not Ending.DONE:
        raise InputError(f"{origin}: {message}; {remedy}")


def serve(work: Callable[[Path], None]) -> None:
    """Do ``work`` on the files in the folder given by the parent, and end this process with a code for the outcome.

    The interpreter does not tear down: destructors of a hostile shape may crash after the work is done.
    """
    folder = Path(sys.argv[1])
    try:
        work(folder)
        code = 0
        message = ""
    except MemoryError:
        code = _MEMORY
        message = ""
    except InputError as error:
        code = _REFUSED
        message = str(error)
    except Exception as error:  # C++ libraries raise many kinds; the cause is always the file
        code = _FAILED
        message = f"stopped its reader ({type(error).__name__}: {error})"
    (folder / _MESSAGE_FILE).write_text(message, encoding="utf-8", errors="replace")
    os._exit(code)


def _name_of(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code}"
