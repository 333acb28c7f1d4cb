"""What the README shows is true: its spec is valid, its commands and files are there."""

import re
import tomllib
from pathlib import Path

from lensforge.cli.cli import cli
from lensforge.spec import parse_spec

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_specs_in_the_readme_are_valid() -> None:
    """The first is whole; the others are what may stand in it for its target, or beside the beam: limits."""
    first, *others = (tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", README, flags=re.DOTALL))
    rest = {name: section for name, section in first.items() if name != "target"}
    beam, *_ = others
    wanted = [other if {"target", "receivers"} & set(other) else {**beam, **other} for other in others]
    for spec in (first, *({**rest, **other} for other in wanted)):
        parse_spec(spec | {"name": "readme"}, "README")


def test_every_command_is_in_the_readme_and_every_command_there_exists() -> None:
    shown = set(re.findall(r"^\| `lensforge ([a-z]+)", README, flags=re.MULTILINE))
    assert shown == set(cli.commands)


def test_every_file_that_the_readme_names_is_there() -> None:
    linked = re.findall(r"\]\((?!https://)([^)#]+)\)", README)
    examples = [f"examples/{name}" for name in re.findall(r"`([a-z_]+\.toml)`", README)]
    assert linked
    for name in linked + examples:
        assert (ROOT / name).exists(), name


def test_the_make_targets_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make (\w+)", README, flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE)
