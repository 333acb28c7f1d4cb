"""The help, and numbers as the command line takes them."""

from pathlib import Path

import click
import pytest
from addon_rows import addon_rows
from click.testing import CliRunner

from lensforge.cli.cli import all_commands, cli
from lensforge.cli.options import WholeNumber
from lensforge.search.schedule import fixed_schedule
from lensforge.spec import load_spec
from lensforge.spec.accuracy import PRESETS


def test_the_bare_command_prints_its_help() -> None:
    done = CliRunner().invoke(cli, [])
    assert done.exit_code == 0 and done.stderr == ""
    assert done.stdout.startswith("Usage: lensforge") or done.stdout.startswith("Usage: cli")
    assert all(f"\n  {name}" in done.stdout for name in all_commands())
    for phrase in ("lengths in mm", "--accuracy draft", "_LENSFORGE_COMPLETE=bash_source", "2 bad input"):
        assert phrase in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


OF_TEXT = ("examples", "new", "schema", *addon_rows("OF_TEXT"))  # what they print is a document, and no record


@pytest.mark.parametrize("name", sorted(all_commands()))
def test_every_command_says_what_it_does_in_a_line(name: str) -> None:
    command = all_commands()[name]
    assert command.help and command.get_short_help_str(200).endswith(".")
    done = CliRunner().invoke(cli, [name, "--help"])
    assert done.exit_code == 0 and max(map(len, done.stdout.splitlines())) <= 80
    assert name in OF_TEXT or ("--json" in done.stdout and "--quiet" in done.stdout)


@pytest.mark.parametrize("name", ["design", "sweep"])
def test_the_help_says_which_rays_of_a_search_are_set_and_those_of_each_preset(name: str) -> None:
    """The numbers are those of the steps of a search with given levels; a TIR lens of revolution takes a quarter."""
    text = " ".join(CliRunner().invoke(cli, [name, "--help"]).stdout.split())
    assert "Rays of each step of the search" in text and "1e6" not in text
    page = (Path(__file__).parents[2] / "docs/choosing.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith("| rays of each step")]
    assert [int(cell.replace(",", "")) for cell in row.split("|")[2:-1]] == [2**14, 2**16, 2**18]
    spec = load_spec(Path(__file__).parents[2] / "examples/spot.toml")
    for preset, rays in zip(("draft", "standard", "reference"), (2**14, 2**16, 2**18), strict=True):
        assert f"{rays} {preset}" in text
        assert {stage.rays for stage in fixed_schedule(spec, PRESETS[preset], last_only=False).stages} == {rays // 4}
    of_spec = spec.replace({"optimise.rays": 20_000})
    assert {stage.rays for stage in fixed_schedule(of_spec, PRESETS["draft"], last_only=False).stages} == {20_000}


@pytest.mark.parametrize(("text", "number"), [("1e6", 10**6), ("2.5E3", 2500), ("1_000", 1000), ("65536", 65536)])
def test_a_whole_number_may_have_an_exponent(text: str, number: int) -> None:
    whole = WholeNumber(1, 10**9).convert(text, None, None)
    assert whole == number and isinstance(whole, int)


@pytest.mark.parametrize("text", ["1.5", "1e-3", "0", "1e10", "1e999999999", "nan", "inf", "1e6x", "", "-5"])
def test_other_numbers_are_refused_with_the_range(text: str) -> None:
    with pytest.raises(click.BadParameter) as refused:
        WholeNumber(1, 10**9).convert(text, None, None)
    assert "1,000,000,000" in str(refused.value) or "write 1000000 or 1e6" in str(refused.value)


def test_the_shell_completes_the_commands() -> None:
    environment = {"_LENSFORGE_COMPLETE": "bash_complete", "COMP_WORDS": "lensforge se", "COMP_CWORD": "1"}
    done = CliRunner().invoke(cli, [], prog_name="lensforge", env=environment)
    assert done.stdout == "plain,sensitivity\n"
