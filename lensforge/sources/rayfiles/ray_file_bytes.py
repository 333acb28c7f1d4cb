"""Bytes of a ray file: read through a bounds-checked memory map, written as rows of little-endian float32.

Numbers too many for the memory are written to a temporary file, and mapped from there like those of a ray file.
"""

import mmap
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile, gettempdir
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from lensforge.errors import InputError
from lensforge.results.files import require_regular_file

IN_MEMORY = 2**27  # bytes of numbers that stay in memory


def spooled(blocks: Iterable[Float[np.ndarray, "m ..."]], name: str) -> Float[np.ndarray, "n ..."]:
    """Join ``blocks`` of float64 along their first axis as a read-only map of a file that is gone when Python ends.

    Raises :class:`InputError`, ``name`` in front, where the temporary folder has no room.
    """
    shape: tuple[int, ...] = ()
    try:
        with TemporaryFile() as spool:
            for block in blocks:
                shape = block.shape[1:]
                spool.write(np.ascontiguousarray(block).data)
            spool.flush()
            return np.asarray(np.memmap(spool, dtype=np.float64, mode="r")).reshape(-1, *shape)
    except OSError as error:
        raise InputError(f"{name}: no room for its numbers in {gettempdir()} ({error.strerror}); set TMPDIR") from error


CHUNK_ROWS = 2**18  # rays handled at a time: bounds the memory whatever the size of the file
HUGE = 1e12  # no length in mm, no flux: what is larger comes from a damaged file
SMALLEST = 1e-30  # no flux: 0x7F800001 byte-swapped reads as 2.4e-38: a NaN of a writer that mixed its byte orders
_LEAST_KNOWN = 1e-12  # no total in W or lm, no wavelength


@dataclass(frozen=True)
class FileImage:
    """The bytes of one file, mapped; every access is checked, so that a lying header cannot lead outside."""

    path: Path
    data: UInt8[np.ndarray, " bytes"]

    @classmethod
    def open(cls, path: Path) -> "FileImage":
        """Map ``path``. Raises :class:`InputError` if it is missing, no regular file, empty, or not readable."""
        path = Path(path)
        require_regular_file(path, missing="give the path of a ray file")
        try:
            if path.stat().st_size == 0:
                raise InputError(f"{path}: the file is empty; fetch it again")
            return cls(path, np.asarray(np.memmap(path, dtype=np.uint8, mode="r")))
        except (OSError, ValueError) as error:  # ValueError: mapped while another program empties it
            raise InputError(f"{path}: not readable ({getattr(error, 'strerror', None) or error})") from error

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return len(self.data)

    def refuse(self, problem: str) -> InputError:
        """Error of one line that names this file."""
        return InputError(f"{self.path}: {problem}")

    def part(self, start: int, stop: int) -> bytes:
        """Copy of the bytes from ``start`` to ``stop``, fewer where the file ends earlier."""
        return self.data[start:stop].tobytes()

    def unpack(self, layout: struct.Struct, offset: int = 0) -> tuple[Any, ...]:
        """Unpack the fields of ``layout`` at ``offset``. Raises :class:`InputError` beyond the end of the file."""
        if offset + layout.size > self.size:
            raise self.refuse(
                f"truncated: {self.size} bytes, its header needs {offset + layout.size}; fetch the file again"
            )
        return layout.unpack(self.part(offset, offset + layout.size))

    def rows(self, start: int, count: int, columns: int, tail: int = 0) -> Float[np.ndarray, "n columns"]:
        """View of ``count`` rows of float32 from ``start``; rows and ``tail`` bytes must end where the file ends."""
        expected = start + 4 * columns * count + tail
        if count < 1:
            raise self.refuse("holds no rays (its header says 0); export it again")
        if expected != self.size:
            missing = expected - self.size
            fault = f"truncated by {missing} bytes" if missing > 0 else f"{-missing} bytes more"
            raise self.refuse(
                f"{count} rays of {columns} columns make {expected} bytes, the file has {self.size} ({fault}); "
                "fetch or export it again"
            )
        return self.data[start : self.size - tail].view("<f4").reshape(count, columns)

    def rows_to_end(self, start: int, columns: int, tail: int = 0) -> Float[np.ndarray, "n columns"]:
        """View of the rows of float32 from ``start`` to the end or ``tail`` bytes before it, where no header counts."""
        count, rest = divmod(self.size - tail - start, 4 * columns)
        if rest:
            raise self.refuse(
                f"ends {rest} bytes after its ray {count}, a ray has {4 * columns}: truncated, or with bytes added; "
                "fetch or export it again"
            )
        if count < 1:
            raise self.refuse("holds no rays, only a header; fetch or export it again")
        return self.rows(start, count, columns, tail)


