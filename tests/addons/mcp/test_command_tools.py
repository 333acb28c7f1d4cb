"""Tools of a client: their schemas, their command lines, and what lies outside of the folder."""

import json
from pathlib import Path

import click
import pytest

from lensforge.addons.mcp.command_tools import CommandTool, command_tools, require_inside
from lensforge.cli.cli import all_commands
from lensforge.errors import InputError

TOOLS = command_tools()


def test_every_command_but_those_with_a_page_or_a_server_is_a_tool() -> None:
    assert set(TOOLS) == set(all_commands()) - {"compile", "mcp", "studio"}


def test_a_schema_has_types_bounds_choices_and_what_is_required() -> None:
    schema = TOOLS["yield"].schema
    assert schema["required"] == ["directory"] and schema["additionalProperties"] is False
    assert schema["properties"]["parts"] | {"description": ""} == {
        "type": "integer",
        "minimum": 40,
        "maximum": 100_000,
        "description": "",
    }
    wavelength = TOOLS["correct"].schema["properties"]["wavelength"]
    assert (wavelength["type"], wavelength["exclusiveMinimum"], "minimum" in wavelength) == ("number", 0.0, False)
    assert TOOLS["design"].schema["properties"]["accuracy"]["enum"] == ["draft", "standard", "reference"]
    assert TOOLS["design"].schema["properties"]["specs"] == {
        "type": "array",
        "items": {"type": "string"},
        "minItems": 1,
        "description": "path in the folder",
    }
    corners = TOOLS["compare"].schema["properties"]["corners"]
    assert (corners["minItems"], corners["maxItems"]) == (4, 4)
    hidden = {"json", "quiet", "open", "scheduler", "device", "threads"}
    assert not hidden & {name for tool in TOOLS.values() for name in tool.schema["properties"]}
    json.dumps([tool.schema for tool in TOOLS.values()])


def test_a_command_line_is_taken_as_the_arguments_say(tmp_path: Path) -> None:
    """Parsed back by the command itself: flags, repeated values, several values of one option, names like options."""
    given = {"specs": ["a.toml", "--rays=9.toml"], "sources": ["x.ray", "y.ray"], "seed": 7, "resume": True}
    module, name, *rest = TOOLS["design"].module_line(given, tmp_path)
    assert (module, name) == ("lensforge", "design")
    values, _, _ = all_commands()["design"].make_parser(click.Context(all_commands()["design"])).parse_args(rest)
    assert (values["specs"], values["files"]) == (("a.toml", "--rays=9.toml"), ["x.ray", "y.ray"])
    assert (values["seed"], values["resume"], values["as_json"]) == ("7", True, True)
    line = TOOLS["compare"].module_line({"directory": "d", "corners": ["1,2", "3,4", "5,6", "7,8"]}, tmp_path)
    values, _, _ = all_commands()["compare"].make_parser(click.Context(all_commands()["compare"])).parse_args(line[2:])
    assert values["corners"] == ("1,2", "3,4", "5,6", "7,8")


@click.command()
@click.option("--budget/--no-budget", default=True)
def study(budget: bool) -> None:
    """Say whether."""


def test_a_flag_that_is_false_is_said_where_it_has_a_word_for_that(tmp_path: Path) -> None:
    assert CommandTool(study).module_line({"budget": False}, tmp_path) == ["lensforge", "study", "--no-budget", "--"]
    assert "--resume" not in TOOLS["design"].module_line({"specs": ["a"], "resume": False}, tmp_path)


@pytest.mark.parametrize("path", ["../lens.toml", "/etc/passwd", "link/lens.toml", "in/../../lens.toml", "a\0b"])
def test_a_path_outside_of_the_folder_is_refused(path: str, tmp_path: Path) -> None:
    folder = tmp_path / "lenses"
    (folder / "in").mkdir(parents=True)
    (folder / "link").symlink_to(tmp_path)
    for refuse in (
        lambda: require_inside(path, folder),
        lambda: TOOLS["design"].module_line({"specs": ["a.toml", path]}, folder),
        lambda: TOOLS["rays"].module_line({"file": "a.ray", "to": path}, folder),
    ):
        with pytest.raises(InputError) as caught:
            refuse()
        assert "\n" not in str(caught.value)
    assert require_inside("in/lens.toml", folder) == folder / "in" / "lens.toml"
