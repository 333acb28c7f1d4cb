"""First code of a child process: it limits itself and runs a script, or answers the calls of its parent.

Arguments: folder that holds the package, script, folder, MiB of memory, seconds, number of the parent process; or
only the folder that holds the package and the number of the parent process, for calls. It imports from the standard
library alone, since nothing else may be loaded before the limits hold.
"""

import ctypes
import gc
import os
import pickle
import re
import runpy
import signal
import sys
from collections.abc import MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import IO

_MIB = 2**20
# Libraries that are mapped, not allocated, count for the address space only: the CAD kernel and VTK have 1 GiB.
_MAPPED_MIB = 4096
# Nearly all new objects are those of libraries, which stay: with Python's own 700 a search among them takes a fifth of
# the seconds in which torch and the CAD kernel are loaded.
_NEW_OBJECTS = 20_000
# Of glibc's mallopt: the largest block that it keeps when it is freed, the most that it allows, and how much it keeps.
_MMAP_THRESHOLD = -3
_LARGEST_KEPT = 2**25
_TRIM_THRESHOLD = -1
_MOST_KEPT = 2**30
_NOT_OURS = ("NUMBA_", "TORCH_LOGS", "TORCH_COMPILE", "CSF_")  # beginnings of variables
_THREAD_NUMBERS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "GOTO_NUM_THREADS")
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)


def limit_itself(memory_mib: int, seconds: float) -> None:
    """Limit memory, computing time, files and core dumps as far as the system can.

    Where it cannot (Windows; macOS for memory) the parent's limit of time remains, and the bounds of readers.
    """
    if sys.platform == "win32":
        return
    import resource

    for kind, most in (
        (resource.RLIMIT_DATA, memory_mib * _MIB),
        (resource.RLIMIT_AS, (memory_mib + _MAPPED_MIB) * _MIB),
        (resource.RLIMIT_CPU, int(seconds) + 1),
        (resource.RLIMIT_FSIZE, memory_mib * _MIB),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
        hard_limit = (
            hard if kind == resource.RLIMIT_CPU else allowed
        )  # at the hard limit it would be killed without a reason
        with suppress(OSError, ValueError):  # a limit that this system does not have
            resource.setrlimit(kind, (allowed, hard_limit))


def ignore_settings_of_libraries(environ: MutableMapping[str, str] = os.environ) -> None:
    """Remove settings from the environment that would change or end the work of libraries yet to load.

    Compilers that are switched off or print (numba, torch), resources of another CAD program, numbers of threads that
    are no numbers, and a style or window of matplotlib: a command draws files in a style of its own. Linear algebra has
    one thread unless more are requested: its arrays are small, and threads that wait for them spin.
    """
    for name, value in list(environ.items()):
        no_number = name in _THREAD_NUMBERS and not re.fullmatch(r"[1-9]\d{0,3}(,[1-9]\d{0,3})*", value.strip())
        if no_number or name.startswith(_NOT_OURS):
            del environ[name]
    environ.update({"MPLBACKEND": "agg", "MATPLOTLIBRC": os.devnull})
    environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def collect_garbage_seldom() -> None:
    """Make Python search for garbage only after so many new objects that loading libraries hardly waits for it."""
    gc.set_threshold(_NEW_OBJECTS, 20, 20)


def keep_freed_memory() -> None:
    """Make arrays reuse freed memory: pages that come anew from the system are zeroed first.

    A step of 2^17 rays then takes 0.85 of the time. :func:`return_freed_memory` returns it between the stages.
    """
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):  # other C libraries than glibc have no such function
            ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
            ctypes.CDLL(None).mallopt(_TRIM_THRESHOLD, _MOST_KEPT)


def return_freed_memory() -> None:
    """Return memory to the system: after a search of minutes allocators keep half of the process's memory."""
    gc.collect(1)  # arrays in cycles, which wait for their turn; what is older are libraries
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):  # other C libraries than glibc have no such function
            ctypes.CDLL(None).malloc_trim(0)


def end_with_parent(parent: int) -> None:
    """End this process with its parent, of the given number, on Linux."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before this line
            os._exit(1)


def answer_calls(calls: IO[bytes], answers: IO[bytes]) -> None:
    """Answer every call until there are no more: True and what the function returns, or False where it raises."""
    while True:
        try:
            function, arguments = pickle.load(calls)
        except EOFError:
            return
        gc.freeze()  # the libraries are no garbage: a search among their 400,000 objects takes 0.25 s
        try:
            answer = True, function(*arguments)
        except Exception:  # the parent calls the function itself, and raises what it raises there
            answer = False, None
        pickle.dump(answer, answers, protocol=pickle.HIGHEST_PROTOCOL)
        answers.flush()
        del function, arguments, answer  # tens of MB
        return_freed_memory()


def _serve_calls(package: str) -> None:
    """Answer calls by pipes of its own: what libraries print goes nowhere."""
    import lensforge

    if Path(lensforge.__file__).resolve().parents[1] != Path(package):
        os._exit(1)  # another version is installed: its parent would get other bits
    pipes = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    for number in (0, 1):
        os.dup2(nothing, number)
    answer_calls(*pipes)
    os._exit(0)  # nothing to be saved; the CAD kernel would take a second to end


if __name__ == "__main__":
    package, *work, parent = sys.argv[1:]
    if work:
        limit_itself(int(work[2]), float(work[3]))
    end_with_parent(int(parent))
    collect_garbage_seldom()
    sys.path.append(package)  # last: where the package is installed, this folder is in the path already
    if work:
        sys.argv = work[:2]
        runpy.run_path(work[0], run_name="__main__")
    else:
        _serve_calls(package)
