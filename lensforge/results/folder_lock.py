"""A lock on a result folder: one command at a time writes there, and another one says at once which process does.

The system's own lock (flock) on a hidden file: it is freed when its process ends, killed or not, and holds on network
file systems that pass locks on. Where a file system knows no locks (some of clusters; Windows), the text in the file
counts instead: a process of this machine that has ended holds nothing; one of another machine is believed, and the
message says which file to delete if it is gone.
"""

import errno
import json
import os
import shlex
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from functools import wraps
from pathlib import Path
from platform import node
from typing import Concatenate, ParamSpec, TypeVar

from lensforge.errors import InputError
from lensforge.results.files import delete_left_files, delete_left_folders, is_dead, own_mark

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]

LOCK_FILE = ".lensforge-lock"
_OTHERS = "wait until it has ended, or give another folder"
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)  # of file systems without locks
_MOST_BYTES, _SHOWN = 4096, 160  # of a holder's text; of each of its entries, in characters
_TRIES = 100  # a holder that ends meanwhile deletes the file that was opened: once in practice
_SETTLE_SECONDS = 0.05  # without locks: whoever wrote last within this time has the folder

_Folder = TypeVar("_Folder", bound=Path)
_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")

_holders: dict[tuple[int, int], tuple[int, int]] = {}  # process and thread, by device and inode of the folder
_guard = threading.Lock()


