"""Functions compiled by numba, kept in a cache that an edit of any source makes anew.

numba keys its cache by the file of the outer function alone, so an edit in a called kernel would go unnoticed. The
cache folder is therefore named by a digest of every file in a package and of numba's version: all kernels that call
each other, and the constants that they use, are in one package. numba's own key is the place of that file, too, so that
every checkout and every environment would compile the same kernels again, for half a minute: here the digest is all.

A new folder begins with the kernels that the installed package carries, if it does: folders like those of the cache in
:data:`CARRIED`. Of another type of CPU they are left alone, and compiled as without.
"""

import atexit
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache, cached_property, partial, reduce
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, SupportsFloat, cast

import numba
import numba.extending
import numpy as np
from numba.core.caching import FunctionCache

from lensforge.errors import InputError

_LARGEST_BYTES = 2**20  # of a compiled kernel: the largest has 0.15 MB
_MOST_WAIT_S = 300.0  # for a kernel that another process compiles: the slowest takes ten seconds

# Kernels allocate nothing. Without numba's runtime (_nrt) no call counts references to its arrays: that is an atomic
# operation on memory that all threads share, for every evaluation of a surface.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "_nrt": False}

CARRIED = Path(__file__).parents[1] / "compiled"  # what a wheel may carry: docs/install.md

Function = Callable[..., Any]
# Of what a kernel counts. With a plain 0 numba compiles all that takes the count for that number first, and drops it.
NONE_YET = np.int64(0)


class KernelCache:
    """The place of a compiled kernel, in the terms of numba's locators: a folder, a stamp of its source, a name."""

    def __init__(self, folder: Path, line: int) -> None:
        self._folder = folder
        self._line = line

    @classmethod
    def from_function(cls, function: Function, source: str) -> "KernelCache":
        """The place of a ``function`` of a ``source`` file."""
        return cls(_folder_of(Path(source).parent), function.__code__.co_firstlineno)

    def ensure_cache_path(self) -> None:
        """Recreate the folder in case it was deleted."""
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Folder of the kernels of these sources."""
        return str(self._folder)

    def get_source_stamp(self) -> str:
        """The digest of these sources."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """The line, as part of the file's name."""
        return str(self._line)


def kernel(function: Function, **options: Any) -> Function:
    """Compile ``function`` with numba, without the interpreter's lock, contracted to fused multiply-adds."""
    if numba.config.DISABLE_JIT:
        raise InputError("NUMBA_DISABLE_JIT = 1: the tracer is compiled by numba, else it takes days; unset it")
    before = numba.config.CACHE_LOCATOR_CLASSES
    numba.config.CACHE_LOCATOR_CLASSES = f"{__name__}.{KernelCache.__name__}"
    try:
        compiled: Any = numba.njit(nogil=True, **{**_OPTIONS, **options})(function)
        compiled._cache = _SharedCache(function)
        return cast(Function, compiled)
    finally:
        numba.config.CACHE_LOCATOR_CLASSES = before


class _SharedCache(FunctionCache):
    """numba's cache of a kernel; while one process compiles it, others that need it wait."""

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The kernel, compiled earlier or meanwhile by another process; None if this one is to compile it."""
        overload = self._kept(signature, target)
        if overload is None:
            with suppress(OSError):  # no locks on this file system, or no end: compiled once more
                self._lock.acquire()
            overload = self._kept(signature, target)
            if overload is not None:
                self._lock.release(force=True)
        return overload

    def _kept(self, signature: Any, target: Any) -> Any:
        try:
            return super().load_overload(signature, target)
        except (EOFError, UnpicklingError):  # a full disk or a power cut has left a part of a file
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep a kernel that this process has compiled, and let others load it."""
        super().save_overload(signature, compiled)
        self._lock.release(force=True)

    @cached_property
    def _lock(self) -> Any:
        from filelock import FileLock

        return FileLock(f"{self._cache_path}/{self._impl.filename_base}.lock", timeout=_MOST_WAIT_S)


