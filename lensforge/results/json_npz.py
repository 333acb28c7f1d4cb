"""JSON and NumPy archives as they are read from a file: bounded in size, and every damage one line."""

import io
import json
import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any
from zipfile import ZipFile

import numpy as np

_MOST_CHARACTERS = 120  # of another library's message
_MOST_VALUES = 20_000_000  # of a JSON file; a million steps of a search have 10 million numbers


@dataclass(frozen=True)
class Form:
    """Numbers of ``kind`` in this machine's byte order, from ``least`` to ``most``.

    ``axes``: the size of each, or a name for a size shared by all arrays of a file.
    """

    axes: tuple[str | int, ...]
    kind: str = "float64"
    least: float = -1e30
    most: float = 1e30


def parse_json(content: bytes) -> Any:
    """The value in the UTF-8 text ``content``. Raises :class:`ValueError`, one line, for bad JSON, NaN and infinity.

    Also for more values than any record has: each takes up to a hundred bytes of memory.
    """
    if (values := content.count(b",")) > _MOST_VALUES:
        raise ValueError(f"{values} values, at most {_MOST_VALUES} are read")
    try:
        return json.loads(content.decode("utf-8"), parse_constant=_refuse)
    except RecursionError:
        raise ValueError("nested too deep") from None


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not valid JSON")


def arrays_in(content: bytes, names: Collection[str] | None, most_bytes: int) -> dict[str, np.ndarray]:
    """The arrays ``names`` (None: all) of the archive ``content``, of booleans, integers or floats, if present.

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


def require_forms(arrays: Mapping[str, np.ndarray], forms: Mapping[str, Form]) -> None:
    """Raise :class:`ValueError`, one line, unless ``arrays`` has exactly the names of ``forms``, each in its form."""
    sizes: dict[str, int] = {}
    for name in dict.fromkeys((*forms, *arrays)):
        if name not in arrays or name not in forms:
            raise ValueError(f"array {name[:40]!r} {'is missing' if name in forms else 'is none of it'}")
        array = arrays[name]
        form = forms[name]
        if array.dtype != np.dtype(form.kind):
            raise ValueError(f"array {name!r} is of type {array.dtype}, must be {form.kind}")
        known = [axis if isinstance(axis, int) else sizes.get(axis, -1) for axis in form.axes]
        if array.ndim != len(known) or any(
            size not in (size_of_axis, -1) for size_of_axis, size in zip(array.shape, known, strict=True)
        ):
            wanted = ", ".join(str(axis if size < 0 else size) for axis, size in zip(form.axes, known, strict=True))
            raise ValueError(f"array {name!r} has the shape {array.shape}, must be ({wanted})")
        sizes |= {axis: size for axis, size in zip(form.axes, array.shape, strict=True) if isinstance(axis, str)}
        wrong = array[~((array >= form.least) & (array <= form.most))]  # NaN is neither
        if wrong.size:
            raise ValueError(f"array {name!r} holds {wrong[0]:.3g}, must be from {form.least:g} to {form.most:g}")
