"""What several test processes share: the first that needs it makes it, and the others wait for it."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

_Made = TypeVar("_Made")


def made_once(folder: Path, make: Callable[[Path], _Made]) -> _Made:
    """What ``make`` returns for ``folder``."""
    kept = folder.with_suffix(".pickle")
    with folder.with_suffix(".lock").open("w") as lock:
        if fcntl is not None:
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            kept.write_bytes(pickle.dumps(make(folder)))
        made: _Made = pickle.loads(kept.read_bytes())
        return made
