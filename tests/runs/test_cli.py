"""The command line as a user meets it: a process, its exit code, one line for every mistake."""

import json
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from click.testing import CliRunner
from coarse_part import coarse_part
from foreground import default_signals
from in_this_process import Ended, lensforge
from scenes import small_spec
from undrawn import undrawn

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.results.arguments import threads_of_torch

LEVELS = "levels = [\n    9,\n    25,\n]"


def write_spec(folder: Path, steps: tuple[int, int] = (80, 80), **replace: str) -> Path:
    text = small_spec(lens__symmetry="auto", optimise__steps_per_level=list(steps)).to_toml()
    for old, new in replace.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "small.toml"
    path.write_text(text, encoding="utf-8")
    return path


@dataclass(frozen=True)
class Killed:
    """A design that is interrupted in its second level, and then resumed."""

    folder: Path
    spec: Path
    code: int
    stderr: str
    resumed: Ended


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Killed:
    """One small design by the command line, which all tests of its folder share."""
    folder = tmp_path_factory.mktemp("cli")
    # Two seconds for the second level: the signal comes in time on a busy machine, too.
    spec = write_spec(folder, steps=(40, 400))
    process = subprocess.Popen(
        [sys.executable, "-m", "lensforge", "design", str(spec), "--accuracy", "draft"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        encoding="utf-8",
        cwd=folder,
        preexec_fn=default_signals,
    )
    assert process.stderr is not None
    assert any(line.startswith("level 1/2") for line in process.stderr)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    checkpoint = folder / "cad_out" / "small" / "checkpoint.bin"
    assert checkpoint.exists() and not checkpoint.with_name("lens.json").exists(), "cut during the search"
    # In this process, and on one thread, which needs no second process: twenty seconds less.
    with pytest.MonkeyPatch.context() as patch, undrawn(), coarse_part(), threads_of_torch(1):
        patch.chdir(folder)
        resumed = lensforge("design", spec, "--accuracy", "draft", "--resume")
    return Killed(folder / "cad_out" / "small", spec, process.returncode, stderr, resumed)


def test_a_design_leaves_every_file(small_run: lf.Run) -> None:
    require_every_file(small_run.folder, light=small_run.verdict.light)  # of few steps


def require_every_file(designed: Path, light: str = "pass") -> None:
    """The files of a design that went well, but for its ``light``."""
    for name in ("lens.json", "lens.step", "lens.stl", "report.html"):
        assert (designed / name).stat().st_size > 1000
    for name in ("design", "evaluate", "export", "check", "verify"):
        content = json.loads((designed / f"{name}.json").read_text(encoding="utf-8"))
        failed = [criterion["name"] for criterion in content["criteria"] if not criterion["passed"]]
        assert failed == [] or (name, light) == ("evaluate", "fail"), name
    verdict = json.loads((designed / "run.json").read_text(encoding="utf-8"))["verdict"]
    assert (verdict["light"], verdict["files"]) == (light, "pass")
    assert verdict["cutting"] == "fail" and verdict["reasons"]["cutting"], "said, but no failure of the run"
    assert not list(designed.glob(".writing-*"))
    assert not (designed / "checkpoint.bin").exists()


@pytest.mark.usefixtures("undrawn")
def test_single_stages_run_again(small_run: lf.Run, tmp_path: Path) -> None:
    folder = tmp_path / "again"
    shutil.copytree(small_run.folder, folder)
    own_light, page = (folder / "evaluate.json").read_bytes(), (folder / "report.html").stat().st_mtime_ns
    done = lensforge("evaluate", folder, "--rays", 2048, "--pixels", 8, "--json")
    assert done.code == 0, done.stderr
    values = json.loads(done.stdout)["evaluate_2048rays_8px"]
    assert (values["rays"], values["pixels"]) == (2048, 8)
    assert values["nmse"]["value"] > 0.0 and values["nmse"]["standard_error"] > 0.0
    assert own_light == (folder / "evaluate.json").read_bytes(), "other conditions: beside the lens's own light"
    assert json.loads((folder / "evaluate_2048rays_8px.json").read_text(encoding="utf-8"))["rays"] == 2048
    assert (folder / "report.html").stat().st_mtime_ns > page, "a report that is there is renewed"
    (folder / "report.html").unlink()
    with coarse_part():
        assert lensforge("check", folder).code == 0
    assert not (folder / "report.html").exists()
    assert lensforge("evaluate", folder, "--source", folder / "lens.stl").code == 2


@pytest.mark.nightly("a design twice; by day a search is ended by a signal, and another resumed")
def test_a_killed_design_says_how_to_go_on_and_goes_on_where_it_was(killed: Killed) -> None:
    assert killed.code == 130
    assert "--resume" in killed.stderr
    assert "Traceback" not in killed.stderr
    assert "level 2/2" in killed.resumed.stderr and "level 1/2" not in killed.resumed.stderr


@pytest.mark.nightly("the whole search again; by day a shorter one resumes to the same bits")
def test_a_killed_design_resumes_to_the_same_lens(killed: Killed) -> None:
    assert killed.resumed.code == 0, killed.resumed.stderr
    assert "  Efficiency " in killed.resumed.stdout
    require_every_file(killed.folder)
    straight = lf.design(lf.load_spec(killed.spec), accuracy="draft").lens
    assert straight == lf.load_lens(killed.folder / "lens.json")


@pytest.mark.parametrize(
    ("replace", "message"),
    [
        ({"min_thickness_mm = 1.0": "min_thickness_mm = -0.1"}, "constraints.min_thickness_mm = -0.1"),
        ({'kind = "flat_top"': 'kind = "fancy"'}, "target"),
        ({"width_mm = 160.0": "width_mm = nan"}, "width_mm"),
        ({LEVELS: "levels = []"}, "levels"),
        ({LEVELS: "levels = [9, 25"}, "not readable as TOML"),
        ({"[lens]": "[lense]"}, "lens"),
        ({"offset_mm = 6.0": "offset_mm = 2.0"}, "lens: outer.offset_mm = 2.0 must exceed"),
        ({"rays = 1024": "rays = 1e9"}, "optimise.rays"),
    ],
)
def test_bad_specs_end_in_one_line(tmp_path: Path, replace: dict[str, str], message: str) -> None:
    result = lensforge("design", write_spec(tmp_path, **replace), "--out", tmp_path / "out")
    assert result.code == 2
    assert message in result.stderr
    assert result.stderr.startswith("lensforge: ")
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ["design", "nowhere.toml"],
        ["design"],
        ["design", "nowhere.toml", "--accuracy", "perfect"],
        ["evaluate", "nowhere"],
        ["export", "nowhere"],
        ["check", "nowhere"],
        ["verify", "nowhere"],
        ["rays", "nowhere.ray"],
        ["fly"],
    ],
)
def test_bad_commands_end_in_one_line(arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = lensforge(*arguments)
    assert result.code == 2
    assert len(result.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_process_ends_in_one_line_too(tmp_path: Path) -> None:
    """Nothing that is loaded on the way says more."""
    for bad in (["design", "nowhere.toml"], ["design", write_spec(tmp_path, **{"[lens]": "[lense]"})]):
        command = [sys.executable, "-m", "lensforge", *map(str, bad)]
        result = subprocess.run(command, capture_output=True, encoding="utf-8", cwd=tmp_path, check=False)
        assert result.returncode == 2 and result.stdout == ""
        assert result.stderr.startswith("lensforge: ") and len(result.stderr.splitlines()) == 1


def test_rays_describes_and_converts(examples: Path, tmp_path: Path) -> None:
    runner = CliRunner()
    described = runner.invoke(cli, ["rays", str(examples / "led.tm25ray"), "--json"])
    assert described.exit_code == 0
    assert json.loads(described.stdout)["rays"] == 20_000
    converted = runner.invoke(cli, ["rays", str(examples / "led.tm25ray"), "--to", str(tmp_path / "led.csv")])
    assert converted.exit_code == 0
    again = runner.invoke(cli, ["rays", str(tmp_path / "led.csv"), "--json"])
    assert json.loads(again.stdout)["format"] == "csv"
    header = runner.invoke(cli, ["rays", str(examples / "led.tm25ray"), "--json", "--header"])
    assert json.loads(header.stdout)["flux"]["header_w"] == 1.0


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_is_not_there_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    spec = write_spec(tmp_path)
    done = lensforge("design", spec, "--device", "cuda", "--out", tmp_path / "out")
    assert done.code == 2
    (line,) = done.stderr.splitlines()
    assert "device = 'cuda'" in line and "allowed here: cpu" in line and "CUDA build of torch" in line
    assert list(tmp_path.iterdir()) == [spec]
