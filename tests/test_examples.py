"""The shipped specs are valid, and say what the README says of them."""

from pathlib import Path

import pytest

from lensforge.spec import load_spec

SPECS = sorted((Path(__file__).parents[1] / "examples").glob("*.toml"))


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_every_shipped_spec_is_valid(path: Path) -> None:
    spec = load_spec(path)
    assert spec.name == path.stem
    assert spec.lens.levels == "auto"
