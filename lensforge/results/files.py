"""Files: read with bounds, written to a temporary name and then renamed; pages of this program told from others.

Temporary files have names by which the next holder of a folder's lock deletes what a killed process left.
"""

import json
import os
import secrets
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from lensforge.errors import InputError, refused
from lensforge.results.json_npz import parse_json
from lensforge.version import __version__

MIB = 2**20
# Bytes, and where they stand, by which archives are known: no format that is read here begins so.
_PACKED = {
    "gzip": (0, b"\x1f\x8b\x08"), "zip": (0, b"PK\x03\x04"), "empty zip": (0, b"PK\x05\x06"),
    "zip in parts": (0, b"PK\x07\x08"), "7z": (0, b"7z\xbc\xaf\x27\x1c"), "RAR": (0, b"Rar!\x1a\x07"),
    "xz": (0, b"\xfd7zXZ\0"), "bzip2": (4, b"1AY&SY"), "zstd": (0, b"\x28\xb5\x2f\xfd"),
    "lz4": (0, b"\x04\x22\x4d\x18"), "cabinet": (0, b"MSCF\0\0\0\0"), "tar": (257, b"ustar"),
}  # fmt: skip
_HEAD_BYTES = 512  # that hold them
_READ_AS_ZIP = (".npy", "[Content_Types].xml", ".model")  # ends of the first name in NumPy's archives and in 3MF
_WRITING = ".lensforge-writing-"  # begins the names of half-written files
_SHOWN = 300  # characters of a path that no file can have
_LONGEST_SHOWN = 1024  # characters of a path that one may have
_PROBE_BYTES = 2**16  # more than a file system keeps beside its own records
_MOST_JSON_BYTES = 256 * MIB  # the largest record of a reference run has 12 MiB
# Of the environment: folders, parted as those of PATH, outside of which no file that a user names is read. For servers,
# whose clients write specs, and name files in them.
REACH = "LENSFORGE_REACH"
_PACKAGE = Path(__file__).resolve().parents[1]


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
            remedy = "the old file is kept" if path.is_file() else "make room, or give another folder"
            raise InputError(f"{path}: cannot be written ({error.strerror}); {remedy}") from error
    finally:
        with suppress(OSError, ValueError):
            temporary.unlink()


def require_writable(path: Path | str) -> None:
    """Raise :class:`InputError` if :func:`replacing` would fail for ``path``: to be checked before long work.

    The folder is made, a block of data written and both removed again: permissions alone do not tell of a full disk, a
    read-only mount or a name that is too long.
    """
    path = Path(path)
    folders: list[Path] = []
    temporary = _temporary_name(path)
    try:
        with _written(path):
            if os.path.lexists(path) and path.is_dir():
                raise InputError(f"{path}: cannot be written (it is a folder); give the name of a file")
            folders = [folder for folder in path.parents if not folder.exists()]  # the deepest first
            _create(path, temporary)
            temporary.write_bytes(bytes(_PROBE_BYTES))
    finally:
        with suppress(OSError, ValueError):
            temporary.unlink()
        for folder in folders:
            with suppress(OSError):
                folder.rmdir()


def _create(path: Path, temporary: Path) -> None:
    """Make the folder of ``path`` and, in it, an empty file ``temporary`` with the permissions of a new file."""
    with _written(path):
        with suppress(FileNotFoundError, NotADirectoryError):
            path.lstat()  # refuses a NUL, and a name that is too long
        path.parent.mkdir(parents=True, exist_ok=True)
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))


def _written(path: Path) -> AbstractContextManager[None]:
    shown = str(path) if len(str(path)) <= _LONGEST_SHOWN else f"{str(path)[:_SHOWN]}..."
    fault = "cannot be written (…); give another folder or name"
    return refused(shown, fault, OSError, ValueError)  # ValueError: a NUL in the path


def _temporary_name(path: Path) -> Path:
    return path.parent / f"{_WRITING}{secrets.token_hex(4)}{path.suffix}"


def delete_half_written(folder: Path) -> None:
    """Delete what killed processes left in ``folder``, on behalf of the holder of its lock; undeletable files stay."""
    for path in folder.glob(f"{_WRITING}*"):
        with suppress(OSError):
            path.unlink()


