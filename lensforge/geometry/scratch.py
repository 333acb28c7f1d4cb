"""Bytes by way of a temporary file, for libraries that know nothing but paths."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from lensforge.errors import InputError


def written(name: str, write: Callable[[Path], None]) -> bytes:
    """The bytes that ``write`` puts into a file called ``name``; :class:`InputError` where the disk has no room."""
    with _folder(name) as folder:
        write(folder / name)
        return (folder / name).read_bytes()


@contextmanager
def as_file(content: bytes, name: str) -> Iterator[Path]:
    """A file called ``name`` that holds ``content``, for as long as the block runs."""
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
