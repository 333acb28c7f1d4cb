"""Rows of numbers in a ray file: little-endian float32 through a bounds-checked memory map, or text.

Text is written with enough digits to read back the same.
"""

import io
import mmap
import re
import struct
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from lensforge.errors import InputError, refused
from lensforge.results.files import require_regular_file
from lensforge.results.text_dialect import Dialect, Line, decoded_text, lines_of
from lensforge.results.text_table import TextTable

HEAD_BYTES = 2**14  # what tells the format of a file, and holds the header of a text
CHUNK_ROWS = 2**18  # rays handled at a time: bounds the memory whatever the size of the file
HUGE = 1e12  # no length in mm, no flux: what is larger comes from a damaged file
SMALLEST = 1e-30  # no flux: 0x7F800001 byte-swapped reads as 2.4e-38: a NaN of a writer that mixed its byte orders
_LEAST_KNOWN = 1e-12  # no total in W or lm, no wavelength


@dataclass(frozen=True)
class FileImage:
    """The bytes of one file, mapped; every access is checked, so that a wrong header cannot lead outside."""

    path: Path
    data: UInt8[np.ndarray, " bytes"]

    @classmethod
    def open(cls, path: Path) -> "FileImage":
        """Map ``path``. Raises :class:`InputError` if it is missing, no regular file, empty, or not readable."""
        path = Path(path)
        require_regular_file(path, missing="give the path of a ray file")
        with refused(path, "not readable (…)", OSError, ValueError):  # ValueError: while another program empties it
            if path.stat().st_size == 0:
                raise InputError(f"{path}: the file is empty; fetch it again")
            return cls(path, np.asarray(np.memmap(path, dtype=np.uint8, mode="r")))

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
    """Size of a mapped file and time of its last change, after which its numbers would differ.

    The system ends a process that reads a mapped file beyond its end, without a line.
    """

    path: Path
    inode: int
    size: int
    changed_ns: int

    @classmethod
    def of(cls, path: Path) -> "FileState":
        """The present state of ``path``. Raises OSError if it no longer exists."""
        stat = path.stat()
        return cls(path, stat.st_ino, stat.st_size, stat.st_mtime_ns)

    def require_same(self) -> None:
        """Raise :class:`InputError` if the file was written to since; a new file under its name does no harm."""
        try:
            present = FileState.of(self.path)
        except OSError:  # deleted: its content stays until it is no longer mapped
            return
        if present.inode == self.inode and present != self:
            size = (
                f"{self.size} to {present.size} bytes"
                if present.size != self.size
                else f"{present.size} bytes as before"
            )
            raise InputError(
                f"{self.path}: was written to while its rays were in use ({size}); start again when it is complete"
            )


