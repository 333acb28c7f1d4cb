"""JSON and NumPy archives as they are read from a file: bounded in size, and every damage one line."""

import io
import json
import warnings
from collections.abc import Collection
from typing import Any
from zipfile import ZipFile

import numpy as np

_MOST_CHARACTERS = 120  # of another library's message


def parse_json(content: bytes) -> Any:
    """The value in the UTF-8 text ``content``. Raises :class:`ValueError`, one line, for no JSON, NaN and infinity."""
    try:
        return json.loads(content.decode("utf-8"), parse_constant=_refuse)
    except RecursionError:
        raise ValueError("nested too deep") from None


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not valid JSON")


def arrays_in(content: bytes, names: Collection[str] | None, most_bytes: int) -> dict[str, np.ndarray]:
    """The arrays ``names`` (None: all) of the archive ``content``, of booleans, integers or floats, if they are there.

    Together they have at most ``most_bytes`` when unpacked. Raises :class:`ValueError`, one line on what is wrong, for
    more than that, for another archive, and for another type of number.
    """
    try:
        with warnings.catch_warnings(), ZipFile(io.BytesIO(content)) as archive:
            warnings.simplefilter("ignore")  # on headers written by Python 2
            unpacked = sum(info.file_size for info in archive.infolist())
            if unpacked > most_bytes:
                raise ValueError(f"{unpacked} bytes unpacked, at most {most_bytes} are read")
            with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
                chosen = {name: arrays[name] for name in arrays.files if names is None or name in names}
    except Exception as error:  # whatever zipfile, zlib and NumPy's parser of a header raise, the file is damaged
        raise ValueError(" ".join((str(error) or type(error).__name__).split())[:_MOST_CHARACTERS]) from None
    for name, array in chosen.items():
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "biuf" or array.dtype.itemsize > 8:
            raise ValueError(f"array {name[:40]!r} must be numbers of 8 bytes at most")
    return chosen