@dataclass(frozen=True)
class FileState:
    """Size of a mapped file and the time at which it was last written to: later its numbers would be others.

    The system ends a process that reads a mapped file beyond its end, without a line.
    """

    path: Path
    inode: int
    size: int
    changed_ns: int

    @classmethod
    def of(cls, path: Path) -> "FileState":
        """The present state of ``path``. Raises OSError where it is gone."""
        now = path.stat()
        return cls(path, now.st_ino, now.st_size, now.st_mtime_ns)

    def require_same(self) -> None:
        """Raise :class:`InputError` where the file was written to since; a file that took its name does no harm."""
        try:
            now = FileState.of(self.path)
        except OSError:  # deleted: its content stays until it is no longer mapped
            return
        if now.inode == self.inode and now != self:
            size = f"{self.size} to {now.size} bytes" if now.size != self.size else f"{now.size} bytes as before"
            raise InputError(
                f"{self.path}: was written to while its rays were in use ({size}); start again when it is complete"
            )


def known(value: float) -> float | None:
    """A header number, or None where it is a way of writing unknown: 0, negative, absurd, NaN, byte-swapped NaN."""
    return float(value) if _LEAST_KNOWN < value < HUGE else None


def plain_text(raw: bytes, encoding: str) -> str:
    """A header text up to its first NUL, unprintable characters as blanks, so that it always stays one line."""
    text = raw.decode(encoding, errors="replace").split("\0")[0]
    return "".join(character if character.isprintable() else " " for character in text).strip()


def scaled(values: Float[np.ndarray, "*n"], factor: float) -> Float[np.ndarray, "*n"]:
    """Multiply ``values`` by ``factor`` in float64; where the factor is 1 return the view itself, still mapped.

    What would fill the memory goes to a temporary file. Raises :class:`InputError` where that has no room.
    """
    if factor == 1.0:
        return values
    products = _products(values, factor)
    if 8 * values.size > IN_MEMORY:
        return spooled(products, "a ray file in another unit than mm or nm")
    return np.concatenate(list(products)) if len(values) else np.zeros(values.shape)


def _products(values: Float[np.ndarray, "*n"], factor: float) -> Iterator[Float[np.ndarray, "*n"]]:
    for start in range(0, len(values), CHUNK_ROWS):
        with np.errstate(invalid="ignore", over="ignore"):
            yield np.multiply(values[start : start + CHUNK_ROWS], factor, dtype=np.float64)
        release_pages(values)


def float_rows(*columns: Float[np.ndarray, "n ..."] | None) -> bytes:
    """Rows of little-endian float32 from the given columns side by side; None is left out."""
    blocks = [column if column.ndim == 2 else column[:, None] for column in columns if column is not None]
    rows = np.empty((len(blocks[0]), sum(block.shape[1] for block in blocks)), dtype="<f4")
    with np.errstate(invalid="ignore", over="ignore"):
        np.concatenate(blocks, axis=1, out=rows, casting="same_kind")
    return rows.tobytes()


def release_pages(*arrays: np.ndarray | None) -> None:
    """Tell the system that the pages under ``arrays`` are not needed now; they are read from the file again when used.

    Only views of mapped files have such pages; nothing happens to other arrays, nor where the system cannot do it.
    """
    mappings = {id(base): base for base in map(_owner, arrays) if isinstance(base, mmap.mmap)}
    for mapping in mappings.values():
        if hasattr(mapping, "madvise"):
            mapping.madvise(mmap.MADV_DONTNEED)


def _owner(array: np.ndarray | None) -> object:
    owner: object = array
    while isinstance(owner, np.ndarray):
        owner = owner.base
    return owner
