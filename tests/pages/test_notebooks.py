"""Stored notebooks: run without an error, of names that the library has; `make notebooks` runs them again."""

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


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_has_run_without_an_error_on_names_that_the_library_has(path: Path) -> None:
    text, code = path.read_text(encoding="utf-8"), cells(path)
    outputs = [output for cell in code for output in cell["outputs"]]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    assert all(output["output_type"] != "error" and output.get("name") != "stderr" for output in outputs)
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    names = library_names(ast.parse("\n".join("".join(cell["source"]) for cell in code)))
    assert names and [name.attr for name in names if not hasattr(lf, name.attr)] == []
    assert not re.search(r'"/(home|tmp|root|Users|work)/|/site-packages/', text), "nothing of the machine"
    assert set(json.loads(text)["metadata"]) <= {"kernelspec", "language_info"} and len(text) < 500_000
