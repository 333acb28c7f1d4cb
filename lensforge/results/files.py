"""Files: read with bounds, written to a temporary name and then renamed.

The names of temporary files state their process, so that the next one can delete what a killed one left.
"""

import hashlib
import json
import os
import platform
import re
import secrets
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from lensforge.errors import InputError
from lensforge.results.json_npz import parse_json

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


MIB = 2**20
_SHOWN = 300  # characters of a path that no file can have
_LONGEST_SHOWN = 1024  # characters of a path that one may have
_PROBE_BYTES = 2**16  # more than a file system keeps beside its own records
_MOST_JSON_BYTES = 256 * MIB  # the largest record of a reference run has 12 MiB


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path``; rename it over ``path`` when the block succeeds.

    The temporary name keeps the suffix, because CAD and mesh writers choose their format by it. On any failure the
    temporary file is deleted and the old file stays. The content is on the disk before the new name is: after a power
    cut there is the old file or the new one. Raises :class:`InputError` for a full disk or a read-only folder.
    """
    path = Path(path)
    temporary = _temporary_name(path)
    try:
        _create(path, temporary)
        try:
            yield temporary
            _flush_to_disk(temporary)
            temporary.replace(path)
            _flush_folder(path.parent)
        except OSError as error:
            kept = "the old file is kept" if path.is_file() else "make room, or give another folder"
            raise InputError(f"{path}: cannot be written ({error.strerror}); {kept}") from error
    finally:
        with suppress(OSError, ValueError):
            temporary.unlink()


def require_writable(path: Path | str) -> None:
    """Raise :class:`InputError` where :func:`replacing` would fail for ``path``: to be asked before long work.

    The folder is made, a block of data written and both removed again: permissions alone do not tell of a full disk,
    a read-only mount or a name that is too long.
    """
    path = Path(path)
    folders: list[Path] = []
    temporary = _temporary_name(path)
    try:
        if os.path.lexists(path) and path.is_dir():
            raise InputError(f"{path}: cannot be written (it is a folder); give the name of a file")
        folders = [folder for folder in path.parents if not folder.exists()]  # the deepest first
        _create(path, temporary)
        temporary.write_bytes(bytes(_PROBE_BYTES))
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise _cannot_be_written(path, error) from None
    finally:
        with suppress(OSError, ValueError):
            temporary.unlink()
        for folder in folders:
            with suppress(OSError):
                folder.rmdir()


def _create(path: Path, temporary: Path) -> None:
    """Make the folder of ``path`` and, in it, an empty file ``temporary`` with the permissions of a new file."""
    try:
        with suppress(FileNotFoundError, NotADirectoryError):
            path.lstat()  # refuses a NUL, and a name that is too long
        path.parent.mkdir(parents=True, exist_ok=True)
        _tidied(path.parent.resolve(), os.getpid())
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except (OSError, ValueError) as error:
        raise _cannot_be_written(path, error) from error


def _cannot_be_written(path: Path, error: Exception) -> InputError:
    reason = error.strerror if isinstance(error, OSError) else error
    shown = str(path) if len(str(path)) <= _LONGEST_SHOWN else f"{str(path)[:_SHOWN]}..."
    return InputError(f"{shown}: cannot be written ({reason}); give another folder or name")


def _temporary_name(path: Path) -> Path:
    """A name in the folder of ``path`` that states this process, with its suffix; no other file has it."""
    return path.parent / f"{WRITING}{own_mark()}-{secrets.token_hex(4)}{path.suffix}"


@cache
def _tidied(folder: Path, _pid: int) -> None:
    """Delete what killed processes left in ``folder``, once for each process and folder."""
    delete_left_files(folder)


def _flush_to_disk(path: Path) -> None:
    """Wait until the content is on the disk: a rename before that may leave an empty file after a power cut."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Wait until a new name is on the disk, where the system can: Windows and some network file systems cannot."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_json(path: Path, content: Any) -> None:
    """Write ``content`` as indented JSON; NaN and infinity are refused, so that any reader can parse it."""
    text = json.dumps(content, indent=2, allow_nan=False)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def read_file(path: Path | str, *, missing: str, most_bytes: int) -> bytes:
    """Content of a regular file of at most ``most_bytes``; ``missing``: the remedy where there is none.

    Raises :class:`InputError` for a folder, a device or a pipe, whose reading may never end, for a path that no file
    can have, and for a file that is too large or not readable.
    """
    require_regular_file(path, missing=missing, most_bytes=most_bytes)
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {missing}") from None


def require_regular_file(path: Path | str, *, missing: str, most_bytes: int | None = None) -> None:
    """Raise :class:`InputError` as :func:`read_file` does, for readers that need a path."""
    try:
        found = Path(path).stat()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {missing}") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{str(path)[:_SHOWN]!r}: cannot be read ({reason}); {missing}") from None
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: {_kind_of(found.st_mode)}, must be a file; {missing}")
    if most_bytes is not None and found.st_size > most_bytes:
        size, most = found.st_size / MIB, most_bytes / MIB
        raise InputError(f"{path}: {size:.0f} MiB, must be at most {most:g} MiB; is it the right file?")


def _kind_of(mode: int) -> str:
    kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"))
    return next((name for matches, name in kinds if matches(mode)), "a device")


def read_json(path: Path, missing: str = "run `lensforge design` first") -> Any:
    """Read JSON. Raises :class:`InputError` for a missing or broken file; ``missing``: the remedy for a missing one.

    It has the bounds of :func:`lensforge.results.json_npz.parse_json`.
    """
    return json_in(read_json_bytes(path, missing), path)


def read_json_bytes(path: Path, missing: str = "run `lensforge design` first") -> bytes:
    """The bytes of a JSON file. Raises :class:`InputError` where it is missing or too large, with a remedy."""
    return read_file(path, missing=missing, most_bytes=_MOST_JSON_BYTES)


def json_in(content: bytes, path: Path) -> Any:
    """Parse the ``content`` of ``path``. Raises :class:`InputError` where it is broken."""
    try:
        return parse_json(content)
    except ValueError as error:
        raise InputError(f"{path}: not readable as JSON ({error})") from None


def file_bytes(name: str, write: Callable[[Path], None]) -> bytes:
    """The bytes that ``write`` puts into a file called ``name``. Raises :class:`InputError` where the disk is full."""
    with temporary_folder(name) as folder:
        write(folder / name)
        return (folder / name).read_bytes()


@contextmanager
def temporary_file(content: bytes, name: str) -> Iterator[Path]:
    """A file called ``name`` that holds ``content``; deleted at the end of the block."""
    with temporary_folder(name) as folder:
        (folder / name).write_bytes(content)
        yield folder / name


@contextmanager
def temporary_folder(name: str) -> Iterator[Path]:
    """A folder for a file called ``name``; deleted at the end of the block, or by the next command after a kill.

    Raises :class:`InputError` where the disk is full.
    """
    delete_left_folders()
    try:
        with tempfile.TemporaryDirectory(prefix=f"{FOLDER}{own_mark()}-") as folder:
            yield Path(folder)
    except OSError as error:
        place = f"{name}: the temporary folder {tempfile.gettempdir()} cannot be used ({error.strerror})"
        raise InputError(f"{place}; make room there, or set TMPDIR to another") from error
