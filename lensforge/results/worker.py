"""First code of a child process: it limits itself, then runs a script with a folder as its argument.

Arguments: folder that holds the package, script, folder, MiB of memory, seconds, number of the parent process. It
imports from the standard library alone, since nothing else may be loaded before the limits hold.
"""

import ctypes
import gc
import os
import runpy
import signal
import sys

_MIB = 2**20
# Libraries that are mapped, not allocated, count for the address space only: the CAD kernel and VTK have 1 GiB.
_MAPPED_MIB = 4096
# Nearly all new objects are those of libraries, which stay: with Python's own 700 a search among them takes a fifth of
# the seconds in which torch and the CAD kernel are loaded.
_NEW_OBJECTS = 20_000
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)


def limit_itself(memory_mib: int, seconds: float, parent: int) -> None:
    """Limit memory, computing time, files and core dumps where the system can, and end with the parent on Linux.

    Where the system cannot (Windows; macOS for memory) the parent's limit of time is left, and the bounds of readers.
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
        kept = hard if kind == resource.RLIMIT_CPU else allowed  # at the hard limit it would be killed without a reason
        try:
            resource.setrlimit(kind, (allowed, kept))
        except (OSError, ValueError):  # a limit that this system does not have
            continue
    end_with_parent(parent)


def collect_garbage_seldom() -> None:
    """Have Python search for garbage after so many new objects that loading libraries hardly waits for it."""
    gc.set_threshold(_NEW_OBJECTS, 20, 20)


def end_with_parent(parent: int) -> None:
    """Have this process end with its parent, whose number is given, on Linux."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        if os.getppid() != parent:  # it ended before this line
            os._exit(1)


if __name__ == "__main__":
    package, script, folder, memory_mib, seconds, parent = sys.argv[1:]
    limit_itself(int(memory_mib), float(seconds), int(parent))
    collect_garbage_seldom()
    sys.path.append(package)  # last: where the package is installed, this folder is in the path already
    sys.argv = [script, folder]
    runpy.run_path(script, run_name="__main__")
