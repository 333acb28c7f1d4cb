"""Rows of numbers as text: parsed by NumPy, and written with enough digits to read back the same."""

import io
from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np
from jaxtyping import Float

from lensforge.results.validation import unquoted
from lensforge.sources.rayfiles.ray_file import as_float64
from lensforge.sources.rayfiles.ray_file_bytes import FileImage, release_pages, spooled

_BLOCK = 2**24  # bytes of text parsed at a time
_IN_MEMORY = 2**27  # bytes of text whose numbers stay in memory


def parse_rows(
    image: FileImage,
    begin: int,
    end: int,
    first_line: int,
    delimiter: str | None = None,
    columns: Sequence[int] | None = None,
    width: int | None = None,
) -> Float[np.ndarray, "n columns"]:
    """Parse the numbers between two bytes as float64 rows of one length; ``first_line`` is the first row's in the file.

    Block by block; what would fill the memory goes to a temporary file, and is mapped like a binary one. ``columns``:
    those to keep, in their order, of ``width``.
    """
    blocks = _parsed(image, begin, end, first_line, delimiter, width)
    if columns is not None:
        blocks = (block[:, columns] for block in blocks)
    first = next(blocks, None)
    if first is None:
        raise image.refuse("holds no rays below its header; export it again")
    every = chain([first], blocks)
    rows = np.concatenate(list(every)) if end - begin <= _IN_MEMORY else spooled(every, str(image.path))
    rows.flags.writeable = False
    return rows


def _parsed(
    image: FileImage, begin: int, end: int, line: int, delimiter: str | None, width: int | None
) -> Iterator[Float[np.ndarray, "n columns"]]:
    while begin < end:
        body = image.part(begin, min(begin + _BLOCK, end))
        if begin + len(body) < end:
            body = body[: body.rfind(b"\n") + 1]
        if not body:
            raise image.refuse(f"line {line} has more than {_BLOCK} bytes: no rays; export it again")
        if body.strip():
            rows = _numbers(image, body, line, delimiter)
            width = width or rows.shape[1]
            if rows.shape[1] != width:
                raise image.refuse(f"line {line}: {rows.shape[1]} numbers, {width} expected; export it again")
            yield rows
        begin, line = begin + len(body), line + body.count(b"\n")
        release_pages(image.data)


def _numbers(image: FileImage, body: bytes, line: int, delimiter: str | None) -> Float[np.ndarray, "n columns"]:
    try:
        rows: Float[np.ndarray, "n columns"] = np.loadtxt(
            io.BytesIO(body), ndmin=2, comments=None, delimiter=delimiter, encoding="latin-1"
        )
    except ValueError as error:
        raise image.refuse(f"rows from line {line} on cannot be read as numbers ({unquoted(error)})") from None
    return rows


def cut_warnings(image: FileImage) -> tuple[str, ...]:
    """A warning if the last line has no end: nothing else shows that its last number lost digits."""
    if image.part(image.size - 1, image.size) == b"\n":
        return ()
    return ("its last line has no line end: if the file was cut there, its last number is wrong",)


def print_rows(*columns: Float[np.ndarray, "n ..."] | None, delimiter: str = " ") -> bytes:
    """Print the given columns side by side: 9 digits for float32, 17 for float64; None is left out."""
    blocks = [column if column.ndim == 2 else column[:, None] for column in columns if column is not None]
    styles = ["%.9g" if block.dtype == np.float32 else "%.17g" for block in blocks for _ in block.T]
    rows = np.concatenate([as_float64(block) for block in blocks], axis=1)
    line = delimiter.join(styles) + "\n"
    return "".join(line % tuple(row) for row in rows.tolist()).encode("ascii")


def numbers(line: str) -> list[float] | None:
    """The numbers of one line separated by blanks, or None if any word is not a number."""
    try:
        return [float(word) for word in line.split()]
    except ValueError:
        return None


def opening_lines(head: bytes) -> list[str] | None:
    """The complete lines of a file's first bytes, or None if they are not plain text."""
    if any(byte < 9 for byte in head):
        return None
    lines = [line.removesuffix("\r") for line in head.decode("latin-1").split("\n")]
    return lines if len(lines) > 1 else None