def _flush_to_disk(path: Path) -> None:
    """Wait until the content is on the disk: a rename before that may leave an empty file after a power cut."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Wait until a new name is on the disk, if the system can: Windows and some network file systems cannot."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_json(path: Path, content: Any) -> None:
    """Write ``content`` as indented JSON; NaN and infinity are refused, so that any reader can parse it."""
    write_file(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode())


def write_file(path: Path | str, content: bytes) -> None:
    """Write ``content`` completely or not at all, as :func:`replacing` does."""
    with replacing(Path(path)) as temporary:
        temporary.write_bytes(content)


def read_file(path: Path | str, *, missing: str, most_bytes: int) -> bytes:
    """Content of a regular file of at most ``most_bytes``; ``missing``: the remedy if there is none.

    Raises :class:`InputError` for a folder, a device or a pipe, whose reading may never end, for a path that no file
    can have, and for a file that is too large or not readable.
    """
    require_regular_file(path, missing=missing, most_bytes=most_bytes)
    with refused(path, f"cannot be read (…); {missing}", OSError), Path(path).open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        content = file.read(min(size, most_bytes) + 1)
    if len(content) > size:  # a file of the system's own, which states no size, or one that grows
        raise InputError(f"{path}: holds more than the {size} bytes that it states; is it the right file?")
    return content


def require_regular_file(path: Path | str, *, missing: str, most_bytes: int | None = None) -> None:
    """Raise :class:`InputError` as :func:`read_file` does, for readers that need a path."""
    with (
        refused(repr(str(path)[:_SHOWN]), f"cannot be read (…); {missing}", OSError, ValueError),  # a NUL in the path
        refused(path, f"no such file; {missing}", FileNotFoundError),
    ):
        status = Path(path).stat()
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: {_kind_of(status.st_mode)}, must be a file; {missing}")
    if most_bytes is not None and status.st_size > most_bytes:
        size = status.st_size / MIB
        most = most_bytes / MIB
        raise InputError(f"{path}: {size:.0f} MiB, must be at most {most:g} MiB; is it the right file?")
    _require_within_reach(Path(path))
    _require_unpacked(Path(path))


def _require_within_reach(path: Path) -> None:
    reach = os.environ.get(REACH)
    if reach is None:
        return
    folders = (_PACKAGE, *(Path(folder).resolve() for folder in reach.split(os.pathsep)))
    if not any(path.resolve().is_relative_to(folder) for folder in folders):
        raise InputError(f"{path}: outside of the folders in {REACH}; copy it into the first of them")


def _require_unpacked(path: Path) -> None:
    """Raise :class:`InputError` for an archive, except NumPy's and 3MF, which are read as they are."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return  # the reader says so
    packing = next((name for name, (at, mark) in _PACKED.items() if head.startswith(mark, at)), None)
    first_name = head[30 : 30 + int.from_bytes(head[26:28], "little")].decode("latin-1")
    if packing and not (packing == "zip" and first_name.endswith(_READ_AS_ZIP)):
        raise InputError(f"{path}: packed ({packing}); unpack it")


def _kind_of(mode: int) -> str:
    kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISSOCK, "a socket"))
    return next((name for matches, name in kinds if matches(mode)), "a device")


def read_json(path: Path, missing: str = "run `lensforge design` first") -> Any:
    """Read JSON within bounds. Raises :class:`InputError`; ``missing``: the remedy if there is no such file."""
    return json_in(read_json_bytes(path, missing), path)


def read_json_bytes(path: Path, missing: str = "run `lensforge design` first") -> bytes:
    """The bytes of a JSON file. Raises :class:`InputError` if it is missing or too large, with a remedy."""
    return read_file(path, missing=missing, most_bytes=_MOST_JSON_BYTES)


def json_in(content: bytes, path: Path) -> Any:
    """Parse the ``content`` of ``path``. Raises :class:`InputError` if it is malformed."""
    with refused(path, "not readable as JSON (…)", ValueError):
        return parse_json(content)


def file_bytes(name: str, write: Callable[[Path], None]) -> bytes:
    """The bytes that ``write`` puts into a file ``name``. Raises :class:`InputError` if the disk is full."""
    with temporary_folder(name) as folder:
        write(folder / name)
        return (folder / name).read_bytes()


@contextmanager
def temporary_file(content: bytes, name: str) -> Iterator[Path]:
    """A file ``name`` with ``content``; deleted at the end of the block."""
    with temporary_folder(name) as folder:
        (folder / name).write_bytes(content)
        yield folder / name


@contextmanager
def temporary_folder(name: str) -> Iterator[Path]:
    """A folder for a file ``name``; deleted at the end of the block, or left to the system after a kill.

    Raises :class:`InputError` if the disk is full.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="lensforge-") as folder:
            yield Path(folder)
    except OSError as error:
        place = f"{name}: the temporary folder {tempfile.gettempdir()} cannot be used ({error.strerror})"
        raise InputError(f"{place}; make room there, or set TMPDIR to another") from error


# A page carries its generator as HTML has it. A PDF gets a comment of one line at its end, where readers of PDF look
# for the last thousand bytes only.
PAGE_MARK = b'<meta name="generator" content="lensforge'
PDF_MARK = b"% printed by lensforge"
_HEAD_BYTES = 4096  # of a page: the mark stands before the styles
_TAIL_BYTES = 256


def require_own(path: Path) -> None:
    """Raise :class:`InputError` if ``path`` holds a page, a PDF or anything else that this program did not write."""
    if not is_free_or_own(path):
        raise InputError(
            f"{path}: not a page of lensforge's, so it is not overwritten; move it away, or give another name"
        )


def is_free_or_own(path: Path) -> bool:
    """True if overwriting ``path`` loses nothing: no file, an empty one, or one of this program's."""
    with refused(path, "cannot be read (…); give another name", OSError, ValueError):  # ValueError: a NUL in the path
        if not path.is_file():
            return not path.exists() and not path.is_symlink()
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
            file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
            tail = file.read(_TAIL_BYTES)
    return not head or PAGE_MARK in head or (head.startswith(b"%PDF") and PDF_MARK in tail)


def pdf_mark() -> bytes:
    """The last line of a PDF that this program made."""
    return b"\n%s %s\n" % (PDF_MARK, __version__.encode())
