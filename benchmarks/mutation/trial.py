"""Tests of one mutant, in a copy of the checkout and a process of its own that is forked after the slow imports."""

import gc
import importlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
_LIBRARIES = (
    "pytest", "numpy", "torch", "numba", "scipy.interpolate", "scipy.optimize", "scipy.sparse", "scipy.spatial",
    "scipy.stats", "jaxtyping", "beartype", "pydantic", "hypothesis", "cadquery", "trimesh", "matplotlib.pyplot",
    "PIL.Image",
)  # fmt: skip
_MEMORY = 8 * 2**30
_WALL = 20.0  # seconds for each second of processor time: other work runs beside the tests


def copy_checkout(copy: Path) -> None:
    """Make ``copy`` hold the files of the working tree, ignored ones left out, with their times."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, encoding="utf-8").stdout.split("\0")
    for name in filter(None, names):
        source, target = ROOT / name, copy / name
        if source.is_file() and not source.is_symlink():
            target.parent.mkdir(parents=True, exist_ok=True)
            if not target.exists() or target.read_bytes() != source.read_bytes():
                shutil.copyfile(source, target)
            os.utime(target, (source.stat().st_mtime, source.stat().st_mtime))


def import_libraries() -> None:
    """Import what the tests need of others, once: it takes longer than most tests. Nothing of lensforge."""
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    for name in _LIBRARIES:
        importlib.import_module(name)
    if "lensforge" in sys.modules:  # the tests would run without the bug
        raise SystemExit("lensforge is loaded before its changed copy")
    gc.freeze()  # no fork looks through what it shares with the others


@contextmanager
def bug(copy: Path, module: str, changed: str) -> Iterator[None]:
    """The copy with a changed module, whose time is another one: Python compiles it anew, and keeps that nowhere."""
    path = copy / "lensforge" / module
    source, of_source = path.read_text(encoding="utf-8"), path.stat().st_mtime
    path.write_text(changed, encoding="utf-8")
    os.utime(path, (of_source + 60, of_source + 60))
    try:
        yield
    finally:
        path.write_text(source, encoding="utf-8")
        os.utime(path, (of_source, of_source))


def run_tests(copy: Path, tests: tuple[str, ...], limit: float, keep_bytecode: bool) -> tuple[str, float]:
    """Outcome ("passed", "failed", "time", or what pytest could not do), and seconds of processor time.

    "stalled" says nothing of the tests: they got too little processor time, or wait for ever.
    """
    shutil.rmtree(copy / ".hypothesis", ignore_errors=True)
    log = copy / "build" / "pytest.txt"
    log.parent.mkdir(exist_ok=True)
    child = os.fork()
    if not child:
        _in_child(copy, tests, limit, keep_bytecode, log)
    end, stalled = time.monotonic() + _WALL * limit, False
    while not (ended := os.wait4(child, os.WNOHANG))[0]:
        if time.monotonic() > end:
            stalled = True
            os.kill(child, signal.SIGKILL)
        time.sleep(0.02)
    _end_children(child)
    seconds = ended[2].ru_utime + ended[2].ru_stime
    if stalled:
        return "stalled", seconds
    if os.WIFSIGNALED(ended[1]):
        return "time" if os.WTERMSIG(ended[1]) in (signal.SIGXCPU, signal.SIGKILL) else "failed", seconds
    code = os.WEXITSTATUS(ended[1])
    return {0: "passed", 1: "failed", 2: "failed"}.get(code, f"pytest ended with {code}"), seconds


def _in_child(copy: Path, tests: tuple[str, ...], limit: float, keep_bytecode: bool, log: Path) -> None:
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (int(limit) + 1, int(limit) + 5))
    resource.setrlimit(resource.RLIMIT_DATA, (_MEMORY, _MEMORY))
    with log.open("wb") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os.chdir(copy)
    os.environ |= {"PYTHONPATH": str(copy)} | ({} if keep_bytecode else {"PYTHONDONTWRITEBYTECODE": "1"})
    sys.path[:] = [str(copy), *(each for each in sys.path if not each.startswith(str(ROOT / "benchmarks")))]
    sys.dont_write_bytecode = not keep_bytecode
    import pytest

    code = 3
    try:
        code = int(pytest.main(["-x", "-p", "no:cacheprovider", *(f"tests/{name}.py" for name in tests)]))
    finally:
        os._exit(code)


def _end_children(session: int) -> None:
    """End what the tests left running in their session."""
    try:
        os.killpg(session, signal.SIGKILL)
    except ProcessLookupError:
        return
