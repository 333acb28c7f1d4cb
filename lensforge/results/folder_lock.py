"""A lock on a result folder: one command at a time writes there, and another one says at once which process does.

The lock is a hidden file, locked by the system where its file system can (flock, by way of filelock): it is free when
its process ends, killed or not.
"""

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from platform import node

from lensforge.errors import InputError
from lensforge.results.files import delete_half_written

LOCK_FILE = ".lensforge-lock"
_SHOWN = 300  # characters of a holder's text, of a path that no file can have


@contextmanager
def locked(folder: Path, *, create: bool = False) -> Iterator[None]:
    """Hold the lock on ``folder`` inside the block; free inside a block of the same thread, which holds it already.

    ``create``: make a folder that is not there, and remove it again where nothing was written into it; otherwise such
    a folder needs no lock. Files that killed processes left half written are deleted. Raises :class:`InputError` at
    once where another process, or another thread of this one, holds the lock, and where the folder cannot be written.
    """
    missing: list[Path] = []
    try:
        if create:
            missing = [path for path in (folder, *folder.parents) if not path.exists()]  # the deepest first
            folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{str(folder)[:_SHOWN]}: cannot be written ({reason}); give another folder") from None
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


@contextmanager
def _held(folder: Path) -> Iterator[None]:
    from filelock import FileLock, Timeout

    path = folder.resolve() / LOCK_FILE
    lock = FileLock(path, timeout=0, is_singleton=True)
    already = lock.is_locked
    try:
        lock.acquire()
        if not already:
            path.write_text(_holder(), encoding="utf-8", errors="replace")
            delete_half_written(folder)
    except Timeout:
        raise InputError(
            f"{folder}: in use by {_words_of(path)}; wait until it has ended, or give another folder"
        ) from None
    except OSError as error:
        lock.release()
        raise InputError(f"{path}: cannot be written ({error.strerror}); give another folder") from None
    try:
        yield
    finally:
        if not already:
            with suppress(OSError):
                path.unlink()  # before the lock is free: after that it may be another's
        lock.release()


def _holder() -> str:
    """Words for this process: its number, machine, command and time."""
    program, *arguments = sys.argv or [""]
    name = "lensforge" if Path(program).name in ("lensforge", "__main__.py") else Path(program).name or "python"
    since = datetime.now().astimezone().isoformat(" ", "seconds")
    return f"{_this_process()} (`{shlex.join([name, *arguments])[:_SHOWN]}`, since {since})"


def _this_process() -> str:
    return f"process {os.getpid()} on {node()}"


def _words_of(path: Path) -> str:
    """The words of the process that holds the lock at ``path``."""
    try:
        text = path.read_bytes()[: 2 * _SHOWN].decode(errors="replace")
    except OSError:  # it has ended meanwhile
        return "another process"
    if text.startswith(f"{_this_process()} "):
        return "another thread of this process"
    return "".join(each if each.isprintable() else "?" for each in text) or "another process"
