"""Settings and modules that a library would take from the current folder, which may be one that somebody else sent.

matplotlib reads ``matplotlibrc`` of the current folder as it loads, which can choose a module to draw with; numba reads
``.numba_config.yaml`` there as it loads and whenever it compiles, which can switch off the compiler and with it the
bits of every result. Neither can be told not to, so they load from another working folder.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

_READ_SETTINGS = ("matplotlib", "numba")
_ELSEWHERE = Path(__file__).resolve().parent


def ignore_settings_in_working_folder() -> None:
    """Have this process ignore what such libraries would read there; before they load, and while one thread runs."""
    if not any(isinstance(finder, _Elsewhere) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Elsewhere())


class _Elsewhere(MetaPathFinder):
    """Finds these libraries as Python does, and loads them with another working folder."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in _READ_SETTINGS:
            return None
        found = PathFinder.find_spec(fullname, path, target)
        if found is not None and found.loader is not None:
            found.loader = _LoadElsewhere(found.loader)
        return found


class _LoadElsewhere(Loader):
    """Loads a module by another loader, which it then leaves in its own place, with another working folder."""

    def __init__(self, inner: Loader) -> None:
        self._inner = inner

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return self._inner.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        module.__loader__ = self._inner
        if module.__spec__ is not None:
            module.__spec__.loader = self._inner
        with _working_folder(_ELSEWHERE):
            self._inner.exec_module(module)
        if module.__name__ == "numba":
            module.core.config._config_fname = ""  # read again at every compilation


@contextmanager
def _working_folder(folder: Path) -> Iterator[None]:
    try:
        before = os.getcwd()  # noqa: PTH109  a path object adds nothing
    except OSError:  # it has been deleted, so nothing can be read from it
        yield
        return
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
