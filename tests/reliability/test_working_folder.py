"""No command runs, imports or obeys a file of the folder that it is started in, which somebody else may have sent."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from nightly import first_by_day
from scenes import hemisphere_directions, small_spec

import lensforge as lf

# Modules of the standard library and of others, of which every command loads some, and each child process others.
PLANTED = (
    "OCP", "PIL", "_manifold", "cadquery", "casadi", "click", "concurrent", "copy", "csv", "ctypes", "decimal", "heapq",
    "http", "inspect", "jaxtyping", "jinja2", "json", "lensforge", "lib3mf", "llvmlite", "logging", "manifold3d",
    "matplotlib", "mitsuba", "multiprocessing", "numba", "numpy", "pickle", "platform", "pydantic", "pyvista", "random",
    "rich", "rtree", "runpy", "scipy", "shutil", "sitecustomize", "skimage", "statistics", "subprocess", "sympy",
    "tempfile", "tomllib", "torch", "trame", "trimesh", "usercustomize", "uuid", "vtk", "vtkmodules", "yaml", "zipfile",
)  # fmt: skip
_CODE = "import pathlib\npathlib.Path({marker!r}).touch()\n"


def plant(folder: Path, marker: Path) -> None:
    """Files in ``folder`` that write ``marker`` when they are imported, and settings that libraries would obey."""
    for name in PLANTED:
        (folder / f"{name}.py").write_text(_CODE.format(marker=str(marker)), encoding="utf-8")
    # Settings by which numba compiles nothing, and matplotlib draws by a module of this folder and with other fonts.
    (folder / ".numba_config.yaml").write_text("disable_jit: 1\ndeveloper_mode: 1\n", encoding="utf-8")
    (folder / "matplotlibrc").write_text("backend: module://pyvista\nfont.size: 37\n", encoding="utf-8")


def program() -> str:
    """The installed program, beside the interpreter."""
    found = shutil.which("lensforge", path=str(Path(sys.executable).parent))
    assert found is not None
    return found


def planted_run(run: lf.Run, tmp_path: Path) -> tuple[Path, Path]:
    """A copy of a result folder in which such files are planted, and what else commands read; and the marker."""
    folder, marker = tmp_path / "received", tmp_path / "ran"
    shutil.copytree(run.folder, folder)
    plant(folder, marker)
    small_spec(optimise={"steps_per_level": [1, 1], "rays": 1024, "pixels": 16}).save(folder / "own.toml")
    directions = hemisphere_directions(800)
    np.savetxt(folder / "points.csv", run.lens.outer.radius(directions)[:, None] * directions, delimiter=",")
    shutil.copy(Path(__file__).parents[2] / "examples" / "led.tm25ray", folder / "led.tm25ray")
    return folder, marker


# The renderer is a child process; those of the cast and of a STEP file's reader start nightly.
COMMANDS = [
    ("report", "."),
    ("rays", "led.tm25ray", "--plot", "led.png"),
    ("design", "own.toml", "--accuracy", "draft", "--out", "out"),
    ("evaluate", ".", "--rays", "1024"),
    ("export", "."),
    ("check", "."),
    ("verify", ".", "--rays", "256", "--stray"),
    ("handover", "."),
    ("photometry", ".", "--rays", "4096"),
    ("compare", ".", "--points", "points.csv", "--surface", "outer"),
    ("sensitivity", ".", "--rays", "1024"),
    ("sweep", "own.toml", "--vary", "source.side_mm=0.9,1.0", "--accuracy", "draft", "--out", "swept"),
    ("tradeoff", "own.toml", "--out", "traded"),
    ("report", ".", "../other", "--out", "both.html"),
]


@pytest.mark.parametrize(
    "command", first_by_day(1, [(command,) for command in COMMANDS], "ten seconds each"), ids=" ".join
)
def test_no_command_runs_code_of_the_folder_that_it_is_started_in(
    command: tuple[str, ...], small_run: lf.Run, tmp_path: Path
) -> None:
    folder, marker = planted_run(small_run, tmp_path)
    if "../other" in command:
        shutil.copytree(small_run.folder, tmp_path / "other")
    done = subprocess.run([program(), *command], cwd=folder, capture_output=True, encoding="utf-8", timeout=900)
    assert done.returncode in (0, 1), done.stderr
    assert "Traceback" not in done.stderr and "internal error" not in done.stderr
    assert not marker.exists()


_SETTINGS = """
import sys
from lensforge.results.working_folder import ignore_settings_in_working_folder
ignore_settings_in_working_folder()
import matplotlib, numba, os
from numba.core import config
first = config.DISABLE_JIT
config.reload_config()
print(matplotlib.rcParams["font.size"], first, config.DISABLE_JIT, os.getcwd() == sys.argv[1], matplotlib.__loader__)
"""


def test_settings_in_the_working_folder_are_ignored(tmp_path: Path) -> None:
    plant(tmp_path, tmp_path / "ran")
    done = subprocess.run(
        [sys.executable, "-P", "-c", _SETTINGS, str(tmp_path.resolve())],
        cwd=tmp_path, capture_output=True, encoding="utf-8",
    )  # fmt: skip
    assert done.stdout.startswith("10.0 0 0 True <_frozen_importlib_external.SourceFileLoader"), done
    assert not (tmp_path / "ran").exists()


def test_the_module_searches_the_working_folder_last(tmp_path: Path) -> None:
    """Python itself searches it first for ``-m``; with -P it does not search it at all."""
    (tmp_path / "click.py").write_text(_CODE.format(marker=str(tmp_path / "ran")), encoding="utf-8")
    for safe in ((), ("-P",)):
        command = [sys.executable, *safe, "-m", "lensforge", "--version"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, encoding="utf-8")
        assert done.stdout.strip() == lf.__version__ if hasattr(lf, "__version__") else done.returncode == 0, done
        assert not (tmp_path / "ran").exists()
