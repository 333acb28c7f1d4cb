"""Tables of light: a CSV file with a line for each row from the top, or an npz file with one array [row, column]."""

import io
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.files import MIB, read_file
from lensforge.npz_file import arrays_in
from lensforge.records.arrays import LARGEST
from lensforge.records.validation import unquoted

_MOST_BYTES = 64 * MIB  # a text of 2000 x 2000 numbers of 16 characters
_ZIP = b"PK\x03\x04"  # begins every npz file


def read_table(path: Path) -> Float[np.ndarray, "h w"]:
    """Light (relative) in ``path``. Raises :class:`InputError` for anything that is no table of numbers from 0 up."""
    content = read_file(path, missing="give a CSV or npz file", most_bytes=_MOST_BYTES)
    values = _from_npz(content, path) if content.startswith(_ZIP) else _from_csv(content, path)
    if values.ndim != 2 or values.size == 0:
        raise InputError(f"{path}: shape {values.shape}, must be a table of rows and columns")
    if not (values.min() >= 0.0 and 1.0 / LARGEST <= values.max() <= LARGEST):
        found = f"{values.min():.4g} to {values.max():.4g}"
        raise InputError(f"{path}: {found}; must be 0 or above, and its largest from {1.0 / LARGEST:g} to {LARGEST:g}")
    return values


def _from_npz(content: bytes, path: Path) -> np.ndarray:
    try:
        found = arrays_in(content, None, 4 * _MOST_BYTES)
    except ValueError as error:
        raise InputError(f"{path}: {error}; save it again with numpy.savez") from None
    if len(found) != 1:
        raise InputError(f"{path}: holds {len(found)} arrays, must hold one; save it with numpy.savez(path, values)")
    return next(iter(found.values())).astype(np.float64)


def _from_csv(content: bytes, path: Path) -> np.ndarray:
    try:
        lines = content.decode("utf-8-sig").splitlines()
        rows = [line.replace(";", ",").replace("\t", ",").split("#")[0].strip() for line in lines]
        delimiter = "," if any("," in row for row in rows) else None
        return np.loadtxt(io.StringIO("\n".join(rows)), delimiter=delimiter, ndmin=2)
    except ValueError as error:
        words = "write commas between numbers, and points in them"
        raise InputError(f"{path}: no table of numbers ({unquoted(error)}); {words}") from None
