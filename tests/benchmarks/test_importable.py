"""Benchmarks: no command of the package runs them, so that nothing else notices what a change of it breaks in them."""

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.py"))
IMPORT_ALL = """
import importlib, json, sys
docstrings = {}
for name in json.loads(sys.argv[1]):
    try:
        docstrings[name] = importlib.import_module(name).__doc__ or ""
    except Exception as error:
        docstrings[name] = f"!{error!r}"
print(json.dumps(docstrings))
"""


@cache
def docstrings() -> dict[str, str]:
    """Those of all benchmarks, with the error of one that cannot be imported.

    By a process of its own: some benchmarks add kinds to those of the package, which all tests of this one would see.
    """
    given = json.dumps(NAMES)
    run = subprocess.run([sys.executable, "-c", IMPORT_ALL, given], cwd=FOLDER, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return dict(json.loads(run.stdout.splitlines()[-1]))


@pytest.mark.parametrize("name", NAMES)
def test_every_benchmark_finds_what_it_imports(name: str) -> None:
    if name.startswith("mitsuba_"):
        pytest.importorskip("mitsuba")
    assert docstrings()[name] and not docstrings()[name].startswith("!")
