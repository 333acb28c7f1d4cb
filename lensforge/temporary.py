"""Names of temporary files that state their process, so that the next one can delete what a killed one left.

A mark is ``MACHINE-PID-START``: hashes of the machine (with its process namespace) and of the process's start around
the process's number. A file is deleted only where its mark is of this machine and no such process runs any more.
"""

import hashlib
import os
import platform
import re
import shutil
import stat
import tempfile
from functools import lru_cache
from pathlib import Path

WRITING, FOLDER = ".writing-", "lensforge-"
_MARK = r"([0-9a-f]{8})-([1-9][0-9]{0,9})-([0-9a-f]{8})"
_UNKNOWN = "0" * 8  # the start of a process, on systems that do not tell it
_DEAD_STATES = ("Z", "X")  # of Linux: killed, and not yet collected by its parent


def own_mark() -> str:
    """Mark of this process, as part of the name of a temporary file or folder."""
    return _mark(os.getpid())


def is_dead(mark: str) -> bool:
    """True where the process of ``mark`` ran on this machine and has ended; False where that is not known."""
    found = re.fullmatch(_MARK, mark)
    if found is None or found[1] != _machine() or os.name != "posix":  # elsewhere a signal 0 is not harmless
        return False
    pid, started = int(found[2]), _start_of(int(found[2]))
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):
        return False  # there is one, of another user
    return started is None or (_UNKNOWN not in (started, found[3]) and started != found[3])


def delete_left_files(folder: Path) -> None:
    """Delete the half-written files of dead processes in ``folder``; a file that cannot be deleted stays."""
    for path in _of_dead_processes(folder, WRITING):
        try:
            path.unlink()
        except OSError:
            continue


def delete_left_folders() -> None:
    """Delete the temporary folders of this user's dead processes; what cannot be deleted stays."""
    try:
        place = Path(tempfile.gettempdir())
    except OSError:
        return  # no temporary folder at all: whoever needs one says so
    for path in _of_dead_processes(place, FOLDER):
        try:
            found = path.lstat()
        except OSError:
            continue  # another process was faster
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid():
            shutil.rmtree(path, ignore_errors=True)  # it follows no links


def _of_dead_processes(folder: Path, prefix: str) -> list[Path]:
    named = re.compile(rf"{re.escape(prefix)}({_MARK})-[^/]*")
    try:
        with os.scandir(folder) as entries:
            marked = [(match[1], Path(entry.path)) for entry in entries if (match := named.fullmatch(entry.name))]
    except OSError:
        return []
    return [path for mark, path in marked if is_dead(mark)]


@lru_cache(maxsize=2)  # the process itself, and after a fork its child
def _mark(pid: int) -> str:
    return f"{_machine()}-{pid}-{_start_of(pid) or _UNKNOWN}"


@lru_cache(maxsize=1)
def _machine() -> str:
    """Hash of the machine's name and, on Linux, of the namespace of its process numbers, as containers have them."""
    try:
        namespace = str(Path("/proc/self/ns/pid").readlink())
    except OSError:
        namespace = ""
    return hashlib.sha256(f"{platform.node()}|{namespace}".encode()).hexdigest()[:8]


def _start_of(pid: int) -> str | None:
    """Hash of the start of process ``pid`` and of the system; None where it has ended, zeros where it is not told."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_bytes()
    except OSError:
        return _UNKNOWN
    try:
        content = Path(f"/proc/{pid}/stat").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return None
    except OSError:
        return _UNKNOWN
    fields = content.rpartition(b")")[2].split()  # the name before it may hold anything
    if fields[0].decode() in _DEAD_STATES:
        return None
    return hashlib.sha256(boot + fields[19]).hexdigest()[:8]
