"""The shipped specs are valid, and say what the README says of them."""

from pathlib import Path

import pytest
from published import CASES

from lensforge.spec import load_spec

EXAMPLES = Path(__file__).parents[1] / "examples"
SPECS = sorted([*EXAMPLES.glob("*.toml"), *EXAMPLES.glob("published/*.toml")])


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_every_shipped_spec_is_valid(path: Path) -> None:
    spec = load_spec(path)
    assert spec.name == path.stem
    # the noise of limits of roads ends automatic levels too early, and lamps together are more even than they can tell
    given = spec.lens.reflects or spec.roads or spec.lamps
    assert spec.lens.levels == "auto" or given


def test_every_published_design_has_a_spec() -> None:
    assert {path.stem for path in EXAMPLES.glob("published/*.toml")} == set(CASES)
