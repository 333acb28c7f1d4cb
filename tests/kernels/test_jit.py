"""The cache of compiled kernels: all that is compiled lies in one folder, whose content is its key."""

import ast
import errno
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from numba.core.caching import FunctionCache

import lensforge
from lensforge.kernels.compiled import cache_folder, kernel
from lensforge.kernels.fate import Fate
from lensforge.kernels.sparse import add_transposed

PACKAGE = Path(lensforge.__file__).parent
KERNELS = PACKAGE / "kernels"
COMPILER = KERNELS / "compiled.py"
PROOF = PACKAGE / "proof"
SOURCES = sorted(path for path in KERNELS.glob("*.py") if path != COMPILER)


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.name)
def test_any_edit_in_the_folder_makes_another_cache(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    copied = tmp_path / "kernels"
    shutil.copytree(KERNELS, copied, ignore=shutil.ignore_patterns("__pycache__"))
    assert cache_folder(copied) == cache_folder(KERNELS)
    edited = copied / source.name
    edited.write_text(edited.read_text() + "# edited\n")
    assert cache_folder(copied) != cache_folder(KERNELS)


@pytest.fixture
def carried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Kernels that the package carries, of these sources, and an empty home of the cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("lensforge.kernels.compiled.CARRIED", tmp_path / "carried")
    folder = tmp_path / "carried" / cache_folder(KERNELS).name
    shutil.rmtree(tmp_path / "cache")
    folder.mkdir(parents=True)
    for name in ("a.nbi", "a.1.nbc", "a.lock"):
        (folder / name).write_text(name)
    return folder


def contents(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


def test_a_new_cache_begins_with_the_kernels_that_the_package_carries(carried: Path, tmp_path: Path) -> None:
    folder = cache_folder(KERNELS)
    assert folder == tmp_path / "cache" / "lensforge" / carried.name
    assert contents(folder) == {"a.nbi": "a.nbi", "a.1.nbc": "a.1.nbc"}, "no locks"
    assert list(folder.parent.iterdir()) == [folder], "nothing is left of what was begun"
    (folder / "a.nbi").write_text("compiled since")
    assert contents(cache_folder(KERNELS))["a.nbi"] == "compiled since", "an older one keeps its own"
    assert contents(cache_folder(PROOF)) == {}, "of other sources"


def test_kernels_of_a_cache_that_cannot_be_written_serve_every_process(
    carried: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those in the cache, such as of an image that another user made; else those of the package."""

    def refuse(**_: object) -> None:
        raise PermissionError("read-only")

    kept = cache_folder(KERNELS)
    (kept / "b.nbi").write_text("kept")
    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    temporary = cache_folder(KERNELS)
    assert temporary != kept and temporary.name == kept.name, "numba takes the name for a stamp of the sources"
    assert contents(temporary) == contents(kept)
    with monkeypatch.context() as full:
        full.setattr("shutil.copyfile", cut_short)
        assert contents(cache_folder(KERNELS)) == {}, "no file of which a part is missing"
    shutil.rmtree(kept)
    monkeypatch.setattr("lensforge.kernels.compiled._begin_with", lambda *_: refuse())
    assert contents(cache_folder(KERNELS)) == {"a.nbi": "a.nbi", "a.1.nbc": "a.1.nbc"}
    shutil.rmtree(carried)
    assert contents(cache_folder(KERNELS)) == {}


def cut_short(_: str, copied: str) -> None:
    """A copy onto a disk that is full."""
    Path(copied).write_bytes(b"a")
    raise OSError(errno.ENOSPC, "no space left on device")


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_a_kernel_of_which_a_part_is_left_is_compiled_again(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def doubled(x: float) -> float:
        return 2.0 * x

    monkeypatch.setattr("lensforge.kernels.compiled._folder_of", lambda _: tmp_path)
    assert kernel(doubled)(3.0) == 6.0
    (file,) = tmp_path.glob(f"*.{suffix}")
    file.write_bytes(file.read_bytes()[:-9])
    for hits in (0, 1):
        again: Any = kernel(doubled)
        assert again(3.0) == 6.0 and sum(again.stats.cache_hits.values()) == hits


_MULTIPLY = """
import numpy as np
from lensforge.kernels.sparse import add_transposed
starts, total = np.array([0, 1, 3]), np.zeros((2, 2))
add_transposed(starts, np.array([0, 0, 1]), np.array([2.0, 3.0, 5.0]), np.array([[1.0, 7.0], [1.0, 1.0]]), 0, 2, total)
assert total.tolist() == [[5.0, 17.0], [5.0, 5.0]], total
found = add_transposed.stats
print(found.cache_path, len(found.cache_hits), len(found.cache_misses))
"""


@pytest.mark.nightly("two more processes that compile")
def test_of_two_checkouts_that_start_together_one_runs_what_the_other_compiles(tmp_path: Path) -> None:
    started = []
    for name in ("first", "second"):
        shutil.copytree(PACKAGE, tmp_path / name / "lensforge", ignore=shutil.ignore_patterns("__pycache__"))
        surroundings = {**os.environ, "PYTHONPATH": str(tmp_path / name), "XDG_CACHE_HOME": str(tmp_path / "cache")}
        command = [sys.executable, "-P", "-c", _MULTIPLY]
        started.append(subprocess.Popen(command, env=surroundings, stdout=subprocess.PIPE, encoding="utf-8"))
    (folder, *first), (again, *second) = (process.communicate()[0].split() for process in started)
    assert folder == again and folder.startswith(str(tmp_path / "cache"))
    assert sorted([first, second]) == [["0", "1"], ["1", "0"]], "hits and misses of the cache"
    shutil.copytree(tmp_path / "cache" / "lensforge", tmp_path / "first" / "lensforge" / "compiled")
    surroundings = {**surroundings, "PYTHONPATH": str(tmp_path / "first"), "XDG_CACHE_HOME": str(tmp_path / "other")}
    carried = subprocess.run(command, env=surroundings, stdout=subprocess.PIPE, encoding="utf-8", check=True)
    (place, *third) = carried.stdout.split()
    assert (place.startswith(str(tmp_path / "other")), third) == (True, ["1", "0"]), "carried by the package"


def test_a_kernel_is_locked_from_the_first_look_for_it_until_it_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not where it lies in the cache, nor where another process has kept it while this one waited."""
    answers: list[str | None] = []
    monkeypatch.setattr(FunctionCache, "load_overload", lambda *_: answers.pop(0))
    monkeypatch.setattr(FunctionCache, "save_overload", lambda *_: None)
    cache: Any = add_transposed._cache  # type: ignore[attr-defined]
    for given, loaded in ((["kernel"], "kernel"), ([None, "kernel"], "kernel"), ([None, None], None)):
        answers[:] = given
        assert cache.load_overload(None, None) == loaded and not answers
        assert cache._lock.is_locked == (loaded is None)
    cache.save_overload(None, None)
    assert not cache._lock.is_locked


@pytest.mark.parametrize(
    ("folder", "sources"), [(KERNELS, SOURCES), (PROOF, [PROOF / "grid_walk.py", PROOF / "vertex_fit.py"])]
)
def test_kernels_take_their_constants_from_their_own_folder(folder: Path, sources: list[Path]) -> None:
    room = f"lensforge.{folder.name}"
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("lensforge"):
                assert node.module.startswith((room, "lensforge.kernels.compiled")), path


def test_the_fates_are_their_places_in_arrays() -> None:
    """Flux is summed by fate with ``bincount``: the values are 0, 1, 2, ... in the order of the enum."""
    assert [int(fate) for fate in Fate] == list(range(len(Fate)))
