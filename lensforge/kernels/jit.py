"""Compiling kernels and running them on every core.

numba keys its cache by the file of the outer function alone, so an edit in a called kernel would go unnoticed. The
cache folder is therefore named by a digest of every file in this package and of numba's version: all kernels and the
constants that they use are in this package. numba's own key is the place of that file, too, so that every checkout and
every environment would compile the same kernels again, for half a minute: here the digest is the whole key.

Rays are cut into a fixed number of chunks, whatever the number of threads, and callers add partial sums in the order
of the chunks: the same bits on any number of threads.
"""

import atexit
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch

from lensforge.errors import InputError
from lensforge.temporary import FOLDER, own_mark

CHUNKS = 8
_LARGEST_BYTES = 2**20  # of a compiled kernel: the largest has 0.15 MB


def cache_folder(kernels: Path) -> Path:
    """Cache folder for the kernels compiled from the sources in ``kernels``; a new one when any of them changes."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(kernels.glob("*.py")):
        digest.update(source.read_bytes())
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = home / "lensforge" / f"kernels-{digest.hexdigest()[:16]}"
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_LARGEST_BYTES))
            return folder
    except (OSError, RuntimeError):  # no home, a read-only or a full one: compiled once for each process
        return _temporary_cache()


def _temporary_cache() -> Path:
    """A folder for this process alone, deleted when it ends."""
    try:
        folder = tempfile.mkdtemp(prefix=f"{FOLDER}{own_mark()}-")
    except OSError as error:
        place = f"neither ~/.cache nor a temporary folder can be used for the compiled kernels ({error.strerror})"
        raise InputError(f"{place}; make room, or set XDG_CACHE_HOME to a folder that can be written") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


_FOLDER = str(cache_folder(Path(__file__).parent))

# Kernels allocate nothing. Without numba's runtime (_nrt) no call counts references to its arrays: that is an atomic
# operation on memory that all threads share, for every evaluation of a surface.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "_nrt": False}


class KernelCache:
    """The place of a compiled kernel, in the terms of numba's locators: a folder, a stamp of its source, a name."""

    def __init__(self, line: int) -> None:
        self._line = line

    @classmethod
    def from_function(cls, function: Callable[..., Any], _: str) -> "KernelCache":
        """The place of ``function``, in whatever file it is."""
        return cls(function.__code__.co_firstlineno)

    def ensure_cache_path(self) -> None:
        """Make the folder again, should it have been deleted."""
        Path(_FOLDER).mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Folder of the kernels of these sources."""
        return _FOLDER

    def get_source_stamp(self) -> str:
        """The digest of these sources."""
        return Path(_FOLDER).name

    def get_disambiguator(self) -> str:
        """The line, a part of the file's name."""
        return str(self._line)


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile ``function`` with numba, without the interpreter's lock, contracted to fused multiply-adds."""
    before = numba.config.CACHE_LOCATOR_CLASSES
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{KernelCache.__name__}"
    try:
        compiled: Callable[..., Any] = numba.njit(nogil=True, cache=True, **_OPTIONS)(function)
        return compiled
    finally:
        numba.config.CACHE_LOCATOR_CLASSES = before


inline = numba.njit(forceinline=True, **_OPTIONS)


def in_chunks(work: Callable[[int, slice], Any], count: int) -> None:
    """Run ``work(chunk number, slice of rays)`` for every chunk on as many threads as torch may use."""
    edges = np.linspace(0, count, CHUNKS + 1).astype(int)
    list(_pool(torch.get_num_threads()).map(lambda i: work(i, slice(edges[i], edges[i + 1])), range(CHUNKS)))


def in_parallel(work: Callable[[int], Any], count: int) -> None:
    """Run ``work(0)`` to ``work(count - 1)``, on as many threads as torch may use."""
    list(_pool(torch.get_num_threads()).map(work, range(count)))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Pool kept from call to call: a search makes some ten calls in every step."""
    return ThreadPoolExecutor(threads)