def as_float64(values: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Copy as float64; signalling NaNs, which vendors write, pass without a warning."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def known(value: float) -> float | None:
    """A header number, or None for the ways of writing unknown: 0, negative, absurd, NaN, byte-swapped NaN."""
    return float(value) if _LEAST_KNOWN < value < HUGE else None


def plain_text(raw: bytes, encoding: str) -> str:
    """A header text up to its first NUL, unprintable characters as blanks, so that it always stays one line."""
    text = raw.decode(encoding, errors="replace").split("\0")[0]
    return "".join(character if character.isprintable() else " " for character in text).strip()


def scaled(values: Float[np.ndarray, "*n"], factor: float) -> Float[np.ndarray, "*n"]:
    """Multiply ``values`` by ``factor`` in float64; where the factor is 1 return the view itself, still mapped."""
    if factor == 1.0:
        return values
    with np.errstate(invalid="ignore", over="ignore"):
        product: Float[np.ndarray, "*n"] = np.multiply(values, factor, dtype=np.float64)
    return product


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


_BLOCK = 2**24  # bytes of text parsed at a time
BLANKS = Dialect(" ")  # of numbers with decimal points
_LEAST_IN_TEXT = 9  # no byte of a text is below a tab
_UTF_16 = 0.9  # share of zeros in its upper bytes


def as_plain_text(image: FileImage) -> FileImage:
    """A text in UTF-16, or with old Macintosh line ends, as plain text; any other file unchanged."""
    head = image.part(0, HEAD_BYTES)
    utf_16 = any(
        upper.count(0) > _UTF_16 * len(upper) and min(lower, default=0) >= _LEAST_IN_TEXT
        for upper, lower in ((head[3::2], head[2::2]), (head[2::2], head[3::2]))  # behind a mark, if it has one
    )
    if not utf_16 and (min(head, default=0) < _LEAST_IN_TEXT or b"\r" not in head or b"\n" in head):
        return image
    text = decoded_text(image.part(0, image.size), str(image.path)).replace("\r\n", "\n").replace("\r", "\n")
    return FileImage(image.path, np.frombuffer(f"{text}\n".encode(), dtype=np.uint8))


def parse_rows(
    image: FileImage,
    begin: int,
    end: int,
    first_line: int,
    dialect: Dialect = BLANKS,
    columns: Sequence[int] | None = None,
    width: int | None = None,
) -> Float[np.ndarray, "n columns"]:
    """Parse the numbers between two bytes as float64 rows of one length; ``first_line`` is the first row's in the file.

    Block by block. ``columns``: those to keep, in their order, of ``width``.
    """
    blocks = _parsed(image, begin, end, first_line, dialect, width)
    if columns is not None:
        blocks = (block[:, columns] for block in blocks)
    every = list(blocks)
    if not every:
        raise image.refuse("holds no rays below its header; export it again")
    rows = np.concatenate(every)
    rows.flags.writeable = False
    return rows


def _parsed(
    image: FileImage, begin: int, end: int, line: int, dialect: Dialect, width: int | None
) -> Iterator[Float[np.ndarray, "n columns"]]:
    while begin < end:
        body = image.part(begin, min(begin + _BLOCK, end))
        if begin + len(body) < end:
            body = body[: body.rfind(b"\n") + 1]
        if not body:
            raise image.refuse(f"line {line} has more than {_BLOCK} bytes: no rays; export it again")
        rows = _numbers(image, body, line, dialect) if body.strip() else None
        if rows is not None:
            width = width or rows.shape[1]
            if rows.shape[1] != width:
                raise image.refuse(f"line {line}: {rows.shape[1]} numbers, {width} expected; export it again")
            yield rows
        begin = begin + len(body)
        line = line + body.count(b"\n")
        release_pages(image.data)


_COMMAS_TO_POINTS = bytes.maketrans(b",", b".")


def _numbers(image: FileImage, body: bytes, line: int, dialect: Dialect) -> Float[np.ndarray, "n columns"] | None:
    """Numbers of a block, read by :mod:`results.text_table` if it holds anything else; None for none."""
    plain = body.translate(_COMMAS_TO_POINTS) if dialect.decimal == "," else body
    delimiter = None if dialect.separator == " " else dialect.separator
    if dialect.decimal == "." or b"." not in body:
        try:
            rows: Float[np.ndarray, "n columns"] = np.loadtxt(
                io.BytesIO(plain), ndmin=2, comments=None, delimiter=delimiter, encoding="latin-1"
            )
        except ValueError:
            pass
        else:
            return rows
    lines = [Line(line + text_line.number - 1, text_line.text) for text_line in lines_of(body.decode("latin-1"))]
    return TextTable(str(image.path), (), lines, dialect).numbers() if lines else None


_BETWEEN = re.compile(rb"[\s,;]+")


def cut_warnings(image: FileImage) -> tuple[str, ...]:
    """A warning if the last line has no end, and its last number fewer characters than any other's of its column.

    Nothing else shows truncation there, and many programs omit the last end of line.
    """
    tail = image.part(max(image.size - HEAD_BYTES, 0), image.size)
    *lengths, last = [len(_BETWEEN.split(line.strip())[-1]) for line in tail.splitlines()[1:] if line.strip()] or [0]
    if tail.endswith(b"\n") or (lengths and last >= min(lengths)):
        return ()
    return ("its last line has no line end: if the file was cut there, its last number is wrong",)


def print_rows(*columns: Float[np.ndarray, "n ..."] | None, delimiter: str = " ") -> bytes:
    """Print the given columns side by side: 9 digits for float32, 17 for float64; None is left out."""
    blocks = [column if column.ndim == 2 else column[:, None] for column in columns if column is not None]
    styles = ["%.9g" if block.dtype == np.float32 else "%.17g" for block in blocks for _ in block.T]
    rows = np.concatenate([as_float64(block) for block in blocks], axis=1)
    line = delimiter.join(styles) + "\n"
    return "".join(line % tuple(row) for row in rows.tolist()).encode("ascii")


def numbers(line: str, dialect: Dialect = BLANKS) -> list[float] | None:
    """The numbers of one line, by default separated by blanks, or None if any word is not a number."""
    try:
        return [dialect.number(word) for word in dialect.cells(Line(1, line), "")] if line.strip() else None
    except (ValueError, InputError):
        return None


def is_counted_text(head: bytes, counts: tuple[int, int], widths: Sequence[int]) -> bool:
    """True for a file of text whose first line is its number of rays and other counts, and its second line a ray.

    ``counts``: fewest and most numbers of the first line, ``widths``: numbers that a ray may have.
    """
    if min(head, default=0) < _LEAST_IN_TEXT or b"\n" not in head:
        return False
    first, ray, dialect = _counted(head)
    whole = all(number.is_integer() for number in first)
    return (
        counts[0] <= len(first) <= counts[1]
        and whole
        and first[0] >= 1.0
        and len(numbers(ray, dialect) or []) in widths
    )


def _counted(head: bytes) -> tuple[list[float], str, Dialect]:
    """Numbers of the first line, the second line, and the dialect of its numbers."""
    first, ray = head.decode("latin-1").split("\n")[:2]
    with warnings.catch_warnings(action="ignore"):  # said once, by who reads the file
        try:
            dialect = Dialect.of([Line(2, ray)], "")
            counts = Dialect.of([Line(1, first)], "")
        except InputError:
            dialect = counts = BLANKS
    return numbers(first, counts) or [0.5], ray, dialect


def counted_rows(image: FileImage, widths: tuple[int, int]) -> tuple[list[float], Float[np.ndarray, "n columns"]]:
    """Numbers of the first line, and the rows below it, as many as its first number promises."""
    head = image.part(0, HEAD_BYTES)
    first, _, dialect = _counted(head)
    rows = parse_rows(image, head.index(b"\n") + 1, image.size, 2, dialect)
    if rows.shape[1] not in widths:
        raise image.refuse(f"line 2: {rows.shape[1]} numbers, a ray has {widths[0]} or {widths[1]}; export it again")
    if len(rows) != first[0]:
        fault = "truncated" if len(rows) < first[0] else "more than that"
        raise image.refuse(
            f"line 1 promises {first[0]:.15g} rays, the file holds {len(rows)} ({fault}); fetch it again"
        )
    return first, rows
