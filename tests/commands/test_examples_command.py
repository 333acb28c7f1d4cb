"""``lensforge examples``: a list, and copies that can be designed; a file that is there stays."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from lensforge.cli import cli
from lensforge.errors import InputError
from lensforge.spec import load_spec

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
SPECS = {path.relative_to(EXAMPLES).with_suffix("").as_posix() for path in EXAMPLES.rglob("*.toml")}


def ran(*arguments: str) -> Result:
    return CliRunner().invoke(cli, ["examples", *arguments])


def test_the_list_names_every_shipped_spec_and_its_content() -> None:
    rows = dict(line.split("\t") for line in ran().output.splitlines())
    assert set(rows) == SPECS and all(len(words) > 20 for words in rows.values())
    assert rows["quickstart"].startswith("The first thing to run: a cross")
    assert "Regulation No. 7" in rows["signal"] and rows["published/circle"].startswith("J. Zhejiang Univ. Sci. C 13")


@pytest.mark.parametrize(
    ("name", "files"),
    [("pi", []), ("image", ["arrow.png"]), ("from_ies.toml", ["street_light.ies"]), ("published/circle", [])],
)
def test_a_copy_has_the_files_that_it_names(
    name: str, files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ran(name).exit_code == 0
    source = (EXAMPLES / name.removesuffix(".toml")).with_suffix(".toml")
    stem = source.stem
    assert {path.name for path in tmp_path.iterdir()} == {f"{stem}.toml", *files}
    for each in (f"{stem}.toml", *files):
        assert (tmp_path / each).read_bytes() == (source.parent / each).read_bytes()
    assert load_spec(f"{stem}.toml").name == stem


def test_a_file_that_is_there_stays_and_nothing_else_is_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arrow.png").write_text("mine", encoding="utf-8")
    refused = ran("image")
    assert isinstance(refused.exception, InputError) and refused.exception.exit_code == 2
    assert str(refused.exception).startswith("arrow.png: is there already")
    assert [path.name for path in tmp_path.iterdir()] == ["arrow.png"]
    assert (tmp_path / "arrow.png").read_text(encoding="utf-8") == "mine"


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    assert "known: batwing, chip_array" in str(ran("pie").exception)


def test_a_wheel_holds_the_specs_and_all_that_the_program_reads(tmp_path: Path) -> None:
    """Built from a copy, without the network, by the build backend of this environment."""
    for name in ("pyproject.toml", "setup.py", "README.md"):
        shutil.copy(ROOT / name, tmp_path / name)
    for name in ("lensforge", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    build = "from setuptools.build_meta import build_wheel; print(build_wheel('dist'))"
    subprocess.run([sys.executable, "-c", build], cwd=tmp_path, capture_output=True, check=True)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    shipped = {f"lensforge/shipped/{stem}.toml" for stem in SPECS}
    assert shipped | {"lensforge/shipped/led.tm25ray", "lensforge/shipped/arrow.png"} <= held
    own = {path for path in (ROOT / "lensforge").rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert {path.relative_to(ROOT).as_posix() for path in own} <= held
