"""The fields of a spec in words: each has some, and the schema and the page made of them are true."""

import inspect
import json
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from addon_rows import needs_addon
from click.testing import CliRunner

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.results.numerals import unit_in
from lensforge.results.registered_kinds import kind_of
from lensforge.spec import Spec
from lensforge.spec.lens_section import LensShape
from lensforge.spec.spec_fields import all_sections, field_description
from lensforge.spec.spec_reference import spec_schema

ROOT = Path(__file__).parents[2]
FIELDS = [(section, name) for section in all_sections(Spec) for name in section.model_fields]
# Counts, shares, indices and other numbers that have no unit, and tables whose numbers have several.
PURE = {
    "spacing", "lamps",
    "lanes", "oncoming_lanes", "wet_uniformity", "uniformity", "uniformity_along", "luminance_per_lux", "edge_ratio",
    "surface_q0", "profile", "number",
    "events", "scene_events",
    "mirror",
    "refractive_index", "reflectance", "power", "intensity", "weight", "conic_constant", "conic_x", "conic_y",
    "abbe_number", "cavity_index", "outside_index", "sigma_c", "levels", "coefficients", "schott_coefficients",
    "terms", "face", "level", "shrinkage", "holder", "scale", "origin", "columns", "rows", "exponent", "values",
    "directions", "ray_flux", "share", "rotation", "normal", "axis", "facing", "rays", "pixels",
    "dimming", "neighbours", "at_least_own_share",
    "steps_per_level", "filter_variance", "lenses", "maintenance_factor", "max_rms_delta_uv", "max_delta_uv",
    "rings", "rim_rings", "count", "amount", "index", "source_flux", "source_size", "at_least", "at_most",
    "at_least_min_over_mean", "at_least_min_over_max", "at_most_contrast",
    "at_most_max_over_mean", "most_wall_ratio", "at_least_d50_over_d10", "at_least_gradient", "at_most_gradient",
    "floor_reflectance", "ceiling_reflectance", "at_least_share", "at_most_share", "a", "b", "g", "robust", "rolloff",
}  # fmt: skip


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    return spec_schema()


def test_every_field_has_words_and_every_number_a_unit(schema: dict[str, Any]) -> None:
    for section, name in FIELDS:
        description = field_description(section, name)
        where = f"{section.__name__}.{name}"
        assert len(description) >= 5 and description.removesuffix(f" [{unit_in(name)}]").endswith("."), (
            f"{where}: no sentence"
        )
        field = {**schema["$defs"], "Spec": schema}[section.__name__]["properties"][name]
        assert field["description"] == description, where
        if any(f'"type": "{kind}"' in json.dumps(field) for kind in ("number", "integer")):
            assert unit_in(name) or name in PURE, f"{where}: a number's name ends with its unit, or it has none"


def test_all_kinds_are_in_the_schema(schema: dict[str, Any]) -> None:
    assert len(all_sections(Spec)) > 50 and len(FIELDS) > 400
    for section in all_sections(Spec):
        if kind_of(section) not in (None, LensShape.usual_kind):
            assert schema["$defs"][section.__name__]["required"][0] == "kind"


@pytest.mark.parametrize(
    ("section", "field", "value"),
    [
        ("source", "side_mm", -1.0),
        ("source", "sid_mm", 1.0),
        ("source", "kind", "sqare"),
        ("lens", "levels", "all"),
        ("lens", "levels", [0]),
        ("lens", "refractive_index", 5.0),
        ("targets", "kind", "disc"),
        ("tolerances", "index", {"amount": -1.0}),
        ("lens", "outer", {"gap_mm": {"amount": -1.0}}),
        ("lens", "middle", {"offset_mm": 6.0}),
        ("manufacture", "process", "mould"),
    ],
)
def test_the_schema_refuses_what_the_program_refuses(
    section: str, field: str, value: object, schema: dict[str, Any]
) -> None:
    content = tomllib.loads((ROOT / "examples" / "rectangle.toml").read_text(encoding="utf-8"))
    content.setdefault(section, {})[field] = value
    assert not jsonschema.Draft202012Validator(schema).is_valid(content)


def test_numbers_of_a_tolerance_and_of_a_coating_may_be_bare(schema: dict[str, Any]) -> None:
    content = tomllib.loads((ROOT / "examples" / "rectangle.toml").read_text(encoding="utf-8"))
    content["tolerances"] = {"source_flux": 0.1, "index": {"amount": 0.1}}
    content["lens"]["outer"] = {"gap_mm": 0.1, "coating": {"reflectance": 0.005}}
    jsonschema.Draft202012Validator(schema).validate(content)


def test_help_and_signature_have_every_argument_with_words_unit_and_default() -> None:
    lf.DiscSource(diameter_mm=1.0)  # pydantic has made its own signature of a class that has been used
    for section in all_sections(Spec):
        names = [name for name in section.model_fields if name != "kind" or kind_of(section) is None]
        arguments = inspect.signature(section).parameters
        assert sorted(arguments) == sorted(names), section
        for name in names:
            field, given = section.model_fields[name], arguments[name].default
            assert field.is_required() == (given is inspect.Parameter.empty)
            assert given == field.default or field.default_factory is not None or field.is_required()
            assert field_description(section, name).split(" ")[0] in (section.__doc__ or "")
    assert "Left out, derived: 0.6 x cavity_radius_mm." in (lf.ConstraintsSection.__doc__ or "")
    assert "diameter_mm (float, mm, 1e-6 to 1e9, needed): Diameter." in (lf.DiscSource.__doc__ or "")
    assert str(inspect.signature(lf.DiscSource)).startswith("(*, diameter_mm: float")


@needs_addon("road")
def test_the_page_and_the_command_say_what_the_fields_say(schema: dict[str, Any]) -> None:
    page = CliRunner().invoke(cli, ["schema", "--page"])
    assert page.exit_code == 0
    stored = (ROOT / "docs" / "spec.md").read_text(encoding="utf-8")
    assert page.output == stored, "write it again: lensforge schema --page > docs/spec.md"
    for section, name in FIELDS:
        if name != "kind" or kind_of(section) is None:
            assert f"| `{name}` |" in stored
    assert json.loads(CliRunner().invoke(cli, ["schema"]).output) == schema
