"""What several test processes share: the first that needs it makes it, and the others wait for it.

Nobody may write there: a folder that one test locks for a moment is refused to a test of another process.
"""

import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from lensforge.results.folder_lock import LOCK_FILE

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
            if folder.is_dir():
                _forbid_locking(folder)
        made: _Made = pickle.loads(kept.read_bytes())
        return made


def _forbid_locking(folder: Path) -> None:
    """Put a file with two names in the place of the folder's lock, which refuses it."""
    lock = folder / LOCK_FILE
    lock.touch()
    os.link(lock, folder.with_suffix(".shared"))


def copied(shared: Path, to: Path, **options: Any) -> Path:
    """Copy a shared folder, such as that of ``small_run``, to one that may be written; ``options`` of ``copytree``."""
    return Path(shutil.copytree(shared, to, ignore=shutil.ignore_patterns(LOCK_FILE), **options))
