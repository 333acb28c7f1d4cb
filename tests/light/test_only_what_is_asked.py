"""A command loads what its scene asks for, and nothing else: seen in the modules of the process when it is done."""

import subprocess
import sys
from pathlib import Path

import pytest
from nightly import NIGHTLY
from scenes import random_surface, small_spec

from lensforge.scene.lens import Lens

CAD = ["cadquery", "OCP", "trimesh", "manifold3d", "lib3mf"]
PICTURES = ["pyvista", "matplotlib", "mitsuba"]
COLOUR = ["colour"]  # colour-science
SOURCES = ["lensforge.sources.ray_set", "lensforge.sources.rayfiles.ray_file_io"]
PROOFS = ["scipy.stats", "lensforge.proof.step_cast", "lensforge.proof.nonsequential_trace", "lensforge.cad.solid"]


def _loaded(*commands: tuple[list[str], list[str]]) -> list[str]:
    """Modules of the list that are loaded after a command; commands follow one another in one process."""
    code = "import sys; from lensforge.cli.cli import cli\n" + "".join(
        f"cli.main({arguments!r}, prog_name='lensforge', standalone_mode=False)\n"
        f"print('loaded:', [name for name in {names!r} if name in sys.modules])\n"
        for arguments, names in commands
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    lines = done.stdout.splitlines()
    return [line.removeprefix("loaded: ") for line in lines if line.startswith("loaded: ")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("asked")
    inner, outer = (random_surface(k, 3.0 * k, 0.01, (9, 25)) for k in (1, 2))
    Lens.double(inner, outer, small_spec(base={"kind": "none"}), 0, "draft").save(path / "lens.json")
    return path


def test_help_loads_nothing_and_a_plain_scene_no_file_reader_no_cad_and_no_pictures(folder: Path) -> None:
    evaluate = (["evaluate", str(folder), "--rays", "64"], ["scipy.stats", *COLOUR, *CAD, *PICTURES, *SOURCES, *PROOFS])
    check = (["check", str(folder)], ["cadquery", "OCP", *PICTURES, *SOURCES])
    shown = (["design", "--help"], [*COLOUR, *CAD, *PICTURES, *SOURCES, *PROOFS, "torch", "scipy", "numba"])
    commands = (shown, evaluate, check) if NIGHTLY else (shown, evaluate)  # by day the check's own test: five seconds
    assert _loaded(*commands) == ["[]"] * len(commands)
