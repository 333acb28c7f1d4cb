"""The command line as a user meets it: a process, its exit code, one line for every mistake."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from in_this_process import lensforge
from made_once import copied
from scenes import small_spec

import lensforge as lf
from lensforge.search.checkpoint import CHECKPOINT

LEVELS = "levels = [\n    9,\n    25,\n]"


def write_spec(folder: Path, **replace: str) -> Path:
    text = small_spec(lens__symmetry="auto").to_toml()
    for old, new in replace.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "small.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_design_leaves_every_file(small_run: lf.Run) -> None:
    designed = small_run.folder
    for name in ("lens.json", "lens.step", "lens.stl", "report.html"):
        assert (designed / name).stat().st_size > 1000
    for name in ("design", "export", "check", "verify"):
        content = json.loads((designed / f"{name}.json").read_text(encoding="utf-8"))
        assert [criterion["name"] for criterion in content["criteria"] if not criterion["passed"]] == [], name
    verdict = json.loads((designed / "run.json").read_text(encoding="utf-8"))["verdict"]
    assert (verdict["light"], verdict["files"]) == (small_run.verdict.light, "pass")
    assert verdict["cutting"] == "fail" and verdict["reasons"]["cutting"], "said, but no failure of the run"
    assert not list(designed.glob(".lensforge-writing-*")) and not (designed / CHECKPOINT).exists()


@pytest.mark.usefixtures("undrawn")
def test_single_stages_run_again(small_run: lf.Run, tmp_path: Path) -> None:
    folder = tmp_path / "again"
    copied(small_run.folder, folder)
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
    assert lensforge("check", folder).code == 0
    assert not (folder / "report.html").exists()
    assert lensforge("evaluate", folder, "--source", folder / "lens.stl").code == 2


def test_a_search_goes_on_from_its_checkpoint_only_with_resume(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, given = tmp_path / "out", []

    def run(_spec: lf.Spec, _folder: Path, *, checkpoint: Path | None, **_options: object) -> lf.Run:
        given.append(checkpoint)
        raise lf.InputError("it has begun")

    monkeypatch.setattr("lensforge.report.pipeline.run", run)
    command = ("design", write_spec(tmp_path), "--out", folder)
    assert "no checkpoint to resume from" in lensforge(*command, "--resume").stderr
    folder.mkdir()
    (folder / CHECKPOINT).touch()
    for resume in ((), ("--resume",)):
        assert "it has begun" in lensforge(*command, *resume).stderr
    assert given == [None, folder / CHECKPOINT]


@pytest.mark.parametrize(
    ("replace", "message"),
    [
        ({"min_thickness_mm = 1.0": "min_thickness_mm = -0.1"}, "constraints.min_thickness_mm = -0.1"),
        ({'kind = "flat_top"': 'kind = "fancy"'}, "target"),
        ({"width_mm = 160.0": "width_mm = nan"}, "width_mm"),
        ({LEVELS: "levels = []"}, "levels"),
        ({LEVELS: "levels = [9, 25"}, "a list is [value, value]; write levels = [9, 25]"),
        ({"[lens]": "[lense]"}, "lens"),
        ({"offset_mm = 6.0": "offset_mm = 2.0"}, "lens: outer.offset_mm = 2.0 must exceed"),
        ({"rays = 1024": "rays = 1e9"}, "optimise.rays"),
        ({"cavity_height_mm = 0.5": "cavity_height_mm = 9.0"}, "cavity_height_mm = 9 and min_thickness_mm = 1 do not"),
        ({"distance_mm = 100.0": "distance_mm = 1e5"}, "étendue"),
        ({"[source]": "[source]\nposition_mm = [9.0, 0.0, 0.0]"}, "source: "),
        ({"diameter_mm = 16.0": "diameter_mm = 1.5"}, "base.diameter_mm = 1.5"),
    ],
)
def test_bad_specs_end_in_one_line_before_anything_is_written(
    tmp_path: Path, replace: dict[str, str], message: str
) -> None:
    result = lensforge("design", write_spec(tmp_path, **replace), "--out", tmp_path / "out")
    line, *beneath = result.stderr.splitlines()
    assert result.code == 2 and line.startswith("lensforge: ") and message in line
    assert all(detail.startswith("  ") for detail in beneath), "the place of a slip"
    assert not (tmp_path / "out" / "lens.json").exists()


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


def test_a_file_is_no_result_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A spec in place of its folder, to read from or to write into: what it is, and what is wanted."""
    monkeypatch.chdir(tmp_path)
    write_spec(tmp_path).rename("m4.toml")
    for arguments in (["report", "m4.toml"], ["check", "m4.toml"], ["design", "m4.toml", "--out", "m4.toml"]):
        result = lensforge(*arguments)
        assert result.code == 2
        assert result.stderr.endswith(
            "m4.toml: a file, must be a result folder, such as cad_out/NAME that `lensforge design` wrote\n"
        )


def test_a_process_ends_in_one_line_too(tmp_path: Path) -> None:
    """Nothing that is loaded on the way says more."""
    command = [sys.executable, "-m", "lensforge", "design", write_spec(tmp_path, **{"[lens]": "[lense]"})]
    result = subprocess.run(command, capture_output=True, encoding="utf-8", cwd=tmp_path, check=False)
    assert result.returncode == 2 and result.stdout == ""
    assert result.stderr.startswith("lensforge: ") and len(result.stderr.splitlines()) == 1


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_is_not_there_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    spec = write_spec(tmp_path)
    done = lensforge("design", spec, "--device", "cuda", "--out", tmp_path / "out")
    assert done.code == 2
    (line,) = done.stderr.splitlines()
    assert "device = 'cuda'" in line and "allowed here: cpu" in line and "CUDA build of torch" in line
    assert list(tmp_path.iterdir()) == [spec]
