"""Stored notebooks: executed, without an error, of names that the library has, and without a path of a machine.

`make notebooks`, in the nightly run, executes them again.
"""

import ast
import json
import re
from pathlib import Path
from typing import Any

import pytest
from page_sources import ROOT
from test_page_blocks import library_names

import lensforge as lf

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))


def cells(path: Path) -> list[dict[str, Any]]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_has_run_without_an_error_and_pictures_are_stored(path: Path) -> None:
    outputs = [output for cell in cells(path) for output in cell["outputs"]]
    assert [cell["execution_count"] for cell in cells(path)] == list(range(1, len(cells(path)) + 1))
    assert all(output["output_type"] != "error" for output in outputs)
    assert all(output.get("name") != "stderr" for output in outputs)
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    assert path.stat().st_size < 500_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_cells_name_what_the_library_has(path: Path) -> None:
    tree = ast.parse("\n".join("".join(cell["source"]) for cell in cells(path)))
    found = library_names(tree)
    assert found
    for name in found:
        assert hasattr(lf, name.attr), f"{path.name}: lf.{name.attr}"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_nothing_of_the_machine_is_stored(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert not re.search(r'"/(home|tmp|root|Users|work)/|/site-packages/', text)
    assert set(json.loads(text)["metadata"]) <= {"kernelspec", "language_info"}
