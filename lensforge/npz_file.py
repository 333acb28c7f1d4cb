"""Arrays of a NumPy archive (`.npz`) that may come from anywhere: what it claims is compared before it is unpacked."""

import io
import warnings
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from math import prod
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

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