as_written = partial(kernel, fastmath=False)  # nothing contracted: the bits of the operations as they stand
# Without code for calls from Python and from C a kernel compiles in three quarters of the time: a call from Python
# would end the process.
inline = numba.njit(forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **_OPTIONS)


_CHAIN = 6  # steps of a polynomial in turn: with 11 or 22 a sum of basis functions takes 1.1 or 1.4 times as long


def polynomial(terms: Callable[[], Sequence[SupportsFloat]]) -> Function:
    """A function of kernels: the polynomial with coefficients ``terms``, the constant one first, of a float64.

    They are evaluated when a kernel is compiled. It is a straight line of instructions: the compiler unrolls a loop
    over coefficients for some numbers of them only, and makes no vector instructions of a loop around one that it does
    not unroll.
    """
    from llvmlite import ir
    from numba.core import types

    def code(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        def plus(term: Any, power: Any, higher: Any) -> Any:
            return builder.fadd(builder.fmul(power, higher, flags=("contract",)), term, flags=("contract",))

        def total(terms: Sequence[Any], power: Any) -> Any:
            if len(terms) > _CHAIN:
                square = builder.fmul(power, power)
                return plus(total(terms[::2], square), power, total(terms[1::2], square))
            return reduce(lambda higher, term: plus(term, power, higher), reversed(terms))

        return total([ir.Constant(ir.DoubleType(), float(term)) for term in terms()], arguments[0])

    def typed(_: Any, x: Any) -> Any:
        return types.float64(types.float64), code

    return cast(Function, numba.extending.intrinsic(typed))


@cache
def _folder_of(package: Path) -> Path:
    return cache_folder(package)


def cache_folder(kernels: Path) -> Path:
    """Cache folder for the kernels compiled from the sources in ``kernels``; a new one when any of them changes."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(kernels.glob("*.py")):
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    carried = CARRIED / name
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        folder = home / "lensforge" / name
        if folder.is_dir():
            carried = folder
        else:
            folder.parent.mkdir(parents=True, exist_ok=True)
            _begin_with(carried, folder)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(_LARGEST_BYTES))
            return folder
    except (OSError, RuntimeError):  # no home, a read-only or a full one: what is missing is compiled for each process
        return _temporary_cache(carried)


def _begin_with(carried: Path, folder: Path) -> None:
    """Make ``folder``, whole or not at all, with the kernels of the folder ``carried``; empty if there are none."""
    with tempfile.TemporaryDirectory(dir=folder.parent, ignore_cleanup_errors=True) as begun:
        copied = Path(begun) / folder.name
        if carried.is_dir():
            _copy_kernels(carried, copied)
        copied.mkdir(exist_ok=True)
        with suppress(OSError):  # another process was earlier
            copied.rename(folder)
    folder.mkdir(exist_ok=True)


def _copy_kernels(carried: Path, copied: Path) -> None:
    shutil.copytree(carried, copied, copy_function=shutil.copyfile, ignore=shutil.ignore_patterns("*.lock", "tmp*"))


def are_compiled() -> bool:
    """True where kernels have been compiled on this machine."""
    return any(_folder_of(Path(__file__).parent).glob("trace.*.nbi"))


def _temporary_cache(carried: Path) -> Path:
    """A folder for this process alone, deleted when it ends, which begins with the kernels of ``carried``, if any."""
    try:
        folder = tempfile.mkdtemp(prefix="lensforge-")
    except OSError as error:
        place = f"neither ~/.cache nor a temporary folder can be used for the compiled kernels ({error.strerror})"
        raise InputError(f"{place}; make room, or set XDG_CACHE_HOME to a folder that can be written") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    copied = Path(folder) / carried.name
    try:
        _copy_kernels(carried, copied)
    except OSError:  # it is no folder, or there is no room, and a file may be cut short: compiled
        shutil.rmtree(copied, ignore_errors=True)
    copied.mkdir(exist_ok=True)
    return copied
