"""Every `lensforge` command on a page is one that the command line takes; scripts and make targets are there."""

import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from page_sources import PAGES, ROOT, blocks, name_of, prose, shell_commands, spans

from lensforge.cli.cli import all_commands, cli
from lensforge.spec import load_spec

PLACEHOLDERS = {"COMMAND", "SPEC.toml"}
SHELL = blocks("", "console", "bash", "sh")
OPTIONS_OF_OTHERS = {"--version", "--help"}


def check(arguments: list[str], place: str) -> None:
    """Parse the arguments of a `lensforge` command; the values of choices are looked at, files are not."""
    if not arguments or arguments[0].startswith("-") or arguments[0] in PLACEHOLDERS:
        return
    names = [name for name in arguments[0].split("|") if name]
    for name in names:
        assert name in all_commands(), f"{place}: lensforge {name}"
        command = all_commands()[name]
        context = click.Context(command, info_name=name)
        try:
            values, _, _ = command.make_parser(context).parse_args(arguments[1:].copy())
        except click.UsageError as error:
            raise AssertionError(f"{place}: lensforge {' '.join(arguments)}: {error.format_message()}") from None
        _check_choices(command, values, place)


def _check_choices(command: click.Command, values: dict[str, object], place: str) -> None:
    for option in command.params:
        value = values.get(option.name or "")
        if isinstance(option.type, click.Choice) and isinstance(value, str):
            for choice in value.split("|"):
                assert choice in option.type.choices, f"{place}: {option.opts[0]} {choice}"


def test_commands_in_blocks_are_taken() -> None:
    commands = [(block.place, arguments) for block in SHELL for arguments in shell_commands(block.text, "lensforge")]
    assert len(commands) > 30
    for place, command in commands:
        check(command, place)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_options_in_sentences_are_taken(page: Path) -> None:
    for span in spans(page):
        if span.startswith("lensforge "):
            check(re.sub(r"[…\[\]]", "", span).split()[1:], name_of(page))
        elif span.startswith("--"):
            option = re.split(r"[ =,]", span)[0]
            assert option in ALL_OPTIONS or _of_a_script(option), f"{name_of(page)}: {option}"


ALL_OPTIONS = OPTIONS_OF_OTHERS | {
    name
    for command in all_commands().values()
    for option in command.params
    for name in (*option.opts, *option.secondary_opts)
}


def _of_a_script(option: str) -> bool:
    scripts = [*(ROOT / "benchmarks").rglob("*.py"), *(ROOT / "docs").glob("*.py")]
    return any(f'"{option}"' in script.read_text(encoding="utf-8") for script in scripts)


def test_options_in_the_table_of_commands_belong_to_their_commands() -> None:
    rows = re.findall(
        r"^\| `lensforge ([a-z]+)[^|]*\|(.*)\|$", prose(ROOT / "docs" / "commands.md").replace("\\|", ","), re.MULTILINE
    )
    assert sorted(name for name, _ in rows) == sorted(all_commands())
    for name, text in rows:
        known = {opt for option in all_commands()[name].params for opt in (*option.opts, *option.secondary_opts)}
        for option in re.findall(r"`(--[a-z-]+)", text):
            assert option in known, f"commands.md: lensforge {name} {option}"


def test_an_option_that_does_not_exist_is_found() -> None:
    with pytest.raises(AssertionError, match="--rayz"):
        check(["evaluate", "DIR", "--rayz", "10"], "a page")
    with pytest.raises(AssertionError, match="AP999"):
        check(["export", "DIR", "--schema", "AP999"], "a page")


def test_scripts_that_pages_name_are_there_with_their_options() -> None:
    commands = [(block.place, command) for block in SHELL for command in shell_commands(block.text, "python")]
    spans_of = [
        (name_of(page), span.split()[1:]) for page in PAGES for span in spans(page) if span.startswith("python ")
    ]
    scripts = [(place, command) for place, command in commands + spans_of if command and command[0].endswith(".py")]
    assert len(scripts) > 15
    for place, (script, *rest) in scripts:
        assert (ROOT / script).is_file(), f"{place}: {script}"
        text = (ROOT / script).read_text(encoding="utf-8")
        for option in (word.split("=")[0] for word in rest if word.startswith("--")):
            assert f'"{option}"' in text, f"{place}: {script} {option}"


IN_ORDER = ["first_lens", "choosing"]  # pages whose commands build on one another


def _commands(page: str) -> list[list[str]]:
    path = ROOT / "docs" / f"{page}.md"
    return [command for block in blocks("", pages=[path]) for command in shell_commands(block.text, "lensforge")]


@pytest.mark.parametrize("page", IN_ORDER)
def test_the_specs_of_a_page_are_written_and_take_its_sweep(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    commands = _commands(page)
    assert commands[0][0] == "new"
    for name, spec, *rest in commands:
        if name == "new":
            assert CliRunner().invoke(cli, [name, spec, *rest]).exit_code == 0
        elif name == "sweep":
            field, values = rest[rest.index("--vary") + 1].split("=")
            for value in values.split(","):
                assert load_spec(spec).replace({field: float(value)}).constraints.max_radius_mm == float(value)
        elif spec.endswith(".toml"):
            load_spec(spec)


@pytest.mark.nightly("designs, and a sweep of four: ten minutes")
@pytest.mark.parametrize("page", IN_ORDER)
def test_the_commands_of_a_page_run_in_its_order(page: str, tmp_path: Path) -> None:
    for command in _commands(page):
        done = subprocess.run(
            [sys.executable, "-m", "lensforge", *command], cwd=tmp_path, capture_output=True, encoding="utf-8"
        )
        assert done.returncode in (0, 1) and "Traceback" not in done.stderr, f"{command}: {done.stderr}"


def test_make_targets_that_pages_name_are_there() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    named = {(name_of(page), name) for page in PAGES for name in re.findall(r"`make (\w+)", prose(page))}
    named |= {(block.place, command[0]) for block in SHELL for command in shell_commands(block.text, "make") if command}
    for place, target in named:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), f"{place}: make {target}"
