"""JSON and NumPy archives that may come from anywhere: what they claim is bounded before it is unpacked."""

import io
import json
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from math import prod
from typing import Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

# A history of 10,000 steps with seven constraints has 10^5 values. Each takes up to 250 bytes in memory.
_MOST_VALUES = 4_000_000
_DEEPEST = 64  # levels; a record has at most nine, and what walks through one calls itself for each
_MOST_DIGITS = 40  # of a whole number; conversion of longer ones takes more than linear time


def parse_json(content: bytes) -> Any:
    """The value in the UTF-8 text ``content``. Raises :class:`ValueError`, one line, where it is not JSON.

    NaN and infinity, which are not valid JSON, are refused; so are more than four million values, more than 64 levels
    of tables and lists, and whole numbers of more than 40 digits.
    """
    values = sum(map(content.count, (b",", b"{", b"[")))  # at least as many as there are
    if values > _MOST_VALUES:
        raise ValueError(f"{values} values, at most {_MOST_VALUES} are read")
    try:
        found = json.loads(content.decode("utf-8"), parse_constant=_refuse, parse_int=_whole_number)
    except RecursionError:
        raise ValueError("nested too deep") from None
    require_flat(found)
    return found


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not valid JSON")


def _whole_number(digits: str) -> int:
    if len(digits) > _MOST_DIGITS:
        raise ValueError(f"a whole number of {len(digits)} digits, at most {_MOST_DIGITS} are read")
    return int(digits)


def require_flat(content: Any) -> None:
    """Raise :class:`ValueError` where tables and lists are nested too deep; a loop: deep ones exhaust the stack."""
    level, depth = [content] if isinstance(content, dict | list) else [], 0
    while level:
        if depth > _DEEPEST:
            raise ValueError(f"nested too deep, more than {_DEEPEST} levels")
        entries = [each.values() if isinstance(each, dict) else each for each in level]
        level = [entry for group in entries for entry in group if isinstance(entry, dict | list)]
        depth += 1


_MOST_MEMBERS = 1000  # an archive of lensforge has fewer than 20; the directory of millions takes minutes to read
_ENTRY = b"PK\x01\x02"  # begins each entry of the directory
_MOST_CHARACTERS = 120  # of another library's message


def arrays_in(content: bytes, names: Collection[str] | None, most_bytes: int) -> dict[str, np.ndarray]:
    """The arrays ``names`` (None: all) of the archive ``content``, of booleans, integers or floats, if they are there.

    Together they have at most ``most_bytes`` when unpacked. Raises :class:`ValueError`, one line on what is wrong, for
    more than that, for another archive, another type of number, and a shape that is not that of the bytes.
    """
    if content.count(_ENTRY) > _MOST_MEMBERS:
        raise ValueError(f"more than {_MOST_MEMBERS} arrays")
    with _damage_in_one_line(), ZipFile(io.BytesIO(content)) as archive:
        wanted = {name: info for name, info in _members(archive) if names is None or name in names}
        unpacked = sum(info.file_size for info in wanted.values())
        if unpacked > most_bytes:
            raise ValueError(f"{unpacked} bytes unpacked, at most {most_bytes} are read")
        return {name: _array(archive.read(info), name) for name, info in wanted.items()}


@contextmanager
def _damage_in_one_line() -> Iterator[None]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on headers written by Python 2, and by Python's parser of the header
            yield
    except Exception as error:  # whatever zipfile, zlib and NumPy's parser of a header raise, the file is damaged
        raise ValueError(" ".join((str(error) or type(error).__name__).split())[:_MOST_CHARACTERS]) from None


def _members(archive: ZipFile) -> Iterator[tuple[str, ZipInfo]]:
    """Name and entry of each array. NumPy stores or deflates; another method may take any memory to unpack."""
    found: set[str] = set()
    for info in archive.infolist():
        name = info.filename.removesuffix(".npy")
        if name in found:
            raise ValueError(f"two arrays {name[:40]!r}")
        if info.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise ValueError(f"array {name[:40]!r} is packed by method {info.compress_type}; NumPy stores or deflates")
        found.add(name)
        yield name, info


def _array(member: bytes, name: str) -> np.ndarray:
    """The array in the bytes of a `.npy` file; NumPy allocates what a header claims, so that is compared before."""
    stream = io.BytesIO(member)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read_header(stream)
    if dtype.kind not in "biuf" or dtype.itemsize > 8:
        raise ValueError(f"array {name!r} of type {str(dtype)[:40]}, must be numbers of 8 bytes at most")
    claimed, there = prod(shape) * dtype.itemsize, len(member) - stream.tell()
    if claimed != there or min(shape, default=0) < 0:
        raise ValueError(f"array {name!r} claims the shape {str(shape)[:40]}, {claimed} bytes, and has {there}")
    found: np.ndarray = np.load(io.BytesIO(member), allow_pickle=False)
    return found
