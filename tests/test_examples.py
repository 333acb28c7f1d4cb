"""The shipped specs are valid, keep to the schema, come back from a file, and say what the README says of them."""

import tomllib
from pathlib import Path

import jsonschema
import pytest
from addon_rows import has_addon
from published import CASES

from lensforge.spec import load_spec
from lensforge.spec.spec_reference import spec_schema

EXAMPLES = Path(__file__).parents[1] / "examples"
OF_ADDONS = {
    **dict.fromkeys(("road_m3", "road_wide", "road_luminance", "pedestrian"), "road"),
    "office_panel": "office",
    "escape_route": "escape",
}
SPECS = sorted(
    path
    for path in (*EXAMPLES.glob("*.toml"), *EXAMPLES.glob("published/*.toml"))
    if path.stem not in OF_ADDONS or has_addon(OF_ADDONS[path.stem])
)


@pytest.fixture(scope="module")
def schema() -> jsonschema.Draft202012Validator:
    return jsonschema.Draft202012Validator(spec_schema())


@pytest.mark.usefixtures("cad_read_here")
@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_a_shipped_spec_is_valid_and_comes_back_from_its_file(
    path: Path, schema: jsonschema.Draft202012Validator, tmp_path: Path
) -> None:
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    schema.validate(content)
    if not (path.parent / content.get("source", {}).get("file", "")).exists():
        pytest.skip("its ray file comes from the vendor")
    spec = load_spec(path)
    assert spec.name == path.stem
    # the noise of limits of roads ends automatic levels too early, and lamps together are more even than they can tell
    given = spec.lens.reflects or spec.applications or spec.lamps
    given = given or path.stem == "made_lens"  # two levels, so that rounding changes the lens by 0.02 µm at most
    assert spec.lens.levels == "auto" or given
    spec.save(tmp_path / "again.toml")
    schema.validate(tomllib.loads((tmp_path / "again.toml").read_text(encoding="utf-8")))
    again = load_spec(tmp_path / "again.toml")
    assert again == spec and again.model_dump() == spec.model_dump()
    assert spec.replace(name="other").replace(name=spec.name) == spec


def test_every_published_design_has_a_spec() -> None:
    assert {path.stem for path in EXAMPLES.glob("published/*.toml")} == set(CASES)
