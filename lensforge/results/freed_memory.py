"""Memory that a stage has freed, returned to the system: allocators keep it, and another process could not have it."""

import ctypes
import gc
import sys
from contextlib import suppress


def return_freed_memory() -> None:
    """Return what can be returned at once: after a search of minutes, half of what its process holds."""
    gc.collect()  # arrays in cycles, which wait for their turn
    if sys.platform == "linux":
        with suppress(AttributeError, OSError):  # other C libraries than glibc have no such function
            ctypes.CDLL(None).malloc_trim(0)