def in_locked_folder(
    stage: Callable[Concatenate[_Folder, _Arguments], _Result],
) -> Callable[Concatenate[_Folder, _Arguments], _Result]:
    """Decorator of a function whose first argument is the folder in which it writes."""

    @wraps(stage)
    def inside(folder: _Folder, /, *args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        with locked(folder):
            return stage(folder, *args, **kwargs)

    return inside


@contextmanager
def locked(folder: Path, *, create: bool = False) -> Iterator[None]:
    """Hold the lock on ``folder`` inside the block; free inside a block of the same thread, which holds it already.

    ``create``: make a folder that is not there, and remove it again where nothing was written into it; otherwise such
    a folder needs no lock. What killed processes left in the folder is deleted. Raises :class:`InputError` at once
    where another process, or another thread of this one, holds the lock, and where the folder cannot be written.
    """
    missing = _make(folder) if create else []
    try:
        if not folder.is_dir():
            yield
            return
        with _held_by_this_thread(folder) as already:
            if already:
                yield
            else:
                with _locked_file(folder):
                    delete_left_files(folder)
                    delete_left_folders()
                    yield
    finally:
        for made in missing:
            with suppress(OSError):  # not empty: it is used now
                made.rmdir()


def _make(folder: Path) -> list[Path]:
    """Make ``folder``; return what was missing of its path, the deepest first."""
    try:
        missing = [path for path in (folder, *folder.parents) if not path.exists()]
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{str(folder)[:_SHOWN]}: cannot be written ({reason}); give another folder") from None
    return missing


@contextmanager
def _held_by_this_thread(folder: Path) -> Iterator[bool]:
    """Reserve ``folder`` for this thread; yield True where it is reserved for it already."""
    found, owner = folder.stat(), (os.getpid(), threading.get_ident())
    key = (found.st_dev, found.st_ino)
    with _guard:
        holder = _holders.get(key)
        if holder is not None and holder[0] == owner[0] and holder != owner:
            raise InputError(f"{folder}: in use by another thread of this process; {_OTHERS}")
        already = holder == owner
        _holders[key] = owner  # a holder before a fork was the parent: the lock itself decides
    try:
        yield already
    finally:
        if not already:
            with _guard:
                del _holders[key]


@contextmanager
def _locked_file(folder: Path) -> Iterator[None]:
    path = folder / LOCK_FILE
    handle = _acquire(folder, path)
    try:
        yield
    finally:
        with suppress(OSError):
            if os.path.samestat(os.fstat(handle), path.lstat()):
                path.unlink()  # before the lock is free: after that it may be another's
        os.close(handle)


def _acquire(folder: Path, path: Path) -> int:
    """Open and lock the file at ``path``, and write into it who holds it; return its handle."""
    for _ in range(_TRIES):
        handle = _open(path)
        try:
            if not _try_lock(handle):
                raise InputError(f"{folder}: in use by {_holder(handle)}; {_OTHERS}")
            if _is_at(handle, path):
                return handle
        except OSError as error:
            _give_up(handle, path)
            raise InputError(f"{path}: cannot be written ({error.strerror}); give another folder") from None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
    raise InputError(f"{folder}: in use by other processes, each for a moment; try again")


def _give_up(handle: int, path: Path) -> None:
    """Close a file into which nothing could be written, and delete it where it is empty: on a full disk it stays so."""
    with suppress(OSError):
        if os.fstat(handle).st_size == 0 and _is_at(handle, path):
            path.unlink()
    os.close(handle)


def _open(path: Path) -> int:
    flags = os.O_RDWR | os.O_CREAT
    for name in ("O_CLOEXEC", "O_NOFOLLOW", "O_NONBLOCK"):  # no links; no waiting for the other end of a pipe
        flags |= getattr(os, name, 0)
    try:
        handle = os.open(path, flags, 0o666)
    except OSError as error:
        if not os.path.lexists(path):
            raise InputError(f"{path.parent}: cannot be written ({error.strerror}); give another folder") from None
        raise InputError(f"{path}: cannot be opened ({error.strerror}); delete it if no other run uses it") from None
    found = os.fstat(handle)
    if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
        os.close(handle)
        raise InputError(f"{path}: no file of its own, so it cannot be a lock; delete it")
    return handle


def _try_lock(handle: int) -> bool:
    """Lock the open file and write this process into it; False where another one holds it."""
    try:
        if fcntl is None:
            raise OSError(errno.ENOSYS, "no flock")
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            return _refused(error)
        return _try_without_locks(handle)
    _write(handle, _own_text())
    return True


def _refused(error: OSError) -> bool:
    if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
        return False
    raise error


def _try_without_locks(handle: int) -> bool:
    text = _own_text()
    mark = _entries(_read(handle)).get("mark", "")
    if mark and not is_dead(mark):
        return False
    _write(handle, text)
    time.sleep(_SETTLE_SECONDS)
    return _read(handle) == text


def _is_at(handle: int, path: Path) -> bool:
    """True where the open file is still the one at ``path``: its last holder may have deleted it."""
    try:
        return os.path.samestat(os.fstat(handle), path.lstat())
    except FileNotFoundError:
        return False


def _own_text() -> bytes:
    program, *arguments = sys.argv or [""]
    name = "lensforge" if Path(program).name in ("lensforge", "__main__.py") else Path(program).name or "python"
    since = datetime.now().astimezone().isoformat(" ", "seconds")
    command = "".join(each if each.isprintable() else "?" for each in shlex.join([name, *arguments])[:_SHOWN])
    content = {"process": str(os.getpid()), "machine": node(), "command": command, "since": since, "mark": own_mark()}
    return json.dumps(content).encode()


def _write(handle: int, text: bytes) -> None:
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    os.write(handle, text)


def _read(handle: int) -> bytes:
    os.lseek(handle, 0, os.SEEK_SET)
    return os.read(handle, _MOST_BYTES)


def _entries(text: bytes) -> dict[str, str]:
    """The entries of a holder's text; none where it is no such text, as in the moment before it is written."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(content, dict):
        return {}
    return {key: value[:_SHOWN] for key, value in content.items() if isinstance(value, str) and value.isprintable()}


def _holder(handle: int) -> str:
    found = _entries(_read(handle))
    if not {"process", "machine", "command", "since", "mark"} <= set(found):
        return "another process"
    words = f"process {found['process']} on {found['machine']} (`{found['command']}`, since {found['since']})"
    gone = "" if found["mark"][:8] == own_mark()[:8] else f"; if it is gone, delete {LOCK_FILE} there"
    return words + gone
