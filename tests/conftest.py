"""Array shapes and dtypes in signatures are checked while the tests run; result folders that many tests read."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

# A thread of OpenBLAS or of torch that waits for another takes a whole core, and the processes of these tests have
# one each: sums of a source's rays took ten times as long, tests of the search, run alone, a third more. They read
# this when they are loaded: the processes of xdist and the commands that tests start obey. Tests of threads say how
# many they want.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import array_checks
import pytest
from addon_rows import addon_rows
from made_once import copied, fcntl, made_once
from nightly import leave_out_by_day

import lensforge
from lensforge.results.worker import collect_garbage_seldom

# That a file outlasts a power cut is not what tests see, and waiting for the disk takes 3 ms for each of thousands.
os.fsync = lambda _: None
# By default Python searches for garbage at 700 new objects: a seventh of the time in which a page is drawn.
collect_garbage_seldom()

_PACKAGES = [
    "surfaces", "optics", "sources", "scene", "light", "search", "cad", "shop", "proof", "made", "addons/measure",
    "addons/road",
]  # fmt: skip
_FOLDER = Path(lensforge.__file__).parent
_UNCHECKED = {  # compiled by numba, which cannot compile what is wrapped; verbs, which refuse wrong types themselves
    "grid_walk.py", "vertex_fit.py",
    "lens_light.py", "searches.py", "casts.py", "part_verbs.py", "measure_verbs.py", "photometric_summary.py",
    # and what takes protocols, of which tests give the part that they need
    "luminaire_classes.py", "yield_study.py", "measured_parts.py", "tolerance_budget.py", "part_study.py",
    "sensitivity.py", "point_tables.py", "shop_files.py", "proof_inputs.py",
}  # fmt: skip
_MODULES = sorted(
    path for package in _PACKAGES for path in (_FOLDER / package).rglob("*.py") if path.name not in _UNCHECKED
)
array_checks.install([".".join(path.relative_to(_FOLDER.parent).with_suffix("").parts) for path in _MODULES])


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    leave_out_by_day(config, items)
    # Processes take files in this order: at the end there should be none that the others wait for. Those beside this
    # one and of add-ons are long, and the last folders by name have short ones.
    items.sort(key=lambda item: item.path.parent.parent == Path(__file__).parent)


def pytest_collection_finish() -> None:
    """What is loaded stays: the search for garbage need not walk through it again and again."""
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    array_checks.begin_test()


@pytest.fixture(autouse=True)
def closed_figures() -> Iterator[None]:
    """Plots that results draw stay open for a notebook to show: matplotlib warns when a process has more than 20."""
    yield
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        pyplot.close("all")


@pytest.fixture
def examples() -> Path:
    return Path(__file__).parents[1] / "examples"


@pytest.fixture
def undrawn() -> Iterator[None]:
    """Reports without pictures, which take four seconds: for tests that read words and numbers."""
    from undrawn import undrawn  # not before the import hook is there

    with undrawn():
        yield


@pytest.fixture
def cad_read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """CAD files are read in this process, by the same code: a child takes a second to load the CAD kernel.

    For tests of what is done with them; that a child reads them, and may crash, is tested elsewhere.
    """
    from lensforge.surfaces import (
        cad_sampling,
        imported_face,
        step_file,  # not before the import hook is there
    )

    readers = {Path(step_file.__file__): step_file._write_products}
    readers[Path(cad_sampling.__file__)] = cad_sampling._sample_face
    for module in (step_file, imported_face):
        monkeypatch.setattr(module, "work_in_child", lambda script, folder, *_, **__: readers[script](folder))


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """A folder of all processes that run these tests together, where they can lock files."""
    folder = tmp_path_factory.getbasetemp()
    return folder if worker_id == "master" or fcntl is None else folder.parent


@pytest.fixture(scope="session", autouse=True)
def compiled_once(shared: Path) -> Iterator[None]:
    """Each kernel is compiled by one process and loaded by the others: a new clone spends two minutes on them."""
    from numba.core.caching import NullCache
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    compiled = Dispatcher.compile

    def in_turn(self: Dispatcher, signature: object) -> object:
        if isinstance(self._cache, NullCache) or fcntl is None:
            return compiled(self, signature)
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}.compiling"
        with global_compiler_lock, (shared / name).open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return compiled(self, signature)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", in_turn)
        yield


@pytest.fixture(scope="session")
def small_run(shared: Path) -> lensforge.Run:
    """A run of a small lens: the object that ``run`` returned, and its folder as it left it. To be read only.

    The report has no pictures, which take ten seconds, and the part few triangles, which every reader of the folder
    adds up. It is made on one thread, one stage after another.
    """
    from presets import WITH_TABLE_ERROR  # not before the import hook is there
    from scenes import small_spec
    from undrawn import undrawn

    from lensforge.results.arguments import threads_of_torch

    spec = small_spec(optimise__steps_per_level=[40, 40])
    with undrawn(), threads_of_torch(1):
        return made_once(shared / "small_run", lambda folder: lensforge.run(spec, folder, accuracy=WITH_TABLE_ERROR))


@pytest.fixture(scope="session")
def whole_run(small_run: lensforge.Run, shared: Path) -> lensforge.Run:
    """The same in a folder of its own, with every result that can be added: studies of the lens, a measured part."""
    return made_once(shared / "whole_run", lambda folder: _with_every_result(small_run, folder))


def _with_every_result(small_run: lensforge.Run, folder: Path) -> lensforge.Run:
    from undrawn import undrawn

    from lensforge.verbs import SENSITIVITY, STRAY, YIELD

    copied(small_run.folder, folder)
    STRAY.run(folder)
    SENSITIVITY.run(folder)
    with undrawn():
        YIELD.run(folder, parts=40, rays=512)
    for measure in addon_rows("WHOLE_RUN").values():
        measure(small_run, folder)
    return lensforge.load(folder)
