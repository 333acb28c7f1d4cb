"""Atomic writing of files, JSON without NaN, and temporary files for writers that need a path."""

import json
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lensforge.errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path``; rename it over ``path`` when the block succeeds.

    The temporary name keeps the suffix, because CAD and mesh writers choose their format by it. On any failure the
    temporary file is deleted and the old file stays. Raises :class:`InputError` for a full disk or a read-only folder.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".writing-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); give another folder") from error
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); the old file is kept") from error
    finally:
        temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def write_json(path: Path, content: Any) -> None:
    """Write ``content`` as indented JSON; NaN and infinity are refused, so that any reader can parse it."""
    text = json.dumps(content, indent=2, allow_nan=False)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def read_json(path: Path, missing: str = "run `lensforge design` first") -> Any:
    """Read JSON. Raises :class:`InputError` for a missing or broken file; ``missing``: the remedy for a missing one.

    NaN and infinity, which are not valid JSON, are refused.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {missing}") from None
    except RecursionError:
        raise InputError(f"{path}: not readable as JSON (nested too deep)") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: not readable as JSON ({error})") from None


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not valid JSON")


def file_bytes(name: str, write: Callable[[Path], None]) -> bytes:
    """The bytes that ``write`` puts into a file called ``name``. Raises :class:`InputError` where the disk is full."""
    with _folder(name) as folder:
        write(folder / name)
        return (folder / name).read_bytes()


@contextmanager
def temporary_file(content: bytes, name: str) -> Iterator[Path]:
    """A file called ``name`` that holds ``content``; deleted at the end of the block."""
    with _folder(name) as folder:
        (folder / name).write_bytes(content)
        yield folder / name


@contextmanager
def _folder(name: str) -> Iterator[Path]:
    try:
        with tempfile.TemporaryDirectory(prefix="lensforge-") as folder:
            yield Path(folder)
    except OSError as error:
        place = f"{name}: the temporary folder {tempfile.gettempdir()} cannot be used ({error.strerror})"
        raise InputError(f"{place}; make room there, or set TMPDIR to another") from error
