"""Exit codes by the verdict, and the verdict that every command renews, on a lens whose search was too short."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from addon_rows import addon_rows
from in_this_process import lensforge
from nightly import first_by_day
from presets import FEW
from scenes import small_spec
from undrawn import undrawn

import lensforge as lf
from lensforge.results.arguments import threads_of_torch
from lensforge.spec import FlatTopTarget
from lensforge.spec.accuracy import PRESETS, Preset

TARGET = FlatTopTarget(width_mm=40.0, distance_mm=100.0, receiver_mm=200.0)


def verdict_in(folder: Path) -> dict[str, str]:
    """The states in ``run.json``, which must be those of the results in the folder."""
    stored = json.loads((folder / "run.json").read_text(encoding="utf-8"))["verdict"]
    assert stored == lf.load(folder).verdict.model_dump(mode="json")
    return {name: stored[name] for name in ("light", "files", "cutting")}


@pytest.fixture(scope="module")
def dark(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, int, str]]:
    """A design of one step for each level, which spreads its light far beyond the target: folder, exit code, stderr."""
    folder = tmp_path_factory.mktemp("dark")
    small_spec(optimise={"steps_per_level": [1, 1], "rays": 1024, "pixels": 16}).replace(target=TARGET).save(
        folder / "dark.toml"
    )
    few = {**vars(FEW), "name": "draft", "photometry_rays": (2**14, 2**14), "verify_rays": 2**11}
    with undrawn(), threads_of_torch(1), pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "draft", Preset.model_construct(**few))  # the command line takes no other
        code, _, stderr = lensforge("design", folder / "dark.toml", "--accuracy", "draft", "--out", folder / "out")
        yield folder / "out", code, stderr


@pytest.fixture
def folder(dark: tuple[Path, int, str], tmp_path: Path) -> Path:
    """A copy of that result folder."""
    return Path(shutil.copytree(dark[0], tmp_path / "copy"))


def test_a_design_whose_light_fails_writes_everything_and_exits_with_1(dark: tuple[Path, int, str]) -> None:
    folder, code, stderr = dark
    assert code == 1
    assert "Photometry: Pattern error (NMSE) = " in stderr.splitlines()[-1] and "Light in the target = " in stderr
    assert "Traceback" not in stderr
    for name in ("lens.json", "lens.step", "lens.stl", "report.html", "run.json", "verify.json"):
        assert (folder / name).stat().st_size > 500, name
    assert verdict_in(folder) == {"light": "fail", "files": "pass", "cutting": "fail"}


COMMANDS = [
    (("evaluate",), 1),
    (("evaluate", "--rays", 2048), 0),  # at other than nominal conditions: no verdict
    (("check",), 0),
    (("handover",), 0),
    (("sensitivity", "--rays", 1024), 0),
    (("export",), 0),
    (("verify",), 0),
    (("report",), 0),
    (("photometry", "--rays", 4096), 0),
    *addon_rows("EXIT_CODES").items(),
]


@pytest.mark.parametrize(("command", "code"), first_by_day(2, COMMANDS, "five to twenty seconds each"))
def test_every_command_renews_the_verdict_and_exits_by_what_it_decides(
    folder: Path, command: tuple[object, ...] | Callable[[Path], tuple[object, ...]], code: int
) -> None:
    command = command(folder) if callable(command) else command
    if command[0] != "report":
        (folder / "report.html").unlink()  # building it again would renew the verdict by itself
    (folder / "run.json").unlink()
    name, *options = command
    status, _, stderr = lensforge(name, folder, *options)
    assert status == code, stderr
    assert verdict_in(folder)["light"] == "fail"
    assert verdict_in(folder)["files"] in ("pass", "undecided")


@pytest.mark.usefixtures("undrawn")
def test_a_part_that_cannot_be_cut_exits_with_1_only_where_the_spec_requires_it(folder: Path) -> None:
    record = json.loads((folder / "lens.json").read_text(encoding="utf-8"))
    record["spec"]["manufacture"] = {"required": True, "cutter_radius_mm": 5.0}  # more than the cavity has
    del record["content_sha256"]  # of the lens as it was
    (folder / "lens.json").write_text(json.dumps(record), encoding="utf-8")
    code, _, stderr = lensforge("check", folder)  # 0 in the spec as it was, see above
    assert code == 1 and "Manufacture: " in stderr
    assert verdict_in(folder)["cutting"] == "fail"


@pytest.mark.usefixtures("undrawn")
def test_files_that_fail_exit_with_1(folder: Path) -> None:
    code, _, stderr = lensforge("export", folder, "--nodes", 18, "--form-nm", 0.1)  # of splines far off their faces
    assert code == 1 and "form_error = " in stderr.splitlines()[-1], stderr
    assert verdict_in(folder)["files"] == "fail"
