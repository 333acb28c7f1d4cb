"""``lensforge examples``: a list, and copies that can be designed; a file that is there stays."""

import importlib.util
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.spec import load_spec

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
SPECS = {path.relative_to(EXAMPLES).with_suffix("").as_posix() for path in EXAMPLES.rglob("*.toml")}

PHOTOGRAPHS = [f"made_lens/{name}" for name in ("off.png", "poses.csv", *(f"led_{number}.png" for number in range(7)))]


def ran(*arguments: str) -> Result:
    return CliRunner().invoke(cli, ["examples", *arguments])


def test_the_list_names_every_shipped_spec_and_its_content() -> None:
    rows = dict(line.split("\t") for line in ran().output.splitlines())
    assert set(rows) == SPECS and all(len(text) > 20 for text in rows.values())
    assert rows["quickstart"].startswith("A cross of light, 200 mm wide")
    assert "Regulation No. 7" in rows["signal"] and "J. Zhejiang Univ. Sci. C 13" in rows["published/circle"]


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("pi", []),
        ("image", ["arrow.png"]),
        ("from_ies.toml", ["street_light.ies"]),
        ("published/circle", []),
        ("made_lens", PHOTOGRAPHS),
    ],
)
def test_a_copy_has_the_files_that_it_names(
    name: str, files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert ran(name).exit_code == 0
    source = (EXAMPLES / name.removesuffix(".toml")).with_suffix(".toml")
    stem = source.stem
    copied = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.relative_to(tmp_path).as_posix() for path in copied} == {f"{stem}.toml", *files}
    for file in (f"{stem}.toml", *files):
        assert (tmp_path / file).read_bytes() == (source.parent / file).read_bytes()
    assert load_spec(f"{stem}.toml").name == stem


def test_a_file_that_is_there_stays_and_nothing_else_is_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arrow.png").write_text("mine", encoding="utf-8")
    refused = ran("image")
    assert isinstance(refused.exception, InputError) and refused.exception.exit_code == 2
    assert str(refused.exception).startswith("arrow.png: exists")
    assert [path.name for path in tmp_path.iterdir()] == ["arrow.png"]
    assert (tmp_path / "arrow.png").read_text(encoding="utf-8") == "mine"


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    assert "known: backlight, backlight_plate, backlight_rim, backlight_thin, batwing" in str(ran("pie").exception)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy with a wheel and an editable install in dist/, built without the network by this environment's backend."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("pyproject.toml", "setup.py", "README.md"):
        shutil.copy(ROOT / name, folder / name)
    for name in ("lensforge", "examples"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    build = "from setuptools.build_meta import *; build_editable('editable'); build_wheel('dist')"
    subprocess.run([sys.executable, "-c", build], cwd=folder, capture_output=True, check=True)
    return folder


def test_a_wheel_holds_the_specs_and_all_that_the_program_reads(checkout: Path) -> None:
    (wheel,) = (checkout / "dist").glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    shipped = {f"lensforge/shipped/{stem}.toml" for stem in SPECS}
    assert shipped | {"lensforge/shipped/led.tm25ray", "lensforge/shipped/arrow.png"} <= held
    paths = {path for path in (ROOT / "lensforge").rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    assert {path.relative_to(ROOT).as_posix() for path in paths} <= held


def test_an_editable_install_is_a_path_which_type_checkers_read(checkout: Path) -> None:
    (wheel,) = (checkout / "editable").glob("*.whl")
    archive = zipfile.ZipFile(wheel)
    (path,) = (name for name in archive.namelist() if name.endswith(".pth"))
    assert Path(archive.read(path).decode().strip()).samefile(checkout)


USER = """
import lensforge as lf

spec = lf.Spec(
    source=lf.SquareSource(side_mm=2),
    lens=lf.LensSection(material="PC"),
    constraints=lf.ConstraintsSection(max_radius_mm=14),
    target=lf.TextTarget(text="LF", width_mm=90, distance_mm=150),
)
height: float = spec.constraints.cavity_height_mm
lf.LensSection(materiel="PC")
"""


@pytest.mark.nightly("mypy reads torch and all else: a minute")
def test_mypy_finds_the_package_from_outside_the_checkout(checkout: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "env", with_pip=False)
    (packages,) = (tmp_path / "env" / "lib").glob("python*/site-packages")
    (wheel,) = (checkout / "editable").glob("*.whl")
    zipfile.ZipFile(wheel).extractall(packages)
    numpy = Path(importlib.util.find_spec("numpy").submodule_search_locations[0])
    (packages / "others.pth").write_text(str(numpy.parent), encoding="utf-8")
    (tmp_path / "user.py").write_text(USER, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--python-executable", tmp_path / "env" / "bin" / "python"]
    result = subprocess.run([*command, "user.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    wrong = 'user.py:11: error: Unexpected keyword argument "materiel" for "LensSection"'
    assert result.stdout.startswith(wrong) and "Found 1 error in 1 file" in result.stdout, result.stdout + result.stderr
