"""Rows of numbers as text: parsed by NumPy, and written with digits enough to come back as the same numbers."""

import io
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lensforge.sources.rayfiles.binary import FileImage
from lensforge.sources.rayfiles.record import CHUNK_ROWS, as_float64


def parse_rows(
    image: FileImage, body: bytes, first_line: int, delimiter: str | None = None
) -> Float[np.ndarray, "n columns"]:
    """The numbers of ``body`` in float64, every row of the same length; ``first_line`` is its number in the file."""
    if not body.strip():
        raise image.refuse("holds no rays below its header; export it again")
    try:
        rows = np.loadtxt(io.BytesIO(body), ndmin=2, comments=None, delimiter=delimiter, encoding="latin-1")
    except ValueError as error:
        problem = " ".join(str(error).split("\n")[0].split())[:160]
        raise image.refuse(
            f"rows from line {first_line} on cannot be read as numbers ({_printable(problem)})"
        ) from None
    rows.flags.writeable = False
    return rows


def cut_warnings(image: FileImage) -> tuple[str, ...]:
    """A warning if the last line has no end: nothing else shows that its last number lost digits."""
    if image.part(image.size - 1, image.size) == b"\n":
        return ()
    return ("its last line has no line end: if the file was cut there, its last number is wrong",)


def print_rows(*columns: Float[np.ndarray, "n ..."], delimiter: str = " ", line_end: str = "\n") -> Iterator[bytes]:
    """The columns side by side, 9 digits for float32 and 17 for float64, some rays at a time."""
    style = "%.9g" if all(column.dtype == np.float32 for column in columns) else "%.17g"
    for start in range(0, len(columns[0]), CHUNK_ROWS):
        part = [as_float64(column[start : start + CHUNK_ROWS]) for column in columns]
        rows = np.concatenate([c if c.ndim == 2 else c[:, None] for c in part], axis=1)
        line = delimiter.join([style] * rows.shape[1]) + line_end
        yield "".join(line % tuple(row) for row in rows.tolist()).encode("ascii")


def numbers(line: str) -> list[float] | None:
    """The numbers of one line separated by blanks, or None if any word is no number."""
    try:
        return [float(word) for word in line.split()]
    except ValueError:
        return None


def opening_lines(head: bytes) -> list[str] | None:
    """The complete lines of a file's first bytes, or None if they are not plain text."""
    if any(byte < 9 for byte in head):
        return None
    lines = head.decode("latin-1").splitlines()
    return lines if len(lines) > 1 else None


def _printable(text: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in text)
