"""A lock on a result folder: one command at a time writes there, and another one says at once which process does.

The lock is a hidden file, locked by the system (flock, by way of filelock): it is free when its process ends, killed
or not. Where a file system knows no such locks, as some of clusters, the file's existence counts instead: filelock
then compares the process that it names with those that run.
"""

import errno
import os
import shlex
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from platform import node

from lensforge.errors import InputError, refused
from lensforge.results.files import delete_half_written

LOCK_FILE = ".lensforge-lock"
_MARKER_FILE = f"{LOCK_FILE}-held"  # the lock of file systems without locks
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)  # of such file systems
_TRIES_SECONDS = 0.2  # without locks: one try finds that the holder has ended, the next takes its place
_OTHERS = "wait until it has ended, or give another folder"
_NOT_WRITTEN = "cannot be written (…); give another folder"
_MOST_BYTES = 4096  # of a holder's text
_SHOWN = 160  # characters of each of its lines


@contextmanager
def locked(folder: Path, *, create: bool = False) -> Iterator[None]:
    """Hold the lock on ``folder`` inside the block; free inside a block of the same thread, which holds it already.

    ``create``: make a missing folder, and remove it again if nothing was written into it; otherwise a missing folder
    needs no lock. Files that killed processes left half written are deleted. Raises :class:`InputError` at once if
    another process, or another thread of this one, holds the lock, and if the folder cannot be written.
    """
    missing = _make(folder) if create else []
    try:
        if folder.is_dir():
            with _held(folder):
                yield
        else:
            yield
    finally:
        for made in missing:
            with suppress(OSError):  # not empty: it is used now
                made.rmdir()


def _make(folder: Path) -> list[Path]:
    """Make ``folder``; return the folders that were missing on its path, the deepest first."""
    with refused(str(folder)[:_SHOWN], _NOT_WRITTEN, OSError, ValueError):  # ValueError: a NUL in the path
        missing = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
    return missing


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    from filelock import FileLock, SoftFileLock, Timeout

    path, marker = (folder.resolve() / name for name in (LOCK_FILE, _MARKER_FILE))
    _require_own_file(path)
    lock = FileLock(path, timeout=0, is_singleton=True, fallback_to_soft=False)
    already = lock.is_locked
    try:
        try:
            lock.acquire()
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            path.unlink(missing_ok=True)
            lock = SoftFileLock(marker, timeout=_TRIES_SECONDS, is_singleton=True)
            path = marker
            already = lock.is_locked
            lock.acquire()
    except Timeout:
        raise InputError(f"{folder}: in use by {_holder(path)}; {_OTHERS}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); give another folder") from None
    try:
        if not already:
            if path != marker:
                _write_holder(path)
            delete_half_written(folder)
        yield
    finally:
        if not already and path != marker:
            with suppress(OSError):
                path.unlink()  # before the lock is free: after that it may be another's
        lock.release()


def _require_own_file(path: Path) -> None:
    """Raise :class:`InputError` for a link, a pipe or a folder in place of the lock: text is written into it."""
    with suppress(OSError):
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
            raise InputError(f"{path}: no file of its own, so it cannot be a lock; delete it")


def _write_holder(path: Path) -> None:
    """Write the holder into the lock: process, machine, command and time, a line each."""
    program, *arguments = sys.argv or [""]
    name = "lensforge" if Path(program).name in ("lensforge", "__main__.py") else Path(program).name or "python"
    since = datetime.now().astimezone().isoformat(" ", "seconds")
    lines = str(os.getpid()), node(), shlex.join([name, *arguments])[:_SHOWN], since
    text = "\n".join("".join(character if character.isprintable() else "?" for character in line) for line in lines)
    with refused(path, _NOT_WRITTEN, OSError):
        path.write_text(text, encoding="utf-8", errors="replace")


def _holder(path: Path) -> str:
    """Phrase for the process that holds the lock at ``path``; filelock's own marker names process and machine only."""
    try:
        with path.open("rb") as file:
            text = file.read(_MOST_BYTES).decode(errors="replace")
    except OSError:
        return "another process"  # it has ended meanwhile
    lines = [
        "".join(character if character.isprintable() else "?" for character in line)[:_SHOWN]
        for line in text.splitlines()
    ]
    if len(lines) < 2:
        return "another process"
    process, machine, *details = lines
    if (process, machine) == (str(os.getpid()), node()):
        return "another thread of this process"
    holder = f"process {process} on {machine}"
    if len(details) == 2:
        holder += f" (`{details[0]}`, since {details[1]})"
    return holder if machine == node() else f"{holder}; if it is gone, delete {path.name} there"
