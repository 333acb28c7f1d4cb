"""Keeping freed memory for the next gradient step.

Every step frees and takes the same arrays of some megabytes. glibc hands such blocks back to the system at once and
faults them in again, page by page, on the next step; where page faults are dear (virtual machines, sandboxes) that is
a large share of a step. ``benchmarks/gradient_step.py --plain-malloc`` measures what it costs.
"""

import ctypes
import sys

_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3  # malloc.h
_LARGEST_MMAP_THRESHOLD = 32 * 2**20  # glibc refuses more
_KEPT = 1024 * 2**20


def keep_freed_memory() -> bool:
    """Ask glibc to keep up to 1 GiB of freed memory; False where the C library is another, and nothing changed."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):
        return False
    settings = ((_MMAP_THRESHOLD, _LARGEST_MMAP_THRESHOLD), (_TRIM_THRESHOLD, _KEPT), (_TOP_PAD, 64 * 2**20))
    return all(mallopt(parameter, value) == 1 for parameter, value in settings)
