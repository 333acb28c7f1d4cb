"""Compiling the fused kernels: one decorator, and a cache that can never be stale.

numba keys its cache by the file of the outer function alone, so an edit in a called kernel would go unnoticed.
The cache folder is therefore named by a digest of every kernel source and of numba's version.
"""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba


def _cache_folder() -> Path:
    sources = sorted(Path(__file__).parents[1].rglob("*_kernel.py"))
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sources:
        digest.update(source.read_bytes())
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = home / "lensforge" / f"kernels-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:  # a read-only home: the kernels are compiled once for each process
        return Path(tempfile.mkdtemp(prefix="lensforge-kernels-"))


_FOLDER = str(_cache_folder())


# Kernels allocate nothing. Without numba's runtime (_nrt) no call counts references to its arrays: that is an atomic
# operation on memory that all threads share, for every evaluation of a surface.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}, "_nrt": False}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile ``function`` with numba, without the interpreter's lock, contracted to fused multiply-adds."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _FOLDER
    try:
        compiled: Callable[..., Any] = numba.njit(nogil=True, cache=True, **_OPTIONS)(function)
        return compiled
    finally:
        numba.config.CACHE_DIR = before


inline = numba.njit(forceinline=True, **_OPTIONS)
