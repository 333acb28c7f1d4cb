"""Benchmarks: no command of the package runs them, so that nothing else notices what a change of it breaks in them."""

import importlib
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.py")))
def test_every_benchmark_finds_what_it_imports(name):
    if name.startswith("mitsuba_"):
        pytest.importorskip("mitsuba")
    assert importlib.import_module(name).__doc__
